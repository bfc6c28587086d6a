"""What `python -m remesh` does with its files."""

import logging
import time
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from cases.remesh_choices import ROUGH, choose_reference, default_sigma, expected_edge
from cases.remesh_picture import draw_before_after
from cases.targets import ALGORITHMS, Target, sigma_length
from meshes import InvalidMesh, NotConverged, TriMesh
from meshes.attributes import interpolate
from meshes.closest_point import two_sided_distance
from meshes.features import find_features
from meshes.io import (
    WITH_POINT_DATA,
    check_surface_suffix,
    read_surface_data,
    write_surface,
)
from meshes.normal_noise import normal_noise
from meshes.quality import surface_quality
from meshes.repair import RepairReport, repair
from meshes.self_intersection import self_intersecting_faces
from meshes.topology import require_valid, topology
from rbf import fit_surfaces
from remesh import RemeshSettings, remesh

LOG = logging.getLogger("phasemesh")

COUNT_TOLERANCE = 0.02
SMOOTHING_PAIRS = {True: 12, False: 8}  # by whether sigma > 0


@dataclass
class Outcome:
    """What was done, for the table and the JSON.

    Parameters
    ----------
    source, destination : str
    options : dict
        As chosen: vertices or edge_length, sigma, reference and so on.
    repair : RepairReport
    before, after : dict
        Figures of both surfaces.
    statistics : dict
        The remesher's own.
    seconds : dict
        By step.
    notes : list of str
    """

    source: str
    destination: str
    options: dict = field(default_factory=dict)
    repair: RepairReport = field(default_factory=RepairReport)
    before: dict = field(default_factory=dict)
    after: dict = field(default_factory=dict)
    statistics: dict = field(default_factory=dict)
    seconds: dict = field(default_factory=dict)
    notes: list = field(default_factory=list)

    @contextmanager
    def timed(self, step):
        """Add the seconds of a step."""
        began = time.perf_counter()
        yield
        self.seconds[step] = self.seconds.get(step, 0.0) + time.perf_counter() - began


def remesh_file(request, reporter):
    """Remesh `request.source` into `request.destination`.

    Parameters
    ----------
    request : cases.remesh_command.Request
    reporter : Reporter

    Returns
    -------
    Outcome
    """
    check_surface_suffix(request.destination)
    outcome = Outcome(str(request.source), str(request.destination))
    with outcome.timed("read"):
        given, data = read_surface_data(request.source)
    reporter.begin("remesh")
    reporter.update("repairing")
    with outcome.timed("repair"):
        surface, outcome.repair = _repaired(request, given)
    with outcome.timed("features"):
        featured = find_features(surface)
    surfaces, settings = _prepared(request, featured, outcome, reporter)
    with outcome.timed("remesh"):
        result = remesh(
            featured,
            surfaces,
            settings,
            rng=np.random.default_rng(request.seed),
            progress=lambda stage, share: reporter.update(stage, round(100 * share), 100),
        )
    outcome.statistics = result.statistics.as_dict()
    _refuse_crossings(request, outcome)
    final = _with_given_labels(result.mesh, featured, surface)
    reporter.update("writing")
    with outcome.timed("write"):
        _write(request, given, data, final, outcome)
    reporter.update("measuring")
    with outcome.timed("measure"):
        _measure(outcome, surface, given, final, settings.sigma)
    if request.picture is not None:
        reporter.update("drawing")
        with outcome.timed("picture"):
            problem = draw_before_after(featured, result.mesh, request.picture)
        outcome.notes += [problem] if problem else []
    outcome.notes += _remarks(outcome)
    for note in outcome.notes:
        reporter.note(note)
    reporter.end(str(request.destination))
    return outcome


def _repaired(request, given):
    """The surface to remesh, and what was mended."""
    try:
        if request.repair:
            surface, report = repair(
                given, fill=request.fill_holes, hold_boundary=request.fix_boundary
            )
        else:
            require_valid(given, closed=False, name="it")
            surface, report = given, _as_it_is(given)
    except InvalidMesh as error:
        raise InvalidMesh(f"{request.source}: {error}") from error
    return surface, report


