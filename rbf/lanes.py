"""Eight numbers at once: the processor's vector registers, for use inside kernels.

A `Lanes` holds eight floats that are loaded, added and multiplied together; +, - and * work
between two of them and between one and a number. Compilers find such rows by themselves in simple
loops only, and then choose registers half as wide and exact square roots and divisions, which take
most of the time of a sum of kernels; `root_estimate` and `improved_root` are as exact and several
times as fast where the processor can help (AVX-512), and plain elsewhere.

Arrays are two-dimensional and C-contiguous; bounds are not checked, so that arrays need room for
eight numbers from wherever lanes are loaded or stored.
"""

import operator

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, models, register_model

COUNT = 8
FLAGS = ("contract", "nsz")  # a product and a sum may be one instruction
DOUBLE, INT8, INT32, INT64 = ir.DoubleType(), ir.IntType(8), ir.IntType(32), ir.IntType(64)
VECTOR, MASK = ir.VectorType(DOUBLE, COUNT), ir.VectorType(ir.IntType(1), COUNT)


class Lanes(types.Type):
    """The type of eight floats in one register."""

    def __init__(self):
        super().__init__(name="Lanes")


LANES = Lanes()


@register_model(Lanes)
class LanesModel(models.PrimitiveModel):
    """In the machine: an LLVM vector."""

    def __init__(self, manager, lanes):
        super().__init__(manager, lanes, VECTOR)


def _constant(number):
    return ir.Constant(VECTOR, [number] * COUNT)


def _spread(builder, number):
    """Lanes with the same number in each; lanes stay as they are."""
    if number.type == VECTOR:
        return number
    empty, first = ir.Constant(VECTOR, ir.Undefined), ir.Constant(INT32, 0)
    places = ir.Constant(ir.VectorType(INT32, COUNT), [first] * COUNT)
    return builder.shuffle_vector(builder.insert_element(empty, number, first), empty, places)


class _Arithmetic(AbstractTemplate):
    """Types of an operator with lanes on one side at least."""

    def generic(self, args, kws):
        known = all(isinstance(a, (Lanes, types.Number)) for a in args)
        if len(args) == 2 and known and LANES in args:
            return signature(LANES, *(a if a == LANES else types.float64 for a in args))
        return None


def _define(symbol, instruction):
    infer_global(symbol)(type(f"Lanes_{instruction}", (_Arithmetic,), {"key": symbol}))

    def lower(context, builder, signature, args):
        a, b = (_spread(builder, argument) for argument in args)
        return getattr(builder, instruction)(a, b, flags=FLAGS)

    for kinds in ((Lanes, Lanes), (Lanes, types.Float), (types.Float, Lanes)):
        lower_builtin(symbol, *kinds)(lower)


for _symbol, _instruction in (
    (operator.add, "fadd"),
    (operator.iadd, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
):
    _define(_symbol, _instruction)


def _intrinsic(builder, name, result, *args):
    kind = ir.FunctionType(result, [argument.type for argument in args])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), args)


def _has_avx512(context):
    return "+avx512f" in context.codegen().magic_tuple()[2]


def _pointer(context, builder, array_type, array, row, column):
    """Where entry (row, column) of an array lies, as a pointer to lanes."""
    if array_type.layout != "C" or array_type.ndim != 2 or array_type.dtype != types.float64:
        raise TypeError(f"lanes need C-contiguous 2-dimensional float arrays, not {array_type}")
    fields = context.make_array(array_type)(context, builder, array)
    width = builder.extract_value(fields.shape, 1)
    place = builder.add(builder.mul(row, width), column)
    return builder.bitcast(builder.gep(fields.data, [place]), VECTOR.as_pointer())


@intrinsic
def load(typing, array, row, column):
    """array[row, column : column + 8]."""

    def generate(context, builder, signature, args):
        place = _pointer(context, builder, signature.args[0], *args)
        return builder.load(place, align=8)

    return LANES(array, types.int64, types.int64), generate


@intrinsic
def store(typing, lanes, array, row, column):
    """array[row, column : column + 8] = lanes."""

    def generate(context, builder, signature, args):
        place = _pointer(context, builder, signature.args[1], *args[1:])
        builder.store(args[0], place, align=8)
        return context.get_dummy_value()

    return types.void(lanes, array, types.int64, types.int64), generate


@intrinsic
def spread(typing, number):
    """Lanes with the same number in each."""
    return LANES(types.float64), lambda context, builder, _, args: _spread(builder, args[0])


