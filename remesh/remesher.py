"""The remesher's one public function."""

from dataclasses import asdict, dataclass, replace

import numpy as np

from meshes import TriMesh
from meshes.edges import edge_table
from meshes.quality import face_areas
from remesh.adjust import match_volume
from remesh.bounded import remesh_within
from remesh.carrier import CORNER_ANGLE, curves_of
from remesh.dense import refined, with_hidden_shapes
from remesh.fidelity import ImplicitFidelity, TriangleFidelity
from remesh.finish import finished_mesh, repair
from remesh.frame import framed
from remesh.halfedge import WorkMesh
from remesh.layout import make_layout, require_finite, row_normals
from remesh.prepare import implicit_carrier, smoothed_carrier, surfaces_by_label
from remesh.recipe import choose_recipe, first_length, run_recipe
from remesh.settings import RemeshSettings
from remesh.shape_kernels import enclosed_volume
from remesh.thesis import run_thesis
from remesh.triangle_surface import TriangleSurface

SLIVER_FRACTION = {True: 0.35, False: 0.5}  # of the mean edge, by whether sigma > 0
NORMAL_BLEND = {True: 0.4, False: 0.5}


@dataclass(frozen=True)
class RemeshStatistics:
    """What was done and how it came out.

    Parameters
    ----------
    vertices_before, vertices, faces : int
    edge_length : float [unit of the points]
        The 6D edge length the result was made for.
    sigma : float [unit of the points]
    volume_drift : float or None
        Relative change of the volume; None for open surfaces.
    inverted_faces : int
        Triangles that disagree with the surface's exact normal at a corner.
    self_intersecting_faces : int
        Triangles that meet others, and could not be separated.
    proved_distance : float or None [unit of the points]
        With `max_error`: no point of the result or of the surface is farther from the other.
    proved_normal_angle : float or None [degrees]
        With `max_error`: every point of either has a point of the other, as near as that, whose
        normal differs by no more.
    """

    vertices_before: int
    vertices: int
    faces: int
    edge_length: float
    sigma: float
    volume_drift: float | None
    inverted_faces: int
    self_intersecting_faces: int
    proved_distance: float | None = None
    proved_normal_angle: float | None = None

    def as_dict(self):
        """The figures by name."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class RemeshResult:
    """The new surface, with the labels and feature edges of the old one, and statistics."""

    mesh: TriMesh
    statistics: RemeshStatistics


def remesh(mesh, surfaces=None, settings=None, rng=None, progress=None):
    """Remesh a surface with triangles that are even in the six-dimensional embedding.

    Parameters
    ----------
    mesh : TriMesh
        Manifold and oriented; closed or open. Its feature edges, label boundaries and open
        boundaries are kept as curves; where they end, meet or turn sharply, as corners.
    surfaces : ImplicitSurface, sequence of ImplicitSurface (one per label), or None
        What the result lies on: interpolants, or a `TriangleSurface` (None: that of `mesh`) for
        the input's own triangles. Planar labels are kept in their plane.
    settings : RemeshSettings, optional
        Default: as many vertices as the input has.
    rng : numpy.random.Generator, optional
        Draws the vertices that algorithm "thesis" smooths; seeded with 0 if not given.
    progress : callable, optional
        Called as progress(stage, share done).

    Returns
    -------
    RemeshResult

    Raises
    ------
    InvalidMesh
        If the input has no faces, NaN points, or is not an oriented manifold.

    Notes
    -----
    Thesis sections 2.4, 2.5 and 3.5; `docs/deviations.md` says what differs.
    """
    settings = RemeshSettings() if settings is None else settings
    progress = (lambda stage, share: None) if progress is None else progress
    rng = np.random.default_rng(0) if rng is None else rng
    require_finite(mesh)
    if settings.vertices is None and settings.edge_length is None and settings.max_error is None:
        settings = replace(settings, vertices=max(len(np.unique(mesh.faces)), 4))
    if framable(surfaces, settings):
        return remeshed_in_frame(mesh, surfaces, settings, rng, progress)
    return remeshed(mesh, surfaces, settings, rng, progress)


def framable(surfaces, settings):
    """Whether the result is to be found in the surface's own frame."""
    triangles = surfaces is None or isinstance(surfaces, TriangleSurface)
    return triangles and settings.algorithm == "pliant" and settings.max_error is None


