"""Kernels of a surface that is simplified within an error bound: rings, stars, their samples.

`state` and `samples` are those of `bounded_mesh.BoundedMesh`. A star is the triangles around a
vertex (or around an edge that is to become one) with the vertex put somewhere: `star`
(k, STAR_WIDTH) holds what `closest_on_triangle` needs, first corner the vertex, and what makes
`closest_in_star` faster: the gradients of the two barycentric coordinates, the squared heights over
the three edges, and 1 / n.n; `fan` (k, 6) the face, its two other corners, and whether its three
edges are on features.
"""

import math

from meshes.closest_point_kernels import FAR, NEEDLE, closest_on_edges, closest_on_triangle
from remesh.compiled import kernel
from remesh.connectivity import following, preceding

MOST_STAR = 200
STAR_WIDTH = 22
WORSE = 0.999  # of an angle: a change that leaves more is none


@kernel
def ring_of(twin, first, v, ring):
    """Fill ring with the half-edges that leave v, in order; returns their number, 0 for too many.

    On a boundary it begins with the boundary's half-edge.
    """
    start = first[v]
    h = start
    while twin[h] >= 0:
        h = following(twin[h])
        if h == start:
            break
    start, count = h, 0
    while True:
        if count == MOST_STAR:
            return 0
        ring[count] = h
        count += 1
        g = twin[preceding(h)]
        if g < 0 or g == start:
            return count
        h = g


@kernel
def fill_fan(state, v, ring, count, other, fan, filled):
    """Append to fan the faces around v that do not contain vertex `other`; returns its length."""
    corner, _, crease, _, _, _, _, _, _ = state
    for i in range(count):
        h = ring[i]
        p, q = corner[following(h)], corner[preceding(h)]
        if p == other or q == other:
            continue
        fan[filled, 0], fan[filled, 1], fan[filled, 2] = h // 3, p, q
        fan[filled, 3], fan[filled, 4] = crease[h], crease[following(h)]
        fan[filled, 5] = crease[preceding(h)]
        filled += 1
    return filled


@kernel
def complete_row(star, i):
    """Fill in what follows from a star's triangle (corner and two edges); 1 / n.n is 0 if thin."""
    ux, uy, uz = star[i, 3], star[i, 4], star[i, 5]
    vx, vy, vz = star[i, 6], star[i, 7], star[i, 8]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    star[i, 9], star[i, 10], star[i, 11] = nx, ny, nz
    nn = nx * nx + ny * ny + nz * nz
    uu, vv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
    ee = (ux - vx) ** 2 + (uy - vy) ** 2 + (uz - vz) ** 2
    if nn <= 0.0 or nn < NEEDLE * uu * vv:
        star[i, 21] = 0.0
        return
    star[i, 12] = (vy * nz - vz * ny) / nn
    star[i, 13] = (vz * nx - vx * nz) / nn
    star[i, 14] = (vx * ny - vy * nx) / nn
    star[i, 15] = (ny * uz - nz * uy) / nn
    star[i, 16] = (nz * ux - nx * uz) / nn
    star[i, 17] = (nx * uy - ny * ux) / nn
    star[i, 18], star[i, 19], star[i, 20], star[i, 21] = nn / vv, nn / uu, nn / ee, 1.0 / nn


@kernel
def fill_star(points, fan, count, x, star):
    """Fill star for the fan's triangles with their vertex at x (3,)."""
    for i in range(count):
        p, q = fan[i, 1], fan[i, 2]
        for d in range(3):
            star[i, d] = x[d]
            star[i, 3 + d] = points[p, d] - x[d]
            star[i, 6 + d] = points[q, d] - x[d]
        complete_row(star, i)


