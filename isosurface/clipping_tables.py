"""The polygons that a level cuts out of a tetrahedron, and keeps of a triangle, for every sign.

Bit k of a pattern is set if node k is inside. Tables hold local numbers, -1 where there is no such
polygon; polygons run counter-clockwise seen from outside the solid.
"""

import numpy as np

from meshes.tet_mesh import TET_FACES

# The edges of a tetrahedron by their local nodes.
TET_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


def _edge(a, b):
    """Local number of the edge between local nodes a and b."""
    return int(np.flatnonzero(np.all(np.equal(TET_EDGES, sorted((a, b))), axis=1))[0])


def _tet_tables():
    """Triangles (16, 3) and quads (16, 4) of local edges that the level cuts out of a tet."""
    triangles = np.full((16, 3), -1)
    quads = np.full((16, 4), -1)
    for node, opposite in enumerate(TET_FACES.tolist()):
        fan = [_edge(node, other) for other in opposite]
        triangles[1 << node] = fan
        triangles[15 - (1 << node)] = fan[::-1]
    for a, b, c, d in ((0, 1, 2, 3), (0, 2, 3, 1), (0, 3, 1, 2)):  # even permutations
        quad = [_edge(a, c), _edge(a, d), _edge(b, d), _edge(b, c)]
        quads[(1 << a) | (1 << b)] = quad
        quads[(1 << c) | (1 << d)] = quad[::-1]
    return triangles, quads


def _facet_tables():
    """Triangles (8, 3) and quads (8, 4) that remain of a facet inside the level.

    Items 0, 1, 2 are its nodes; 3, 4, 5 its edges 01, 12 and 20.
    """
    triangles = np.full((8, 3), -1)
    quads = np.full((8, 4), -1)
    triangles[7] = 0, 1, 2
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        triangles[1 << a] = a, 3 + a, 3 + c
        quads[7 - (1 << c)] = a, b, 3 + b, 3 + c
    return triangles, quads


TET_TRIANGLES, TET_QUADS = _tet_tables()
FACET_TRIANGLES, FACET_QUADS = _facet_tables()
