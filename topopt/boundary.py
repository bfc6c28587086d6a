"""Supports, loads and symmetry planes of a problem on the boundary of a mesh.

How partly covered facets count: a load acts on exactly the part of the boundary inside its region,
whatever the mesh. A support holds the nodes inside its region, so its edge is as sharp as the
mesh; its facet set has every facet that overlaps the region with positive area. Facets on a
symmetry plane are no boundary of the part: they carry no load, and a node that lies on them alone
is held by the symmetry only.
"""

from types import MappingProxyType

import numpy as np

from meshes.errors import InvalidCase
from meshes.structured import bcc_box
from topopt.problem import BoundaryConditions, Box, BoxDomain
from topopt.regions import clip_triangles, contains, tolerance_of
from topopt.rigid_motions import describe_motions, free_motions, mesh_components
from topopt.traction import traction_forces


def boundary_conditions(mesh, problem, log=None):
    """Held degrees of freedom and consistent nodal forces of a problem on a mesh.

    Parameters
    ----------
    mesh : TetMesh
    problem : Problem
    log : callable taking a str, optional
        Told what share of a load acts on held degrees of freedom, and so does no work.

    Returns
    -------
    BoundaryConditions
        The forces are the loads' in full, at held degrees of freedom too.

    Raises
    ------
    InvalidCase
        A load or a symmetry plane that touches no boundary facet, a zero traction, a support that
        holds no node, or names given twice.

    Notes
    -----
    Force and moments of every load are exact on meshes that do not follow its region.
    """
    _check_entries(problem)
    outer = _outer_facets(mesh.points, mesh.facets, problem.symmetry)
    fixed = np.zeros((len(mesh.points), 3), dtype=bool)
    for plane, on_plane in _symmetry_facets(mesh.points, mesh.facets, problem.symmetry):
        fixed[mesh.facets[on_plane], plane.axis] = True
    for support in problem.supports:
        nodes = _support_nodes(mesh, support, outer)
        fixed[np.ix_(nodes, support.fixed)] = True
    load_forces = {load.name: _load_forces(mesh, load, outer) for load in problem.loads}
    forces = sum(load_forces.values(), np.zeros((len(mesh.points), 3)))
    _report_idle_forces(load_forces, forces, fixed, problem, log)
    for array in (fixed, forces, *load_forces.values()):
        array.flags.writeable = False
    return BoundaryConditions(fixed, forces, MappingProxyType(load_forces))


def attach_sets(mesh, problem):
    """The same mesh with the problem's named sets and symmetry planes.

    Facet sets "load:<name>" and "support:<name>" have the facets that overlap the region with
    positive area, "symmetry:<plane>" those on a symmetry plane; node sets "support:<name>" the
    nodes that are held. Raises as `boundary_conditions` does.
    """
    _check_entries(problem)
    outer = _outer_facets(mesh.points, mesh.facets, problem.symmetry)
    facet_sets, node_sets = {}, {}
    for plane, on_plane in _symmetry_facets(mesh.points, mesh.facets, problem.symmetry):
        facet_sets[f"symmetry:{plane.name}"] = on_plane
    for load in problem.loads:
        _load_forces(mesh, load, outer)
        facet_sets[f"load:{load.name}"] = _overlapping(mesh, load.region, outer)
    for support in problem.supports:
        node_sets[f"support:{support.name}"] = _support_nodes(mesh, support, outer)
        facet_sets[f"support:{support.name}"] = _overlapping(mesh, support.region, outer)
    return mesh.with_sets(facet_sets, node_sets, tuple(problem.symmetry))


def check_rigid_motions(mesh, problem, fixed):
    """Raise InvalidCase, naming every rigid motion that the held degrees of freedom leave free.

    Parameters
    ----------
    mesh : TetMesh
        Every connected component is checked by itself.
    problem : Problem
        Whose supports and symmetry planes are named in the sentence.
    fixed : (n, 3) bool array
    """
    count, component = mesh_components(mesh)
    for k in range(count):
        here = component == k
        where = f"part {k + 1} of {count} of the domain: " if count > 1 else ""
        _check_held(mesh.points[here], fixed[here], problem, where)


