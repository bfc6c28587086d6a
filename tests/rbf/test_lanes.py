"""Vector registers inside kernels, with and without the processor's own instructions; threads."""

import threading

import numba
import numpy as np
import pytest
from numba import njit

from rbf import lanes
from rbf.threads import in_parts


@pytest.fixture(params=["avx512", "plain"])
def instructions(request, monkeypatch):
    """Compile for any processor too, not only for the one at hand."""
    if request.param == "plain":
        monkeypatch.setattr(lanes, "_has_avx512", lambda context: False)


def test_improved_root_is_exact_to_rounding(instructions):
    @njit
    def roots(x, out):
        for j in range(0, x.shape[1], 8):
            row = lanes.load(x, 0, j)
            root = lanes.improved_root(row, lanes.root_estimate(row))
            lanes.store(root, out, 0, j)

    rng = np.random.default_rng(0)
    x = np.concatenate([1.0 + rng.random(800), 10.0 ** rng.uniform(-30, 7, 800)])[None]
    out = np.empty_like(x)
    roots(x, out)
    np.testing.assert_allclose(out, 1.0 / np.sqrt(x), rtol=4e-16)


def test_compress_moves_the_wanted_lanes_to_the_front(instructions):
    @njit
    def select(x, limit, out):
        row = lanes.load(x, 0, 0)
        bits = lanes.below(row, limit)
        lanes.store(lanes.compress(row, bits), out, 0, 0)
        return lanes.count_bits(bits)

    for pattern in range(256):
        wanted = (pattern >> np.arange(8)) & 1 == 1
        x = np.where(wanted, np.arange(8.0), 10.0 + np.arange(8.0))[None]
        out = np.empty((1, 8))
        count = select(x, 9.0, out)
        assert count == wanted.sum()
        np.testing.assert_array_equal(out[0, :count], np.flatnonzero(wanted))


def test_arithmetic_is_that_of_the_numbers(instructions):
    @njit
    def combine(x, number, out):
        a, b = lanes.load(x, 0, 0), lanes.load(x, 1, 3)
        result = (number - a) * b + 2.0 * lanes.magnitude(a)
        result += lanes.positive(b) - lanes.spread(number)
        lanes.store(result, out, 0, 0)
        return lanes.total(result)

    x, out = np.random.default_rng(1).standard_normal((2, 11)), np.empty((1, 8))
    a, b = x[0, :8], x[1, 3:]
    total = combine(x, 0.7, out)
    expected = (0.7 - a) * b + 2.0 * abs(a) + np.maximum(b, 0.0) - 0.7
    np.testing.assert_allclose(out[0], expected, rtol=1e-14, atol=1e-14)
    assert total == pytest.approx(expected.sum(), rel=1e-13)


@pytest.mark.parametrize("count", [0, 1, 99, 100, 1001])
def test_parts_make_up_the_whole_in_any_number_of_threads(count):
    done, lock = [], threading.Lock()

    def kernel(first, last, argument):
        assert argument == "given"
        with lock:
            done.extend(range(first, last))

    before = numba.get_num_threads()
    try:
        for threads in {1, before}:
            numba.set_num_threads(threads)
            done.clear()
            in_parts(kernel, count, "given", least=20)
            assert sorted(done) == list(range(count))
    finally:
        numba.set_num_threads(before)


def test_an_error_in_a_thread_is_not_lost():
    def kernel(first, last):
        if last == 1000:
            raise ValueError("the last part")

    with pytest.raises(ValueError, match="last part"):
        in_parts(kernel, 1000, least=1)
