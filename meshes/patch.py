"""Names and planes of the pieces a surface is made of."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Plane:
    """The plane {x : normal . x = offset}; `normal` is a unit vector, `offset` is in metres."""

    normal: tuple[float, float, float]
    offset: float

    def signed_distance(self, points):
        """Signed distance of points (n, 3) [m]; positive on the side the normal points to."""
        return np.asarray(points) @ np.asarray(self.normal) - self.offset


@dataclass(frozen=True)
class Patch:
    """A named piece of a surface: planar (with its outward `plane`) or smooth (`plane` is None)."""

    name: str
    plane: Plane | None = None


@dataclass(frozen=True)
class SymmetryPlane:
    """The plane {x : x[axis] = offset} about which the modelled part is mirrored."""

    axis: int
    offset: float = 0.0

    @property
    def name(self):
        """The plane in words, e.g. `x=0`."""
        return f"{'xyz'[self.axis]}={self.offset:g}"

    def reflect(self, points):
        """Mirror image of points (n, 3) [m]; exact for points on the plane."""
        image = np.array(points, dtype=float)
        image[..., self.axis] = 2.0 * self.offset - image[..., self.axis]
        return image
