"""How fine a surface is asked for, and how much its curvature counts, in the remesher's terms."""

from dataclasses import dataclass

import numpy as np

from cases import quantities
from meshes.topology import edge_table

ALGORITHMS = {"default": "pliant", "thesis": "thesis"}


@dataclass(frozen=True)
class Target:
    """How fine a surface is asked for; exactly one of the three, or none for the input's count.

    Parameters
    ----------
    vertices : int or None
    edge_length : float or None [unit of the points]
        6D length.
    edge_factor : float or None
        6D length in longest edges of the input.
    """

    vertices: int | None = None
    edge_length: float | None = None
    edge_factor: float | None = None

    def for_surface(self, surface):
        """The `vertices` and `edge_length` of RemeshSettings for a surface."""
        if self.edge_factor is not None:
            return {"edge_length": self.edge_factor * longest_edge(surface)}
        if self.edge_length is not None:
            return {"edge_length": self.edge_length}
        return {"vertices": self.vertices or max(4, len(np.unique(surface.faces)))}


def longest_edge(surface):
    """Length of the longest edge of a surface, in the unit of its points."""
    ends = surface.points[edge_table(surface.faces).edges]
    return float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).max())


def sigma_length(sigma, diagonal, parse=quantities.length):
    """The weight of the normals, in the unit of `diagonal`, that "0.05" or "14mm" means.

    Parameters
    ----------
    sigma : float or str
        A number is in diagonals; a text with a unit is absolute.
    diagonal : float
    parse : callable
        Makes an absolute length of the text, in the unit of `diagonal`.
    """
    return parse(sigma) if quantities.is_absolute(sigma) else sigma * diagonal
