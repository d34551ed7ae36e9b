"""Elementary functions that LLVM vectorises inside Numba kernels, in the type of their argument.

Numba calls the C library for exp, sin and cos, one number at a time: 5 to 10 ns each, more than all else a
ray costs.  In float32 these are short polynomials without a branch; in float64 the C library's functions
stay.

Letters: x = n q + r with n the nearest integer, q the period of the reduction (log 2 or pi/2), |r| <= q/2.
Adding and subtracting 1.5 * 2^23 rounds to the nearest integer and leaves its bits in the mantissa; NaN stays
NaN on every path.  Accuracies are those of the tests.

What Numba compiles is marked no_type_check: a wrapper that checks annotations cannot be compiled.
"""

import math
from typing import Any, no_type_check

import numpy as np
from numba import types
from numba.extending import overload

from plnerf.ops.cpu_arrays import FAST
from plnerf.ops.kernel_cache import INNER

_OPTIONS = INNER | {"forceinline": True, "fastmath": FAST, "error_model": "numpy"}
_f32 = np.float32
_ROUND = _f32(12582912.0)  # 1.5 * 2^23
_LOG2_E = _f32(math.log2(math.e))
_LOG_2_HIGH = _f32(0.693359375)  # nine bits: n times it is exact
_LOG_2_LOW = _f32(-2.12194440e-4)
_LAST_EXPONENT = _f32(87.0)  # exp(-87) = 1.6e-38 is still a normal number
_TINY = _f32(np.finfo(np.float32).tiny)
_ROOT_HALF_BITS = np.int32(0x3F3504F3)  # of sqrt(1/2)
_2_OVER_PI = _f32(2 / math.pi)
# pi/2 in three parts of few bits.  Cephes, sinf.
_HALF_PI = (_f32(1.5703125), _f32(4.8375129699707031e-4), _f32(7.549789948768648e-8))


@no_type_check
def exp_and_expm1_neg(x: Any) -> Any:
    """(exp(-x), -expm1(-x)) for x >= 0, both within 1.5e-7 relatively; beyond x = 87 exactly (0, 1)."""
    raise NotImplementedError("for use inside of Numba kernels")


@no_type_check
def _exp_and_expm1_neg32(x):
    one = _f32(1)
    y = _LAST_EXPONENT if x > _LAST_EXPONENT else x
    rounded = y * -_LOG2_E + _ROUND
    n = rounded - _ROUND
    r = (-y - n * _LOG_2_HIGH) - n * _LOG_2_LOW
    p = _f32(1 / 5040) * r + _f32(1 / 720)
    p = p * r + _f32(1 / 120)
    p = p * r + _f32(1 / 24)
    p = p * r + _f32(1 / 6)
    p = p * r + _f32(0.5)
    p = p * r * r + r  # exp(r) - 1
    scale = np.int32((_f32(rounded).view(np.int32) + np.int32(127)) << np.int32(23)).view(np.float32)  # 2^n
    exp_neg = scale + scale * p
    alpha = (one - scale) - scale * p
    return (_f32(0) if x > _LAST_EXPONENT else exp_neg), (one if x > _LAST_EXPONENT else alpha)


@overload(exp_and_expm1_neg, jit_options=_OPTIONS)
@no_type_check
def _exp_and_expm1_neg(x):
    if x == types.float32:
        return _exp_and_expm1_neg32
    return lambda x: (math.exp(-x), -math.expm1(-x))


@no_type_check
def sin_cos(x: Any) -> Any:
    """(sin x, cos x), both within 2e-7, for |x| <= 8192 in float32."""
    raise NotImplementedError("for use inside of Numba kernels")


@no_type_check
def _sin_cos32(x):
    rounded = x * _2_OVER_PI + _ROUND
    n = rounded - _ROUND
    quarter = _f32(rounded).view(np.int32)
    r = ((x - n * _HALF_PI[0]) - n * _HALF_PI[1]) - n * _HALF_PI[2]
    z = r * r
    s = ((_f32(-1.9515295891e-4) * z + _f32(8.3321608736e-3)) * z + _f32(-1.6666654611e-1)) * z * r + r
    c = (_f32(2.443315711809948e-5) * z + _f32(-1.388731625493765e-3)) * z + _f32(4.166664568298827e-2)
    c = c * z * z + (_f32(1) - _f32(0.5) * z)
    odd = (quarter & np.int32(1)) != 0
    sine, cosine = (c if odd else s), (s if odd else c)
    sine = -sine if (quarter & np.int32(2)) != 0 else sine
    cosine = -cosine if ((quarter + np.int32(1)) & np.int32(2)) != 0 else cosine
    return sine, cosine


@overload(sin_cos, jit_options=_OPTIONS)
@no_type_check
def _sin_cos(x):
    if x == types.float32:
        return _sin_cos32
    return lambda x: (math.sin(x), math.cos(x))


@no_type_check
def power(x: Any, exponent: Any) -> Any:
    """x^exponent for 0 <= x <= 1 and 0 < exponent <= 1; in float32 within 1e-5 relatively, denormals too."""
    raise NotImplementedError("for use inside of Numba kernels")


@no_type_check
def _power32(x, exponent):
    small = x < _TINY
    scaled = x * _f32(16777216.0) if small else x
    bits = _f32(scaled).view(np.int32)
    e = np.int32((bits - _ROOT_HALF_BITS) >> np.int32(23))
    f = np.int32(bits - (e << np.int32(23))).view(np.float32) - _f32(1)  # x = 2^e (1 + f)
    p = _f32(7.0376836292e-2) * f + _f32(-1.1514610310e-1)  # Cephes, logf
    p = p * f + _f32(1.1676998740e-1)
    p = p * f + _f32(-1.2420140846e-1)
    p = p * f + _f32(1.4249322787e-1)
    p = p * f + _f32(-1.6668057665e-1)
    p = p * f + _f32(2.0000714765e-1)
    p = p * f + _f32(-2.4999993993e-1)
    p = p * f + _f32(3.3333331174e-1)
    octaves = _f32(e) - (_f32(24) if small else _f32(0))
    log = octaves * _LOG_2_LOW + (p * f * f * f - _f32(0.5) * f * f) + f + octaves * _LOG_2_HIGH
    raised, _ = exp_and_expm1_neg(-exponent * log)
    return _f32(0) if x == _f32(0) else raised


@overload(power, jit_options=_OPTIONS)
@no_type_check
def _power(x, exponent):
    if x == types.float32:
        return _power32
    return lambda x, exponent: x**exponent
