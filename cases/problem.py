"""From a validated case to the problem that topopt solves."""

import math

from cases import quantities
from meshes.errors import InvalidCase, InvalidMesh
from meshes.io import read_surface
from meshes.patch import SymmetryPlane
from meshes.quality import signed_volume
from meshes.topology import topology
from meshes.tri_mesh import TriMesh
from topopt.problem import (
    Box,
    BoxDomain,
    Cylinder,
    Load,
    LoadCase,
    Material,
    Passive,
    Problem,
    Slab,
    Sphere,
    Support,
    SurfaceDomain,
    SurfaceRegion,
)

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

    def region(kind, name, section):
        return _region(section, loaded.folder, f"{kind}.{name}")

    return Problem(
        domain=_domain(case.domain, loaded.folder),
        supports=tuple(
            Support(
                name,
                region("supports", name, section),
                tuple("xyz".index(axis) for axis in section.fixed),
                section.displacement,
                section.stiffness,
            )
            for name, section in case.supports.items()
        ),
        loads=tuple(
            Load(name, region("loads", name, section), section.traction)
            for name, section in case.loads.items()
        ),
        volume_fraction=case.topopt.volume_fraction,
        gamma=_number_or_none(case.topopt.gamma),
        eps=_number_or_none(case.topopt.eps),
        material=Material(*material.lame, material.density, material.void_ratio),
        symmetry=tuple(SymmetryPlane(*quantities.plane(text)) for text in case.symmetry),
        gravity=case.gravity,
        load_cases=tuple(
            LoadCase(name, section.loads, section.weight, section.gravity, section.displacements)
            for name, section in case.load_cases.items()
        ),
        passive=tuple(
            Passive(name, region("passive", name, section), section.phase == "solid")
            for name, section in case.passive.items()
        ),
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


def _region(section, folder, key):
    """The region of a section; an axis-parallel plane is a box without thickness."""
    if section.slab is not None:
        return Slab(section.slab.point, section.slab.normal, section.slab.thickness)
    if section.sphere is not None:
        return Sphere(section.sphere.center, section.sphere.radius)
    if section.cylinder is not None:
        return Cylinder(section.cylinder.start, section.cylinder.end, section.cylinder.radius)
    if section.surface is not None:
        surface = _surface(folder, section.surface, section.unit, f"{key}.surface")
        return SurfaceRegion(_closed(surface, f"{key}.surface: {section.surface}"),
                             name=section.surface)  # fmt: skip
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
    return SurfaceDomain(_surface(folder, section.surface, section.unit, "domain.surface"))


def _surface(folder, name, unit, key):
    """Read a surface file, its points in metres."""
    try:
        surface = read_surface(folder / name)
    except (OSError, InvalidCase, InvalidMesh) as error:
        raise InvalidCase(f"{key}: {error}") from None
    return surface.with_points(surface.points * _UNITS[unit])


def _closed(surface, where):
    """The surface, oriented outward; InvalidCase if it has no inside."""
    found = topology(surface.faces, len(surface.points))
    if not (found.watertight and found.oriented and not found.nonmanifold_edges):
        raise InvalidCase(
            f"{where} is not closed, so it has no inside; close it, or name the region by a box, "
            f"sphere or cylinder."
        )
    if signed_volume(surface) < 0.0:
        return TriMesh(surface.points, surface.faces[:, ::-1])
    return surface
