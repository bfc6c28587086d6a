"""Slow, obvious twins of the compiled kernels in rbf/."""

import numpy as np

SCALE = 0.2  # of the derivative functional


def hermite_matrix(kernel, points, normals):
    """The full matrix (2 n, 2 n) of the Hermite form; lengths in support radii."""
    n = len(points)
    matrix = np.empty((n, 2, n, 2))
    for i in range(n):
        for j in range(n):
            d = points[i] - points[j]
            r = np.linalg.norm(d)
            phi, f1, f2, _ = kernel.chain(np.array(max(r, 1e-300)))
            slope = f1 * d  # gradient of phi
            curvature = f1 * np.eye(3) + (f2 * np.outer(d, d) if r > 0 else 0.0)
            matrix[i, 0, j, 0] = phi
            matrix[i, 0, j, 1] = -SCALE * slope @ normals[j]
            matrix[i, 1, j, 0] = SCALE * slope @ normals[i]
            matrix[i, 1, j, 1] = -(SCALE**2) * normals[i] @ curvature @ normals[j]
    return matrix.reshape(2 * n, 2 * n)


def value_matrix(kernel, points):
    """The full matrix (n, n) of values; lengths in support radii."""
    return kernel(np.linalg.norm(points[:, None] - points[None, :], axis=2))


def kernel_sum(kernel, queries, centres):
    """Value (n,), gradient (n, 3), and whether supported, by summing over all centres.

    centres : (m, 7) array of x, y, z, a, b; S = sum a phi + b . grad phi; in support radii.
    """
    values, gradients = np.zeros(len(queries)), np.zeros((len(queries), 3))
    supported = np.zeros(len(queries), bool)
    for q, x in enumerate(queries):
        for centre in centres:
            d, a, b = x - centre[:3], centre[3], centre[4:]
            r = np.linalg.norm(d)
            if r >= 1.0:
                continue
            supported[q] = True
            phi, f1, f2, _ = kernel.chain(np.array(max(r, 1e-300)))
            values[q] += a * phi + f1 * b @ d
            gradients[q] += a * f1 * d + f1 * b + (f2 * (b @ d) * d if r > 0 else 0.0)
    values[~supported], gradients[~supported] = np.nan, np.nan
    return values, gradients, supported


def approximate_inverse(matrix, groups, m):
    """G^T G of groups [(columns, own)]: sites each group sees, the last `own` being its own."""
    total = np.zeros_like(matrix)
    for columns, own in groups:
        unknowns = (np.asarray(columns)[:, None] * m + np.arange(m)).ravel()
        block = matrix[np.ix_(unknowns, unknowns)]
        rows = np.linalg.inv(np.linalg.cholesky(block))[-own * m :]
        total[np.ix_(unknowns, unknowns)] += rows.T @ rows
    return total


def vertex_normals(points, faces):
    """Face normals weighted by the inverse distance to the face's centroid, one by one."""
    normals = np.zeros_like(points)
    for face in faces:
        a, b, c = points[face]
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal)
        for v in face:
            normals[v] += normal / np.linalg.norm(points[v] - (a + b + c) / 3.0)
    return normals / np.linalg.norm(normals, axis=1)[:, None]
