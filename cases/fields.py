"""Field types of the case schema: numbers with bounds, lengths, vectors, ranges, choices.

Each refuses a wrong value with the end of one sentence ("must lie in (0, 1)") and describes
itself in the JSON schema.
"""

import math
import re
from typing import Annotated, Any

from pydantic import PlainValidator, WithJsonSchema
from pydantic_core import PydanticCustomError

from cases import quantities

_LENGTH_PATTERN = r"^\s*[-+]?[0-9.eE+-]+\s*(m|dm|cm|mm|um|nm)\s*$"


def refusal(text):
    """The error by which a field refuses its value; `text` ends the sentence."""
    return PydanticCustomError("refused", "{text}", {"text": text})


def _validated(check, schema):
    """A field type that runs `check` (raising ValueError) and has the JSON schema given."""

    def validate(value):
        try:
            return check(value)
        except PydanticCustomError:
            raise
        except ValueError as error:
            raise refusal(str(error)) from None

    return Annotated[Any, PlainValidator(validate), WithJsonSchema(schema)]


def _bounds_in_words(above, at_least, below, at_most):
    low, high = (above, at_least), (below, at_most)
    if low != (None, None) and high != (None, None):
        left = f"({above:g}" if above is not None else f"[{at_least:g}"
        right = f"{below:g})" if below is not None else f"{at_most:g}]"
        return f"must lie in {left}, {right}"
    if above is not None:
        return "must be positive" if above == 0 else f"must be above {above:g}"
    if at_least is not None:
        return f"must be at least {at_least:g}"
    return f"must be below {below:g}" if below is not None else f"must be at most {at_most:g}"


def _bounds_in_schema(above, at_least, below, at_most):
    keys = ("exclusiveMinimum", "minimum", "exclusiveMaximum", "maximum")
    return {k: v for k, v in zip(keys, (above, at_least, below, at_most)) if v is not None}


def _or_words(schema, words, nullable):
    options = [*schema.get("anyOf", [schema]), *([{"enum": list(words)}] if words else [])]
    if nullable:
        options.append({"type": "null"})
    return {"anyOf": options} if len(options) > 1 else options[0]


def number(
    above=None,
    at_least=None,
    below=None,
    at_most=None,
    parse=quantities.plain_number,
    words=(),
    nullable=False,
    hint=None,
):
    """A number within bounds; `words` such as "auto" (or null) may stand for one.

    Parameters
    ----------
    above, at_least, below, at_most : float, optional
    parse : callable
        Makes a float of the raw value, e.g. `quantities.length`.
    words : tuple of str
        Texts that are taken as they are.
    nullable : bool
        Whether null is allowed.
    hint : callable, optional
        Given the refused number, returns a remark for the end of the message, or "".
    """

    def check(value):
        if (value is None and nullable) or (isinstance(value, str) and value in words):
            return value
        try:
            result = parse(value)
        except ValueError as error:
            also = "".join(f", or {word}" for word in words)
            raise ValueError(f"{error}{also}") from None
        inside = (
            (above is None or result > above)
            and (at_least is None or result >= at_least)
            and (below is None or result < below)
            and (at_most is None or result <= at_most)
        )
        if not inside:
            remark = hint(result) if hint else ""
            raise refusal_with_remark(_bounds_in_words(above, at_least, below, at_most), remark)
        return result

    schema = {"type": "number", **_bounds_in_schema(above, at_least, below, at_most)}
    if parse is quantities.length:
        schema = {"anyOf": [schema, {"type": "string", "pattern": _LENGTH_PATTERN}]}
    return _validated(check, _or_words(schema, words, nullable))


def refusal_with_remark(text, remark):
    """A refusal whose remark comes after the value: `must be ..., got 9.5 (remark)`."""
    return PydanticCustomError("refused", "{text}", {"text": text, "remark": remark})


def length(above=None, at_least=None, words=(), nullable=False):
    """A length [m], given in metres or with a unit."""
    return number(above, at_least, parse=quantities.length, words=words, nullable=nullable)


