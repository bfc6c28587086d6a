"""Numbers as people write them in a case file: plain SI, or with a unit of length."""

import math
import re
from decimal import Decimal

# Exponents of ten, so that "20mm" is the very float that 0.02 is.
LENGTH_UNITS = {"m": 0, "dm": -1, "cm": -2, "mm": -3, "um": -6, "nm": -9}

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_WITH_UNIT = re.compile(rf"^\s*({_NUMBER})\s*([A-Za-z]+)\s*$")
_PLAIN = re.compile(rf"^\s*{_NUMBER}\s*$")
_PLANE = re.compile(r"^\s*([xyz])\s*(?:=\s*(\S.*?)\s*)?$")


def plain_number(value):
    """Return `value` as a finite float.

    Raises
    ------
    ValueError
        If it is no number (a quoted one is none either), or not finite.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        if isinstance(value, str) and _PLAIN.match(value):
            raise ValueError("must be a number without quotes")
        if isinstance(value, str) and _WITH_UNIT.match(value):
            raise ValueError("must be a plain number in SI units, without a unit")
        raise ValueError("must be a number")
    try:
        number = float(value)
    except OverflowError:
        raise ValueError("must be a finite number (this one is too large)") from None
    if not math.isfinite(number):
        raise ValueError("must be a finite number")
    return number


def length(value):
    """Return a length [m]: a number is in metres, a text carries its unit ("14mm", "0.7 mm").

    Raises
    ------
    ValueError
        If the text is no number with a unit of length, or the number is not finite.
    """
    if not isinstance(value, str):
        try:
            return plain_number(value)
        except ValueError as error:
            raise ValueError(
                str(error).replace("a number", "a length in metres or with a unit, as 14mm")
            ) from None
    match = _WITH_UNIT.match(value)
    if not match:
        if _PLAIN.match(value):
            raise ValueError("must be a number without quotes, or carry a unit, as 14mm")
        raise ValueError("must be a length: a number in metres, or one with a unit, as 14mm")
    number, unit = match.groups()
    if unit not in LENGTH_UNITS:
        raise ValueError(f"must have a unit of length ({', '.join(LENGTH_UNITS)}), not {unit!r}")
    try:
        metres = float(Decimal(number).scaleb(LENGTH_UNITS[unit]))
    except ArithmeticError:
        metres = math.inf
    if not math.isfinite(metres):
        raise ValueError("must be a finite length")
    return metres


def is_absolute(value):
    """Whether `value` is a text with a unit, such as "14mm"."""
    return isinstance(value, str) and _WITH_UNIT.match(value) is not None


def plane(text):
    """Split "z=20mm" into (axis, offset): (2, 0.02); "z" alone means z=0.

    Raises
    ------
    ValueError
        If the text names no axis-parallel plane.
    """
    match = _PLANE.match(text) if isinstance(text, str) else None
    if not match:
        raise ValueError("must name an axis-parallel plane, as x=0 or z=20mm")
    axis, offset = match.groups()
    if offset is None:
        return "xyz".index(axis), 0.0
    if _PLAIN.match(offset):
        return "xyz".index(axis), float(offset)
    return "xyz".index(axis), length(offset)
