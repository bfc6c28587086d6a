"""The search for an edge length: few meshes, also where the count jumps."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from meshes import NotConverged
from topopt.meshing_count import Size, mesh_by_count, search

BOX = Size(0.05 * 0.015 * 0.02 / 0.05**3, 2 * (0.015 + 0.02 + 0.015 * 0.02 / 0.05) / 0.05)


class StaircaseMesher:
    """Counts as pytetwild's: a jump by 2 at h = 0.0235 over any power of two, noise of 1 %.

    The jump takes a hundredth of the length; the size of the largest mesh of all is noted.
    """

    def __init__(self, noise=0.01, width=0.01):
        self.rng, self.noise, self.width = np.random.default_rng(1), noise, width
        self.counts = []

    def __call__(self, edge_length):
        steps = math.log2(0.0235 / edge_length)
        whole = math.floor(steps)
        rest = steps - whole
        rise = min(rest / self.width, 1.0)
        stairs = whole + 0.33 * rise + 0.67 * rest  # continuous, period 1
        tets = BOX.volume * 7.0 * 8.0**stairs / 0.0235**3
        tets *= 1.0 + self.noise * self.rng.uniform(-1, 1)
        self.counts.append(int(tets))
        return SimpleNamespace(tets=range(int(tets)))


@pytest.mark.parametrize(
    "target", [1500, 5000, 14_724, 40_000, 90_000, 280_148, 294_231, 1_120_591]
)
def test_a_count_is_met_with_few_large_meshes(target):
    mesher = StaircaseMesher()
    mesh = mesh_by_count(mesher, BOX, target, lambda word: None)
    assert len(mesh.tets) == pytest.approx(target, rel=0.05)
    large = [count for count in mesher.counts if count > target / 4]
    if target > 40_000:
        assert len(large) <= 5
        assert len(mesher.counts) <= 25


def test_the_best_mesh_is_returned_and_the_search_stops_early():
    mesher = StaircaseMesher(noise=0.0)
    edge_length, mesh, counts = search(mesher, 0.02, 20_000, 12)
    assert counts == mesher.counts
    assert abs(len(mesh.tets) / 20_000 - 1) == min(abs(n / 20_000 - 1) for n in counts) <= 0.03
    assert all(abs(n / 20_000 - 1) > 0.03 for n in counts[:-1])
    assert len(mesher(edge_length).tets) == len(mesh.tets)


@pytest.mark.parametrize("exponent", [-0.6, -3.0, -12.0])
def test_flat_and_steep_counts_take_few_tries(exponent):
    def mesh_at(edge_length):
        return SimpleNamespace(tets=range(int(3000 * (edge_length / 0.02) ** exponent)))

    edge_length, mesh, counts = search(mesh_at, 0.02 * 3 ** (1 / exponent), 3000, 20)
    assert counts[0] == pytest.approx(9000, rel=1e-3) and len(counts) <= 8
    assert len(mesh.tets) == pytest.approx(3000, rel=0.03)
    assert edge_length == pytest.approx(0.02, rel=0.06)


def test_a_count_in_a_sharp_jump_is_refused_with_the_nearest_ones():
    mesher = StaircaseMesher(noise=0.0, width=1e-9)
    below, above = (len(mesher(0.0235 * (1 + sign * 1e-6)).tets) for sign in (1, -1))
    assert above / below > 1.8
    with pytest.raises(NotConverged, match=f"no mesh of {int(1.4 * below):,} tets") as caught:
        mesh_by_count(mesher, BOX, int(1.4 * below), lambda word: None)
    counts = np.array(caught.value.history)
    assert abs(counts - below).min() / below < 0.03 and abs(counts - above).min() / above < 0.03


def test_the_nearest_count_is_used_with_a_warning_rather_than_none():
    def mesh_at(edge_length):
        count = round(BOX.count(edge_length))
        if count > 150_000:
            count = 279_000 if count < 297_000 else 330_000
        return SimpleNamespace(tets=range(count))

    words = []
    found = mesh_by_count(mesh_at, BOX, 297_000, words.append)
    assert len(found.tets) == 279_000
    assert words[-1].startswith("warning: no mesh of 297,000") and "279,000" in words[-1]
    with pytest.raises(NotConverged, match="279,000 came out"):
        mesh_by_count(mesh_at, BOX, 240_000, words.append)


def test_a_shape_that_takes_more_tets_is_given_up_soon():
    counts = []

    def mesh_at(edge_length):
        rng = np.random.default_rng(len(counts))
        counts.append(int(1100 * rng.uniform(0.97, 1.03) + 4 * edge_length**-3))
        return SimpleNamespace(tets=range(counts[-1]))

    with pytest.raises(NotConverged, match=r"no mesh of 600 tets .* about 1,\d\d\d, however"):
        mesh_by_count(mesh_at, BOX, 600, lambda word: None)
    assert len(counts) <= 6
    found = mesh_by_count(mesh_at, BOX, 3000, lambda word: None)
    assert len(found.tets) == pytest.approx(3000, rel=0.05)


@pytest.mark.parametrize("tets", [100, 10_000, 10_000_000])
def test_the_first_guess_inverts_the_count(tets):
    assert BOX.count(BOX.edge_length(tets)) == pytest.approx(tets, rel=1e-9)
