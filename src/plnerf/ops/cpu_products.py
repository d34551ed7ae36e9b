"""Small matrix products at the processor's speed inside of Numba kernels.

Numba turns a triple loop into vector code that goes through memory for every sum.  Here a tile of sums stays
in vector registers over the whole inner loop, which is what the libraries for matrix products do; they in
turn are called from outside of a kernel only, with all operands in memory.

All three products of a layer, on points p, inputs i and outputs o, are of one form, with other strides:
    forward        y[p, :]   += sum_i  x[p, i] w^T[i, :]
    backward       g_x[p, :] += sum_o  g[p, o] w[o, :]
    weights        g_w[o, :] += sum_p  g[p, o] x[p, :]
"""

from typing import no_type_check

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

_LANE = ir.IntType(32)
_FUSE = ("contract",)  # a product and the sum that takes it may be one fused multiply-add


@intrinsic(prefer_literal=True)
@no_type_check
def add_products(  # noqa: PLR0913 (three arrays, where to begin in each, and how to go on)
    typing, out, out_first, out_stride, s, s_first, s_stride, s_step, v, v_first, v_step, terms, tile, lanes
):
    """out[a, :] += sum_k s[a, k] v[k, :] for a < tile: rows of `lanes` numbers, k < terms.

    The arrays are flat and contiguous; out[a, :] begins at out_first + a out_stride, s[a, k] lies at
    s_first + a s_stride + k s_step, v[k, :] begins at v_first + k v_step.  tile and lanes are literals.
    Nothing is checked.
    """
    count, rows = lanes.literal_value, tile.literal_value

    def generate(context, builder, signature, arguments):
        real = context.get_value_type(signature.args[0].dtype)
        align = signature.args[0].dtype.bitwidth // 8
        vector = ir.VectorType(real, count)
        data = [context.make_array(signature.args[a])(context, builder, arguments[a]).data for a in (0, 3, 7)]
        out_first, out_stride, s_first, s_stride, s_step, v_first, v_step, terms = (
            arguments[a] for a in (1, 2, 4, 5, 6, 8, 9, 10)
        )

        def row(array, index):
            return builder.bitcast(builder.gep(array, [index]), vector.as_pointer())

        places = []
        for a in range(rows):
            index = builder.add(out_first, builder.mul(out_stride, ir.Constant(out_stride.type, a)))
            places.append(row(data[0], index))
        sums = [cgutils.alloca_once_value(builder, builder.load(place, align=align)) for place in places]
        with cgutils.for_range(builder, terms) as loop:
            k = loop.index
            term = builder.load(row(data[2], builder.add(v_first, builder.mul(k, v_step))), align=align)
            at = builder.add(s_first, builder.mul(k, s_step))
            for a in range(rows):
                index = builder.add(at, builder.mul(s_stride, ir.Constant(s_stride.type, a)))
                scalar = builder.load(builder.gep(data[1], [index]))
                spread = builder.insert_element(ir.Constant(vector, ir.Undefined), scalar, _LANE(0))
                mask = ir.Constant(ir.VectorType(_LANE, count), [0] * count)
                spread = builder.shuffle_vector(spread, ir.Constant(vector, ir.Undefined), mask)
                product = builder.fmul(spread, term, flags=_FUSE)
                builder.store(builder.fadd(builder.load(sums[a]), product, flags=_FUSE), sums[a])
        for place, total in zip(places, sums, strict=True):
            builder.store(builder.load(total), place, align=align)
        return context.get_dummy_value()

    i = types.int64
    return types.void(out, i, i, s, i, i, i, v, i, i, i, tile, lanes), generate
