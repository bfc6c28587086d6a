"""From a validated case to the problem that topopt solves."""

import math

from cases import quantities
from meshes.errors import InvalidCase, InvalidMesh
from meshes.io import read_surface
from meshes.patch import SymmetryPlane
from topopt.problem import Box, BoxDomain, Load, Material, Problem, Support, SurfaceDomain

LARGEST_PART = 10.0  # m
_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}


def to_problem(loaded):
    """Build the Problem of a LoadedCase.

    Raises
    ------
    InvalidCase
        If the surface of the domain cannot be read.
    """
    case = loaded.case
    material = case.material
    return Problem(
        domain=_domain(case.domain, loaded.folder),
        supports=tuple(
            Support(name, _region(section), tuple("xyz".index(axis) for axis in section.fixed))
            for name, section in case.supports.items()
        ),
        loads=tuple(
            Load(name, _region(section), section.traction) for name, section in case.loads.items()
        ),
        volume_fraction=case.topopt.volume_fraction,
        gamma=_number_or_none(case.topopt.gamma),
        eps=_number_or_none(case.topopt.eps),
        material=Material(
            material.lame_lambda, material.lame_mu, material.density, material.void_ratio
        ),
        symmetry=tuple(SymmetryPlane(*quantities.plane(text)) for text in case.symmetry),
        gravity=case.gravity,
    )


def units_warning(problem):
    """A sentence if the domain is so large that a unit was probably forgotten, else None."""
    domain = problem.domain
    corners = (
        [domain.lower, domain.upper] if isinstance(domain, BoxDomain) else domain.surface.points
    )
    size = max(max(values) - min(values) for values in zip(*corners))
    if size < LARGEST_PART:
        return None
    return (
        f"the domain is {size:g} m long; lengths without a unit are metres, so write 50mm for "
        "50 millimetres"
    )


def _number_or_none(value):
    return None if value == "auto" else value


def _region(section):
    """The Box of a `box` or `plane` region; a plane is a box without thickness."""
    if section.box is not None:
        ranges = list(section.box)
    else:
        axis, offset = quantities.plane(section.plane)
        ranges = [section.x, section.y, section.z]
        ranges[axis] = (offset, offset)
    lower = tuple(-math.inf if low is None else low for low, _ in ranges)
    upper = tuple(math.inf if high is None else high for _, high in ranges)
    return Box(lower, upper)


def _domain(section, folder):
    if section.box is not None:
        return BoxDomain(section.box.lower, section.box.upper)
    path = folder / section.surface
    try:
        surface = read_surface(path)
    except (OSError, InvalidCase, InvalidMesh) as error:
        raise InvalidCase(f"domain.surface: {error}") from None
    return SurfaceDomain(surface.with_points(surface.points * _UNITS[section.unit]))
