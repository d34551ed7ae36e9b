"""Triton kernels of the hash encoding.  Each program works on one block of points at one level.

Programs of one level run one after another, so that a level's part of the table stays in the GPU's cache.
Arithmetic is done in the type of the points; a table of float16 or bfloat16 is widened as it is read.

Letters: L levels, F features, F_UP the power of two from F on; n the cells an axis; i, j, k a cell and u, v,
w the fraction of it along x, y and z, then the weights of its upper vertices, with d their slopes s'(u) n and
dd their curvatures s''(u) n^2.  A corner's number has a bit for each axis.  `layout` is `grid_layout`'s.

What Triton compiles is marked no_type_check: a wrapper that checks annotations cannot be compiled.
"""

from typing import no_type_check

import triton
import triton.language as tl

from plnerf.ops.grid import HASH_PRIMES

_PRIME_Y, _PRIME_Z = tl.constexpr(HASH_PRIMES[1]), tl.constexpr(HASH_PRIMES[2])


@triton.jit
@no_type_check
def _points(points, BLOCK: tl.constexpr):
    """The points of this program, and which of them there are."""
    p = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    return p, p < points


@triton.jit
@no_type_check
def _level(layout):
    """Cells an axis, first row, whether dense, hash mask, and how far apart rows of neighbours lie."""
    at = layout + tl.program_id(1) * 4
    n, start, dense, mask = tl.load(at), tl.load(at + 1), tl.load(at + 2), tl.load(at + 3)
    step_y = tl.where(dense != 0, n + 1, _PRIME_Y).to(tl.uint32)
    step_z = tl.where(dense != 0, (n + 1) * (n + 1), _PRIME_Z).to(tl.uint32)
    return n, start, dense != 0, mask.to(tl.uint32), step_y, step_z


@triton.jit
@no_type_check
def _locate(at, there, n):
    """Cell of a coordinate and the fraction within it; a NaN lands in cell 0."""
    value = tl.load(at, mask=there, other=0.0)
    scaled = value * n.to(value.dtype)
    cell = tl.minimum(tl.floor(tl.where(scaled > 0, scaled, 0.0)), n.to(value.dtype) - 1)
    return cell.to(tl.int32).to(tl.uint32), scaled - cell


@triton.jit
@no_type_check
def _weight(u, CUBIC: tl.constexpr):
    return u * u * (3 - 2 * u) if CUBIC else u


@triton.jit
@no_type_check
def _slope(u, n, CUBIC: tl.constexpr):
    return 6 * u * (1 - u) * n.to(u.dtype) if CUBIC else tl.zeros_like(u) + n.to(u.dtype)


@triton.jit
@no_type_check
def _curvature(u, n, CUBIC: tl.constexpr):
    return (6 - 12 * u) * n.to(u.dtype) * n.to(u.dtype) if CUBIC else tl.zeros_like(u)


@triton.jit
@no_type_check
def _row(cx, cy, cz, start, dense, mask):
    """Row of a vertex whose coordinates were multiplied by the steps of their axes; uint32 wraps around."""
    return start + tl.where(dense, cx + cy + cz, (cx ^ cy ^ cz) & mask).to(tl.int64)


