"""PL-NeRF: photos of a power transmission line to a neural radiance field, and what a line engineer
needs of it.
"""

__version__ = "0.1.0"
