"""A table's rows as SIMD vectors inside of Numba kernels.

Numba has no vector type, and does not turn scalar code on neighbouring numbers into vector code.  So a row of
F numbers is a tuple of F scalars to Numba, and each operation here packs its tuples into an LLVM vector and
unpacks the result: LLVM drops unpacking followed by packing, and a chain of these operations stays in vector
registers.  For two or four features that is two to three times as fast as the same loop over scalars.

Letters: F numbers of a row (a literal, known when the kernel is compiled); `index` counts numbers, not rows.
Arrays are flat and contiguous, their type that of the scalars.  Nothing is checked: neither bounds nor types.
"""

from typing import no_type_check

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

_LANE = ir.IntType(32)
_FUSE = ("contract",)  # a product and the sum that takes it may be one fused multiply-add


@no_type_check
def _pack(builder, row, real, count):
    vector = ir.Constant(ir.VectorType(real, count), ir.Undefined)
    for lane in range(count):
        vector = builder.insert_element(vector, builder.extract_value(row, lane), _LANE(lane))
    return vector


@no_type_check
def _unpack(context, builder, vector, row_type):
    lanes = [builder.extract_element(vector, _LANE(lane)) for lane in range(row_type.count)]
    return context.make_tuple(builder, row_type, lanes)


@no_type_check
def _spread(builder, scalar, real, count):
    vector = ir.Constant(ir.VectorType(real, count), ir.Undefined)
    for lane in range(count):
        vector = builder.insert_element(vector, scalar, _LANE(lane))
    return vector


@no_type_check
def _address(context, builder, array_type, array, index, count):
    real = context.get_value_type(array_type.dtype)
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), ir.VectorType(real, count).as_pointer())