def _refuse_crossings(request, outcome):
    """Refuse a surface of which faces still cross after repair and remeshing."""
    report, left = outcome.repair, outcome.statistics["self_intersecting_faces"]
    if request.keep_crossings or not (report.crossing_faces and left):
        return
    why = (
        "smoothing does not draw them apart, and they are not of closed pieces to be united"
        if request.repair
        else "--no-repair leaves them"
    )
    raise InvalidMesh(
        f"{request.source}: {report.crossing_faces:,} faces cross others ({why}), and {left:,} of "
        "the result would: mend them, or remesh them all the same with --keep-crossings"
    )


def _as_it_is(surface):
    """The report of a surface that is not to be repaired."""
    holes = topology(surface.faces, len(surface.points)).boundary_loops
    crossing = int(self_intersecting_faces(surface.points, surface.faces).sum())
    return RepairReport(crossed_faces=crossing, holes=holes, crossing_faces=crossing)


def _prepared(request, surface, outcome, reporter):
    """Surfaces (None for the triangles) and settings of the remesher."""
    edge = expected_edge(surface, request.vertices, request.edge_length)
    with outcome.timed("features"):
        noise = normal_noise(surface)
    if request.sigma is None:
        sigma = default_sigma(surface, edge, 0.0 if request.smooth else noise)
    else:
        sigma = sigma_length(request.sigma, surface.diagonal, request.length)
    reference = choose_reference(request, surface, edge)
    surfaces = None
    if reference == "rbf":
        reporter.update("fitting the interpolant")
        with outcome.timed("fit"):
            surfaces, reference = _fitted(request, surface, outcome)
    smoothing = SMOOTHING_PAIRS[sigma > 0.0] if request.smooth else 0
    target = _target(request, surface)
    outcome.options = {
        **target,
        "sigma": sigma,
        "sigma_diagonals": sigma / surface.diagonal if surface.diagonal else 0.0,
        "normal_noise_degrees": float(np.degrees(noise)),
        "reference": reference,
        "algorithm": request.algorithm,
        "iterations": request.iterations,
        "smooth": request.smooth,
        "quality": request.quality,
        "fix_boundary": request.fix_boundary,
        "fill_holes": request.fill_holes,
        "seed": request.seed,
    }
    if noise > ROUGH and not request.smooth:
        outcome.notes.append(
            f"the surface is rough (its normals scatter by {np.degrees(noise):.1f} degrees): "
            "--smooth may give better triangles"
        )
    return surfaces, RemeshSettings(
        **target,
        sigma=sigma,
        iterations=request.iterations,
        algorithm=ALGORITHMS[request.algorithm],
        smoothing=smoothing,
        quality=request.quality,
        fix_boundary=request.fix_boundary,
    )


def _target(request, surface):
    """How fine, in the remesher's terms."""
    longest = request.max_length
    sizing = {
        "min_length": request.min_length,
        "max_length": float("inf") if longest is None else longest,
        "gradation": request.gradation,
    }
    if request.max_error is None:
        return {**Target(request.vertices, request.edge_length).for_surface(surface), **sizing}
    return {
        "max_error": sigma_length(request.max_error, surface.diagonal, request.length),
        "max_normal_angle": request.max_normal_angle,
        "edge_length": request.edge_length,
        **sizing,
    }


def _fitted(request, surface, outcome):
    """The interpolants, or None where they do not converge and nobody insists on them."""
    try:
        return fit_surfaces(surface), "rbf"
    except NotConverged as error:
        if request.reference == "rbf":
            raise
        outcome.notes.append(f"the input's triangles are used, as the interpolant failed: {error}")
        return None, "triangles"