def remeshed_in_frame(mesh, surfaces, settings, rng, progress):
    """See `remesh`; for triangles as the surface."""
    inside = framed(mesh)
    if inside is None:
        return remeshed(mesh, surfaces, settings, rng, progress)
    frame, inner = inside.frame, inside.frame.settings(settings)
    longest = longest_allowed(inside.mesh, inner)
    if longest < np.inf:
        inside = inside.refined(longest, settings.fix_boundary)
    below, smoothing = inside, 0
    if surfaces is not None:
        source, smoothing = surfaces.source, surfaces.normal_smoothing
        if source is not mesh and longest == np.inf:
            below = framed(getattr(source, "mesh", source), frame)
    surface = TriangleSurface(below.mesh, smoothing)
    found = remeshed(inside.mesh, surface, inner, rng, progress, below)
    length = frame.size * found.statistics.edge_length
    return replace(
        found, statistics=replace(found.statistics, edge_length=length, sigma=settings.sigma)
    )


def remeshed(mesh, surfaces, settings, rng, progress, below=None):
    """See `remesh`; the mesh and all lengths as they are.

    below : FramedMesh, optional
        The triangles that are the surface, if all is in a frame that the result is to leave.
    """
    if below is None:
        mesh, surfaces = fine_enough(mesh, surfaces, settings)
    layout = layout_of(mesh, surfaces)
    mesh = layout.mesh
    if settings.max_error is not None:
        return conclude_within(layout, surfaces, settings, progress)
    if surfaces is None:
        surfaces = TriangleSurface(layout)
    if isinstance(surfaces, TriangleSurface):
        carrier, gaps = triangle_start(surfaces, settings)
    else:
        by_label = surfaces_by_label(mesh, surfaces)
        if settings.algorithm != "thesis":
            layout = with_all_shapes(layout, by_label, aimed_edge(mesh, settings))
            mesh = layout.mesh
        carrier = implicit_carrier(layout, by_label, settings.corner_angle)
        gaps = ImplicitFidelity(by_label)
    progress("carrier", 1.0)
    volume = enclosed_volume(mesh.points, mesh.faces) if layout.closed else None
    work = WorkMesh(carrier, settings.vertices or 0, settings.fix_boundary)
    if settings.algorithm == "thesis":
        length = run_thesis(work, gaps, settings, rng, progress)
    else:
        recipe = choose_recipe(settings, mesh, settings.smoothing > 0)
        length = run_recipe(
            work, gaps, recipe, settings, volume, first_length(work, recipe, settings),
            settings.vertices, progress,
        )  # fmt: skip
    return conclude(layout, work, gaps, settings, (length, volume, below), progress)


def conclude_within(layout, surfaces, settings, progress):
    """The result within an error bound, and its statistics."""
    mesh = layout.mesh
    found = remesh_within(mesh, surfaces, settings, progress)
    progress("finished", 1.0)
    return concluded(
        layout, found.mesh, settings, found.crossing, found.inverted,
        edge_length=mean_edge(found.mesh),
        proved_distance=found.distance,
        proved_normal_angle=found.normal_angle,
    )  # fmt: skip