@intrinsic(prefer_literal=True)
@no_type_check
def load_row(typing, array, index, count):
    """The `count` numbers from array[index] on, as a tuple.  `count` is a literal."""
    row_type = types.UniTuple(array.dtype, count.literal_value)

    def generate(context, builder, signature, arguments):
        array_type = signature.args[0]
        pointer = _address(context, builder, array_type, *arguments[:2], row_type.count)
        vector = builder.load(pointer, align=array_type.dtype.bitwidth // 8)
        return _unpack(context, builder, vector, row_type)

    return row_type(array, types.uint64, count), generate


@intrinsic
@no_type_check
def load_record(typing, array, index):
    """Record number `index`, of an array of records of F numbers of one type, as a tuple.

    F is part of the array's type, so that a function for rows of any length needs no closure: a kernel whose
    closure holds another compiled function is compiled anew by every process.
    """
    number = array.dtype.typeof(next(iter(array.dtype.fields)))
    row_type = types.UniTuple(number, len(array.dtype.fields))

    def generate(context, builder, signature, arguments):
        real = context.get_value_type(number)
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        vector_type = ir.VectorType(real, row_type.count)
        pointer = builder.bitcast(builder.gep(data, [arguments[1]]), vector_type.as_pointer())
        vector = builder.load(pointer, align=number.bitwidth // 8)
        return _unpack(context, builder, vector, row_type)

    return row_type(array, types.uint64), generate


@intrinsic
@no_type_check
def store_row(typing, array, index, row):
    """Writes a tuple to the numbers from array[index] on."""

    def generate(context, builder, signature, arguments):
        array_type = signature.args[0]
        real = context.get_value_type(array_type.dtype)
        pointer = _address(context, builder, array_type, *arguments[:2], row.count)
        vector = _pack(builder, arguments[2], real, row.count)
        builder.store(vector, pointer, align=array_type.dtype.bitwidth // 8)
        return context.get_dummy_value()

    return types.void(array, types.uint64, row), generate


@intrinsic(prefer_literal=True)
@no_type_check
def spread(typing, scalar, count):
    """A row of `count` times the scalar.  `count` is a literal."""
    row_type = types.UniTuple(scalar, count.literal_value)

    def generate(context, builder, signature, arguments):
        return context.make_tuple(builder, row_type, [arguments[0]] * row_type.count)

    return row_type(scalar, count), generate


@intrinsic(prefer_literal=True)
@no_type_check
def touched(typing, row, group):
    """A bit for each number: whether any number of its group of `group`, a literal, is not zero.  NaN is not.

    The groups are neighbours and fill the row: a vector may hold several rows of a table.
    """
    whole = types.Integer.from_bitwidth(max(8, 1 << (row.count - 1).bit_length()), signed=False)
    width = group.literal_value
    firsts = sum(1 << lane for lane in range(0, row.count, width))

    def generate(context, builder, signature, arguments):
        real = context.get_value_type(row.dtype)
        vector = _pack(builder, arguments[0], real, row.count)
        other = builder.fcmp_unordered("!=", vector, ir.Constant(vector.type, [0.0] * row.count))
        bits = builder.bitcast(other, ir.IntType(row.count))
        found = bits
        for shift in range(1, width):
            found = builder.or_(found, builder.lshr(bits, ir.Constant(bits.type, shift)))
        found = builder.and_(found, ir.Constant(bits.type, firsts))
        found = builder.mul(found, ir.Constant(bits.type, (1 << width) - 1))
        return builder.zext(found, context.get_value_type(whole)) if row.count < whole.bitwidth else found

    return whole(row, group), generate


@intrinsic
@no_type_check
def choose(typing, bits, a, b):
    """a_i where the i-th bit is set, as `touched` returns them, else b_i."""

    def generate(context, builder, signature, arguments):
        real = context.get_value_type(a.dtype)
        mask = arguments[0]
        if a.count < bits.bitwidth:
            mask = builder.trunc(mask, ir.IntType(a.count))
        mask = builder.bitcast(mask, ir.VectorType(ir.IntType(1), a.count))
        vectors = (_pack(builder, argument, real, a.count) for argument in arguments[1:])
        return _unpack(context, builder, builder.select(mask, *vectors), a)

    return a(bits, a, b), generate


@intrinsic
@no_type_check
def product(typing, a, b):
    """a_i b_i."""

    def generate(context, builder, signature, arguments):
        real = context.get_value_type(a.dtype)
        vectors = (_pack(builder, argument, real, a.count) for argument in arguments)
        return _unpack(context, builder, builder.fmul(*vectors, flags=_FUSE), a)

    return a(a, b), generate


@intrinsic
@no_type_check
def quotient(typing, a, b):
    """a_i / b_i."""

    def generate(context, builder, signature, arguments):
        real = context.get_value_type(a.dtype)
        vectors = (_pack(builder, argument, real, a.count) for argument in arguments)
        return _unpack(context, builder, builder.fdiv(*vectors), a)

    return a(a, b), generate


@intrinsic
@no_type_check
def square_root(typing, row):
    """The square root of each number."""

    def generate(context, builder, signature, arguments):
        real = context.get_value_type(row.dtype)
        vector = _pack(builder, arguments[0], real, row.count)
        name = f"llvm.sqrt.v{row.count}{real.intrinsic_name}"
        kind = ir.FunctionType(vector.type, [vector.type])
        root = cgutils.get_or_insert_function(builder.module, kind, name)
        return _unpack(context, builder, builder.call(root, [vector]), row)

    return row(row), generate


@intrinsic
@no_type_check
def scaled(typing, share, row):
    """share * row."""

    def generate(context, builder, signature, arguments):
        real = context.get_value_type(signature.args[0])
        product = builder.fmul(
            _spread(builder, arguments[0], real, row.count),
            _pack(builder, arguments[1], real, row.count),
            flags=_FUSE,
        )
        return _unpack(context, builder, product, row)

    return row(row.dtype, row), generate


@intrinsic
@no_type_check
def add_scaled(typing, total, share, row):
    """total + share * row."""

    def generate(context, builder, signature, arguments):
        real = context.get_value_type(signature.args[1])
        product = builder.fmul(
            _spread(builder, arguments[1], real, row.count),
            _pack(builder, arguments[2], real, row.count),
            flags=_FUSE,
        )
        vector = builder.fadd(_pack(builder, arguments[0], real, row.count), product, flags=_FUSE)
        return _unpack(context, builder, vector, row)

    return row(row, row.dtype, row), generate


@intrinsic
@no_type_check
def dot(typing, a, b):
    """Sum of a_i b_i over the F numbers, in their order."""

    def generate(context, builder, signature, arguments):
        real = context.get_value_type(signature.return_type)
        product = builder.fmul(
            _pack(builder, arguments[0], real, a.count), _pack(builder, arguments[1], real, a.count)
        )
        total = builder.extract_element(product, _LANE(0))
        for lane in range(1, a.count):
            total = builder.fadd(total, builder.extract_element(product, _LANE(lane)))
        return total

    return a.dtype(a, b), generate