@intrinsic
def positive(typing, lanes):
    """max(lanes, 0); 0 where they are NaN."""

    def generate(context, builder, signature, args):
        zero = _constant(0.0)
        return builder.select(builder.fcmp_ordered(">", args[0], zero), args[0], zero)

    return lanes(lanes), generate


@intrinsic
def magnitude(typing, lanes):
    """Absolute values."""

    def generate(context, builder, signature, args):
        return _intrinsic(builder, "llvm.fabs.v8f64", VECTOR, args[0])

    return lanes(lanes), generate


@intrinsic
def root_estimate(typing, lanes):
    """1 / sqrt(lanes) for positive lanes: the processor's estimate of 14 bits, exact elsewhere."""

    def generate(context, builder, signature, args):
        if _has_avx512(context):
            name, everywhere = "llvm.x86.avx512.rsqrt14.pd.512", ir.Constant(INT8, -1)
            return _intrinsic(builder, name, VECTOR, args[0], _constant(0.0), everywhere)
        root = _intrinsic(builder, "llvm.sqrt.v8f64", VECTOR, args[0])
        return builder.fdiv(_constant(1.0), root, flags=FLAGS)

    return lanes(lanes), generate


@intrinsic
def improved_root(typing, lanes, estimate):
    """1 / sqrt(lanes), to rounding, from the `root_estimate`.

    One step of the fourth-order iteration y <- y (1 + e / 2 + 3 e^2 / 8 + 5 e^3 / 16),
    e = 1 - x y^2, makes 53 bits of 14; an exact estimate stays as it is.
    """

    def generate(context, builder, signature, args):
        x, y = args
        if not _has_avx512(context):
            return y

        def fused(a, b, c):
            return builder.fadd(builder.fmul(a, b, flags=FLAGS), c, flags=FLAGS)

        xy = builder.fmul(x, y, flags=FLAGS)
        e = builder.fsub(_constant(1.0), builder.fmul(xy, y, flags=FLAGS), flags=FLAGS)
        series = fused(fused(_constant(0.3125), e, _constant(0.375)), e, _constant(0.5))
        return fused(builder.fmul(y, e, flags=FLAGS), series, y)

    return lanes(lanes, lanes), generate


@intrinsic
def total(typing, lanes):
    """The sum of the eight numbers, by halves."""

    def generate(context, builder, signature, args):
        parts, width = args[0], COUNT
        while width > 1:
            width //= 2
            empty = ir.Constant(parts.type, ir.Undefined)
            halves = []
            for start in (0, width):
                places = [ir.Constant(INT32, start + k) for k in range(width)]
                places = ir.Constant(ir.VectorType(INT32, width), places)
                halves.append(builder.shuffle_vector(parts, empty, places))
            parts = builder.fadd(*halves, flags=("nsz",))
        return builder.extract_element(parts, ir.Constant(INT32, 0))

    return types.float64(lanes), generate


@intrinsic
def below(typing, lanes, limit):
    """Where lanes < limit: an integer, whose bit k says it of lane k."""

    def generate(context, builder, signature, args):
        mask = builder.fcmp_ordered("<", args[0], _spread(builder, args[1]))
        return builder.zext(builder.bitcast(mask, INT8), INT64)

    return types.int64(lanes, types.float64), generate


@intrinsic
def count_bits(typing, bits):
    """How many bits of an integer are set."""

    def generate(context, builder, signature, args):
        return _intrinsic(builder, "llvm.ctpop.i64", INT64, args[0])

    return types.int64(types.int64), generate


@intrinsic
def compress(typing, lanes, bits):
    """The lanes whose bit is set, moved to the front; what follows them is of no use."""

    def generate(context, builder, signature, args):
        mask = builder.bitcast(builder.trunc(args[1], INT8), MASK)
        if _has_avx512(context):
            name = "llvm.x86.avx512.mask.compress.v8f64"
            return _intrinsic(builder, name, VECTOR, args[0], _constant(0.0), mask)
        place = ir.Constant(INT32, 0)
        packed = ir.Constant(VECTOR, ir.Undefined)
        for k in range(COUNT):  # written in any case, and overwritten if not wanted
            lane = ir.Constant(INT32, k)
            number = builder.extract_element(args[0], lane)
            packed = builder.insert_element(packed, number, place)
            step = builder.zext(builder.extract_element(mask, lane), INT32)
            place = builder.add(place, step)
        return packed

    return lanes(lanes, types.int64), generate
