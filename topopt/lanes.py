"""Several numbers at once: the processor's vector registers, for use inside kernels.

A `Lanes` is a row of 3 or 6 numbers (a node's unknowns, a row of a block) that are loaded, added
and multiplied together, which is several times as fast as one after the other, and takes the
compiler less time too. Compilers find such rows by themselves in long loops only; blocks of
3 x 3 and 6 x 6 are too short for that.

Arrays are C-contiguous and are read as a list of rows, or of blocks, of the width at hand, whatever
their shape: `load(x, i, 3)` is x[i] of an (n, 3) array, block k of an array (n, b, c) starts at
its entry k b c. Widths and counts must be literal numbers. Bounds are not checked.
"""

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, models, register_model

CONTRACT = ("contract",)  # a product and a sum may be one instruction
INT32 = ir.IntType(32)
CACHE_LINE = 64  # bytes


class Lanes(types.Type):
    """The type of `count` numbers in one register."""

    def __init__(self, dtype, count):
        self.dtype, self.count = dtype, count
        super().__init__(name=f"Lanes({dtype}, {count})")


@register_model(Lanes)
class LanesModel(models.PrimitiveModel):
    """In the machine: an LLVM vector."""

    def __init__(self, manager, lanes):
        number = manager.lookup(lanes.dtype).get_value_type()
        super().__init__(manager, lanes, ir.VectorType(number, lanes.count))