def whole(at_least=None, at_most=None, words=(), nullable=False):
    """A whole number within bounds."""

    def parse(value):
        if isinstance(value, bool) or not isinstance(value, int):
            raise ValueError("must be a whole number")
        return value

    schema = {"type": "integer", **_bounds_in_schema(None, at_least, None, at_most)}

    def check(value):
        if (value is None and nullable) or (isinstance(value, str) and value in words):
            return value
        try:
            result = parse(value)
        except ValueError as error:
            raise ValueError(str(error) + "".join(f", or {word}" for word in words)) from None
        if (at_least is not None and result < at_least) or (
            at_most is not None and result > at_most
        ):
            raise ValueError(_bounds_in_words(None, at_least, None, at_most))
        return result

    return _validated(check, _or_words(schema, words, nullable))


def vector(parse=quantities.plain_number, what="numbers"):
    """Three numbers [x, y, z]."""

    def check(value):
        if not isinstance(value, list | tuple) or len(value) != 3:
            raise ValueError(f"must be three {what} [x, y, z]")
        return tuple(parse(item) for item in value)

    item = {"type": ["number", "string"] if parse is quantities.length else "number"}
    return _validated(check, {"type": "array", "items": item, "minItems": 3, "maxItems": 3})


def interval(value):
    """Return a range of lengths (low, high); null (or an infinite bound) leaves an end open."""
    if value is None:
        return (None, None)
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise ValueError("must be a range [low, high], with null for an open end")
    ends = tuple(
        None
        if end is None or (isinstance(end, float) and math.isinf(end))
        else quantities.length(end)
        for end in value
    )
    if None not in ends and ends[0] > ends[1]:
        raise ValueError("must be a range [low, high] with low <= high")
    return ends


_END = {"type": ["number", "string", "null"]}
_RANGE = {"type": ["array", "null"], "items": _END, "minItems": 2, "maxItems": 2}

Range = _validated(interval, _RANGE)


def _three_intervals(value):
    if value is None:
        return None
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise ValueError("must be three ranges [[x0, x1], [y0, y1], [z0, z1]]")
    return tuple(interval(item) for item in value)


BoxRanges = _validated(
    _three_intervals, {"type": ["array", "null"], "items": _RANGE, "minItems": 3, "maxItems": 3}
)


def _plane_text(value):
    if value is None:
        return None
    axis, offset = quantities.plane(value)
    return f"{'xyz'[axis]}={offset!r}"


PlaneText = _validated(_plane_text, {"type": ["string", "null"], "pattern": "^[xyz]"})


def _planes(value):
    if not isinstance(value, list | tuple):
        raise ValueError("must be a list of planes, as [x=0, y=0]")
    texts = [_plane_text(item) for item in value]
    axes = [text[0] for text in texts]
    if len(set(axes)) != len(axes):
        raise ValueError("must name each axis once")
    return tuple(texts)


Planes = _validated(_planes, {"type": "array", "items": {"type": "string", "pattern": "^[xyz]"}})


def _directions(value):
    if not isinstance(value, list | tuple) or not value or not set(value) <= set("xyz"):
        raise ValueError("must list the directions that are held, as [x, y, z]")
    return tuple(axis for axis in "xyz" if axis in value)


Directions = _validated(
    _directions, {"type": "array", "items": {"enum": ["x", "y", "z"]}, "minItems": 1}
)


def _name(value):
    if not isinstance(value, str) or not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}", value):
        raise ValueError("must be a name of letters, digits, '-', '_' and '.'")
    return value


Name = _validated(_name, {"type": "string", "pattern": "^[A-Za-z0-9][A-Za-z0-9_.-]*$"})


def _names(value):
    if not isinstance(value, list | tuple) or not all(isinstance(item, str) for item in value):
        raise ValueError("must be a list of names, as [deck, side]")
    if len(set(value)) != len(value):
        raise ValueError("must name each once")
    return tuple(value)


Names = _validated(_names, {"type": "array", "items": {"type": "string"}})


def _sigma(value):
    if value == "auto":
        return value
    if quantities.is_absolute(value):
        if quantities.length(value) < 0:
            raise ValueError("must be at least 0")
        return value.strip()
    try:
        result = quantities.plain_number(value)
    except ValueError:
        raise ValueError(
            "must be a number (in units of the bounding box's diagonal), "
            "a length with its unit, as 14mm, or auto"
        ) from None
    if result < 0:
        raise ValueError("must be at least 0")
    return result


Sigma = _validated(
    _sigma,
    {"anyOf": [{"type": "number", "minimum": 0}, {"type": "string", "pattern": _LENGTH_PATTERN},
               {"enum": ["auto"]}]},
)  # fmt: skip
