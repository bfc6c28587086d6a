"""Least-squares fit of the vertices to the surface, and the uniform offset for the volume.

Vertices on a curved surface with straight edges inside lose volume. Here every triangle is
sampled, the gap from each sample to the surface is one equation for the displacements of the
triangle's corners, and conjugate gradients solve the damped normal equations

    min sum_s w_s ((sum_i b_si d_i) . N_s - gap_s)^2
        + sum_v D_v (damping |d_v|^2 + tangential |d_v - (d_v . n_v) n_v|^2)
        + ridge * sum_edges D_e ((o_i + s_i) - (o_j + s_j))^2,    s = d . n,

D the diagonal of the first sum, o the vertices' present offsets.
"""

import math

import numpy as np

from remesh.compiled import allocating, kernel
from remesh.connectivity import (
    BASE,
    HINT,
    INTERIOR,
    KIND,
    MAX_RING,
    OFFSET,
    ROWS,
    ring,
)
from remesh.embedding import as_tangents, triangle_normal
from remesh.guard import no_worse
from remesh.nearest import near, point_and_normal
from remesh.shape_kernels import enclosed_volume
from remesh.star import STAR_SHAPE, gather_star, star_quality

DAMPING = 1e-3
TOLERANCE = 1e-5
HALVINGS = 4
VOLUME_STEPS = 3


def barycentric_samples(order):
    """Centroids (order^2, 3) of the triangles that order^2 equal parts of a triangle are."""
    points = []
    for i in range(order):
        for j in range(order - i):
            points.append(((3 * i + 1) / (3 * order), (3 * j + 1) / (3 * order)))
            if i + j < order - 1:
                points.append(((3 * i + 2) / (3 * order), (3 * j + 2) / (3 * order)))
    u, v = np.array(points).T
    return np.stack([u, v, 1.0 - u - v], axis=1)


def free_rows(work):
    """Rows (n,) bool of vertices that may leave the carrier: inside smooth patches."""
    used = int(work.counts[ROWS])
    planar = np.array([patch.plane is not None for patch in work.carrier.mesh.labels])
    links = work.links[:used]
    on_plane = planar[work.carrier.mesh.face_labels[links[:, HINT]]]
    return (links[:, KIND] == INTERIOR) & (links[:, BASE] == np.arange(used)) & ~on_plane


def fit_vertices(
    work, gaps, sigma, limits, tangential=0.05, ridge=0.0, order=2, normal_only=False, steps=40
):
    """Move vertices so that the triangles, not the vertices, lie on the surface on average.

    Parameters
    ----------
    work : WorkMesh
        Compacted here.
    gaps : callable
        gaps(rows, corners, samples, own) -> (normals (k, 3), gaps (k,)): at each sample of each
        triangle a unit normal of the surface and the gap to it along that normal; with `own` the
        normal of the triangle itself.
    sigma : float [unit of the points]
        Of the 6D angles that `limits` speaks of.
    limits : (angle6, angle3, agreement)
        A step is halved where a triangle would fall below these and below what it was.
    tangential : float
        Damping of moves along the surface.
    ridge : float
        Weight of differences of the offsets across edges.
    order : int
        order^2 samples per triangle.
    normal_only : bool
        Move along the normals alone.
    steps : int
        Most iterations of conjugate gradients.

    Returns
    -------
    (n, 9) float array
        For every row its position, and the entries xx, yy, zz, xy, yz, zx of the quadratic form
        of its displacement that the sum of squared gaps grows by, in units of the mean over the
        free vertices of that sum.
    """
    work.compact()
    used = int(work.counts[ROWS])
    corners, _ = work.corner_rows()
    corners = np.ascontiguousarray(corners)
    rows = work.rows[:used]
    free = free_rows(work)
    if not free.any():
        return np.zeros((len(work.rows), 9))
    samples = barycentric_samples(order)
    normals, gap = gaps(work, corners, samples, normal_only)
    weights = np.empty(len(corners))
    root_areas(rows, corners, weights)
    step = np.zeros((used, 3))
    solve_fit(
        rows, corners, samples, weights, normals, gap, free, tangential, ridge,
        0.0 if normal_only else 1.0, steps, step,
    )  # fmt: skip
    take_steps(work, free, step, sigma, limits)
    hold = np.zeros((len(work.rows), 9))
    energy = hold_forms(corners, samples, weights, normals, gap, step, hold)
    hold[:, 3:] *= np.count_nonzero(free) / energy if energy > 0.0 else 0.0
    hold[:used, :3] = rows[:, :3]
    return hold


