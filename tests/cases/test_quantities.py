"""Lengths with units, plain numbers, planes."""

import pytest

from cases.quantities import is_absolute, length, plain_number, plane


@pytest.mark.parametrize(
    ("text", "metres"),
    [("14mm", 0.014), ("0.71 mm", 0.00071), ("2 cm", 0.02), ("3m", 3.0), ("1e3 um", 1e-3),
     ("-5nm", -5e-9), (".5 dm", 0.05), (0.02, 0.02), (3, 3.0)],
)  # fmt: skip
def test_length_is_the_very_float_of_the_metres(text, metres):
    assert length(text) == metres


@pytest.mark.parametrize(
    ("value", "reason"),
    [("14", "without quotes"), ("14 inch", "'inch'"), ("mm", "with a unit"), (True, "must be"),
     (float("inf"), "finite"), (10**400, "finite"), ("1e99999999999999999999 m", "finite"),
     ([1], "must be"), (None, "must be")],
)  # fmt: skip
def test_length_refuses(value, reason):
    with pytest.raises(ValueError, match=reason):
        length(value)


@pytest.mark.parametrize("value", ["5", "5mm", True, None, float("nan"), 10**400])
def test_plain_number_refuses(value):
    with pytest.raises(ValueError, match="must be"):
        plain_number(value)


def test_plane():
    assert plane("x=0") == (0, 0.0)
    assert plane("y") == (1, 0.0)
    assert plane(" z = 20mm ") == (2, 0.02)
    assert plane("z=-0.5") == (2, -0.5)
    for text in ("w=0", "x=", "x=1 mile", "xy", 5):
        with pytest.raises(ValueError, match="must"):
            plane(text)


def test_is_absolute():
    assert is_absolute("14mm")
    assert not is_absolute("0.05")
    assert not is_absolute(0.05)
