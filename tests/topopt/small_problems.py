"""Small optimisation problems for the tests."""

from dataclasses import replace

import numpy as np

from meshes.patch import SymmetryPlane
from meshes.structured import bcc_box
from topopt.problem import Box, BoxDomain, Load, Material, Problem, Support


def cantilever(cells=(6, 2, 4), scale=1.0, **changes):
    """A beam clamped at x = 0 and pulled down at its far lower edge: (mesh, problem)."""
    size = scale * np.array([0.06, 0.02, 0.04])
    patch = Box((size[0], 0.0, 0.0), (size[0], size[1], 0.25 * size[2]))
    problem = Problem(
        BoxDomain((0.0, 0.0, 0.0), tuple(size)),
        supports=(Support("wall", Box((0.0, -1e9, -1e9), (0.0, 1e9, 1e9))),),
        loads=(Load("tip", patch, (0.0, 0.0, -20000.0)),),
        volume_fraction=0.4,
        gamma=0.02 * scale,
        eps=0.004 * scale,
        symmetry=(SymmetryPlane(1),),
    )
    return bcc_box((0.0, 0.0, 0.0), size, cells), replace(problem, **changes)


def unloaded(size, volume_fraction, eps, gamma=1.0):
    """A box [0, size] with neither load nor support: the flow of the interface alone."""
    domain = BoxDomain((0.0, 0.0, 0.0), tuple(size))
    return Problem(domain, (), (), volume_fraction, gamma=gamma, eps=eps, material=Material())
