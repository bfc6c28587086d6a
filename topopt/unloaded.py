"""The state problem of a part that nothing loads: the flow of the interface alone."""

import numpy as np

from topopt.elasticity import Response, State
from topopt.geometry import tet_geometry


class Unloaded:
    """Stands in for `ElasticModel` where there are neither loads nor gravity: u = 0.

    Parameters
    ----------
    mesh : TetMesh
    problem : Problem
        Its material is kept.
    """

    def __init__(self, mesh, problem):
        self.mesh = mesh
        self.material = problem.material
        self.gravity = np.zeros(3)
        self.geometry = tet_geometry(mesh)

    @property
    def volumes(self):
        return self.geometry.volumes

    def solve(self, phi, start=None, tolerance=1e-6):
        """Return the State at rest."""
        displacement = np.zeros((len(self.mesh.points), 3))
        density = np.zeros(len(self.mesh.tets))
        return State(
            displacements=displacement[None],
            compliances=(0.0,),
            compliance=0.0,
            energy_density=density,
            iterations=0,
            residual=0.0,
            compliance_error=0.0,
            solver="none",
            assembly_seconds=0.0,
            setup_seconds=0.0,
            solve_seconds=0.0,
        )

    def response(self, phi, state, direction, tolerance=1e-2, start=None):
        """Return the Response of rest."""
        return Response(np.zeros_like(state.displacements), np.zeros(len(self.mesh.tets)), 0)
