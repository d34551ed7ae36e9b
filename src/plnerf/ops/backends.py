"""The names of the backends (`dispatch.py`)."""

from typing import Literal

Backend = Literal["torch", "numba", "triton"]
BackendChoice = Literal["auto", "torch", "numba", "triton"]
