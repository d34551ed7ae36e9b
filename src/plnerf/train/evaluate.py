"""Held-out images rendered and measured, with everything that somebody needs to repeat the numbers.

Writes into the run folder: eval/metrics.json, eval/summary.md, eval/panels/NAME.png.
"""



