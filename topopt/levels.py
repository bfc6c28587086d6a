"""Coarse to fine: a design found on a coarse mesh is carried over and gone on with on a finer one.

    levels = Levels(problem, coarse, 2)
    rough = optimize(coarse, problem, coarse_settings(settings), levels.first())
    result = optimize(fine, problem, settings, levels.next(coarse, rough.loop, fine))

A step on a mesh of twice the edge length costs an eighth, and the design that it ends with spares
the fine mesh most of its steps. A coarse mesh cannot resolve the last one's interface: nodes would
hold it fast. So eps is twice as long from level to level: as many elements cross the interface on
each, and a wide one finds the better topology, since bars join and part while they are still soft.
The energy of an interface per area, gamma, stays the same. The result and its certificate belong to
the last mesh alone.
"""

from dataclasses import dataclass, replace

import numpy as np

from meshes.phase_field import PhaseField
from meshes.tet_mesh import TetMesh
from topopt.history import HistoryRow
from topopt.parameters import auto_eps
from topopt.problem import Problem
from topopt.transfer import transferred

REFINEMENT = 2.0  # edge length of a level over that of the next
COARSE_TOLERANCE = 1e-2  # KKT residual at which a coarse level is left
COARSE_STAGNATION = 5e-4  # decrease of J over 5 steps at which it is left: saddles are slow


@dataclass(frozen=True, eq=False)
class LevelStart:
    """Where the optimisation begins on one of several nested meshes.

    Parameters
    ----------
    phi : (n,) float array or None
        Nodal values on the level's mesh; None: phi = m.
    level : int
        From 1, the coarsest.
    gamma : float or None [J/m^2]
    eps : float [m]
    history : tuple of HistoryRow
        Of the levels before.
    """

    phi: np.ndarray | None
    level: int
    gamma: float | None
    eps: float
    history: tuple[HistoryRow, ...] = ()


@dataclass(frozen=True, eq=False)
class Levels:
    """The parameters of a problem on nested meshes.

    Parameters
    ----------
    problem : Problem
    coarsest : TetMesh
        The mesh of level 1.
    count : int
        Levels; from one to the next the edge length is halved.
    """

    problem: Problem
    coarsest: TetMesh
    count: int

    @property
    def last_eps(self):
        """eps [m] of the last level; chosen for its edge length where the problem says nothing."""
        if self.problem.eps is not None:
            return self.problem.eps
        return auto_eps(self.coarsest) / REFINEMENT ** (self.count - 1)

    def eps_on(self, level):
        """eps [m] of a level."""
        return self.last_eps * REFINEMENT ** max(self.count - level, 0)

    def first(self):
        """The start on the coarsest mesh."""
        return LevelStart(None, 1, self.problem.gamma, self.eps_on(1))

    def next(self, mesh, loop, finer, level=None):
        """The start on a finer mesh.

        Parameters
        ----------
        mesh : TetMesh
        loop : LoopState
            What the run on `mesh` ended with.
        finer : TetMesh
        level : int, optional
            That of `finer`; the next one if not given.

        Returns
        -------
        LevelStart
            A gamma that was chosen keeps its ratio to eps, a given one its value.
        """
        level = loop.level + 1 if level is None else level
        eps = self.eps_on(level)
        gamma = loop.gamma * (eps / loop.eps if self.problem.gamma is None else 1.0)
        phi = transferred(PhaseField(mesh, loop.phi), finer)
        return LevelStart(phi, level, gamma, eps, loop.history)


def coarse_settings(settings):
    """The OptimizationSettings of all levels but the last."""
    return replace(
        settings,
        tolerance=max(settings.tolerance, COARSE_TOLERANCE),
        stagnation=max(settings.stagnation, COARSE_STAGNATION),
        check_resolution=False,
    )
