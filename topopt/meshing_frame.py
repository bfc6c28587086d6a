"""The frame a domain is meshed in: its longest side is 1, its lower corner the origin.

Domains that differ by scale and place alone look the same there, so meshes do not depend on units
and are kept once. Coordinates are rounded to 12 digits, so that 0.05 m and 50 mm agree; scaling by
a power of two gives the same bits.
"""

from dataclasses import dataclass

import numpy as np

from meshes.errors import InvalidCase
from meshes.patch import Plane
from meshes.quality import signed_volume
from meshes.self_intersection import self_intersecting_faces
from meshes.structured import box_patches
from meshes.topology import topology
from meshes.tri_mesh import TriMesh
from topopt.meshing_flat import flat_parts
from topopt.problem import BoxDomain, SurfaceDomain

DIGITS = 12
NO_VOLUME = 1e-9  # of the cube over the longest side


@dataclass(frozen=True, eq=False)
class Frame:
    """A domain's surface in the frame it is meshed in, and the way back.

    Parameters
    ----------
    points : (n, 3) float array
        In [0, 1].
    faces : (f, 3) int32 array
        Oriented outward.
    planes : tuple of Plane
        The large flat parts of the surface, in the frame.
    widths : tuple of float
        Width of each: twice the area over the perimeter, in the frame.
    names : tuple of str
        Their names.
    face_plane : (f,) int array
        Index of the plane that each face lies on; -1 on curved parts.
    exact : bool
        The planes are the whole surface (a box): the mesh fills it to machine precision.
    lower, size : (3,) float arrays [m]
        Lower corner and sides of the bounding box.
    upper : (3,) float array [m]
    """

    points: np.ndarray
    faces: np.ndarray
    planes: tuple[Plane, ...]
    widths: tuple[float, ...]
    names: tuple[str, ...]
    face_plane: np.ndarray
    exact: bool
    lower: np.ndarray
    upper: np.ndarray

    @property
    def scale(self):
        """The longest side [m]: the unit of length of the frame."""
        return float((self.upper - self.lower).max())

    @property
    def surface(self):
        """The domain's surface in the frame, as a TriMesh."""
        return TriMesh(self.points, self.faces)

    def to_metres(self, points):
        """Points (n, 3) of the frame in metres."""
        if not self.exact:
            return self.lower + points * self.scale
        sides = self.points.max(axis=0)  # rounded: a factor for each axis keeps the box exact
        return self.lower + points / sides * (self.upper - self.lower)

    def plane_in_metres(self, plane):
        """A plane of the frame in metres; exactly on the bounding box where it touches it."""
        normal = np.asarray(plane.normal)
        axis = int(np.abs(normal).argmax())
        if abs(normal[axis]) == 1.0:
            height = normal[axis] * plane.offset
            top = self.points[:, axis].max()
            if height in (0.0, top):
                where = self.upper if height == top else self.lower
            else:
                where = self.to_metres(np.full((1, 3), height))[0]
            return Plane(plane.normal, float(normal[axis] * where[axis]))
        offset = plane.offset * self.scale + float(normal @ self.lower)
        return Plane(plane.normal, offset)


def frame_of(domain):
    """The frame of a BoxDomain or a SurfaceDomain.

    Raises
    ------
    InvalidCase
        A box without volume, or a surface that is not closed, not manifold, not orientable, or
        cuts itself.
    """
    if isinstance(domain, BoxDomain):
        return _box_frame(domain)
    if isinstance(domain, SurfaceDomain):
        return _surface_frame(domain.surface)
    raise TypeError(f"no such domain: {domain!r}")


def in_frame(length, frame):
    """A length [m] in the frame, rounded as the coordinates are."""
    return float(f"{length / frame.scale:.{DIGITS}g}")


def _box_frame(domain):
    lower, upper = np.asarray(domain.lower, float), np.asarray(domain.upper, float)
    size = upper - lower
    if not (np.isfinite(size).all() and (size > 0).all()):
        raise InvalidCase(
            f"the domain box from {tuple(map(float, lower))} m to {tuple(map(float, upper))} m "
            f"has no volume; every upper bound must be larger than the lower one."
        )
    sides = np.round(size / size.max(), DIGITS)
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], float) * sides
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = np.array([f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))], np.int32)
    patches = box_patches((0.0, 0.0, 0.0), sides)
    planes, names = tuple(p.plane for p in patches), tuple(p.name for p in patches)
    face_plane = np.repeat([0, 1, 2, 3, 4, 5], 2)
    return Frame(corners, faces, planes, (np.inf,) * 6, names, face_plane, True, lower, upper)


def _surface_frame(surface):
    used, faces = np.unique(surface.faces, return_inverse=True)
    corners, faces = surface.points[used], faces.reshape(-1, 3).astype(np.int32)
    _check_closed(corners, faces)
    lower, upper = corners.min(axis=0), corners.max(axis=0)
    points = np.round((corners - lower) / (upper - lower).max(), DIGITS)
    volume = signed_volume(TriMesh(points, faces))
    if abs(volume) <= NO_VOLUME:
        raise InvalidCase("the domain's surface bounds no solid: it encloses no volume.")
    if volume < 0:
        faces = np.ascontiguousarray(faces[:, ::-1])
    planes, widths, face_plane = flat_parts(points, faces)
    names = tuple(f"plane{k + 1}" for k in range(len(planes)))
    return Frame(points, faces, planes, widths, names, face_plane, False, lower, upper)


def _check_closed(points, faces):
    """Raise InvalidCase unless a surface bounds a solid."""
    found = topology(faces, len(points))
    problems = (
        (not len(faces), "no faces: give a closed surface"),
        (int((~np.isfinite(points)).any(axis=1).sum()), "vertices that are NaN or infinite"),
        (found.boundary_edges, "open boundary edges: close its holes"),
        (found.nonmanifold_edges, "edges with more than two faces: make it manifold"),
        (found.nonmanifold_vertices, "vertices where parts of it only touch: separate them"),
        (found.collapsed_faces, "faces with a repeated vertex: remove them"),
        (not found.oriented, "neighbouring faces of opposite orientation: orient it"),
    )
    for count, what in problems:
        if count:
            number = "" if isinstance(count, bool) else f"{count} "
            raise InvalidCase(f"the domain's surface bounds no solid: it has {number}{what}.")
    if not np.ptp(points, axis=0).all():
        raise InvalidCase("the domain's surface bounds no solid: it is flat.")
    crossing = int(self_intersecting_faces(points, faces).sum())
    if crossing:
        raise InvalidCase(
            f"the domain's surface cuts itself in {crossing} faces; repair it in the program it "
            f"comes from."
        )