@kernel
def closest_in_star(x, y, z, star, i, limit):
    """Squared distance of (x, y, z) from a star's triangle; FAR if it is seen to exceed `limit`."""
    inverse = star[i, 21]
    if inverse <= 0.0:
        return closest_on_triangle(x, y, z, star[i], FAR)[2]
    px, py, pz = x - star[i, 0], y - star[i, 1], z - star[i, 2]
    off = px * star[i, 9] + py * star[i, 10] + pz * star[i, 11]
    square = off * off * inverse
    if square > 1.0001 * limit:
        return FAR
    v = px * star[i, 12] + py * star[i, 13] + pz * star[i, 14]
    w = px * star[i, 15] + py * star[i, 16] + pz * star[i, 17]
    u = 1.0 - v - w
    if v >= 0.0 and w >= 0.0 and u >= 0.0:
        return square
    room = 1.0001 * limit - square
    if (
        (v < 0.0 and v * v * star[i, 18] > room)
        or (w < 0.0 and w * w * star[i, 19] > room)
        or (u < 0.0 and u * u * star[i, 20] > room)
    ):
        return FAR
    return closest_on_edges(px, py, pz, star[i])[2]


@kernel
def least_sine(star, i):
    """Smallest height over longest edge of a star's triangle, and its longest edge squared."""
    uu = star[i, 3] ** 2 + star[i, 4] ** 2 + star[i, 5] ** 2
    vv = star[i, 6] ** 2 + star[i, 7] ** 2 + star[i, 8] ** 2
    ww = (
        (star[i, 3] - star[i, 6]) ** 2
        + (star[i, 4] - star[i, 7]) ** 2
        + (star[i, 5] - star[i, 8]) ** 2
    )
    longest = max(uu, max(vv, ww))
    area = math.sqrt(star[i, 9] ** 2 + star[i, 10] ** 2 + star[i, 11] ** 2)
    return area / longest if longest > 0.0 else 0.0, longest


@kernel
def agreement_with(normals, v, star, i):
    """Cosine between a star's triangle and the mean normal that vertex v stands for."""
    nn = star[i, 9] ** 2 + star[i, 10] ** 2 + star[i, 11] ** 2
    mm = normals[v, 0] ** 2 + normals[v, 1] ** 2 + normals[v, 2] ** 2
    if nn <= 0.0 or mm <= 0.0:
        return -1.0
    dot = 0.0
    for d in range(3):
        dot += star[i, 9 + d] * normals[v, d]
    return dot / math.sqrt(nn * mm)


@kernel
def turn_between(one, v, normals, w):
    """Squared distance between the unit vectors along row v of one array and row w of another."""
    dot, vv, ww = 0.0, 0.0, 0.0
    for d in range(3):
        dot += one[v, d] * normals[w, d]
        vv += one[v, d] ** 2
        ww += normals[w, d] ** 2
    return 2.0 - 2.0 * dot / math.sqrt(vv * ww) if vv > 0.0 and ww > 0.0 else 0.0


@kernel
def star_shape(state, fan, star, count, normal, figures, room):
    """Least height over edge, least agreement with the corners' normals, excess of length.

    The last is the largest squared length over the squares allowed, of edges in 3D, and of spokes
    in 6D. normal (3,) is that of the vertex; room (1, 3).
    """
    normals = state[7]
    _, _, _, _, longest2, longest6, sigma2, _ = figures
    sine, agree, excess = FAR, FAR, 0.0
    for d in range(3):
        room[0, d] = normal[d]
    for i in range(count):
        here, length2 = least_sine(star, i)
        sine, excess = min(sine, here), max(excess, length2 / longest2)
        agree = min(agree, agreement_with(room, 0, star, i))
        agree = min(agree, agreement_with(normals, fan[i, 1], star, i))
        agree = min(agree, agreement_with(normals, fan[i, 2], star, i))
        if sigma2 > 0.0:
            spoke2 = star[i, 3] ** 2 + star[i, 4] ** 2 + star[i, 5] ** 2
            spoke2 += sigma2 * turn_between(room, 0, normals, fan[i, 1])
            excess = max(excess, spoke2 / longest6)
    return sine, agree, excess