def check_problem(problem):
    """Find what is wrong with a problem's loads, supports and symmetry before it is meshed.

    The checks of `boundary_conditions` and `check_rigid_motions` on the domain's own surface,
    with the corners of the supported areas as held nodes. Supports on an edge or a point alone
    cannot be judged without the mesh; then the rigid motions are left to it.

    Raises
    ------
    InvalidCase
    """
    _check_entries(problem)
    points, faces = _domain_surface(problem.domain)
    outer = _outer_facets(points, faces, problem.symmetry)
    for load in problem.loads:
        _patch_forces(points, faces, load, outer)
    held = [
        (points[faces[on_plane]].reshape(-1, 3), (plane.axis,))
        for plane, on_plane in _symmetry_facets(points, faces, problem.symmetry)
    ]
    for support in problem.supports:
        corners = _supported_corners(points, faces[outer], support)
        if not len(corners):
            return
        held.append((corners, support.fixed))
    fixed = np.zeros((sum(len(corners) for corners, _ in held), 3), dtype=bool)
    start = 0
    for corners, axes in held:
        fixed[start : start + len(corners), list(axes)] = True
        start += len(corners)
    nodes = np.concatenate([points, *(corners for corners, _ in held)])
    _check_held(nodes, np.concatenate([np.zeros(points.shape, bool), fixed]), problem, "")


def _check_entries(problem):
    """Names of loads and of supports are keys of sets: each may occur once."""
    for kind, items in (("load", problem.loads), ("support", problem.supports)):
        names = [item.name for item in items]
        for name in sorted({name for name in names if names.count(name) > 1}):
            raise InvalidCase(f"{kind} '{name}' is given twice; give every {kind} its own name.")
    for support in problem.supports:
        if not support.fixed:
            raise InvalidCase(
                f"support '{support.name}' holds no direction; name at least one of x, y, z."
            )


def _domain_surface(domain):
    """Points and outward triangles of the domain's boundary."""
    if isinstance(domain, BoxDomain):
        mesh = bcc_box(domain.lower, domain.upper, (1, 1, 1))
        return mesh.points, mesh.facets
    return domain.surface.points, domain.surface.faces


def _symmetry_facets(points, facets, symmetry):
    """Pairs of a symmetry plane and the indices of the facets that lie on it.

    Raises InvalidCase for a plane that has none, or that has domain on both sides.
    """
    tolerance, found = tolerance_of(points), []
    for plane in symmetry:
        distance = points[:, plane.axis] - plane.offset
        on_plane = np.flatnonzero((np.abs(distance) <= tolerance)[facets].all(axis=1))
        span = f"the domain spans {_span(points, plane.axis)}"
        if distance.min() < -tolerance and distance.max() > tolerance:
            raise InvalidCase(
                f"symmetry plane {plane.name} cuts through the domain: {span} m; give the domain "
                f"of one half only, or leave the plane out."
            )
        if not len(on_plane):
            raise InvalidCase(
                f"symmetry plane {plane.name} touches no flat face of the domain: {span} m; "
                f"move the plane to the face where the part is to be mirrored."
            )
        found.append((plane, on_plane))
    return found


def _outer_facets(points, facets, symmetry):
    """Indices of the facets that are boundary of the whole part: those on no symmetry plane."""
    outer = np.ones(len(facets), dtype=bool)
    for _, on_plane in _symmetry_facets(points, facets, symmetry):
        outer[on_plane] = False
    return np.flatnonzero(outer)


def _load_forces(mesh, load, outer):
    return _patch_forces(mesh.points, mesh.facets, load, outer)


def _patch_forces(points, facets, load, outer):
    """Nodal forces (n, 3) of a load on the facets `outer`; InvalidCase if there is none."""
    if not np.isfinite(load.traction).all() or not np.any(load.traction):
        raise InvalidCase(
            f"load '{load.name}' has the traction {_numbers(load.traction)} Pa: give three finite "
            f"numbers, not all zero, or leave the load out."
        )
    tolerance = tolerance_of(points)
    forces, area = traction_forces(points, facets[outer], load.region, load.traction, tolerance)
    if not area > 0:
        raise InvalidCase(
            f"load '{load.name}' touches no boundary facet of the domain: "
            + _region_and_domain(load.region, points)
            + "; let its region cover a part of the surface (facets on symmetry planes do not "
            "count)."
        )
    return forces