@triton.jit
@no_type_check
def encode(  # noqa: PLR0913 (a kernel's arrays, one by one)
    layout, x, table, out, points,
    L: tl.constexpr, F: tl.constexpr, F_UP: tl.constexpr, CUBIC: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """out[p, l F + f] = sum over corners of share times table[row, f]."""
    p, there = _points(points, BLOCK)
    f = tl.arange(0, F_UP)
    each = there[:, None] & (f < F)[None, :]
    n, start, dense, mask, step_y, step_z = _level(layout)
    i, u = _locate(x + p * 3, there, n)
    j, v = _locate(x + p * 3 + 1, there, n)
    k, w = _locate(x + p * 3 + 2, there, n)
    j, k = j * step_y, k * step_z
    u, v, w = _weight(u, CUBIC), _weight(v, CUBIC), _weight(w, CUBIC)
    total = tl.zeros([BLOCK, F_UP], dtype=u.dtype)
    for corner in tl.static_range(8):
        share = (u if corner & 1 else 1 - u) * (v if corner & 2 else 1 - v) * (w if corner & 4 else 1 - w)
        row = _row(
            i + 1 if corner & 1 else i, j + step_y if corner & 2 else j, k + step_z if corner & 4 else k,
            start, dense, mask,
        )  # fmt: skip
        value = tl.load(table + row[:, None] * F + f[None, :], mask=each, other=0.0)
        total += share[:, None] * value.to(u.dtype)
    tl.store(out + p[:, None] * (L * F) + tl.program_id(1) * F + f[None, :], total, mask=each)


@triton.jit
@no_type_check
def _runs(x, p, points, n, i, j, k, BLOCK: tl.constexpr):
    """Where a run of points of one cell starts, and where it ends, within the block of this program."""
    at = tl.arange(0, BLOCK)
    before, after = at > 0, (at < BLOCK - 1) & (p + 1 < points)
    i0, _ = _locate(x + p * 3 - 3, before, n)
    j0, _ = _locate(x + p * 3 - 2, before, n)
    k0, _ = _locate(x + p * 3 - 1, before, n)
    i1, _ = _locate(x + p * 3 + 3, after, n)
    j1, _ = _locate(x + p * 3 + 4, after, n)
    k1, _ = _locate(x + p * 3 + 5, after, n)
    starts = (i0 != i) | (j0 != j) | (k0 != k) | (at == 0)
    ends = (i1 != i) | (j1 != j) | (k1 != k) | (after == 0)
    return starts, ends


@triton.jit
@no_type_check
def _joined(left, left_starts, right, right_starts):
    """Sums of two neighbouring stretches: a run that starts in the right one takes nothing from the left."""
    return tl.where(right_starts != 0, right, left + right), left_starts | right_starts


@triton.jit
@no_type_check
def table_gradient(  # noqa: PLR0913 (a kernel's arrays, one by one)
    layout, x, g_out, g_table, points,
    L: tl.constexpr, F: tl.constexpr, F_UP: tl.constexpr, CUBIC: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """g_table[row, f] += share times g_out[p, l F + f], for every corner.

    Points come ray by ray, so that neighbours often lie in one cell: each run of them is summed up first,
    and added to the table once.  Atomic additions are what this kernel takes its time for.
    """
    p, there = _points(points, BLOCK)
    f = tl.arange(0, F_UP)
    each = there[:, None] & (f < F)[None, :]
    n, start, dense, mask, step_y, step_z = _level(layout)
    i, u = _locate(x + p * 3, there, n)
    j, v = _locate(x + p * 3 + 1, there, n)
    k, w = _locate(x + p * 3 + 2, there, n)
    starts, ends = _runs(x, p, points, n, i, j, k, BLOCK)
    starts = tl.broadcast_to(starts.to(tl.int32)[:, None], [BLOCK, F_UP])
    j, k = j * step_y, k * step_z
    u, v, w = _weight(u, CUBIC), _weight(v, CUBIC), _weight(w, CUBIC)
    g = tl.load(g_out + p[:, None] * (L * F) + tl.program_id(1) * F + f[None, :], mask=each, other=0.0)
    g = g.to(u.dtype)
    for corner in tl.static_range(8):
        share = (u if corner & 1 else 1 - u) * (v if corner & 2 else 1 - v) * (w if corner & 4 else 1 - w)
        row = _row(
            i + 1 if corner & 1 else i, j + step_y if corner & 2 else j, k + step_z if corner & 4 else k,
            start, dense, mask,
        )  # fmt: skip
        total, _ = tl.associative_scan((share[:, None] * g, starts), 0, _joined)
        total = total.to(g_table.dtype.element_ty)
        at = g_table + row[:, None] * F + f[None, :]
        tl.atomic_add(at, total, mask=each & ends[:, None], sem="relaxed")


@triton.jit
@no_type_check
def position_gradient(  # noqa: PLR0913 (a kernel's arrays, one by one)
    layout, x, g_out, table, parts_x, points,
    L: tl.constexpr, F: tl.constexpr, F_UP: tl.constexpr, CUBIC: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """parts_x[l, p, :] = gradient by x of <g_out, out> of one level; the caller adds the levels up."""
    p, there = _points(points, BLOCK)
    f = tl.arange(0, F_UP)
    each = there[:, None] & (f < F)[None, :]
    n, start, dense, mask, step_y, step_z = _level(layout)
    i, u = _locate(x + p * 3, there, n)
    j, v = _locate(x + p * 3 + 1, there, n)
    k, w = _locate(x + p * 3 + 2, there, n)
    j, k = j * step_y, k * step_z
    du, dv, dw = _slope(u, n, CUBIC), _slope(v, n, CUBIC), _slope(w, n, CUBIC)
    u, v, w = _weight(u, CUBIC), _weight(v, CUBIC), _weight(w, CUBIC)
    g = tl.load(g_out + p[:, None] * (L * F) + tl.program_id(1) * F + f[None, :], mask=each, other=0.0)
    g = g.to(u.dtype)
    gx, gy, gz = tl.zeros_like(u), tl.zeros_like(u), tl.zeros_like(u)
    for corner in tl.static_range(8):
        row = _row(
            i + 1 if corner & 1 else i, j + step_y if corner & 2 else j, k + step_z if corner & 4 else k,
            start, dense, mask,
        )  # fmt: skip
        entry = tl.load(table + row[:, None] * F + f[None, :], mask=each, other=0.0)
        value = tl.sum(g * entry.to(u.dtype), axis=1)
        pu, pv, pw = u if corner & 1 else 1 - u, v if corner & 2 else 1 - v, w if corner & 4 else 1 - w
        gx += value * (du if corner & 1 else -du) * pv * pw
        gy += value * pu * (dv if corner & 2 else -dv) * pw
        gz += value * pu * pv * (dw if corner & 4 else -dw)
    at = parts_x + (tl.program_id(1) * points + p) * 3
    tl.store(at, gx, mask=there)
    tl.store(at + 1, gy, mask=there)
    tl.store(at + 2, gz, mask=there)


@triton.jit
@no_type_check
def position_gradient_backward(  # noqa: PLR0913 (a kernel's arrays, one by one)
    layout, x, g_out, table, q, parts_x, g_g_out, g_table, points,
    L: tl.constexpr, F: tl.constexpr, F_UP: tl.constexpr, CUBIC: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Gradients of <q, position gradient> by x (parts_x, as above), g_out and table.

    With m_c = sum_i q_i d(share_c)/dx_i the scalar to differentiate is sum_c m_c <g_out, table_c>.
    """
    p, there = _points(points, BLOCK)
    f = tl.arange(0, F_UP)
    each = there[:, None] & (f < F)[None, :]
    n, start, dense, mask, step_y, step_z = _level(layout)
    i, u = _locate(x + p * 3, there, n)
    j, v = _locate(x + p * 3 + 1, there, n)
    k, w = _locate(x + p * 3 + 2, there, n)
    j, k = j * step_y, k * step_z
    q0 = tl.load(q + p * 3, mask=there, other=0.0).to(u.dtype)
    q1 = tl.load(q + p * 3 + 1, mask=there, other=0.0).to(u.dtype)
    q2 = tl.load(q + p * 3 + 2, mask=there, other=0.0).to(u.dtype)
    du, dv, dw = _slope(u, n, CUBIC), _slope(v, n, CUBIC), _slope(w, n, CUBIC)
    ddu, ddv, ddw = _curvature(u, n, CUBIC), _curvature(v, n, CUBIC), _curvature(w, n, CUBIC)
    u, v, w = _weight(u, CUBIC), _weight(v, CUBIC), _weight(w, CUBIC)
    columns = p[:, None] * (L * F) + tl.program_id(1) * F + f[None, :]
    g = tl.load(g_out + columns, mask=each, other=0.0).to(u.dtype)
    g_g = tl.zeros([BLOCK, F_UP], dtype=u.dtype)
    gx, gy, gz = tl.zeros_like(u), tl.zeros_like(u), tl.zeros_like(u)
    for corner in tl.static_range(8):
        row = _row(
            i + 1 if corner & 1 else i, j + step_y if corner & 2 else j, k + step_z if corner & 4 else k,
            start, dense, mask,
        )  # fmt: skip
        at = row[:, None] * F + f[None, :]
        entry = tl.load(table + at, mask=each, other=0.0).to(u.dtype)
        pu, pv, pw = u if corner & 1 else 1 - u, v if corner & 2 else 1 - v, w if corner & 4 else 1 - w
        su, sv, sw = du if corner & 1 else -du, dv if corner & 2 else -dv, dw if corner & 4 else -dw
        tu, tv, tw = ddu if corner & 1 else -ddu, ddv if corner & 2 else -ddv, ddw if corner & 4 else -ddw
        m = q0 * su * pv * pw + q1 * pu * sv * pw + q2 * pu * pv * sw
        value = tl.sum(g * entry, axis=1)
        g_g += m[:, None] * entry
        part = (m[:, None] * g).to(g_table.dtype.element_ty)
        tl.atomic_add(g_table + at, part, mask=each, sem="relaxed")
        gx += value * (q0 * tu * pv * pw + q1 * su * sv * pw + q2 * su * pv * sw)
        gy += value * (q0 * su * sv * pw + q1 * pu * tv * pw + q2 * pu * sv * sw)
        gz += value * (q0 * su * pv * sw + q1 * pu * sv * sw + q2 * pu * pv * tw)
    tl.store(g_g_out + columns, g_g, mask=each)
    at_x = parts_x + (tl.program_id(1) * points + p) * 3
    tl.store(at_x, gx, mask=there)
    tl.store(at_x + 1, gy, mask=there)
    tl.store(at_x + 2, gz, mask=there)