def _with_given_labels(mesh, featured, given):
    """The labels of the input on the result; the patches found where the input had none.

    A patch between features lies in one label of the input.
    """
    if len(given.labels) < 2:
        return mesh
    of_patch = np.zeros(len(featured.labels), dtype=np.int64)
    of_patch[featured.face_labels] = given.face_labels
    labels = of_patch[mesh.face_labels]
    return TriMesh(mesh.points, mesh.faces, labels, given.labels, mesh.feature_edges)


def _write(request, given, data, final, outcome):
    """Write the result with the values of the input at its vertices."""
    suffix = request.destination.suffix.lower()
    keeps = suffix in WITH_POINT_DATA
    if data and not keeps:
        outcome.notes.append(
            f"{suffix[1:].upper()} holds no values at vertices: {', '.join(data)} left out; "
            "write a PLY or VTP to keep them"
        )
    if len(given.labels) > 1 and suffix in (".stl", ".off"):
        outcome.notes.append(
            f"{suffix[1:].upper()} holds no face labels: write a PLY, VTP or OBJ to keep them"
        )
    carried = interpolate(given, data, final.points) if keeps else {}
    write_surface(request.destination, final, point_data=carried)


def _measure(outcome, surface, given, final, sigma):
    """Figures of both surfaces; those before are of the file as it is."""
    weight = sigma if sigma > 0.0 else 0.05 * surface.diagonal
    before = surface_quality(given, sigma=weight, intersections=False).as_dict()
    before["self_intersecting_faces"] = outcome.repair.crossed_faces
    after = surface_quality(final, sigma=weight).as_dict()
    for figures, mesh in ((before, given), (after, final)):
        figures["boundary_loops"] = topology(mesh.faces, len(mesh.points)).boundary_loops
    rms, largest = two_sided_distance(surface, final)
    after["distance_rms"], after["distance_max"] = (
        rms / surface.diagonal,
        largest / surface.diagonal,
    )
    proved = outcome.statistics.get("proved_distance")
    if proved is not None:
        after["distance_proved"] = proved / surface.diagonal
        after["normal_angle_proved"] = outcome.statistics["proved_normal_angle"]
    outcome.before, outcome.after = before, after


def invalid(outcome):
    """What is wrong with the result in a sentence; empty if it is valid."""
    crossing = outcome.after["self_intersecting_faces"]
    against = outcome.statistics.get("inverted_faces")
    words = []
    if crossing and not outcome.repair.crossing_faces:
        words.append(f"{crossing:,} triangles cross others")
    if against:
        words.append(f"{against:,} lie against the surface's normals")
    if not words:
        return ""
    return (
        f"{outcome.destination} is written, but {' and '.join(words)}: "
        "ask for more vertices, or try --smooth"
    )


def _bound_remarks(outcome):
    """What the user should know if an error bound could not be met."""
    asked, proved = outcome.options.get("max_error"), outcome.statistics.get("proved_distance")
    if asked is None or proved <= asked:
        return []
    return [
        f"the error bound of {asked:.4g} is not met: {proved:.4g} is proved; "
        "a shorter --min-length or a larger bound may help"
    ]


def _remarks(outcome):
    """What the user should know about the result."""
    report, after = outcome.repair, outcome.after
    notes = [f"repaired: {'; '.join(report.lines())}"] if report.lines() else []
    asked = outcome.options.get("vertices")
    if asked is not None and abs(after["vertices"] - asked) > COUNT_TOLERANCE * asked:
        limits = outcome.options["min_length"] > 0.0 or outcome.options["max_length"] < np.inf
        why = "the lengths" if limits else "features, the boundary or the triangles' shapes"
        notes.append(
            f"{asked:,} vertices were asked for, {after['vertices']:,} came out: {why} do not "
            f"allow {'fewer' if after['vertices'] > asked else 'more'}"
        )
    notes += _bound_remarks(outcome)
    if after["self_intersecting_faces"] and report.crossing_faces:
        notes.append(
            f"{after['self_intersecting_faces']:,} triangles of the result cross others, as "
            f"{report.crossing_faces:,} of the input do"
        )
    return notes
