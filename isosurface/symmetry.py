"""Which nodes, facets and vertices lie on the symmetry planes."""

import numpy as np

from meshes import InvalidMesh

# Share of the bounding box's diagonal within which a point counts as lying on a plane.
PLANE_TOLERANCE = 1e-9


def on_symmetry_planes(points, symmetry, tolerance=PLANE_TOLERANCE):
    """Which points (n, 3) lie on which plane: (n, s) bool."""
    on = np.zeros((len(points), len(symmetry)), dtype=bool)
    limit = tolerance * np.linalg.norm(np.ptp(points, axis=0)) if len(points) else 0.0
    for k, plane in enumerate(symmetry):
        on[:, k] = np.abs(points[:, plane.axis] - plane.offset) <= limit
    return on


def snapped_to_symmetry(mesh):
    """Points of a TetMesh moved exactly onto their symmetry planes, and the facets on these.

    Parameters
    ----------
    mesh : TetMesh

    Returns
    -------
    points : (n, 3) float array [m]
    on_symmetry : (b,) bool array
        Boundary facets that lie on a symmetry plane.

    Raises
    ------
    InvalidMesh
        If a symmetry plane has no facet on it.
    """
    points = np.array(mesh.points)
    on = on_symmetry_planes(points, mesh.symmetry)
    facets_on = on[mesh.facets].all(axis=1)
    for k, plane in enumerate(mesh.symmetry):
        if not facets_on[:, k].any():
            raise InvalidMesh(
                f"no facet of the mesh lies on the symmetry plane {plane.name}: "
                "mesh only the part on one side of it"
            )
        points[on[:, k], plane.axis] = plane.offset
    return points, facets_on.any(axis=1)
