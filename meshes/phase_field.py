"""A phase field: 1 is material, 0 is void."""

from dataclasses import dataclass

import numpy as np

from meshes.arrays import frozen
from meshes.tet_mesh import TetMesh


@dataclass(frozen=True, eq=False)
class PhaseField:
    """Nodal values (n,) in [0, 1] of a P1 function on a tetrahedral mesh."""

    mesh: TetMesh
    values: np.ndarray

    def __post_init__(self):
        values = frozen(self.values, np.float64, (len(self.mesh.points),), "values")
        object.__setattr__(self, "values", values)
