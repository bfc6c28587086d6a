"""How fine, and how much curvature counts."""

import pytest

from cases.targets import Target, longest_edge, sigma_length
from tests.shapes import cube


def test_target():
    surface = cube(2.0)
    assert longest_edge(surface) == pytest.approx(2.0 * 2**0.5)
    assert Target(vertices=50).for_surface(surface) == {"vertices": 50}
    assert Target(edge_length=0.1).for_surface(surface) == {"edge_length": 0.1}
    assert Target().for_surface(surface) == {"vertices": 8}
    factor = Target(edge_factor=2.0).for_surface(surface)
    assert factor["edge_length"] == pytest.approx(4.0 * 2**0.5)


def test_sigma():
    assert sigma_length(0.05, 20.0) == 1.0
    assert sigma_length("14mm", 20.0) == 0.014
    assert sigma_length("14mm", 20.0, lambda text: 14.0) == 14.0