def take_steps(work, free, step, sigma, limits):
    """Move the free rows by `step` (n, 3) as far as `limits` allow; return how many were cut."""
    used = len(free)
    cut = apply_steps(
        work.halves, work.links, work.rows, used, free, step, sigma**2, as_tangents(limits)
    )
    refresh_feet(work.links, work.rows, used, free, work.carrier.reference)
    return cut


def match_volume(work, volume):
    """Offset all free vertices by one distance along their normals, so that the volume is met.

    Closed meshes only; returns the distance.
    """
    work.compact()
    free = np.flatnonzero(free_rows(work))
    total = 0.0
    if len(free) == 0:
        return total
    corners = work.corner_rows()[0].astype(np.int32)
    points = work.rows[:, :3].copy()
    trial = 1e-3 * np.linalg.norm(np.ptp(points[corners[:, 0]], axis=0))
    for _ in range(VOLUME_STEPS):
        now = enclosed_volume(points, corners)
        points[free] += trial * work.rows[free, 3:6]
        slope = (enclosed_volume(points, corners) - now) / trial
        if slope <= 0.0:
            break
        distance = (volume - now) / slope
        work.rows[free, :3] += distance * work.rows[free, 3:6]
        work.rows[free, OFFSET] += distance
        points[free] = work.rows[free, :3]
        total += distance
    return total


@kernel
def root_areas(rows, corners, roots):
    """Write the square root of twice the area (m,) of triangles of rows."""
    for t in range(corners.shape[0]):
        x, y, z = triangle_normal(rows, corners[t, 0], corners[t, 1], corners[t, 2])
        roots[t] = math.sqrt(math.sqrt(x * x + y * y + z * z))


@kernel
def accumulate(rows, corners, samples, weights, normals, gap, right, diagonal):
    """Right side (n, 3) and diagonal (n,) of the normal equations."""
    per = samples.shape[0]
    for t in range(corners.shape[0]):
        for s in range(per):
            r = t * per + s
            for k in range(3):
                v = corners[t, k]
                b = samples[s, k] * weights[t]
                diagonal[v] += b * b
                for z in range(3):
                    right[v, z] += b * weights[t] * gap[r] * normals[r, z]


@kernel
def hold_forms(corners, samples, weights, normals, gap, step, hold):
    """Sum the quadratic forms of single displacements into hold[:, 3:]; return the energy left."""
    per = samples.shape[0]
    energy = 0.0
    for t in range(corners.shape[0]):
        w2 = weights[t] * weights[t]
        for s in range(per):
            r = t * per + s
            x, y, z = normals[r, 0], normals[r, 1], normals[r, 2]
            left = gap[r]
            for k in range(3):
                v, b = corners[t, k], samples[s, k]
                left -= b * (step[v, 0] * x + step[v, 1] * y + step[v, 2] * z)
                f = b * b * w2
                hold[v, 3] += f * x * x
                hold[v, 4] += f * y * y
                hold[v, 5] += f * z * z
                hold[v, 6] += f * x * y
                hold[v, 7] += f * y * z
                hold[v, 8] += f * z * x
            energy += w2 * left * left
    return energy


@kernel
def edge_weights(corners, diagonal, ridge, rows, out, total, right):
    """Weights (m, 3) of the ridge at the triangles' edges, their vertex sums, its right side."""
    for t in range(corners.shape[0]):
        for k in range(3):
            i, j = corners[t, k], corners[t, (k + 1) % 3]
            w = 0.125 * ridge * (diagonal[i] + diagonal[j])
            out[t, k] = w
            total[i] += w
            total[j] += w
            q = w * (rows[i, OFFSET] - rows[j, OFFSET])
            for z in range(3):
                right[i, z] -= q * rows[i, 3 + z]
                right[j, z] += q * rows[j, 3 + z]


@kernel
def apply_operator(
    rows, corners, samples, weights, normals, diagonal, ridges, tangential, x, along, y
):
    """y = (normal equations' matrix) x; `along` (n,) is scratch for x . n."""
    n = x.shape[0]
    for v in range(n):
        s = x[v, 0] * rows[v, 3] + x[v, 1] * rows[v, 4] + x[v, 2] * rows[v, 5]
        along[v] = s
        for z in range(3):
            y[v, z] = diagonal[v] * (
                DAMPING * x[v, z] + tangential * (x[v, z] - s * rows[v, 3 + z])
            )
    per = samples.shape[0]
    for t in range(corners.shape[0]):
        a, b, c = corners[t, 0], corners[t, 1], corners[t, 2]
        w2 = weights[t] * weights[t]
        for s in range(per):
            r = t * per + s
            u, v, w = samples[s, 0], samples[s, 1], samples[s, 2]
            value = 0.0
            for z in range(3):
                value += (u * x[a, z] + v * x[b, z] + w * x[c, z]) * normals[r, z]
            value *= w2
            for z in range(3):
                f = value * normals[r, z]
                y[a, z] += u * f
                y[b, z] += v * f
                y[c, z] += w * f
        for k in range(3):
            i, j = corners[t, k], corners[t, (k + 1) % 3]
            q = ridges[t, k] * (along[i] - along[j])
            for z in range(3):
                y[i, z] += q * rows[i, 3 + z]
                y[j, z] -= q * rows[j, 3 + z]


