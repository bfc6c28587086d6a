"""The meshes of a run's levels, coarse to fine: how fine each is, and where it lies on disk.

The last one is `mesh.npz`, as later stages know it, the others `mesh-level1.npz` ... An adapted
last mesh has to wait for the design of the level before; until then that level's mesh stands in
its place.
"""

import logging

from meshes.io import load_tet_mesh, save_tet_mesh
from topopt.domain import attach_sets, estimated_edge_length, mesh_domain
from topopt.levels import REFINEMENT
from topopt.sizing import interface_sizing

LOG = logging.getLogger("phasemesh")
FEWEST = 20  # tets of a lattice


def make_meshes(run):
    """Make and keep the meshes of all levels, but for an adapted one."""
    section = run.case.mesh
    made = section.levels - section.adapted
    meshes = [mesh_of_level(run, level) for level in range(1, made + 1)]
    run.coarse_meshes = tuple(meshes[: section.levels - 1])
    run.mesh = meshes[-1]
    for level, mesh in enumerate(run.coarse_meshes, 1):
        save_tet_mesh(_path(run, level), mesh)
    save_tet_mesh(run.folder / "mesh.npz", run.mesh)


def load_meshes(run):
    """Read what `make_meshes` (and `adapt_mesh`) kept."""
    levels = range(1, run.case.mesh.levels)
    run.coarse_meshes = tuple(load_tet_mesh(_path(run, level)) for level in levels)
    run.mesh = load_tet_mesh(run.folder / "mesh.npz")


def adapt_mesh(run, design):
    """Make the adapted mesh of the last level for the design (PhaseField) before, and keep it."""
    length = finest_edge_length(run)
    if run.case.mesh.tets is not None:  # the coarse mesh tells how good the estimate is
        count = len(design.mesh.tets) * REFINEMENT**3
        length *= (count / run.case.mesh.tets) ** (1.0 / 3.0)
    LOG.info("the last mesh has edges of %.3g m where the interface is", length)
    run.mesh = _mesh(run, sizing=interface_sizing(design, length))
    save_tet_mesh(run.folder / "mesh.npz", run.mesh)


def mesh_of_level(run, level):
    """The uniform mesh of a level; of a coarse one the count is met roughly."""
    section = run.case.mesh
    factor = REFINEMENT ** (section.levels - level)
    if level == section.levels:
        return _mesh(run, edge_length=section.edge_length, tets=section.tets)
    if section.kind == "bcc" and section.tets is not None:
        return _mesh(run, tets=max(round(section.tets / factor**3), FEWEST))
    return _mesh(run, edge_length=factor * finest_edge_length(run))


def finest_edge_length(run):
    """Edge length [m] of the last level."""
    section = run.case.mesh
    if section.edge_length is not None:
        return section.edge_length
    return estimated_edge_length(run.problem, section.tets)


def _mesh(run, **size):
    section = run.case.mesh
    mesh = mesh_domain(
        run.problem,
        kind=section.kind,
        cache=None if section.cache else False,
        log=LOG.info,
        time_limit=section.time_limit,
        **size,
    )
    return attach_sets(mesh, run.problem)


def _path(run, level):
    return run.folder / f"mesh-level{level}.npz"
