"""What the remesher asks of a surface, and the surface that needs no fit: a plane."""

from typing import Protocol, runtime_checkable

import numpy as np

from meshes.patch import Plane


@runtime_checkable
class ImplicitSurface(Protocol):
    """The zero set of a function S whose gradient points outward.

    All methods take points (n, 3) and are pure. Where S is undefined (outside the support of a
    compactly supported interpolant) values and gradients are NaN, never 0.
    """

    def value(self, points) -> np.ndarray:
        """S at points (n, 3): (n,)."""

    def gradient(self, points) -> np.ndarray:
        """Gradient of S at points (n, 3): (n, 3), not normalised."""

    def value_and_gradient(self, points) -> tuple[np.ndarray, np.ndarray]:
        """Both at once: (n,) and (n, 3)."""

    def project(self, points) -> tuple[np.ndarray, np.ndarray]:
        """Points of the surface near points (n, 3), and the unit outward normals there.

        A point that cannot be projected (S undefined, no convergence) comes back as NaN.
        """


class PlaneSurface:
    """A planar cap as an ImplicitSurface: S is the signed distance to the plane."""

    def __init__(self, plane: Plane):
        self.plane = plane
        self._normal = np.asarray(plane.normal, dtype=float)

    def value(self, points):
        return self.plane.signed_distance(points)

    def gradient(self, points):
        return np.broadcast_to(self._normal, np.shape(points)).copy()

    def value_and_gradient(self, points):
        return self.value(points), self.gradient(points)

    def project(self, points):
        moved = np.asarray(points) - self.value(points)[:, None] * self._normal
        return moved, self.gradient(points)
