"""The best of the curves that lie near each other."""

from typing import no_type_check

import numpy as np

from plnerf.detect.parabola import curve_point
from plnerf.ops.kernel_cache import njit


@njit(cache=True)
@no_type_check
def distinct_ones(curves, first, last, apart, most):
    """Numbers of the curves that are kept, no more than `most`: each lies `apart` from all before it.

    curves: (c, 6), best first; first, last: (c,), where what each shows begins and ends, 0 to 1.  Two are
    compared at both ends and in the middle of what the later one shows, across and up.
    """
    kept, y, z = np.empty(min(most, len(curves)), np.int64), np.empty(3), np.empty(3)
    count = 0
    for c in range(len(curves)):
        if count == most:
            break
        for i in range(3):
            y[i], z[i] = curve_point(curves[c], first[c] + 0.5 * i * (last[c] - first[c]))
        new = True
        for k in kept[:count]:
            near = True
            for i in range(3):
                y_k, z_k = curve_point(curves[k], first[c] + 0.5 * i * (last[c] - first[c]))
                near = near and max(abs(y_k - y[i]), abs(z_k - z[i])) < apart
            if near:
                new = False
                break
        if new:
            kept[count] = c
            count += 1
    return kept[:count]
