"""The triangles around a vertex that moves: angles, and agreement with the surface's normals.

A star is an array (blocks, FIELDS * LANES) of zeros at first: LANES triangles side by side, field
after field, so that the loop over them is compiled into vector instructions. What is beyond the
last triangle in the last block is of an earlier star, and its results are not read.

The fields are positions and normals of the two corners besides the centre, the squared distances
between these (positions, normals), the centre's normal as the triangle has it, and what is
computed for a place of the centre.
"""

import math

from remesh.compiled import hot
from remesh.connectivity import MAX_RING, ORIGIN, following, preceding
from remesh.embedding import degrees_of, fourfold_area, least_angle, squared_parts

LANES = 8
NEXT, LAST, RIM, RIM_TURN, OWN = 0, 6 * LANES, 12 * LANES, 13 * LANES, 14 * LANES
TANGENT6, TANGENT3, AGREEMENT = 17 * LANES, 18 * LANES, 19 * LANES  # of the least angles
COST, EXCESS3, EXCESS = 17 * LANES, 18 * LANES, 19 * LANES  # see `star_costs`
SINE3, COSINE3, AREA = 20 * LANES, 21 * LANES, 22 * LANES
WEIGHT, PULL = 17 * LANES, 18 * LANES  # see `star_pulls`
STAR_SHAPE = (MAX_RING // LANES, 23 * LANES)


@hot
def gather_star(halves, rows, fan, count, star):
    """Write what stays the same of a fan's triangles while its centre moves."""
    for i in range(count):
        part, lane = star[i // LANES], i % LANES
        b, c = halves[following(fan[i]), ORIGIN], halves[preceding(fan[i]), ORIGIN]
        for k in range(6):
            part[NEXT + k * LANES + lane] = rows[b, k]
            part[LAST + k * LANES + lane] = rows[c, k]
        part[RIM + lane], part[RIM_TURN + lane] = squared_parts(rows, b, c)


@hot
def set_centre(halves, rows, fan, count, star):
    """Write the centre's normals, one per triangle: at a crease they differ."""
    for i in range(count):
        part, lane = star[i // LANES], i % LANES
        a = halves[fan[i], ORIGIN]
        for k in range(3):
            part[OWN + k * LANES + lane] = rows[a, 3 + k]


@hot
def spokes(part, i, x, y, z):
    """Vectors from the centre (x, y, z) to both other corners of the i-th triangle."""
    return (
        part[NEXT + i] - x, part[NEXT + LANES + i] - y, part[NEXT + 2 * LANES + i] - z,
        part[LAST + i] - x, part[LAST + LANES + i] - y, part[LAST + 2 * LANES + i] - z,
    )  # fmt: skip


@hot
def turn(part, i, corner):
    """Squared difference of the normals at the centre and at a corner (NEXT or LAST)."""
    x = part[corner + 3 * LANES + i] - part[OWN + i]
    y = part[corner + 4 * LANES + i] - part[OWN + LANES + i]
    z = part[corner + 5 * LANES + i] - part[OWN + 2 * LANES + i]
    return x * x + y * y + z * z


@hot
def along(part, i, first, x, y, z):
    """Product of a vector with the normal that starts at a field."""
    return x * part[first + i] + y * part[first + LANES + i] + z * part[first + 2 * LANES + i]


@hot
def star_triangle(part, i, x, y, z, sigma2):
    """Sine and cosine of the least 6D angle of a triangle of a star, and of the 3D one, each pair
    times some factor; twice its area times its agreement, and twice its area.

    x, y, z : position of the centre.
    """
    ux, uy, uz, vx, vy, vz = spokes(part, i, x, y, z)
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    area = math.sqrt(nx * nx + ny * ny + nz * nz)  # twice the triangle's
    at_a = along(part, i, OWN, nx, ny, nz)
    at_b = along(part, i, NEXT + 3 * LANES, nx, ny, nz)
    at_c = along(part, i, LAST + 3 * LANES, nx, ny, nz)
    normal = min(at_a, min(at_b, at_c))
    first = ux * ux + uy * uy + uz * uz
    last = vx * vx + vy * vy + vz * vz
    rim = part[RIM + i]
    cosine = first + last + rim - 2.0 * min(rim, min(first, last))
    sine3 = 2.0 * area if cosine > 0.0 else 0.0
    cosine3 = cosine if cosine > 0.0 else 1.0
    if sigma2 <= 0.0:
        return sine3, cosine3, sine3, cosine3, normal, area
    sine6, cosine6 = least_angle(
        first + sigma2 * turn(part, i, NEXT), last + sigma2 * turn(part, i, LAST),
        rim + sigma2 * part[RIM_TURN + i],
    )  # fmt: skip
    return sine6, cosine6, sine3, cosine3, normal, area


@hot
def star_qualities(star, count, x, y, z, sigma2):
    """Write TANGENT6, TANGENT3 and AGREEMENT of every triangle."""
    for block in range((count + LANES - 1) // LANES):
        part = star[block]
        for i in range(LANES):
            sine6, cosine6, sine3, cosine3, normal, area = star_triangle(part, i, x, y, z, sigma2)
            part[TANGENT6 + i] = sine6 / cosine6
            part[TANGENT3 + i] = sine3 / cosine3
            part[AGREEMENT + i] = normal / area if area > 0.0 else -1.0


@hot
def star_quality(rows, halves, fan, count, star, sigma2):
    """Tangents of the least 6D and 3D angle, and least agreement with the normals, in a star."""
    set_centre(halves, rows, fan, count, star)
    a = halves[fan[0], ORIGIN]
    x, y, z = rows[a, 0], rows[a, 1], rows[a, 2]
    if sigma2 > 0.0:
        star_qualities(star, count, x, y, z, sigma2)
    else:
        star_qualities(star, count, x, y, z, 0.0)
    tangent6, tangent3, agreement = math.inf, math.inf, 1.0
    for i in range(count):
        part, lane = star[i // LANES], i % LANES
        tangent6 = min(tangent6, part[TANGENT6 + lane])
        tangent3 = min(tangent3, part[TANGENT3 + lane])
        agreement = min(agreement, part[AGREEMENT + lane])
    return tangent6, tangent3, agreement


@hot
def star_costs(star, count, x, y, z, sigma2, tangent3, least_agreement):
    """Write of every triangle (60 - angle6) / 30 to COST, and what a cost adds seldom:

    SINE3, COSINE3, AREA, and EXCESS3 and EXCESS, negative where the 3D angle and the agreement
    with the normals are too small.
    """
    for block in range((count + LANES - 1) // LANES):
        part = star[block]
        for i in range(LANES):
            sine6, cosine6, sine3, cosine3, normal, area = star_triangle(part, i, x, y, z, sigma2)
            part[COST + i] = 2.0 - degrees_of(sine6, cosine6) / 30.0
            part[SINE3 + i], part[COSINE3 + i], part[AREA + i] = sine3, cosine3, area
            part[EXCESS3 + i] = sine3 - tangent3 * cosine3
            part[EXCESS + i] = normal - least_agreement * area


@hot
def star_pulls(star, count, x, y, z, sigma2):
    """Write of every triangle four times its 6D area to WEIGHT, and to PULL the vector (3 fields)
    by which its two other corners are off the centre in the sum.
    """
    for block in range((count + LANES - 1) // LANES):
        part = star[block]
        for i in range(LANES):
            ux, uy, uz, vx, vy, vz = spokes(part, i, x, y, z)
            part[WEIGHT + i] = fourfold_area(
                ux * ux + uy * uy + uz * uz + sigma2 * turn(part, i, NEXT),
                vx * vx + vy * vy + vz * vz + sigma2 * turn(part, i, LAST),
                part[RIM + i] + sigma2 * part[RIM_TURN + i],
            )
            part[PULL + i] = ux + vx
            part[PULL + LANES + i] = uy + vy
            part[PULL + 2 * LANES + i] = uz + vz
