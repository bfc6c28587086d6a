"""Supports, loads and symmetry planes of a problem on the boundary of a mesh.

How partly covered facets count: loads and springs act on exactly the part of the boundary inside
their region, whatever the mesh. A rigid support holds the nodes inside its region, so its edge is
as sharp as the mesh; its facet set has every facet that overlaps the region with positive area.
Facets on a symmetry plane are no boundary of the part: they carry no load and no spring, and a
node that lies on them alone is held by the symmetry only.
"""

from types import MappingProxyType

import numpy as np

from meshes.errors import InvalidCase
from meshes.structured import bcc_box
from topopt.passive import check_passive
from topopt.problem import BoundaryConditions, BoxDomain, CaseConditions, moved
from topopt.regions import clip_triangles, contains, grown, in_words, tolerance_of
from topopt.rigid_motions import describe_motions, free_motions, mesh_components
from topopt.traction import facet_mass, merged_springs, traction_forces


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
        A load, spring or symmetry plane that touches no boundary facet, a zero traction, a support
        that holds no node, supports that contradict each other, names given twice or unknown, or a
        load case in which nothing moves.

    Notes
    -----
    Force and moments of every load are exact on meshes that do not follow its region.
    """
    _check_entries(problem)
    outer = _outer_facets(mesh.points, mesh.facets, problem.symmetry)
    fixed = np.zeros((len(mesh.points), 3), dtype=bool)
    for plane, on_plane in _symmetry_facets(mesh.points, mesh.facets, problem.symmetry):
        fixed[mesh.facets[on_plane], plane.axis] = True
    for support in rigid_supports(problem):
        nodes = _support_nodes(mesh, support, outer)
        fixed[np.ix_(nodes, support.fixed)] = True
    load_forces = {load.name: _load_forces(mesh, load, outer) for load in problem.loads}
    forces = sum(load_forces.values(), np.zeros((len(mesh.points), 3)))
    cases = tuple(
        CaseConditions(
            case.name,
            case.weight,
            sum((load_forces[name] for name in case.loads), np.zeros_like(forces)),
            case.gravity,
            _imposed(mesh, problem, case, outer),
        )
        for case in problem.cases
    )
    _report_idle_forces(load_forces, fixed, log)
    _check_work(cases, fixed, problem)
    for array in (fixed, forces, *load_forces.values(), *(case.forces for case in cases)):
        array.flags.writeable = False
    springs = _springs(mesh, problem, outer)
    return BoundaryConditions(fixed, forces, MappingProxyType(load_forces), cases, springs)


def attach_sets(mesh, problem):
    """The same mesh with the problem's named sets and symmetry planes.

    Facet sets "load:<name>" and "support:<name>" have the facets that overlap the region with
    positive area, "symmetry:<plane>" those on a symmetry plane; node sets "support:<name>" the
    nodes that are held, rigidly or by springs. Raises as `boundary_conditions` does.
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
        facets = _overlapping(mesh, support.region, outer)
        rigid = support.stiffness is None
        nodes = _support_nodes(mesh, support, outer) if rigid else np.unique(mesh.facets[facets])
        node_sets[f"support:{support.name}"] = nodes
        facet_sets[f"support:{support.name}"] = facets
    return mesh.with_sets(facet_sets, node_sets, tuple(problem.symmetry))


def rigid_supports(problem):
    """The supports without a stiffness."""
    return tuple(support for support in problem.supports if support.stiffness is None)


def check_rigid_motions(mesh, problem, fixed, springs=None):
    """Raise InvalidCase, naming every rigid motion that supports and springs leave free.

    Parameters
    ----------
    mesh : TetMesh
        Every connected component is checked by itself.
    problem : Problem
        Whose supports and symmetry planes are named in the sentence.
    fixed : (n, 3) bool array
    springs : Springs, optional
    """
    if springs is not None:
        fixed = fixed.copy()
        fixed[springs.rows] |= springs.blocks > 0.0
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
    check_passive(problem)
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
        if not len(corners) and support.stiffness is not None:
            raise InvalidCase(_no_area(support, points))
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
    """Names are keys of sets, so each may occur once; numbers must make sense."""
    groups = {"load": problem.loads, "support": problem.supports, "load case": problem.load_cases}
    for kind, items in groups.items():
        names = [item.name for item in items]
        for name in sorted({name for name in names if names.count(name) > 1}):
            raise InvalidCase(f"{kind} '{name}' is given twice; give every {kind} its own name.")
    for support in problem.supports:
        _check_support(support)
    for case in problem.load_cases:
        _check_case(case, problem)
    if problem.load_cases:
        _check_all_act(problem)


def _check_support(support):
    if not support.fixed:
        raise InvalidCase(
            f"support '{support.name}' holds no direction; name at least one of x, y, z."
        )
    moved_axes = [axis for axis in range(3) if support.displacement[axis] != 0.0]
    if not np.isfinite(support.displacement).all() or not set(moved_axes) <= set(support.fixed):
        raise InvalidCase(
            f"support '{support.name}' has the displacement {_numbers(support.displacement)} m: "
            f"give three finite numbers, 0 in the directions that it does not hold."
        )
    if support.stiffness is None:
        return
    if not 0.0 < support.stiffness < np.inf:
        raise InvalidCase(
            f"support '{support.name}' has the stiffness {support.stiffness:g} N/m^3: give a "
            f"positive number, or leave it out for a rigid support."
        )
    if moved_axes:
        raise InvalidCase(
            f"support '{support.name}' has a stiffness and a displacement; move a rigid support, "
            f"or load the springs by a traction."
        )


