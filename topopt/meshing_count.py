"""The edge length that gives a wanted number of tets.

The count n(h) falls roughly as h^-3, but in steps: pytetwild halves the edges of a background
grid, so n jumps by about 2 wherever h passes a certain length over a power of two, and between
the jumps it may hardly change. The steps repeat when h is halved. So the length is first found on
meshes some times coarser, which cost next to nothing, then carried over with h halved.
"""

import math
from dataclasses import dataclass

from meshes.errors import NotConverged

WANTED, ALLOWED = 0.03, 0.05  # relative errors of the count: where tries are cheap, and elsewhere
TOLERATED = 0.1  # likewise, at most: where the search found no better mesh
COARSE = 40_000  # tets of the largest mesh that counts as cheap
CHEAP_TRIES, MIDDLE_TRIES, FULL_TRIES = 14, 2, 5
FLAT = 0.15  # relative spread of counts that no longer fall
WIDE = math.log(2.0)  # logarithm of the ratio of edge lengths over which they should have
NARROW = 0.001  # logarithm of the ratio of edge lengths between which no other is tried
LONGEST_STEP = 0.4  # likewise, between one edge length and the next
DENSITY = 9.0  # tets per cube of the edge length, roughly, for the very first guess
SKIN = 0.3  # n is about density * (V / h^3 + SKIN * S / h^2): measured on boxes


@dataclass(frozen=True)
class Size:
    """Volume and surface area of a domain."""

    volume: float
    area: float

    def count(self, edge_length):
        """Roughly how many tets there are."""
        return DENSITY * (self.volume / edge_length**3 + SKIN * self.area / edge_length**2)

    @property
    def longest_edge(self):
        """Four times the mean thickness: longer edges than the domain can have."""
        return 4.0 * 2.0 * self.volume / self.area

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

    def bracket(self):
        """The tried (log h, error) next to the target: with too many and with too few tets."""
        many = max((t for t in self.tried if t[1] > 0), default=None)
        few = min((t for t in self.tried if t[1] <= 0), default=None)
        return many, few

    def stuck(self):
        """Whether the lengths on both sides are as good as equal: n jumps over the target."""
        many, few = self.bracket()
        return many is not None and few is not None and abs(few[0] - many[0]) < NARROW

    def floor(self, longest):
        """Least count, if it is above the target and longer edges than those tried would not help:
        they do not lower it any more, or are longer than `longest`; else None."""
        _, few = self.bracket()
        if few is not None:
            return None
        tried = sorted(self.tried)[-3:]
        counts = [self.target * math.exp(error) for _, error in tried]
        wide = len(tried) == 3 and tried[-1][0] - tried[0][0] > WIDE
        flat = max(counts) < (1.0 + FLAT) * min(counts)
        if (wide and flat) or tried[-1][0] > math.log(longest):
            return round(min(counts))
        return None

    def next(self):
        """The edge length to try next."""
        many, few = self.bracket()
        if many is None or few is None:
            return math.exp(self._beyond(few if many is None else many))
        if few[0] <= many[0]:  # noise: the lengths are out of order
            return math.exp((few[0] + many[0]) / 2.0)
        share = min(max(many[1] / (many[1] - few[1]), 0.2), 0.8)
        return math.exp(many[0] + share * (few[0] - many[0]))

    def _beyond(self, nearest):
        """A step across the target by n ~ h^-3, doubled with every try that stayed on one side."""
        place, error = nearest
        step = error / 3.0 * 2.0 ** (len(self.tried) - 1)
        return place + min(max(step, -LONGEST_STEP), LONGEST_STEP)


def mesh_by_count(mesh_at, size, target, log):
    """Mesh with a wanted number of tets: within 5 %, and within 3 % where tries are cheap.

    When none was found after some tries, one within 10 % is used, and `log` told.

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
        If no mesh within 10 % was found; the history holds the counts tried.

    Notes
    -----
    A curved or detailed surface takes a certain number of tets however long the edges, and meshing
    takes the longer, the less they fit. So the search ends when three lengths, over a factor of
    two, give the same number above the target, or an edge as long as four thicknesses does.
    """
    halvings = 0
    while target / 8**halvings > COARSE:
        halvings += 1
    edge_length = size.edge_length(target) * 2**halvings
    tries = CHEAP_TRIES
    for left in range(halvings, 0, -1):
        wanted = target * size.count(edge_length) / size.count(edge_length / 2**left)
        log(f"looking for the edge length on coarser meshes of about {wanted:,.0f} tets")
        edge_length = search(mesh_at, edge_length, wanted, tries)[0] / 2.0
        tries = MIDDLE_TRIES
    if halvings:
        _, mesh, counts = search(mesh_at, edge_length, target, FULL_TRIES, ALLOWED)
    else:
        longest = size.longest_edge
        _, mesh, counts = search(mesh_at, edge_length, target, CHEAP_TRIES, longest=longest)
    error = abs(len(mesh.tets) / target - 1.0)
    if error > TOLERATED:
        raise NotConverged(
            f"no mesh of {target:,} tets was found; {_numbers(counts)} came out: ask for one of "
            f"these numbers, or give an edge length.",
            counts,
        )
    if error > ALLOWED:
        log(
            f"warning: no mesh of {target:,} tets was found within 5 %; the nearest one, of "
            f"{len(mesh.tets):,}, is used"
        )
    return mesh


def search(mesh_at, edge_length, target, tries, enough=WANTED, longest=math.inf):
    """Look around a first edge length for a mesh with a wanted number of tets.

    Stops after some tries, with a count that is near `enough`, or when the lengths tried on both
    sides of the target are as good as equal.

    Returns
    -------
    edge_length : float
    mesh
        The one nearest to the target, made with this edge length.
    counts : list of int
        Numbers of tets that came out, in order.
    """
    seeker, counts, least = EdgeLengthSearch(target), [], math.inf
    for _ in range(tries):
        mesh = mesh_at(edge_length)
        counts.append(len(mesh.tets))
        seeker.add(edge_length, counts[-1])
        error = abs(counts[-1] / target - 1.0)
        if error < least:
            least, best = error, (edge_length, mesh)
        if least <= enough or seeker.stuck():
            break
        floor = seeker.floor(longest)
        if floor is not None:
            raise NotConverged(
                f"no mesh of {target:,.0f} tets was found: the shape of the domain alone takes "
                f"about {floor:,}, however long the edges; ask for more than that, or "
                f"simplify its surface.",
                counts,
            )
        edge_length = seeker.next()
    return *best, counts


def _numbers(counts):
    return ", ".join(f"{count:,}" for count in sorted(set(counts)))