@kernel
def segment_square(x, y, z, a, b):
    """Squared distance of a point from the segment between points a (3,) and b (3,)."""
    length, along = 0.0, 0.0
    ex, ey, ez = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    px, py, pz = x - a[0], y - a[1], z - a[2]
    length = ex * ex + ey * ey + ez * ez
    along = px * ex + py * ey + pz * ez
    t = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
    return (px - t * ex) ** 2 + (py - t * ey) ** 2 + (pz - t * ez) ** 2


@kernel
def nearest_curve(points, fan, star, count, x, y, z, hub):
    """Nearest feature edge of a star to a point: (triangle of the star, squared distance)."""
    best, least = -1, FAR
    for i in range(count):
        p, q = points[fan[i, 1]], points[fan[i, 2]]
        for k in range(3):
            if fan[i, 3 + k] == 0:
                continue
            if k == 0:
                square = segment_square(x, y, z, hub, p)
            elif k == 1:
                square = segment_square(x, y, z, p, q)
            else:
                square = segment_square(x, y, z, q, hub)
            if square < least:
                best, least = i, square
    return best, least


@kernel
def gather(head, after, face, pool, filled):
    """Append the samples of a face to pool; returns its length."""
    s = head[face]
    while s >= 0:
        pool[filled] = s
        filled += 1
        s = after[s]
    return filled


@kernel
def gather_fan(samples, fan, count, pool):
    """Write the samples of a fan's faces to pool; returns how many."""
    filled = 0
    for i in range(count):
        filled = gather(samples[0], samples[1], fan[i, 0], pool, filled)
    return filled


@kernel
def fill_triangle(points, a, b, c, star, i):
    """Row i of a star for the triangle (a, b, c)."""
    for d in range(3):
        star[i, d] = points[a, d]
        star[i, 3 + d] = points[b, d] - points[a, d]
        star[i, 6 + d] = points[c, d] - points[a, d]
    complete_row(star, i)


@kernel
def measure(state, samples, fan, star, count, hub, pool, filled, limit2, cosine, found):
    """Assign the pooled samples to the star: sum of (squared distance / allowed)^2, -1 if too far.

    found (s,) gets the star's triangle of each. limit2 is the squared distance allowed, times the
    sample's own share; `cosine` the least one between a sample's normal and its triangle's.
    """
    points = state[6]
    _, _, place, on_curve, direction, share, _ = samples
    total = 0.0
    guess = 0
    for j in range(filled):
        s = pool[j]
        x, y, z = place[s, 0], place[s, 1], place[s, 2]
        allowed = limit2 * share[s]
        if on_curve[s] == 1:
            best, least = nearest_curve(points, fan, star, count, x, y, z, hub)
        else:
            best, least = guess, closest_in_star(x, y, z, star, guess, FAR)
            for i in range(count):
                if i != guess:
                    square = closest_in_star(x, y, z, star, i, least)
                    if square < least:
                        best, least = i, square
            guess = best
        if least > allowed or best < 0:
            return -1.0
        if cosine > -1.0 and on_curve[s] == 0:
            size = math.sqrt(star[best, 9] ** 2 + star[best, 10] ** 2 + star[best, 11] ** 2)
            dot = 0.0
            for d in range(3):
                dot += star[best, 9 + d] * direction[s, d]
            if dot < cosine * size:
                return -1.0
        found[s] = best
        total += (least / allowed) ** 2
    return total


@kernel
def assign(samples, fan, count, pool, filled, found):
    """List the pooled samples at the faces of the fan that were found for them."""
    head, after = samples[0], samples[1]
    for i in range(count):
        head[fan[i, 0]] = -1
    for j in range(filled - 1, -1, -1):
        s = pool[j]
        face = fan[found[s], 0]
        after[s] = head[face]
        head[face] = s