def _support_nodes(mesh, support, outer):
    """Nodes (k,) that a support holds; InvalidCase if there is none."""
    nodes = np.unique(mesh.facets[outer])
    inside = contains(support.region, mesh.points[nodes], tolerance_of(mesh.points))
    if not inside.any():
        between = len(_overlapping(mesh, support.region, outer))
        advice = (
            "it lies between the nodes: refine the mesh or enlarge the region"
            if between
            else "let its region cover a part of the surface (facets on symmetry planes do not "
            "count)"
        )
        raise InvalidCase(
            f"support '{support.name}' holds no node of the domain's boundary: "
            f"{_region_and_domain(support.region, mesh.points)}; {advice}."
        )
    return nodes[inside]


def _overlapping(mesh, region, outer):
    """Indices (k,) of the facets in `outer` that overlap a region with positive area."""
    corners = mesh.points[mesh.facets[outer]]
    return outer[np.unique(clip_triangles(corners, region, tolerance_of(mesh.points)).parent)]


def _supported_corners(points, faces, support):
    """Corners (k, 3) of the supported area: none if it is an edge or a point; InvalidCase if the
    region does not even touch the surface."""
    tolerance = tolerance_of(points)
    pieces = clip_triangles(points[faces], support.region, tolerance)
    if not len(pieces.parent) and not len(
        clip_triangles(points[faces], _grown(support.region, 1e3 * tolerance), tolerance).parent
    ):
        raise InvalidCase(
            f"support '{support.name}' does not touch the domain's boundary: "
            f"{_region_and_domain(support.region, points)}; let its region cover a part of the "
            f"surface (facets on symmetry planes do not count)."
        )
    return (pieces.barycentric @ points[faces][pieces.parent]).reshape(-1, 3)


def _grown(region, margin):
    lower, upper = np.asarray(region.lower), np.asarray(region.upper)
    return Box(tuple(lower - margin), tuple(upper + margin))


def _check_held(points, fixed, problem, where):
    """Raise InvalidCase if held degrees of freedom leave a rigid motion of the points free."""
    motions = describe_motions(points, *free_motions(points, fixed))
    if not motions:
        return
    holders = [f"support '{support.name}'" for support in problem.supports]
    holders += [f"symmetry plane {plane.name}" for plane in problem.symmetry]
    raise InvalidCase(
        f"{where}the part is not held: {_listed(holders) or 'no support at all'} "
        f"{'leave' if len(holders) != 1 else 'leaves'} {len(motions)} rigid "
        f"{'motions' if len(motions) > 1 else 'motion'} free ({'; '.join(motions)}); add a "
        f"support, hold more directions, or use a symmetry plane."
    )


def _report_idle_forces(load_forces, forces, fixed, problem, log):
    """Tell `log` which loads push on held degrees of freedom; InvalidCase if all of them do."""
    for name, force in load_forces.items():
        total = np.abs(force).sum()
        share = np.abs(force[fixed]).sum() / total
        if share > 0 and log is not None:
            log(
                f"load '{name}': {100 * share:.3g} % of it acts on held degrees of freedom and "
                f"goes straight into the supports."
            )
    idle = problem.loads and not np.any(forces[~fixed])
    if idle and not np.any(problem.gravity):
        raise InvalidCase(
            "all loads act on held degrees of freedom only, so nothing deforms; move the loads "
            "off the supports, or hold fewer directions."
        )


def _region_and_domain(region, points):
    domain = " x ".join(_span(points, axis) for axis in range(3))
    return f"its region is {_spans(region)} m, the domain spans {domain} m"


def _spans(region):
    return " x ".join(f"[{a:.6g}, {b:.6g}]" for a, b in zip(region.lower, region.upper))


def _span(points, axis):
    return f"[{points[:, axis].min():.6g}, {points[:, axis].max():.6g}]"


def _numbers(values):
    return "(" + ", ".join(f"{value:g}" for value in values) + ")"


def _listed(words):
    return ", ".join(words[:-1]) + " and " + words[-1] if len(words) > 1 else "".join(words)
