"""What the vector loops say of the triangles around a vertex, against their slow twins."""

import numpy as np
import pytest

from remesh.carrier import make_carrier
from remesh.connectivity import BASE, MAX_RING, ring
from remesh.embedding import as_tangents
from remesh.halfedge import WorkMesh
from remesh.optimise import BARRIER, star_cost
from remesh.smooth import pull_to_centroids
from remesh.star import STAR_SHAPE, gather_star, star_quality
from tests.remesh import reference
from tests.remesh.shapes import cylinder, hemisphere, jittered

SIGMA, LEAST3, WEIGHT3, AGREE = 0.3, 35.0, 0.7, 0.95


@pytest.fixture(scope="module", params=["cylinder", "hemisphere"])
def stars(request):
    """(work, [(vertex, fan, count, star)]): fans of 3 to 12 triangles, creases, boundaries."""
    mesh = cylinder(2.0, 12, 3) if request.param == "cylinder" else jittered(hemisphere(2), 0.3, 1)
    work = WorkMesh(make_carrier(mesh))
    found, star = [], np.zeros(STAR_SHAPE)
    for v in np.flatnonzero(work.links[:, BASE] == np.arange(len(work.links))):
        fan = np.empty(MAX_RING, np.int64)
        count, _ = ring(work.halves, work.links, v, fan)
        gather_star(work.halves, work.rows, fan, count, star)
        found.append((v, fan, count, star.copy()))
    return work, found


@pytest.mark.parametrize("sigma", [0.0, SIGMA])
def test_least_angles_and_agreement(stars, sigma):
    work, found = stars
    for v, fan, count, star in found:
        got = star_quality(work.rows, work.halves, fan, count, star, sigma**2)
        angle6, angle3, agree = reference.star_quality(work, v, sigma)
        assert np.degrees(np.arctan(got[:2])) == pytest.approx([angle6, angle3], abs=1e-6)
        assert got[2] == pytest.approx(agree, abs=1e-12)


@pytest.mark.parametrize("sigma", [0.0, SIGMA])
def test_costs_of_the_search(stars, sigma):
    work, found = stars
    tangent3 = as_tangents((0.0, LEAST3, 0.0))[1]
    for power in (2, 8):
        settings = np.array([sigma**2, power, LEAST3, WEIGHT3, AGREE, tangent3])
        for v, fan, count, star in found:
            got = star_cost(work.rows, work.halves, fan, count, star, settings)
            expected = reference.star_cost(
                work, v, sigma, power, (LEAST3, WEIGHT3), (AGREE, BARRIER)
            )
            assert got == pytest.approx(expected, rel=1e-4, abs=1e-4)


def test_steps_to_the_centroids(stars):
    work, found = stars
    shift = np.empty(3)
    for v, fan, count, star in found:
        pull_to_centroids(work.halves, work.rows, fan, count, star, SIGMA**2, shift)
        expected = reference.step_to_centroids(work, v, SIGMA)
        assert shift == pytest.approx(expected, abs=1e-12)
