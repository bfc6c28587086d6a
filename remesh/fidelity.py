"""How far the triangles are from the surface: from the input's triangles, or from S(x) = 0."""

import math

import numpy as np

from meshes.quality import normalised
from remesh.adjust import free_rows, refresh_feet, take_steps
from remesh.compiled import allocating
from remesh.connectivity import HINT, ROWS
from remesh.embedding import triangle_normal
from remesh.nearest import near

CLEAR_GAP = 4e-3  # of the mean edge: beyond it the gap itself gives the direction
SAME_SIDE = 0.7


class TriangleFidelity:
    """Gaps to the triangles of a surface.

    Parameters
    ----------
    surface : Carrier
        Of the surface as it is.
    hints : (m,) int array
        For each triangle of the work mesh's carrier one of the surface nearby.
    """

    on_carrier = True  # the carrier's triangles, not only its vertices, are the surface

    def __init__(self, surface, hints):
        self.surface = surface
        self.hints = np.asarray(hints, np.int64)
        edges = surface.mesh.points[surface.mesh.faces[:, :2]]
        length = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1).mean()
        self.clear_gap = CLEAR_GAP * length

    def __call__(self, work, corners, samples, own):
        """See `adjust.fit_vertices`."""
        count = len(corners) * len(samples)
        normals, gap = np.empty((count, 3)), np.empty(count)
        hints = self.hints[work.links[corners[:, 0], HINT]]
        triangle_gaps(
            self.surface.reference, work.rows, corners, hints, samples, own, self.clear_gap,
            normals, gap,
        )  # fmt: skip
        return normals, gap

    def settle(self, work):
        """Nothing to do: the carrier's feet are on the triangles already."""

    def on_surface(self, work, action):
        """Run action() with the surface itself, not its smoothed copy, as the work's carrier.

        Only where there are no feature curves (the two have different arc lengths).
        """
        carrier = work.carrier
        if self.surface is carrier or len(carrier.curves.vertices):
            return
        used = int(work.counts[ROWS])
        free = free_rows(work)
        hints = work.links[:used, HINT].copy()
        work.links[:used, HINT] = self.hints[hints]
        work.carrier = self.surface
        refresh_feet(work.links, work.rows, used, free, work.carrier.reference)
        action()
        work.carrier = carrier
        work.links[:used, HINT] = hints
        refresh_feet(work.links, work.rows, used, free, carrier.reference)

    def feet(self, mesh, work):
        """Nearest faces (n,) of the mesh that the surface was made of, barycentric weights (n, 3).

        For the points of a mesh made of the compact work mesh.
        """
        hints = self.hints[work.links[work.base_rows(), HINT]]
        faces, found = self.surface.locate(mesh.points, hints)
        v, w = found[:, 0], found[:, 1]
        return self.surface.layout.order[faces], np.stack([1.0 - v - w, v, w], axis=1)

    def exact_normals(self, mesh, work):
        """Interpolated normals (m, 3, 3) of the carrier at the corners of the work mesh."""
        return work.corner_normals()


