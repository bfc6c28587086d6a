"""A frame that moves with the surface, so that results do not depend on how it lies.

Roundings of 1e-16 decide which of two nearly equal edges is collapsed first, and everything after
it. So the recipe works in a frame of the surface's own: its centroid, its root mean square radius,
its principal axes, coordinates rounded to a grid. A surface that was moved, turned or scaled then
is the same surface, bit for bit. Third moments say which way the axes point; where a surface is as
good as symmetric, and where moments are nearly equal, the order of its faces decides instead.

Of 120,000 coordinates that are off by 5e-16 radii one is rounded to another number in one case of
a hundred. The rounding itself is a tenth of that of a file in single precision.
"""

from dataclasses import dataclass, replace

import numpy as np

from meshes.patch import Patch, Plane
from meshes.quality import area_vectors, normalised
from meshes.tri_mesh import TriMesh
from remesh.dense import refined_with
from remesh.finish import on_plane
from remesh.layout import compacted

GRID = 2.0**-26  # of the root mean square radius
DIGITS = 2.0**36  # of lengths in the settings
SEPARATED = 0.01  # least difference of principal moments, of their sum
LEANING, ARM = 1e-3, 1e-5  # least third moment, and least mean by the order of faces, in radii
REACH = 1.0  # cells within which a coordinate is one that points of the input share
FACTORS = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9)  # odd, of no pattern
LENGTHS = ("edge_length", "sigma", "min_length", "max_length")


@dataclass(frozen=True, eq=False)
class Frame:
    """Where a surface's own frame is: x = centre + size * (y @ axes).

    Parameters
    ----------
    centre : (3,) float array [unit of the points]
    size : float [unit of the points]
    axes : (3, 3) float array
        Rows are unit vectors, right-handed.
    """

    centre: np.ndarray
    size: float
    axes: np.ndarray

    def coordinates(self, points):
        """Points (n, 3) in the frame."""
        return turned((points - self.centre) / self.size, self.axes.T)

    def places(self, coordinates):
        """Where points are that have coordinates (n, 3) in the frame."""
        return self.centre + self.size * turned(coordinates, self.axes)

    def settings(self, settings):
        """The settings with all lengths in the frame's unit."""
        return replace(
            settings,
            **{name: self._length(getattr(settings, name)) for name in LENGTHS},
        )

    def _length(self, length):
        """A length in the frame's unit, rounded; None and infinity stay."""
        if length is None or length == np.inf:
            return length
        mantissa, exponent = np.frexp(length / self.size)
        return float(np.ldexp(np.rint(mantissa * DIGITS) / DIGITS, exponent))


@dataclass(frozen=True, eq=False)
class FramedMesh:
    """A mesh and its copy on the grid of a frame.

    Parameters
    ----------
    frame : Frame
    given : TriMesh
    mesh : TriMesh
        The copy, with the same faces; planar labels have the plane that fits the copy's points.
    rest : (n, 3) float array
        What rounding took from the coordinates.
    """

    frame: Frame
    given: TriMesh
    mesh: TriMesh
    rest: np.ndarray

    def refined(self, longest, fix_boundary):
        """The FramedMesh with its faces cut until no edge is longer (see `dense.refined`)."""
        mesh, rest = refined_with(self.mesh, longest, fix_boundary, self.rest)
        before = len(self.rest)
        more = self.frame.places(mesh.points[before:] + rest[before:])
        points = np.concatenate([self.given.points, more])
        labels, edges = self.given.labels, mesh.feature_edges
        given = TriMesh(points, mesh.faces, mesh.face_labels, labels, edges)
        return FramedMesh(self.frame, given, mesh, rest)

    def restored(self, result, feet, hold):
        """A mesh made of the copy, where the given mesh is.

        Parameters
        ----------
        result : TriMesh
        feet : (faces, weights)
            Of the copy, below each point: (k,) int array, and barycentric (k, 3) float array.
        hold : bool
            Whether points that were not moved come before the planes of planar labels, of which
            they may lie off a little.

        Returns
        -------
        TriMesh
            What rounding took is given back. Points of the copy are those of the given mesh bit by
            bit, coordinates that some of its points share are shared exactly, planar labels are
            exactly in their plane.
        """
        rest = np.einsum("pk,pki->pi", feet[1], self.rest[self.mesh.faces[feet[0]]])
        points = self.frame.places(result.points + rest)
        with_shared_coordinates(points, self.given.points, REACH * GRID * self.frame.size)
        kept, source = same_points(self.mesh.points, result.points)
        points[kept] = self.given.points[source]
        for label, patch in enumerate(self.given.labels):
            if patch.plane is not None:
                vertices = np.unique(result.faces[result.face_labels == label])
                points[vertices] = on_plane(points[vertices], patch.plane)
        if hold:
            points[kept] = self.given.points[source]
        labels = self.given.labels
        return TriMesh(points, result.faces, result.face_labels, labels, result.feature_edges)


