"""A hash grid's shape as kernels take it: numbers in one array."""

from functools import cache

import numpy as np
from jaxtyping import Int64

from plnerf.ops.grid import GridShape


@cache
def grid_layout(shape: GridShape) -> Int64[np.ndarray, "L 4"]:
    """For each level: cells along an axis, first row, 1 if dense, hash mask (T - 1)."""
    mask = (1 << shape.log2_table) - 1
    rows = zip(shape.resolutions, shape.starts, shape.dense, strict=True)
    return np.array([(n, start, int(dense), mask) for n, start, dense in rows], dtype=np.int64)