class _Array:
    """An array inside a kernel, seen as one long row of numbers."""

    def __init__(self, context, builder, array_type, value):
        if array_type.layout != "C":
            raise TypeError(f"lanes are loaded from C-contiguous arrays, not from {array_type}")
        self.builder, self.dtype = builder, array_type.dtype
        self.number = context.get_data_type(array_type.dtype)
        self.data = context.make_array(array_type)(context, builder, value).data

    def pointer(self, offset, kind):
        item = self.builder.gep(self.data, [offset])
        return self.builder.bitcast(item, kind.as_pointer())

    def load(self, offset, width):
        """Numbers offset ... offset + width - 1."""
        pointer = self.pointer(offset, ir.VectorType(self.number, width))
        return self.builder.load(pointer, align=self.dtype.bitwidth // 8)

    def number_at(self, offset):
        return self.builder.load(self.pointer(offset, self.number))

    def store(self, lanes, offset):
        self.builder.store(lanes, self.pointer(offset, lanes.type), align=self.dtype.bitwidth // 8)

    def at(self, place, size, extra=0):
        """Offset of entry `extra` of the place-th piece of so many numbers."""
        start = self.builder.mul(place, ir.Constant(place.type, size))
        return self.builder.add(start, ir.Constant(place.type, extra))


def _spread(builder, number, width):
    """A register with the same number in each lane."""
    kind = ir.VectorType(number.type, width)
    one = builder.insert_element(ir.Constant(kind, ir.Undefined), number, ir.Constant(INT32, 0))
    places = ir.Constant(ir.VectorType(INT32, width), [ir.Constant(INT32, 0)] * width)
    return builder.shuffle_vector(one, ir.Constant(kind, ir.Undefined), places)


def _add_times(builder, total, a, b):
    return builder.fadd(total, builder.fmul(a, b, flags=CONTRACT), flags=CONTRACT)


# --- single rows -----------------------------------------------------------------------------


@intrinsic(prefer_literal=True)
def load(typing, array, row, width):
    """Row `row` of the array, of `width` numbers."""
    count = width.literal_value

    def generate(context, builder, signature, args):
        source = _Array(context, builder, signature.args[0], args[0])
        return source.load(source.at(args[1], count), count)

    return Lanes(array.dtype, count)(array, types.uint64, width), generate


@intrinsic
def store(typing, lanes, array, row):
    """Put the lanes into row `row` of the array."""

    def generate(context, builder, signature, args):
        target = _Array(context, builder, signature.args[1], args[1])
        target.store(args[0], target.at(args[2], lanes.count))
        return context.get_dummy_value()

    return types.void(lanes, array, types.uint64), generate


@intrinsic(prefer_literal=True)
def zero(typing, array, width):
    """Lanes of zeros in the precision of the array."""
    lanes = Lanes(array.dtype, width.literal_value)

    def generate(context, builder, signature, args):
        return ir.Constant(context.get_value_type(lanes), None)

    return lanes(array, width), generate


@intrinsic
def add(typing, a, b):
    """a + b."""
    return a(a, b), lambda context, builder, signature, args: builder.fadd(*args, flags=CONTRACT)


@intrinsic
def subtract(typing, a, b):
    """a - b."""
    return a(a, b), lambda context, builder, signature, args: builder.fsub(*args, flags=CONTRACT)


@intrinsic
def scale(typing, factor, lanes):
    """factor * lanes."""

    def generate(context, builder, signature, args):
        return builder.fmul(_spread(builder, args[0], lanes.count), args[1], flags=CONTRACT)

    return lanes(lanes.dtype, lanes), generate


@intrinsic
def convert(typing, lanes, array):
    """The lanes in the precision of the array."""
    result = Lanes(array.dtype, lanes.count)

    def generate(context, builder, signature, args):
        kind = context.get_value_type(result)
        if lanes.dtype.bitwidth == array.dtype.bitwidth:
            return args[0]
        widen = lanes.dtype.bitwidth < array.dtype.bitwidth
        return (builder.fpext if widen else builder.fptrunc)(args[0], kind)

    return result(lanes, array), generate


@intrinsic
def dot(typing, a, b):
    """The inner product of two rows, first entry first."""

    def generate(context, builder, signature, args):
        return _sum(builder, builder.fmul(*args, flags=CONTRACT), a.count)

    return a.dtype(a, b), generate


def _sum(builder, lanes, count):
    total = builder.extract_element(lanes, ir.Constant(INT32, 0))
    for c in range(1, count):
        item = builder.extract_element(lanes, ir.Constant(INT32, c))
        total = builder.fadd(total, item, flags=CONTRACT)
    return total


@intrinsic(prefer_literal=True)
def prefetch(typing, array, k, rows, width, ahead):
    """Ask for what stands `ahead` bytes after the start of block k, as much as a block is long.

    A core waits for memory more than it computes. Told a few thousand bytes early what it will
    need, it reads matrices about a third faster. Places beyond the array's end do no harm.
    """
    length = rows.literal_value * width.literal_value * array.dtype.bitwidth // 8

    def generate(context, builder, signature, args):
        source = _Array(context, builder, signature.args[0], args[0])
        number = array.dtype.bitwidth // 8
        byte = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [byte, INT32, INT32, INT32])
        ask = builder.module.declare_intrinsic("llvm.prefetch", [byte], kind)
        for_reading, keep, data = (ir.Constant(INT32, n) for n in (0, 3, 1))
        for offset in range(0, length, CACHE_LINE):
            place = source.at(args[1], length // number, (ahead.literal_value + offset) // number)
            pointer = builder.bitcast(source.pointer(place, source.number), byte)
            builder.call(ask, [pointer, for_reading, keep, data])
        return context.get_dummy_value()

    return types.void(array, types.uint64, rows, width, ahead), generate


# --- blocks times rows -----------------------------------------------------------------------


@intrinsic(prefer_literal=True)
def zero_rows(typing, array, rows, width):
    """A block of zeros as a tuple of rows, in the precision of the array."""
    result = types.UniTuple(Lanes(array.dtype, width.literal_value), rows.literal_value)

    def generate(context, builder, signature, args):
        return ir.Constant(context.get_value_type(result), None)

    return result(array, rows, width), generate


@intrinsic
def add_rows_times(typing, sums, blocks, k, x, j):
    """sums[i] += row i of block k * x[j], entry by entry: `row_sums` then is the sum of blocks @ x.

    Adding up a row is left to the end, because it is slow across a register.
    """
    rows, width = sums.count, sums.dtype.count

    def generate(context, builder, signature, args):
        total, place, column = args[0], args[2], args[4]
        matrix = _Array(context, builder, signature.args[1], args[1])
        vector = _Array(context, builder, signature.args[3], args[3])
        values = vector.load(vector.at(column, width), width)
        if x.dtype.bitwidth < sums.dtype.dtype.bitwidth:
            values = builder.fpext(values, context.get_value_type(sums.dtype))
        for i in range(rows):
            row = matrix.load(matrix.at(place, rows * width, i * width), width)
            added = _add_times(builder, builder.extract_value(total, i), row, values)
            total = builder.insert_value(total, added, i)
        return total

    return sums(sums, blocks, types.uint64, x, types.uint64), generate


@intrinsic
def add_outer(typing, sums, left, right):
    """sums[i] += left[i] * right: adds the outer product of two rows."""
    width = right.count

    def generate(context, builder, signature, args):
        total = args[0]
        for i in range(sums.count):
            factor = builder.extract_element(args[1], ir.Constant(INT32, i))
            row = builder.extract_value(total, i)
            added = _add_times(builder, row, _spread(builder, factor, width), args[2])
            total = builder.insert_value(total, added, i)
        return total

    return sums(sums, left, right), generate


@intrinsic
def row_sums(typing, sums):
    """The sum of each row of a tuple of rows, as Lanes."""
    result = Lanes(sums.dtype.dtype, sums.count)

    def generate(context, builder, signature, args):
        lanes = ir.Constant(context.get_value_type(result), ir.Undefined)
        for i in range(sums.count):
            total = _sum(builder, builder.extract_value(args[0], i), sums.dtype.count)
            lanes = builder.insert_element(lanes, total, ir.Constant(INT32, i))
        return lanes

    return result(sums), generate


@intrinsic
def add_combination(typing, total, weights, blocks, k):
    """total + sum over i of weights[i] * row i of block k: total + block^T @ weights."""
    rows, width = weights.count, total.count

    def generate(context, builder, signature, args):
        result, factors, _, place = args
        matrix = _Array(context, builder, signature.args[2], args[2])
        for i in range(rows):
            row = matrix.load(matrix.at(place, rows * width, i * width), width)
            factor = builder.extract_element(factors, ir.Constant(INT32, i))
            result = _add_times(builder, result, _spread(builder, factor, width), row)
        return result

    return total(total, weights, blocks, types.uint64), generate


# --- blocks times blocks, in memory; the right one has six columns ----------------------------

COLUMNS = 6


def _product_rows(builder, left, entry, right, start, inner, target=None):
    """The rows of left @ right, one after the other (plus those of target, if given).

    left[entry(i, m)] are the entries of the left block; `start(m)` where row m of the right one is.
    """
    right_rows = [right.load(start(m), COLUMNS) for m in range(inner)]

    def row(i):
        total = target(i) if target else None
        for m in range(inner):
            factor = _spread(builder, left.number_at(entry(i, m)), COLUMNS)
            if total is None:
                total = builder.fmul(factor, right_rows[m], flags=CONTRACT)
            else:
                total = _add_times(builder, total, factor, right_rows[m])
        return total

    return row


def _add_product(transposed):
    """Code of result[s] += left[l] @ right[r], or of left[l]^T @ right[r]."""

    def typed(typing, left, l, right, r, result, s, width):
        b = width.literal_value
        rows = COLUMNS if transposed else b

        def generate(context, builder, signature, args):
            a, c, out = (_Array(context, builder, signature.args[n], args[n]) for n in (0, 2, 4))
            here, there, place = args[1], args[3], args[5]

            def entry(i, m):
                return a.at(here, rows * b, m * COLUMNS + i if transposed else i * b + m)

            def start(m):
                return c.at(there, b * COLUMNS, m * COLUMNS)

            def target(i):
                return out.at(place, rows * COLUMNS, i * COLUMNS)

            row = _product_rows(
                builder, a, entry, c, start, b, lambda i: out.load(target(i), COLUMNS)
            )
            for i in range(rows):
                out.store(row(i), target(i))
            return context.get_dummy_value()

        index = types.uint64
        return types.void(left, index, right, index, result, index, width), generate

    return typed


@intrinsic(prefer_literal=True)
def add_product(typing, left, l, right, r, result, s, width):
    """result[s] (b, 6) += left[l] (b, b) @ right[r] (b, 6), with b = width."""
    return _add_product(False)(typing, left, l, right, r, result, s, width)


@intrinsic(prefer_literal=True)
def add_transposed_product(typing, left, l, right, r, result, s, width):
    """result[s] (6, 6) += left[l]^T @ right[r], for left and right (b, 6) with b = width."""
    return _add_product(True)(typing, left, l, right, r, result, s, width)


@intrinsic(prefer_literal=True)
def transform(typing, matrix, k, factor, blocks, s, width):
    """blocks[s] = factor * matrix[k] @ blocks[s], for blocks (b, 6) with b = width."""
    b = width.literal_value

    def generate(context, builder, signature, args):
        a = _Array(context, builder, signature.args[0], args[0])
        target = _Array(context, builder, signature.args[3], args[3])
        place, by = args[4], _spread(builder, args[2], COLUMNS)

        def start(m):
            return target.at(place, b * COLUMNS, m * COLUMNS)

        row = _product_rows(
            builder, a, lambda i, m: a.at(args[1], b * b, i * b + m), target, start, b
        )
        for i, lanes in enumerate([row(i) for i in range(b)]):
            target.store(builder.fmul(by, lanes, flags=CONTRACT), start(i))
        return context.get_dummy_value()

    index = types.uint64
    return types.void(matrix, index, blocks.dtype, blocks, index, width), generate
