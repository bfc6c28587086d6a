"""What is done in vector registers against the same in numpy."""

import numpy as np
import pytest
from numba import njit
from numpy.testing import assert_allclose, assert_array_equal

from topopt import lanes


@njit
def rows_of_three(a, b, single, out):
    x, y = lanes.load(a, 1, 3), lanes.load(b, 0, 3)
    lanes.store(lanes.add(x, y), out, 0)
    lanes.store(lanes.subtract(x, y), out, 1)
    lanes.store(lanes.scale(2.5, x), out, 2)
    lanes.store(lanes.convert(lanes.load(single, 2, 3), out), out, 3)
    lanes.store(lanes.zero(out, 3), out, 4)
    outer = lanes.add_outer(lanes.zero_rows(a, 3, 3), x, y)
    outer = lanes.add_outer(outer, x, x)
    for i in range(3):
        lanes.store(outer[i], out, 6 + i)
    lanes.prefetch(a, 1, 3, 3, 4096)  # far beyond the end
    return lanes.dot(x, y)


@njit
def blocks_times_rows(blocks, x, weights, out, sums_out):
    sums = lanes.zero_rows(blocks, 3, 6)
    for k in range(blocks.shape[0]):
        sums = lanes.add_rows_times(sums, blocks, k, x, k + 1)
    lanes.store(lanes.row_sums(sums), sums_out, 0)
    total = lanes.load(x, 0, 6)
    for k in range(blocks.shape[0]):
        total = lanes.add_combination(total, lanes.load(weights, k, 3), blocks, k)
    lanes.store(total, out, 0)


@njit
def products(square, wide, added, transposed, moved):
    lanes.add_product(square, 1, wide, 0, added, 1, 3)
    lanes.add_transposed_product(wide, 1, wide, 0, transposed, 1, 3)
    lanes.transform(square, 1, 0.5, moved, 1, 3)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_rows(rng):
    a, b, single = rng.random((2, 3)), rng.random((1, 3)), rng.random((3, 3)).astype(np.float32)
    out = np.full((9, 3), 7.0)
    found = rows_of_three(a, b, single, out)
    assert found == pytest.approx(a[1] @ b[0], rel=1e-14)
    expected = [a[1] + b[0], a[1] - b[0], 2.5 * a[1], single[2], np.zeros(3), np.full(3, 7.0)]
    assert_array_equal(out[:6], expected)
    assert_allclose(out[6:], np.outer(a[1], a[1] + b[0]), rtol=1e-14)


@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_blocks_times_rows(rng, precision):
    blocks, x = rng.random((4, 3, 6)).astype(precision), rng.random((5, 6)).astype(np.float32)
    weights = rng.random((4, 3)).astype(precision)
    out, sums = np.zeros((2, 6), precision), np.zeros((2, 3), precision)
    blocks_times_rows(blocks, x.astype(precision), weights, out, sums)
    close = {"rtol": 1e-5 if precision == np.float32 else 1e-13}
    assert_allclose(sums[0], np.einsum("kij,kj->i", blocks, x[1:]), **close)
    assert_allclose(out[0], x[0] + np.einsum("kij,ki->j", blocks, weights), **close)
    assert not sums[1].any() and not out[1].any()


def test_products_of_blocks(rng):
    square, wide = rng.random((2, 3, 3)), rng.random((2, 3, 6))
    added, moved = rng.random((3, 3, 6)), rng.random((3, 3, 6))
    transposed = rng.random((3, 6, 6))
    expected = [v.copy() for v in (added, transposed, moved)]
    expected[0][1] += square[1] @ wide[0]
    expected[1][1] += wide[1].T @ wide[0]
    expected[2][1] = 0.5 * square[1] @ moved[1]
    products(square, wide, added, transposed, moved)
    for found, value in zip((added, transposed, moved), expected, strict=True):
        assert_allclose(found, value, rtol=1e-13)


def test_strided_arrays_are_refused(rng):
    columns = rng.random((6, 4)).T
    with pytest.raises(TypeError, match="C-contiguous"):
        rows_of_three(columns, columns, columns, columns)