def concluded(layout, result, settings, crossing, inverted, **figures):
    """The RemeshResult of a mesh: its counts, what is wrong with it, and other figures."""
    mesh, drift = layout.mesh, None
    volume = enclosed_volume(mesh.points, mesh.faces) if layout.closed else 0.0
    if volume != 0.0:
        drift = enclosed_volume(result.points, result.faces) / volume - 1.0
    statistics = RemeshStatistics(
        vertices_before=len(mesh.points),
        vertices=len(result.points),
        faces=len(result.faces),
        sigma=settings.sigma,
        volume_drift=drift,
        self_intersecting_faces=crossing,
        inverted_faces=inverted,
        **figures,
    )
    return RemeshResult(result, statistics)


def mean_edge(mesh):
    """Mean edge length of a mesh."""
    ends = mesh.points[edge_table(mesh.faces).edges]
    return float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).mean())


def layout_of(mesh, surfaces):
    """The Layout of a mesh: its triangle surface's, if that is what was handed in."""
    if isinstance(surfaces, TriangleSurface) and surfaces.source is mesh:
        return surfaces.layout
    return make_layout(mesh)


def longest_allowed(mesh, settings):
    """Length from which on edges of the input are cut first; infinite without a field of sizes and
    without a longest length: the mesh then may be as coarse as it is."""
    longest = settings.max_length
    if settings.max_error is None:
        longest = np.inf if settings.gradation is None else aimed_edge(mesh, settings)
    return np.inf if settings.smoothing > 0 else longest


def fine_enough(mesh, surfaces, settings):
    """Mesh and surfaces, the mesh's faces cut where edges are longer than allowed."""
    longest = longest_allowed(mesh, settings)
    if longest == np.inf:
        return mesh, surfaces
    mesh = refined(mesh, longest, settings.fix_boundary)
    if isinstance(surfaces, TriangleSurface) and surfaces.source is not mesh:
        surfaces = None
    return mesh, surfaces


def with_all_shapes(layout, surfaces, length):
    """The Layout, with more vertices where surfaces are not what the vertices' normals tell."""
    normals = row_normals(layout)[layout.group]
    mesh = with_hidden_shapes(layout.mesh, normals, surfaces, length)
    return layout if mesh is layout.mesh else make_layout(mesh)


def aimed_edge(mesh, settings):
    """Length of the edges that are aimed at, were sigma 0."""
    if settings.edge_length is not None:
        return settings.edge_length
    area = face_areas(mesh.points, mesh.faces).sum()
    return float(np.sqrt(2.0 * area / (np.sqrt(3.0) * settings.vertices)))


def triangle_start(surface, settings):
    """Carrier and fidelity for the input's own triangles as the surface."""
    faces = len(surface.carrier.mesh.faces)
    if settings.smoothing == 0:
        carrier = surface.carrier
        if settings.corner_angle != CORNER_ANGLE:
            curves = curves_of(carrier.layout, carrier.normals, settings.corner_angle)
            carrier = replace(carrier, curves=curves)
        return carrier, TriangleFidelity(surface.carrier, np.arange(faces))
    embedded = settings.sigma > 0.0
    carrier, hints = smoothed_carrier(
        surface, settings.smoothing, SLIVER_FRACTION[embedded], NORMAL_BLEND[embedded],
        settings.corner_angle,
    )  # fmt: skip
    return carrier, TriangleFidelity(surface.carrier, hints)


def conclude(layout, work, gaps, settings, found, progress):
    """The result and its statistics, checked against the exact normals.

    found : the 6D edge length, the input's volume (None if open), a FramedMesh or None
    """
    length, volume, below = found
    work.compact()
    crossing, inverted, rounds = repair(work, gaps)
    if rounds > 0 and volume is not None and settings.fit and settings.algorithm == "pliant":
        match_volume(work, volume)
    result = finished_mesh(work, layout.mesh)
    found = concluded(layout, result, settings, crossing, inverted, edge_length=float(length))
    if below is not None:
        result, _ = work.to_mesh()
        feet = gaps.feet(result, work)
        found = replace(found, mesh=below.restored(result, feet, settings.fix_boundary))
    progress("finished", 1.0)
    return found
