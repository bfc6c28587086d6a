"""Smoothed aggregation multigrid for linear elasticity.

Read in this order: `aggregation` (which nodes move as one), `patterns` (where the nonzeros are),
`hierarchy` (the numbers of every level), `cycle` (how levels help each other), `solver`
(conjugate gradients around it). The kernels modules hold the loops.
"""

from topopt.multigrid.cycle import CycleSettings
from topopt.multigrid.solver import MultigridSolver

__all__ = ["CycleSettings", "MultigridSolver"]
