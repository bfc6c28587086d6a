"""Kernel of the volume enclosed by a surface whose vertices move along given directions."""

from numba import njit


@njit(cache=True, error_model="numpy")
def determinant(a, b, c):
    """Triple product a . (b x c) of tuples."""
    return (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )


@njit(cache=True, error_model="numpy")
def volume_coefficients(points, directions, faces, origin, coefficients):
    """Coefficients (4,) of the volume as a cubic polynomial of the offset along the directions."""
    for k in range(4):
        coefficients[k] = 0.0
    for f in range(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        a = (points[i, 0] - origin[0], points[i, 1] - origin[1], points[i, 2] - origin[2])
        b = (points[j, 0] - origin[0], points[j, 1] - origin[1], points[j, 2] - origin[2])
        c = (points[k, 0] - origin[0], points[k, 1] - origin[1], points[k, 2] - origin[2])
        u = (directions[i, 0], directions[i, 1], directions[i, 2])
        v = (directions[j, 0], directions[j, 1], directions[j, 2])
        w = (directions[k, 0], directions[k, 1], directions[k, 2])
        coefficients[0] += determinant(a, b, c) / 6.0
        mixed = determinant(u, b, c) + determinant(a, v, c) + determinant(a, b, w)
        coefficients[1] += mixed / 6.0
        mixed = determinant(u, v, c) + determinant(u, b, w) + determinant(a, v, w)
        coefficients[2] += mixed / 6.0
        coefficients[3] += determinant(u, v, w) / 6.0
