"""How rough a surface looks at a given scale, whatever its triangles."""

import numpy as np
from scipy.spatial import cKDTree

from meshes.closest_point import sample_surface
from meshes.quality import face_areas, face_normals

PER_BALL = 50  # samples in a flat ball
MOST_SAMPLES, PROBES, FEWEST = 200_000, 3_000, 12
SAME_SHEET = 0.3  # cosine below which a sample lies on the other side of a thin wall


def roughness(mesh, radius, seed=0):
    """Mean deviation [radians] of a surface's normals from smoothly varying ones.

    Around random points of the surface the normals of the triangles within a radius are fitted by
    a linear function of the position, which the surface's curvature follows; counted is the root
    mean square of what is left. Facets, steps and waves shorter than the radius all count, by the
    area they take, so that meshes of different sizes can be compared. Planar patches are left out.

    Parameters
    ----------
    mesh : TriMesh
    radius : float [unit of the points]
    seed : int

    Returns
    -------
    float
        NaN if there is nothing but planar patches.
    """
    planar = np.array([label.plane is not None for label in mesh.labels], bool)
    faces = mesh.faces[~planar[mesh.face_labels]]
    area = face_areas(mesh.points, faces).sum()
    if not area > 0.0:
        return float("nan")
    count = int(min(MOST_SAMPLES, max(PROBES, PER_BALL * area / (np.pi * radius**2))))
    points, chosen = sample_surface(mesh.points, faces, count, np.random.default_rng(seed))
    normals = face_normals(mesh.points, faces)[chosen]
    probes = np.arange(0, count, max(1, count // PROBES))
    near = cKDTree(points).query_ball_point(points[probes], radius)
    here = np.repeat(np.arange(len(probes)), [len(found) for found in near])
    there = np.concatenate(near).astype(np.int64)
    same = np.einsum("ij,ij->i", normals[probes[here]], normals[there]) > SAME_SHEET
    here, there = here[same], there[same]
    step = (points[there] - points[probes[here]]) / radius
    return float(np.mean(_left_by_linear_fits(here, step, normals[there], len(probes))))


def _left_by_linear_fits(group, step, values, count):
    """Root mean squares (g,) of what a linear fit of values (n, 3) leaves in each group."""
    base = np.concatenate([np.ones((len(step), 1)), step], axis=1)
    size = np.bincount(group, minlength=count)
    matrix = _sums(group, np.einsum("ni,nj->nij", base, base), count)
    right = _sums(group, np.einsum("ni,nj->nij", base, values), count)
    matrix += 1e-9 * np.maximum(size, 1)[:, None, None] * np.eye(4)  # flat balls leave it singular
    slopes = np.linalg.solve(matrix, right)
    left = values - np.einsum("ni,nij->nj", base, slopes[group])
    squares = np.bincount(group, np.einsum("nj,nj->n", left, left), minlength=count)
    usable = size >= FEWEST
    return np.sqrt(squares[usable] / size[usable])


def _sums(group, terms, count):
    """Sums (g, ...) of terms (n, ...) over groups."""
    flat = terms.reshape(len(terms), -1).T
    sums = [np.bincount(group, column, minlength=count) for column in flat]
    return np.stack(sums, axis=1).reshape(count, *terms.shape[1:])
