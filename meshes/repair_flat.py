"""Triangles without area taken out: needles collapsed, caps flipped.

They are rare, so that this is plain Python on the few faces around them.
"""

from dataclasses import replace

import numpy as np

FLAT = 1e-6  # height over longest edge of a triangle that counts as flat
NEEDLE = 10.0  # its shortest edge is collapsed if it is below this times the height
PASSES = 20


def flat_faces(points, faces):
    """Faces (m,) bool whose height is below FLAT of their longest edge."""
    return _shape(points[faces]) <= FLAT


def _shape(corners):
    """Height over longest edge (m,) of triangles (m, 3, 3); 0 if all corners coincide."""
    sides = corners - np.roll(corners, -1, axis=1)
    longest = np.abs(sides).max(axis=(1, 2))
    sides = sides / np.where(longest > 0, longest, 1.0)[:, None, None]
    square = np.einsum("mkd,mkd->mk", sides, sides).max(axis=1)
    double_area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return double_area / np.where(square > 0, square, 1.0)


def remove_flat(soup):
    """Take flat triangles out of a manifold surface.

    Returns
    -------
    Soup
    removed, left : int
        Flat faces that are gone, and those that could not be taken out.
    """
    before = int(np.count_nonzero(flat_faces(soup.points, soup.faces)))
    if before == 0:
        return soup, 0, 0
    work = _Work(soup)
    for _ in range(PASSES):
        flat = np.flatnonzero(work.alive & flat_faces(work.points, work.faces))
        if len(flat) == 0 or not sum(work.treat(int(face)) for face in flat):
            break
    result = replace(soup, faces=work.faces).keep(work.alive)
    left = int(np.count_nonzero(flat_faces(result.points, result.faces)))
    return result, max(before - left, 0), left


class _Work:
    """Faces with the faces at every vertex."""

    def __init__(self, soup):
        largest = np.abs(soup.points).max(initial=0.0)
        self.points = np.ldexp(soup.points, -np.frexp(largest)[1])
        self.faces = soup.faces.copy()
        self.alive = np.ones(len(self.faces), dtype=bool)
        order = np.argsort(self.faces.ravel(), kind="stable")
        bounds = np.searchsorted(self.faces.ravel()[order], np.arange(len(self.points) + 1))
        self._order, self._bounds, self._changed = order // 3, bounds, {}

    def around(self, vertex):
        """The faces at a vertex, as a set that may be changed."""
        if vertex not in self._changed:
            first, last = self._bounds[vertex : vertex + 2]
            self._changed[vertex] = set(self._order[first:last].tolist())
        return self._changed[vertex]

    def treat(self, face):
        """Collapse, flip or drop one flat face; whether that was possible."""
        if not self.alive[face] or _shape(self.points[self.faces[face]][None])[0] > FLAT:
            return False
        corners = self.points[self.faces[face]]
        lengths = np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1)
        shortest, longest = int(np.argmin(lengths)), int(np.argmax(lengths))
        height = _shape(corners[None])[0] * lengths[longest]
        if lengths[shortest] <= max(NEEDLE * height, FLAT * lengths[longest]):
            a, b = (int(self.faces[face, (shortest + k) % 3]) for k in (0, 1))
            return self._collapse(a, b) or self._collapse(b, a)
        return self._flip(face, longest)

    def _neighbours(self, vertex):
        return {int(v) for face in self.around(vertex) for v in self.faces[face]} - {vertex}

    def _collapse(self, kept, gone):
        """Move vertex `gone` onto `kept` if the surface stays a manifold and nothing turns over."""
        shared = self.around(kept) & self.around(gone)
        if len(self._neighbours(kept) & self._neighbours(gone)) != len(shared):
            return False
        if self._on_boundary(gone) and (len(shared) != 1 or not self._on_boundary(kept)):
            return False
        moved = sorted(self.around(gone) - shared)
        after = np.where(self.faces[moved] == gone, kept, self.faces[moved])
        before_shape = _shape(self.points[self.faces[moved]])
        facing = np.einsum("md,md->m", *(self._normals(f) for f in (self.faces[moved], after)))
        solid = before_shape > FLAT
        if np.any(facing[solid] <= 0) or np.any(_shape(self.points[after])[solid] <= FLAT):
            return False
        if len(moved) == 0 and len(self.around(kept)) == len(shared):
            return False  # nothing but these faces
        for face in shared:
            self._drop(face)
        for face, corners in zip(moved, after):
            self.faces[face] = corners
            self.around(kept).add(face)
        self._changed[gone] = set()
        return True

    def _on_boundary(self, vertex):
        return len(self._neighbours(vertex)) != len(self.around(vertex))

    def _normals(self, faces):
        a, b, c = (self.points[faces[:, k]] for k in range(3))
        return np.cross(b - a, c - a)

    def _drop(self, face):
        self.alive[face] = False
        for vertex in self.faces[face]:
            self.around(int(vertex)).discard(face)

    def _flip(self, face, corner):
        """Flip the longest edge, or drop the face where that edge is open."""
        a, b, c = (int(self.faces[face, (corner + k) % 3]) for k in range(3))
        others = (self.around(a) & self.around(b)) - {face}
        if not others:
            if self._on_boundary(c):
                return False
            self._drop(face)
            return True
        other = others.pop()
        d = next(int(v) for v in self.faces[other] if v not in (a, b))
        new = np.array([[a, d, c], [d, b, c]])
        if d == c or self.around(c) & self.around(d):
            return False
        old = np.array([self.faces[face], self.faces[other]])
        old_shape, new_shape = _shape(self.points[old]), _shape(self.points[new])
        reference = self._normals(old)[int(np.argmax(old_shape))]
        turned = self._normals(new) @ reference < 0
        if new_shape.min() <= old_shape.min() or turned[new_shape > FLAT].any():
            return False
        for gone in (face, other):
            for vertex in self.faces[gone]:
                self.around(int(vertex)).discard(gone)
        for number, corners in zip((face, other), new):
            self.faces[number] = corners
            for vertex in corners:
                self.around(int(vertex)).add(number)
        return True