def framed(mesh, frame=None):
    """The FramedMesh of a mesh in its own frame or in one given; None if it has no extent."""
    mesh = compacted(mesh)
    frame = own_frame(mesh) if frame is None else frame
    if frame is None:
        return None
    exact = frame.coordinates(mesh.points)
    points = GRID * np.rint(exact / GRID)
    labels = tuple(
        patch if patch.plane is None
        else Patch(patch.name, plane_through(points, mesh.faces[mesh.face_labels == label]))
        for label, patch in enumerate(mesh.labels)
    )  # fmt: skip
    copy = TriMesh(points, mesh.faces, mesh.face_labels, labels, mesh.feature_edges)
    return FramedMesh(frame, mesh, copy, exact - points)


def own_frame(mesh):
    """The Frame of a mesh without unused points; None if all points are one.

    Scaling by powers of two scales it without roundings.
    """
    low = mesh.points[0]
    _, exponent = np.frexp(np.abs(mesh.points - low).max())
    unit = float(np.ldexp(1.0, exponent))
    points = np.ascontiguousarray(((mesh.points - low) / unit).T)
    centre = points.mean(axis=1)
    arms = points - centre[:, None]
    moments = np.array([[(one * other).mean() for one in arms] for other in arms])  # in pairs
    size = np.sqrt(np.trace(moments))
    if not size > 0.0:
        return None
    axes = own_axes(arms / size, moments / size**2, mesh.faces)
    return Frame(low + unit * centre, unit * float(size), axes)


def own_axes(arms, moments, faces):
    """Axes (3, 3) of a surface, as rows: right-handed, along its principal axes if it has them.

    Parameters
    ----------
    arms : (3, n) float array
        From the centroid to the points; their root mean square is 1.
    moments : (3, 3) float array
    faces : (m, 3) int array
    """
    values, vectors = np.linalg.eigh(moments)
    if np.diff(values).min() < SEPARATED:
        return axes_along(by_order(arms, faces, 1), by_order(arms, faces, 2))
    axes = np.empty((3, 3))
    for k in range(2):
        axis = vectors[:, k]
        along = axis[0] * arms[0] + axis[1] * arms[1] + axis[2] * arms[2]
        lean = (along * along * along).mean()
        if abs(lean) < LEANING:
            lean = (by_order(arms, faces, 1) * axis).sum()
        axes[k] = -axis if lean < 0.0 else axis
    axes[2] = np.cross(axes[0], axes[1])
    return axes


def by_order(arms, faces, power):
    """Mean (3,) of the arms of faces' first points, weighted by the faces' order.

    By a power of it, and by the fractional parts of irrational multiples of its square: no order
    that a shape's symmetry could come with makes both vanish.
    """
    order = np.arange(len(faces))
    weights = (order / len(faces) - 0.5) ** power + np.modf(np.sqrt(1.0 + power) * order**2)[0]
    return (weights * arms[:, faces[:, 0]]).mean(axis=1)


def axes_along(first, second):
    """Axes (3, 3) along one vector and beside another; the given ones if these are too short."""
    length = np.sqrt((first**2).sum())
    if length < ARM:
        return np.eye(3)
    first = first / length
    second = second - (first * second).sum() * first
    length = np.sqrt((second**2).sum())
    if length < ARM:
        return np.eye(3)
    second = second / length
    return np.stack([first, second, np.cross(first, second)])


def turned(points, matrix):
    """points (n, 3) @ matrix (3, 3), with the same roundings for every point."""
    return points[:, :1] * matrix[0] + points[:, 1:2] * matrix[1] + points[:, 2:] * matrix[2]


def plane_through(points, faces):
    """The plane amid the points of faces (m, 3), along their mean normal."""
    normal = normalised(area_vectors(points, faces).sum(axis=0))
    distance = (points[np.unique(faces)] * normal).sum(axis=1)
    offset = 0.5 * (distance.min() + distance.max()) if len(faces) else 0.0
    return Plane(tuple(float(x) for x in normal), float(offset))


def with_shared_coordinates(points, given, reach):
    """Give points (n, 3) the coordinates that three given points share, where these are near.

    Planes across the axes, and curves in them, thus stay what they are.
    """
    for k in range(3):
        values = np.sort(given[:, k])
        shared = np.unique(values[2:][values[2:] == values[:-2]])
        if len(shared) == 0:
            continue
        index = np.searchsorted(0.5 * (shared[1:] + shared[:-1]), points[:, k])
        near = np.abs(shared[index] - points[:, k]) <= reach
        points[near, k] = shared[index[near]]


def same_points(points, others):
    """Which of `others` (k,) are among `points` on the grid, and which point each of them is."""
    candidates = np.flatnonzero((GRID * np.rint(others / GRID) == others).all(axis=1))
    sought, numbers = numbered(others[candidates]), numbered(points)
    ordered = np.append(np.sort(sought), np.uint64(0))
    possible = np.flatnonzero(ordered[np.searchsorted(ordered[:-1], numbers)] == numbers)
    possible = possible[np.argsort(numbers[possible], kind="stable")]
    found = np.searchsorted(numbers[possible], sought)
    known = found < len(possible)
    candidates, index = candidates[known], possible[found[known]]
    same = (points[index] == others[candidates]).all(axis=1)
    return candidates[same], index[same]


def numbered(points):
    """One number (n,) for the cell of each point (n, 3), hardly ever the same for two cells."""
    cells = np.rint(points / GRID).astype(np.int64).view(np.uint64)
    return (cells * np.array(FACTORS, np.uint64)).sum(axis=1, dtype=np.uint64)