def _check_case(case, problem):
    loads = [load.name for load in problem.loads]
    movable = [support.name for support in moved(problem.supports)]
    for names, known, what in (
        (case.loads, loads, "load"),
        (case.displacements, movable, "support with a displacement"),
    ):
        for name in names:
            if name not in known:
                has = f"there are {_listed(known)}" if known else "there is none at all"
                raise InvalidCase(
                    f"load case '{case.name}' names '{name}', but there is no such {what}; {has}."
                )
    if not 0.0 < case.weight < np.inf:
        raise InvalidCase(
            f"load case '{case.name}' has the weight {case.weight:g}; give a positive number."
        )


def _check_all_act(problem):
    """Raise InvalidCase for a load or an imposed displacement that acts in no load case."""
    acting = {name for case in problem.load_cases for name in (*case.loads, *case.displacements)}
    for item in (*problem.loads, *moved(problem.supports)):
        if item.name not in acting:
            raise InvalidCase(
                f"'{item.name}' acts in no load case; name it in one of "
                f"{_listed([case.name for case in problem.load_cases])}, or leave it out."
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
        clip_triangles(points[faces], grown(support.region, 1e3 * tolerance), tolerance).parent
    ):
        raise InvalidCase(
            f"support '{support.name}' does not touch the domain's boundary: "
            f"{_region_and_domain(support.region, points)}; let its region cover a part of the "
            f"surface (facets on symmetry planes do not count)."
        )
    return (pieces.barycentric @ points[faces][pieces.parent]).reshape(-1, 3)


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


def _imposed(mesh, problem, case, outer):
    """The displacement (n, 3) that a load case imposes, or None if it is zero everywhere.

    Raises InvalidCase where supports or symmetry planes want different values at one node.
    """
    if not case.displacements:
        return None
    wanted = np.full((len(mesh.points), 3), np.nan)
    for plane, on_plane in _symmetry_facets(mesh.points, mesh.facets, problem.symmetry):
        wanted[mesh.facets[on_plane], plane.axis] = 0.0
    for support in rigid_supports(problem):
        acts = support.name in case.displacements
        nodes = _support_nodes(mesh, support, outer)
        for axis in support.fixed:
            value = support.displacement[axis] if acts else 0.0
            earlier = wanted[nodes, axis]
            if np.any(~np.isnan(earlier) & (earlier != value)):
                raise InvalidCase(
                    f"support '{support.name}' moves nodes in {'xyz'[axis]} by {value:g} m that "
                    f"another support or a symmetry plane holds elsewhere; separate their regions, "
                    f"or hold fewer directions."
                )
            wanted[nodes, axis] = value
    return np.nan_to_num(wanted)


def _springs(mesh, problem, outer):
    """The Springs of all elastic supports, or None if there are none."""
    supports = [support for support in problem.supports if support.stiffness is not None]
    if not supports:
        return None
    tolerance, facets = tolerance_of(mesh.points), mesh.facets[outer]
    rows, columns, blocks = [], [], []
    for support in supports:
        pairs, mass = facet_mass(mesh.points, facets, support.region, tolerance)
        if not len(mass):
            raise InvalidCase(_no_area(support, mesh.points))
        directions = np.isin(np.arange(3), support.fixed)
        rows.append(pairs[:, 0])
        columns.append(pairs[:, 1])
        blocks.append(support.stiffness * mass[:, None] * directions)
    return merged_springs(*map(np.concatenate, (rows, columns, blocks)), len(mesh.points))


def _no_area(support, points):
    return (
        f"support '{support.name}' has springs but no area to act on: "
        f"{_region_and_domain(support.region, points)}; let its region cover a part of the "
        f"surface (facets on symmetry planes do not count)."
    )


def _report_idle_forces(load_forces, fixed, log):
    """Tell `log` which loads push on held degrees of freedom."""
    for name, force in load_forces.items():
        total = np.abs(force).sum()
        share = np.abs(force[fixed]).sum() / total
        if share > 0 and log is not None:
            log(
                f"load '{name}': {100 * share:.3g} % of it acts on held degrees of freedom and "
                f"goes straight into the supports."
            )


def _check_work(cases, fixed, problem):
    """Raise InvalidCase for a load case in which nothing acts on anything that can move."""
    for case in cases:
        weighs = case.gravity and np.any(problem.gravity)
        if weighs or case.displacement is not None or np.any(case.forces[~fixed]):
            continue
        if not problem.load_cases and not problem.loads:
            continue
        where = f"load case '{case.name}': " if problem.load_cases else ""
        if not np.any(case.forces):
            raise InvalidCase(f"{where}nothing acts in it; name a load or a displacement.")
        raise InvalidCase(
            f"{where}all loads act on held degrees of freedom only, so nothing deforms; move the "
            f"loads off the supports, or hold fewer directions."
        )


def _region_and_domain(region, points):
    domain = " x ".join(_span(points, axis) for axis in range(3))
    return f"its region is {in_words(region)}, the domain spans {domain} m"


def _span(points, axis):
    return f"[{points[:, axis].min():.6g}, {points[:, axis].max():.6g}]"


def _numbers(values):
    return "(" + ", ".join(f"{value:g}" for value in values) + ")"


def _listed(words):
    return ", ".join(words[:-1]) + " and " + words[-1] if len(words) > 1 else "".join(words)