@kernel
def precondition(rows, free, diagonal, total, tangential, sideways, residual, out):
    """out = diagonal preconditioner, normal and tangential apart; 0 on held rows."""
    product = 0.0
    for v in range(residual.shape[0]):
        s = 0.0
        for z in range(3):
            s += residual[v, z] * rows[v, 3 + z]
        along = 0.0
        across = 0.0
        if free[v] and diagonal[v] > 0.0:
            along = 1.0 / (diagonal[v] * (1.0 + DAMPING) + total[v])
            across = sideways / (diagonal[v] * (tangential + DAMPING + 0.08))
        for z in range(3):
            q = s * rows[v, 3 + z]
            out[v, z] = q * along + (residual[v, z] - q) * across
            product += out[v, z] * residual[v, z]
    return product


@allocating
def solve_fit(
    rows, corners, samples, weights, normals, gap, free, tangential, ridge, sideways, steps, x
):
    """Conjugate gradients for the displacements x (n, 3), which start at 0; returns the steps."""
    n = x.shape[0]
    residual, diagonal, total = np.zeros((n, 3)), np.zeros(n), np.zeros(n)
    ridges = np.zeros(corners.shape)
    accumulate(rows, corners, samples, weights, normals, gap, residual, diagonal)
    if ridge > 0.0:
        edge_weights(corners, diagonal, ridge, rows, ridges, total, residual)
    z, p, y, along = np.zeros((n, 3)), np.zeros((n, 3)), np.empty((n, 3)), np.empty(n)
    first, before = 0.0, 1.0
    for step in range(steps):
        now = precondition(rows, free, diagonal, total, tangential, sideways, residual, z)
        if step == 0:
            first = now
        if now <= TOLERANCE * first or now <= 0.0:
            return step
        beta = now / before if step > 0 else 0.0
        before = now
        for v in range(n):
            for k in range(3):
                p[v, k] = z[v, k] + beta * p[v, k]
        apply_operator(
            rows, corners, samples, weights, normals, diagonal, ridges, tangential, p, along, y
        )
        curvature = 0.0
        for v in range(n):
            for k in range(3):
                curvature += p[v, k] * y[v, k]
        if curvature <= 0.0:
            return step
        alpha = now / curvature
        for v in range(n):
            for k in range(3):
                x[v, k] += alpha * p[v, k]
                residual[v, k] -= alpha * y[v, k]
    return steps


@allocating
def apply_steps(halves, links, rows, used, free, step, sigma2, limits):
    """Move free vertices by their steps, halved until no triangle gets too bad; count the cuts."""
    fan, star = np.empty(MAX_RING, np.int64), np.zeros(STAR_SHAPE)
    start = np.empty(3)
    cuts = 0
    for v in range(used):
        if not free[v]:
            continue
        count, _ = ring(halves, links, v, fan)
        if count == 0:
            continue
        gather_star(halves, rows, fan, count, star)
        before = star_quality(rows, halves, fan, count, star, sigma2)
        for k in range(3):
            start[k] = rows[v, k]
        scale = 1.0
        for trial in range(HALVINGS + 1):
            if trial == HALVINGS:
                scale = 0.0
            for k in range(3):
                rows[v, k] = start[k] + scale * step[v, k]
            if scale == 0.0 or no_worse(
                star_quality(rows, halves, fan, count, star, sigma2), before, limits
            ):
                break
            scale *= 0.5
        if scale < 1.0:
            cuts += 1
    return cuts


@allocating
def refresh_feet(links, rows, used, free, reference):
    """Keep the positions of free vertices; renew normal, hint and offset from the carrier."""
    point = np.empty(6)
    for r in range(used):
        if not free[r]:
            continue
        x, y, z = rows[r, 0], rows[r, 1], rows[r, 2]
        t, v, w, _ = near(reference, x, y, z, links[r, HINT])
        point_and_normal(reference, t, v, w, point)
        links[r, HINT] = t
        rows[r, OFFSET] = (
            (x - point[0]) * point[3] + (y - point[1]) * point[4] + (z - point[2]) * point[5]
        )
        for k in range(3, 6):
            rows[r, k] = point[k]
