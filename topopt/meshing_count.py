"""The edge length that gives a wanted number of tets.

The count n(h) falls roughly as h^-3, but in steps: pytetwild halves the edges of a background
grid, so n jumps by about 2 wherever h passes a certain length over a power of two, and between
the jumps it may hardly change. The steps repeat when h is halved. So the length is first found on
meshes some times coarser, which cost next to nothing, then carried over with h halved.
"""

import math
from dataclasses import dataclass

from meshes.errors import NotConverged

WANTED, ALLOWED = 0.03, 0.05  # relative errors of the count: aimed at, and accepted at last
COARSE = 40_000  # tets of the largest mesh that counts as cheap
CHEAP_TRIES, FULL_TRIES = 8, 4
NARROW = 0.01  # logarithm of the ratio of edge lengths between which no mesh is looked for
DENSITY = 9.0  # tets per cube of the edge length, roughly, for the very first guess
SKIN = 0.5  # n is about density * (V / h^3 + SKIN * S / h^2): measured on boxes


@dataclass(frozen=True)
class Size:
    """Volume and surface area of a domain."""

    volume: float
    area: float

    def count(self, edge_length):
        """Roughly how many tets there are."""
        return DENSITY * (self.volume / edge_length**3 + SKIN * self.area / edge_length**2)

    def edge_length(self, tets):
        """Roughly the edge length that gives so many tets."""
        low, high = 1e-9 * self.area**0.5, 1e3 * self.area**0.5
        for _ in range(100):
            middle = math.sqrt(low * high)
            low, high = (middle, high) if self.count(middle) > tets else (low, middle)
        return middle


class EdgeLengthSearch:
    """Secant on log n against log h, kept between the nearest lengths on both sides.

    Parameters
    ----------
    target : float
        Number of tets wanted.
    """

    def __init__(self, target):
        self.target = target
        self.tried = []  # (log h, log(n / target)), in the order tried

    def add(self, edge_length, tets):
        """Note the count that an edge length gave."""
        self.tried.append((math.log(edge_length), math.log(tets / self.target)))

    @property
    def error(self):
        """The smallest |n / target - 1| so far."""
        return min(abs(math.expm1(error)) for _, error in self.tried)

    def bracket(self):
        """The tried (log h, error) next to the target: with too many and with too few tets."""
        many = max((t for t in self.tried if t[1] > 0), default=None)
        few = min((t for t in self.tried if t[1] <= 0), default=None)
        return many, few

    def stuck(self):
        """Whether the lengths on both sides are as good as equal: n jumps over the target."""
        many, few = self.bracket()
        return many is not None and few is not None and few[0] - many[0] < NARROW

    def next(self, slope=-3.0):
        """The edge length to try next; `slope` is d log n / d log h while only one is known."""
        many, few = self.bracket()
        if many is None or few is None:
            place, error = min(self.tried, key=lambda t: abs(t[1]))
            return math.exp(place - min(max(error / slope, -0.4), 0.4))
        if few[0] <= many[0]:  # noise: lengths out of order
            return math.exp((few[0] + many[0]) / 2.0)
        share = min(max(many[1] / (many[1] - few[1]), 0.15), 0.85)
        return math.exp(many[0] + share * (few[0] - many[0]))


def mesh_by_count(mesh_at, size, target, log):
    """Mesh with a wanted number of tets, within 3 % if that is to be had and 5 % else.

    Parameters
    ----------
    mesh_at : callable taking an edge length, returning a mesh with `tets`
    size : Size
    target : int
    log : callable taking a str

    Returns
    -------
    The mesh nearest to the target.

    Raises
    ------
    NotConverged
        If no mesh within 5 % was found; the history holds the counts tried.
    """
    levels = 0
    while target / 8**levels > COARSE:
        levels += 1
    first = size.edge_length(target) * 2**levels
    for level in range(levels, 0, -1):
        wanted = target * size.count(first) / size.count(first / 2**level)
        log(f"looking for the edge length on a mesh of about {wanted:,.0f} tets")
        first, _ = _search(mesh_at, first, wanted, CHEAP_TRIES if level == levels else 2)
        first /= 2.0
    edge_length, mesh = _search(mesh_at, first, target, FULL_TRIES if levels else CHEAP_TRIES)
    return mesh


def _search(mesh_at, edge_length, target, tries):
    """The best (edge length, mesh) of some tries around a first edge length."""
    search, best = EdgeLengthSearch(target), None
    for _ in range(tries):
        mesh = mesh_at(edge_length)
        search.add(edge_length, len(mesh.tets))
        error = abs(len(mesh.tets) / target - 1.0)
        if best is None or error < best[0]:
            best = (error, edge_length, mesh)
        if best[0] <= WANTED or search.stuck():
            break
        edge_length = search.next()
    return best[1:]
