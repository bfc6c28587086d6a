"""Topology optimisation with a phase field: from a `Problem` to a `PhaseField`.

    mesh = attach_sets(mesh_domain(problem, tets=50_000), problem)      # topopt.domain
    result = optimize(mesh, problem, OptimizationSettings(steps=60))    # topopt.optimize

`optimize` runs the flow (`flow`), each of whose steps solves the state problem (`elasticity`) and
one quadratic programme (`pdas`, with `box_qp` to fall back on).
"""

from topopt.problem import (
    BoundaryConditions,
    Box,
    BoxDomain,
    Load,
    Material,
    Problem,
    Support,
    SurfaceDomain,
)

__all__ = [
    "BoundaryConditions",
    "Box",
    "BoxDomain",
    "Load",
    "Material",
    "Problem",
    "Support",
    "SurfaceDomain",
]
