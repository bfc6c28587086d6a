"""Phase fields with known surfaces, for the tests of isosurface."""

import numpy as np

from meshes import PhaseField, SymmetryPlane
from meshes.structured import bcc_box


def sine_profile(distance, width):
    """The obstacle potential's profile over an interface of a width; distance > 0 is inside."""
    angle = np.clip(np.pi * np.asarray(distance) / width, -np.pi / 2, np.pi / 2)
    return 0.5 * (1.0 + np.sin(angle))


def box(cells, lower=(0.0, 0.0, 0.0), upper=(1.0, 1.0, 1.0), symmetry=""):
    """A BCC mesh of a box, with symmetry planes through its lower faces on the axes named."""
    planes = tuple(SymmetryPlane("xyz".index(axis), lower["xyz".index(axis)]) for axis in symmetry)
    cells = (cells,) * 3 if np.isscalar(cells) else cells
    return bcc_box(lower, upper, cells).with_sets(symmetry=planes)


def sphere_field(mesh, centre, radius, width=0.2):
    """A ball; the interface is `width` wide."""
    distance = radius - np.linalg.norm(mesh.points - np.asarray(centre), axis=1)
    return PhaseField(mesh, sine_profile(distance, width))


def torus_field(mesh, major, minor, width=0.2):
    """A torus about the z axis through the origin."""
    ring = np.hypot(mesh.points[:, 0], mesh.points[:, 1]) - major
    return PhaseField(mesh, sine_profile(minor - np.hypot(ring, mesh.points[:, 2]), width))


def slab_field(mesh, axis, low, high, width=0.3):
    """The slab low < x[axis] < high."""
    x = mesh.points[:, axis]
    return PhaseField(mesh, sine_profile(np.minimum(x - low, high - x), width))


def rod_field(mesh, axis, centre, radius, width=0.2):
    """A round rod along an axis, through the whole mesh."""
    across = np.delete(mesh.points, axis, axis=1) - np.asarray(centre)
    return PhaseField(mesh, sine_profile(radius - np.linalg.norm(across, axis=1), width))


def arch_field(cells=6):
    """A thin arch under a plate: rims of two caps, two symmetry planes, in [0, 5] x [0, 2]^2."""
    mesh = box((5 * cells // 2, cells, cells), upper=(5.0, 2.0, 2.0), symmetry="xy")
    x, y, z = mesh.points.T
    arch = 0.25 - np.abs(z - 1.7 * (1.0 - (x / 4.7) ** 2)) / np.sqrt(1.0 + (0.72 * x / 4.7) ** 2)
    plate = np.minimum(np.minimum(z - 1.6, 1.3 - x), 1.2 - y)
    distance = np.maximum(np.minimum(arch, 0.8 - y), plate)
    return PhaseField(mesh, sine_profile(distance, 0.6))


def random_field(rng, cells, symmetry="", on_level=0.2):
    """Random nodal values, a share of them exactly at the level 0.5."""
    mesh = box(cells, symmetry=symmetry)
    values = rng.uniform(size=len(mesh.points))
    values[rng.uniform(size=len(values)) < on_level] = 0.5
    return PhaseField(mesh, values)