class ImplicitFidelity:
    """Gaps to the zero sets of implicit surfaces, one per label.

    Parameters
    ----------
    surfaces : sequence of ImplicitSurface
    """

    on_carrier = False

    def __init__(self, surfaces):
        self.surfaces = surfaces

    def __call__(self, work, corners, samples, own):
        """See `adjust.fit_vertices`."""
        triangles = work.rows[corners, :3]
        points = samples @ triangles
        per = len(samples)
        _, live = work.corner_rows()
        labels = work.labels[live]
        a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
        own_normals = np.cross(b - a, c - a)
        own_normals /= np.maximum(np.linalg.norm(own_normals, axis=1), 1e-300)[:, None]
        normals = np.repeat(own_normals, per, axis=0)
        gap = np.zeros(len(normals))
        for label in np.unique(labels):
            index = np.flatnonzero(labels == label)
            flat = (index[:, None] * per + np.arange(per)).ravel()
            value, gradient = self.surfaces[label].value_and_gradient(points[index].reshape(-1, 3))
            size = np.linalg.norm(gradient, axis=1)
            known = np.isfinite(value) & (size > 0.0)
            direction = gradient[known] / size[known, None]
            distance = -value[known] / size[known]
            cosine = np.einsum("ij,ij->i", direction, normals[flat[known]])
            along = cosine > SAME_SIDE
            chosen = flat[known]
            gap[chosen] = distance if not own else distance * cosine
            if not own:
                gap[chosen[~along]] *= cosine[~along]
                normals[chosen[along]] = direction[along]
        return normals, gap

    def settle(self, work):
        """Move all free vertices onto their surfaces, and renew their offsets."""
        free = free_rows(work)
        step = np.zeros((len(free), 3))
        patch = work.carrier.mesh.face_labels[work.links[: len(free), HINT]]
        for label in np.unique(patch[free]):
            rows = np.flatnonzero(free & (patch == label))
            moved, _ = self.surfaces[label].project(work.rows[rows, :3])
            known = np.isfinite(moved).all(axis=1)
            step[rows[known]] = moved[known] - work.rows[rows[known], :3]
        take_steps(work, free, step, 0.0, (0.0, 0.0, 0.0))

    def on_surface(self, work, action):
        """Nothing to do: the carrier has the exact normals already."""

    def exact_normals(self, mesh, work):
        """Unit gradients (m, 3, 3) at the corners of a mesh; the carrier's where undefined."""
        normals = work.corner_normals()
        for label in np.unique(mesh.face_labels):
            chosen = mesh.face_labels == label
            corners = mesh.points[mesh.faces[chosen]].reshape(-1, 3)
            exact = normalised(self.surfaces[label].gradient(corners)).reshape(-1, 3, 3)
            normals[chosen] = np.where(np.isfinite(exact), exact, normals[chosen])
        return normals


@allocating
def triangle_gaps(reference, rows, corners, hints, samples, own, clear_gap, normals, gap):
    """Unit direction and gap from samples of triangles to the reference triangles.

    The direction is the gap's own where that is clear, else the reference triangle's normal, and
    the sampled triangle's normal where these disagree with it (or always, with `own`).
    """
    shape = reference[0]
    per = samples.shape[0]
    n = np.empty(3)
    m = np.empty(3)
    d = np.empty(3)
    for t in range(corners.shape[0]):
        a, b, c = corners[t, 0], corners[t, 1], corners[t, 2]
        n[0], n[1], n[2] = triangle_normal(rows, a, b, c)
        size = math.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
        hint = hints[t]
        for k in range(3):
            n[k] /= size if size > 0.0 else 1.0
        for s in range(per):
            u, v, w = samples[s, 0], samples[s, 1], samples[s, 2]
            x = u * rows[a, 0] + v * rows[b, 0] + w * rows[c, 0]
            y = u * rows[a, 1] + v * rows[b, 1] + w * rows[c, 1]
            z = u * rows[a, 2] + v * rows[b, 2] + w * rows[c, 2]
            hint, p, q, square = near(reference, x, y, z, hint)
            d[0] = shape[hint, 0] + p * shape[hint, 3] + q * shape[hint, 6] - x
            d[1] = shape[hint, 1] + p * shape[hint, 4] + q * shape[hint, 7] - y
            d[2] = shape[hint, 2] + p * shape[hint, 5] + q * shape[hint, 8] - z
            m[0] = shape[hint, 4] * shape[hint, 8] - shape[hint, 5] * shape[hint, 7]
            m[1] = shape[hint, 5] * shape[hint, 6] - shape[hint, 3] * shape[hint, 8]
            m[2] = shape[hint, 3] * shape[hint, 7] - shape[hint, 4] * shape[hint, 6]
            size = math.sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2])
            distance = math.sqrt(square)
            along = d[0] * n[0] + d[1] * n[1] + d[2] * n[2]
            same = (m[0] * n[0] + m[1] * n[1] + m[2] * n[2]) > SAME_SIDE * size
            r = t * per + s
            if distance > clear_gap and abs(along) > 0.5 * distance and not own:
                sign = 1.0 if along > 0.0 else -1.0
                for k in range(3):
                    normals[r, k] = sign * d[k] / distance
            elif distance <= clear_gap and same and size > 0.0 and not own:
                for k in range(3):
                    normals[r, k] = m[k] / size
            else:
                for k in range(3):
                    normals[r, k] = n[k]
            gap[r] = d[0] * normals[r, 0] + d[1] * normals[r, 1] + d[2] * normals[r, 2]
