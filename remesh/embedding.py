"""The embedding of a surface in six dimensions: lengths and angles that see curvature.

A point x with unit normal n becomes Psi(x) = (x, sigma n); lengths and angles are those of
Psi (thesis section 2.5). Kernels take `rows`, an array whose first six columns are x and n, and
`sigma2` = sigma^2; sigma2 = 0 gives the ordinary length and angle.

Symbols: a, b, c rows of the array; sigma2 = sigma^2 [squared unit of the points].
"""

import math

import numpy as np

from remesh.compiled import hot

DEGREES = 180.0 / math.pi


@hot
def squared_parts(rows, a, b):
    """|x_a - x_b|^2 and |n_a - n_b|^2 of two rows."""
    position = 0.0
    normal = 0.0
    for k in range(3):
        d = rows[a, k] - rows[b, k]
        position += d * d
        d = rows[a, k + 3] - rows[b, k + 3]
        normal += d * d
    return position, normal


@hot
def squared_length(rows, a, b, sigma2):
    """|Psi(a) - Psi(b)|^2 of two rows."""
    position, normal = squared_parts(rows, a, b)
    return position + sigma2 * normal


@hot
def least_angle(first, second, third):
    """Sine and cosine, times one factor, of a triangle's smallest angle from its squared edges."""
    short, p, q = first, second, third
    if p < short:
        short, p = p, short
    if q < short:
        short, q = q, short
    cosine = p + q - short  # 2 |p| |q| cos of the angle opposite the shortest edge
    area = 4.0 * p * q - cosine * cosine  # 16 area^2
    return (math.sqrt(max(area, 0.0)), cosine) if cosine > 0.0 else (0.0, 1.0)


@hot
def least_tangent(first, second, third):
    """Tangent of the smallest angle of the triangle with these squared edge lengths."""
    sine, cosine = least_angle(first, second, third)
    return sine / cosine


@hot
def degrees_of(sine, cosine):
    """Angle [degrees] between 0 and 60, to 6e-5 degrees, with one division and no atan.

    The rational function of the tangent is the best of its kind in the largest error (least
    squares, reweighted). sine and cosine may share any factor.
    """
    s, c = sine * sine, cosine * cosine
    above = c * c + s * (0.76184092 * c + 0.08711568 * s)
    below = c * c * c + s * (1.09510097 * c * c + s * (0.25271927 * c + 0.006342 * s))
    return DEGREES * sine * cosine * above / below


@hot
def triangle_tangent(rows, a, b, c, sigma2):
    """Tangent of the smallest 6D angle of the triangle of three rows."""
    return least_tangent(
        squared_length(rows, a, b, sigma2),
        squared_length(rows, b, c, sigma2),
        squared_length(rows, c, a, sigma2),
    )


@hot
def fourfold_area(first, second, third):
    """Four times the area of the triangle with these squared edge lengths."""
    mixed = first * second + second * third + third * first
    squares = first * first + second * second + third * third
    return math.sqrt(max(2.0 * mixed - squares, 0.0))


@hot
def triangle_normal(rows, a, b, c):
    """Normal of the triangle of three rows, as long as twice its area."""
    ux, uy, uz = rows[b, 0] - rows[a, 0], rows[b, 1] - rows[a, 1], rows[b, 2] - rows[a, 2]
    vx, vy, vz = rows[c, 0] - rows[a, 0], rows[c, 1] - rows[a, 1], rows[c, 2] - rows[a, 2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@hot
def agreement(rows, a, b, c):
    """Least cosine between the normal of a triangle and the surface's normals at its corners."""
    x, y, z = triangle_normal(rows, a, b, c)
    length = math.sqrt(x * x + y * y + z * z)
    if length <= 0.0:
        return -1.0
    at_a = x * rows[a, 3] + y * rows[a, 4] + z * rows[a, 5]
    at_b = x * rows[b, 3] + y * rows[b, 4] + z * rows[b, 5]
    at_c = x * rows[c, 3] + y * rows[c, 4] + z * rows[c, 5]
    return min(at_a, min(at_b, at_c)) / length


def as_tangents(limits):
    """Limits (angle6, angle3 [degrees], agreement) with the angles' tangents, for the kernels."""
    angle6, angle3, agree = limits
    return np.array([math.tan(angle6 / DEGREES), math.tan(angle3 / DEGREES), agree])


def embed(points, normals, sigma):
    """Psi of points (n, 3) with unit normals (n, 3): (n, 6), thesis section 2.5."""
    return np.concatenate([points, sigma * np.asarray(normals)], axis=1)


def face_corner_embedding(points, faces, corner_normals, sigma):
    """Psi at the corners of each face: (m, 3, 6); a crease vertex has one normal per patch.

    Parameters
    ----------
    points : (n, 3) float array
    faces : (m, 3) int array
    corner_normals : (m, 3, 3) float array
        Unit normal of each face's own patch at each of its corners.
    sigma : float
        In the unit of the points.
    """
    return np.concatenate([points[faces], sigma * corner_normals], axis=2)


def corner_edge_lengths(corners):
    """Lengths (m, 3) of the edges (0, 1), (1, 2), (2, 0) of triangles (m, 3, d)."""
    return np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)


def smallest_angles(corners):
    """Smallest angle (m,) [degrees] of triangles (m, 3, d), in as many dimensions as given."""
    short, p, q = np.sort(corner_edge_lengths(corners) ** 2, axis=1).T
    cosine = p + q - short
    area = np.sqrt(np.maximum(4.0 * p * q - cosine**2, 0.0))
    return np.degrees(np.arctan2(area, cosine))


def embedded_area(corners):
    """Area of triangles (m, 3, d), summed."""
    first, second, third = (corner_edge_lengths(corners) ** 2).T
    mixed = first * second + second * third + third * first
    squares = first**2 + second**2 + third**2
    return float(np.sqrt(np.maximum(2.0 * mixed - squares, 0.0)).sum() / 4.0)
