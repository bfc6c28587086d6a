"""The three cases of the thesis as problems, for the tests of the mesh and its boundary."""

from meshes import SymmetryPlane
from topopt.problem import Box, BoxDomain, Load, Problem, Support


def bridge(scale=1.0):
    """The modelled quarter of the bridge, its lengths times `scale`."""
    x, y, z = 0.05 * scale, 0.015 * scale, 0.02 * scale
    return Problem(
        domain=BoxDomain((0, 0, 0), (x, y, z)),
        supports=(Support("ends", Box((0.9 * x, 0, 0), (x, y, 0))),),
        loads=(Load("deck", Box((0, 0, z), (0.2 * x, 0.5 * z, z)), (0, 0, -2400.0)),),
        volume_fraction=0.095,
        symmetry=(SymmetryPlane(0), SymmetryPlane(1)),
    )


def table():
    """The modelled quarter of the table."""
    return Problem(
        domain=BoxDomain((0, 0, 0), (0.048, 0.014, 0.02)),
        supports=(Support("foot", Box((0.044, 0.01, 0), (0.048, 0.014, 0)), (2,)),),
        loads=(Load("deck", Box((0, 0, 0.02), (0.04, 0.01, 0.02)), (0, 0, -2400.0)),),
        volume_fraction=0.12,
        symmetry=(SymmetryPlane(0), SymmetryPlane(1)),
    )


def whole_table():
    """The whole table, its four feet held in z alone."""
    feet = tuple(
        Support(f"foot {i}{j}", Box((x, y, 0), (x + 0.004, y + 0.004, 0)), (2,))
        for i, x in enumerate((0.0, 0.092))
        for j, y in enumerate((0.0, 0.024))
    )
    return Problem(
        domain=BoxDomain((0, 0, 0), (0.096, 0.028, 0.02)),
        supports=feet,
        loads=(Load("deck", Box((0.008, 0.004, 0.02), (0.088, 0.024, 0.02)), (0, 0, -2400.0)),),
        volume_fraction=0.12,
    )


def tower():
    """The modelled quarter of the tower."""
    return Problem(
        domain=BoxDomain((0, 0, 0), (0.06, 0.01, 0.01)),
        supports=(Support("foot", Box((0, 0.006, 0.006), (0, 0.01, 0.01)), (0, 2)),),
        loads=(Load("top", Box((0.06, 0, 0), (0.06, 0.002, 0.002)), (-240000.0, 0, 0)),),
        volume_fraction=0.2,
        symmetry=(SymmetryPlane(1), SymmetryPlane(2)),
    )
