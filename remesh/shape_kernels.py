"""Kernels over whole triangulations: normals, smoothing, areas and volumes.

`group` (m, 3) says which row each face corner belongs to (see `layout`).
Slow twins: `meshes.quality`, and `remesh.triangle_surface` in the tests.
"""

import math

from remesh.compiled import kernel
from remesh.connectivity import ORIGIN, TRIANGLES, following
from remesh.embedding import fourfold_area, squared_length


@kernel
def normalise_rows(vectors):
    """Make vectors (k, 3) as long as 1; zero vectors stay zero."""
    for r in range(vectors.shape[0]):
        largest = max(abs(vectors[r, 0]), max(abs(vectors[r, 1]), abs(vectors[r, 2])))
        if largest <= 0.0:
            continue
        square = 0.0
        for k in range(3):
            vectors[r, k] /= largest
            square += vectors[r, k] * vectors[r, k]
        length = math.sqrt(square)
        for k in range(3):
            vectors[r, k] /= length


@kernel
def gather_normals(points, faces, group, normals):
    """Unit normals (k, 3), handed in as 0: unit face normals times the angles at the corners."""
    for t in range(faces.shape[0]):
        a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
        largest = 0.0
        for k in range(3):
            largest = max(largest, abs(points[b, k] - points[a, k]))
            largest = max(largest, abs(points[c, k] - points[a, k]))
        if largest <= 0.0:
            continue
        scale = 1.0 / largest
        ux, uy = scale * (points[b, 0] - points[a, 0]), scale * (points[b, 1] - points[a, 1])
        uz, vx = scale * (points[b, 2] - points[a, 2]), scale * (points[c, 0] - points[a, 0])
        vy, vz = scale * (points[c, 1] - points[a, 1]), scale * (points[c, 2] - points[a, 2])
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        area = math.sqrt(x * x + y * y + z * z)
        if area <= 0.0:
            continue
        uu, vv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
        uv = ux * vx + uy * vy + uz * vz
        at_a = math.atan2(area, uv)
        at_b = math.atan2(area, uu - uv)
        at_c = math.atan2(area, vv - uv)
        for k in range(3):
            angle = at_a if k == 0 else (at_b if k == 1 else at_c)
            weight = angle / area
            r = group[t, k]
            normals[r, 0] += weight * x
            normals[r, 1] += weight * y
            normals[r, 2] += weight * z
    normalise_rows(normals)


@kernel
def average_normals(group, normals, total):
    """Sums over the triangles around each row of their rows' normals and its own, as unit vectors.

    total : (k, 3), handed in as 0
    """
    for t in range(group.shape[0]):
        a, b, c = group[t, 0], group[t, 1], group[t, 2]
        for k in range(3):
            face = normals[a, k] + normals[b, k] + normals[c, k]
            total[a, k] += face + normals[a, k]
            total[b, k] += face + normals[b, k]
            total[c, k] += face + normals[c, k]
    normalise_rows(total)


@kernel
def umbrella_step(faces, twins, factor, free, points, total, degree):
    """Move free points by `factor` times the way to their neighbours' mean.

    total, degree : (n, 3), (n,)
        Scratch.
    """
    flat = faces.reshape(faces.size)
    for v in range(points.shape[0]):
        degree[v] = 0
        for k in range(3):
            total[v, k] = 0.0
    for h in range(flat.size):
        a, b = flat[h], flat[following(h)]
        degree[a] += 1
        for k in range(3):
            total[a, k] += points[b, k]
        if twins[h] < 0:
            degree[b] += 1
            for k in range(3):
                total[b, k] += points[a, k]
    for v in range(points.shape[0]):
        if free[v]:
            for k in range(3):
                points[v, k] += factor * (total[v, k] / degree[v] - points[v, k])


@kernel
def area_and_moments(points, faces, out):
    """Write area, area times centroid (3), and area times squared distance from the first point."""
    for i in range(5):
        out[i] = 0.0
    for t in range(faces.shape[0]):
        a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
        ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], 0.0
        uz = points[b, 2] - points[a, 2]
        vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], 0.0
        vz = points[c, 2] - points[a, 2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        area = 0.5 * math.sqrt(x * x + y * y + z * z)
        out[0] += area
        square = 0.0
        for k in range(3):
            centre = (points[a, k] + points[b, k] + points[c, k]) / 3.0 - points[0, k]
            out[1 + k] += area * centre
            square += centre * centre
        out[4] += area * square


@kernel
def area_of_rows(halves, rows, counts, sigma2):
    """6D area of the triangles of a work mesh."""
    total = 0.0
    for t in range(counts[TRIANGLES]):
        a, b, c = halves[3 * t, ORIGIN], halves[3 * t + 1, ORIGIN], halves[3 * t + 2, ORIGIN]
        if a >= 0:
            total += fourfold_area(
                squared_length(rows, a, b, sigma2),
                squared_length(rows, b, c, sigma2),
                squared_length(rows, c, a, sigma2),
            )
    return 0.25 * total


@kernel
def enclosed_volume(points, faces):
    """Signed volume inside closed triangles, taken from their first point."""
    total = 0.0
    for t in range(faces.shape[0]):
        a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
        x, y, z = points[0, 0], points[0, 1], points[0, 2]
        ax, ay, az = points[a, 0] - x, points[a, 1] - y, points[a, 2] - z
        bx, by, bz = points[b, 0] - x, points[b, 1] - y, points[b, 2] - z
        cx, cy, cz = points[c, 0] - x, points[c, 1] - y, points[c, 2] - z
        total += ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    return total / 6.0
