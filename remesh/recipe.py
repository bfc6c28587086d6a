"""The measured recipe: pliant loop, exact count, fits and searches."""

from dataclasses import dataclass, replace

import numpy as np

from meshes.quality import face_areas
from meshes.topology import label_boundaries
from remesh.adjust import fit_vertices, match_volume
from remesh.collapse import collapse_short_edges
from remesh.connectivity import BASE, CORNER, INTERIOR, KIND
from remesh.embedding import smallest_angles
from remesh.flip import DELAUNAY, VALENCE, flip_edges
from remesh.follow import fit_curves, split_far_edges
from remesh.insert import insert_beside_short_edges
from remesh.mend import raise_worst
from remesh.optimise import optimise_vertices
from remesh.relieve import relieve_gaps
from remesh.shape_kernels import area_and_moments
from remesh.sizing import Sizing
from remesh.smooth import AREA, UNIFORM, smooth_vertices
from remesh.split import split_long_edges
from remesh.sweeps import FIRST_LENGTH, PliantLoop, length_for_count
from remesh.tips import keep_tips

LAST_AGREEMENT = 0.2
LONGEST, HELD_SHAPE = 3.0, (0.0, 12.0, 0.1)  # of collapses at the end, the first in shortest edges
SMALL, QUALITY_SWEEPS = 45.0, 15  # [degrees] of angles that are searched for on request
MOST_HALVINGS, HOLDING_ROUNDS = 10, 3
COUNT_ROUNDS, COUNT_TOLERANCE = 8, 0.005  # searches end when the count is as near as that
COARSER = 1.25  # times the distance allowed between feature edges and curves, each round
FARTHEST = 0.03  # of the target length: largest gap, and that of creases from their edges
DIRECTIONS, WORST_DIRECTIONS = 3, 6  # of the general search and of that for the worst
CURVE_ANGLE = 22.0  # [degrees] that fitting curves may leave in 3D
MEND_FARTHEST = 0.033  # of the target length: creases from their edges where angles are mended
LEAST_AGREEMENT, RELIEFS = 0.1, 3
MOST_INSERTED, FILL_ROUNDS = 0.005, 3  # share of the vertices
THIN = 18.0  # [degrees] below which a triangle at a held short edge gets a vertex
LOOP_SIGMA = 0.85  # of sigma: the searches then stretch triangles, and stop short of it
STRETCHED = 3.0  # triangles that sigma stretches more cannot keep their 3D angles
FIRST_STEP, HELD_STEP, WORST_STEP = 0.08, 0.04, 0.15  # of the mean edge at a vertex


@dataclass(frozen=True)
class Recipe:
    """Figures of the recipe that differ between kinds of input.

    Parameters
    ----------
    sigma : float [unit of the points]
        Of the loop.
    final_sigma : float [unit of the points]
        Of the angles that the searches improve.
    weights : UNIFORM or AREA
        Of the loop's smoothing.
    short, long : float
        Collapse below, split above these times the target length.
    agreement : float
        Least cosine between triangles and the surface's normals at their corners.
    least3 : float [degrees]
        3D angle that the searches try to reach.
    floor : float [degrees]
        3D angle that every triangle has at the end where that can be had.
    weight3 : float
        Its weight in the cost of the general search.
    loop_least3 : float [degrees]
        3D angle below which the loop makes no triangle.
    first_search, later_search : tuple of int
        Sweeps of the searches before and between the fits, each number followed by flips.
    fits : tuple of float
        Tangential damping of each point-to-plane fit.
    hold : float
        Weight of the gaps' growth in the searches after fits: 1 lets a vertex that adds the mean
        gap turn one triangle from 30 to 60 degrees.
    last_fit : float
        Tangential damping of the last fit; 0 for one along the normals alone.
    ridge : float
        Weight of offset differences across edges in the fits.
    order : int
        Samples per triangle: order^2.
    delaunay_rounds : int
        Last rounds of the loop that flip for angles instead of valences.
    last_search : tuple of int
        Sweeps of a last search by the surface's own normals; empty for none.
    """

    sigma: float
    final_sigma: float
    weights: int = UNIFORM
    short: float = 0.7
    long: float = 1.4
    agreement: float = 0.3
    least3: float = 39.2
    floor: float = 39.0
    weight3: float = 0.0
    loop_least3: float = 8.0
    first_search: tuple = (2, 2, 6)
    later_search: tuple = (6,)
    fits: tuple = (0.05, 0.03)
    hold: float = 0.2
    last_fit: float = 0.0
    ridge: float = 0.0
    order: int = 2
    delaunay_rounds: int = 2
    last_search: tuple = ()

    @property
    def embedded(self):
        """Whether the result's angles are meant in 6D."""
        return self.final_sigma > 0.0


def run_recipe(work, gaps, recipe, settings, volume, length, vertices, progress):
    """Take a work mesh through the loop, the fits and the searches."""
    if settings.sized:
        work.sizing = Sizing(
            work.carrier, recipe.sigma, settings.gradation, settings.min_length,
            settings.max_length,
        )  # fmt: skip
    keep_tips(work, tip_length(work, recipe, length, vertices))
    loop = PliantLoop(
        work, recipe.sigma, (20.0, recipe.loop_least3, recipe.agreement),
        recipe.weights if settings.gradation is None else UNIFORM, recipe.short, recipe.long,
    )  # fmt: skip
    length = loop.run(
        length, settings.iterations, vertices, recipe.delaunay_rounds, recipe.final_sigma,
        lambda share: progress("loop", share),
    )  # fmt: skip
    meet_count_and_curves(work, loop, recipe, length, vertices)
    sizing, work.sizing = work.sizing, None
    if settings.sized:
        length = min(max(length, settings.min_length), settings.max_length)
    work.compact()
    gaps.settle(work)
    recipe = finishing(recipe, settings)
    if settings.fit:
        fit_offsets(work, gaps, recipe)
        progress("fit", 0.3)
    if settings.optimise:
        general_search(work, recipe, recipe.first_search)
        progress("optimise", 0.5)
    if settings.fit:
        fit_and_search(work, gaps, recipe, settings.optimise)
        progress("fit", 1.0)
    if settings.optimise:
        improve_worst(work, recipe, length)
        if not recipe.embedded:  # thin in 3D is what sigma asks for
            relieve_short_edges(work, recipe, length)
        mend_worst(work, recipe, length)
    if settings.fit and settings.smoothing == 0:
        relieve(work, gaps, recipe, length, settings.optimise)
    if settings.quality is not None:
        search_for_worst(work, recipe)
    progress("optimise", 1.0)
    if settings.sized:
        hold_lengths(work, recipe, settings, length, sizing)
    if settings.fit and volume is not None:
        match_volume(work, volume)
        split_above(work, settings.max_length)
    return length


def hold_lengths(work, recipe, settings, length, sizing):
    """Collapse the edges that have come to be too short, and split those that are too long.

    What that takes from the number of vertices asked for is given back where edges are longest.
    """
    longest = min(settings.max_length, LONGEST * settings.min_length)
    for _ in range(HOLDING_ROUNDS):
        changed = 0
        if settings.min_length > 0.0:
            changed += collapse_short_edges(work, settings.min_length, longest, 0.0, HELD_SHAPE)
            work.compact()
        changed += split_above(work, settings.max_length)
        if changed == 0:
            return
        if settings.vertices is not None and work.vertices < settings.vertices:
            work.sizing = sizing
            PliantLoop(work, recipe.sigma, (0.0, 0.0, LEAST_AGREEMENT)).split_longest(
                settings.vertices - work.vertices, length
            )
            work.sizing = None
        improve_worst(work, recipe, length)
    split_above(work, settings.max_length)


def split_above(work, longest):
    """Split edges until none is longer in 3D; return how many."""
    if longest == np.inf:
        return 0
    total = 0
    for _ in range(MOST_HALVINGS):
        done = split_long_edges(work, longest, 0.0, LEAST_AGREEMENT)
        total += done
        if done == 0:
            break
    return total


def relieve(work, gaps, recipe, length, search):
    """Make the largest gaps smaller, in turn with a search for the worst angles."""
    limits = (20.0 if recipe.embedded else 0.0, recipe.floor, LEAST_AGREEMENT)
    for i in range(RELIEFS):
        if i > 0:
            improve_worst(work, recipe, length)
        left = relieve_gaps(work, FARTHEST * length, recipe.final_sigma, limits, gaps.on_carrier)
        if not search:
            return
        if left == 0 and least_angle(work) > recipe.floor:
            break
    mend_worst(work, recipe, length)


def least_angle(work):
    """Least 3D angle [degrees] of the work mesh."""
    return smallest_angles(work.rows[work.corner_rows()[0], :3]).min()


def relieve_short_edges(work, recipe, length):
    """Put vertices beside short edges that are held, where triangles are thin because of them."""
    most = int(MOST_INSERTED * work.vertices)
    for _ in range(FILL_ROUNDS):
        rows = insert_beside_short_edges(work, THIN, most)
        if len(rows) == 0:
            return
        most -= len(rows)
        adapt_around(work, recipe, rows)
        improve_worst(work, recipe, length)


def adapt_around(work, recipe, rows):
    """Flip and search around vertices that stay where they are."""
    agreement = recipe.agreement
    steps = np.zeros(len(work.links))
    steps[near_rows(work, rows, 1)] = FIRST_STEP
    work.links[rows, KIND] = CORNER
    for _ in range(2):
        flip_edges(work, recipe.final_sigma, (20.0, 0.0, agreement), DELAUNAY, 3)
        optimise_vertices(
            work, recipe.final_sigma, steps, 2, recipe.least3, recipe.weight3, agreement,
            sweeps=3,
        )  # fmt: skip
    work.links[rows, KIND] = INTERIOR


def near_rows(work, rows, rings):
    """Rows (n,) bool of some vertices and of as many rings around them."""
    corners, _ = work.corner_rows()
    vertex = work.links[corners, BASE]
    chosen = np.zeros(len(work.links), bool)
    chosen[rows] = True
    for _ in range(rings):
        chosen[vertex[chosen[vertex].any(axis=1)]] = True
    return chosen


def meet_count_and_curves(work, loop, recipe, length, vertices):
    """Meet the count, with feature edges that follow their curves as closely as it allows.

    What the curves need more, the patches get less; where that is not enough, the feature edges
    follow from farther away.
    """
    farthest, asked = FARTHEST * length, vertices
    if vertices is None:
        return follow_curves(work, recipe, farthest)
    for turn in range(COUNT_ROUNDS):
        loop.meet_count(max(asked, 4), length)
        before = work.vertices
        follow_curves(work, recipe, farthest)
        if abs(work.vertices - vertices) <= COUNT_TOLERANCE * vertices:
            return None
        asked = vertices - (work.vertices - before)
        if turn > 2:
            farthest *= COARSER
    return loop.meet_count(vertices, length)


def follow_curves(work, recipe, farthest):
    """Have the feature edges follow their curves closely."""
    if len(work.carrier.curves.vertices) == 0:
        return
    for _ in range(2):
        if split_far_edges(work, farthest, recipe.agreement) == 0:
            break
        flip_edges(work, recipe.sigma, (25.0, 0.0, recipe.agreement), VALENCE, 3)
        smooth_vertices(work, recipe.sigma, (20.0, 0.0, recipe.agreement), UNIFORM, 0.7)
    fit_curves(work, (0.0, CURVE_ANGLE, recipe.agreement), farthest)
    split_far_edges(work, farthest, recipe.agreement)


def tip_length(work, recipe, length, vertices):
    """3D length that edges will have near a tip, where the surface bends by one radian per edge."""
    if vertices is not None:
        length = length_for_count(work, recipe.final_sigma, vertices)
    return length / np.sqrt(1.0 + (recipe.final_sigma / length) ** 2)


def general_search(work, recipe, sweeps, agreement=None, hold=None):
    """Improve all angles by pattern search, with flips after each of the numbers of sweeps.

    hold : (n, 9) float array, optional
        What the last fit returned: the search then minds how far it moves from there.
    """
    agreement = recipe.agreement if agreement is None else agreement
    steps = np.full(len(work.links), FIRST_STEP if hold is None else HELD_STEP)
    guard3 = recipe.loop_least3 if recipe.embedded else 0.0
    for count in sweeps:
        optimise_vertices(
            work, recipe.final_sigma, steps, 2, recipe.least3, recipe.weight3, agreement,
            sweeps=count, directions=DIRECTIONS, hold=hold, hold_weight=recipe.hold,
        )  # fmt: skip
        flip_edges(work, recipe.final_sigma, (20.0, guard3, agreement), DELAUNAY, 3)


def fit_and_search(work, gaps, recipe, search):
    """Point-to-plane fits of the vertices, each followed by a search held to it; then offsets."""
    limits = (20.0 if recipe.embedded else 0.0, recipe.least3, recipe.agreement)
    for tangential in recipe.fits:
        hold = fit_vertices(
            work, gaps, recipe.final_sigma, limits, tangential, recipe.ridge, recipe.order
        )
        if search:
            general_search(work, recipe, recipe.later_search, hold=hold)
    if search and recipe.last_search:
        adapt_to_surface(work, gaps, recipe, hold)
    if search and recipe.last_fit > 0.0:
        fit_vertices(
            work, gaps, recipe.final_sigma, limits, recipe.last_fit, recipe.ridge, recipe.order
        )
    elif search:
        fit_offsets(work, gaps, recipe)


def fit_offsets(work, gaps, recipe):
    """Fit the vertices along their normals alone."""
    return fit_vertices(
        work, gaps, recipe.final_sigma, (0.0, 0.0, recipe.agreement), ridge=recipe.ridge,
        order=recipe.order, normal_only=True,
    )  # fmt: skip


def adapt_to_surface(work, gaps, recipe, hold):
    """Flip and search by the surface's own normals, which a smoothed carrier lacks."""

    def search():
        limits = (20.0, recipe.loop_least3, LAST_AGREEMENT)
        flip_edges(work, recipe.final_sigma, limits, DELAUNAY, 4)
        general_search(work, recipe, recipe.last_search, LAST_AGREEMENT, hold=hold)

    gaps.on_surface(work, search)


def improve_worst(work, recipe, length, sweeps=20):
    """Search around the few worst triangles alone."""
    farthest = FARTHEST * length
    if recipe.embedded:
        optimise_vertices(
            work, recipe.sigma, WORST_STEP, 2, recipe.least3, 20.0, recipe.agreement, 0.1, sweeps,
            directions=WORST_DIRECTIONS, along_curves=farthest,
        )  # fmt: skip
    else:
        optimise_vertices(
            work, 0.0, WORST_STEP, 2, recipe.least3, 20.0, recipe.agreement, recipe.least3, sweeps,
            directions=WORST_DIRECTIONS, along_curves=farthest,
        )  # fmt: skip


def mend_worst(work, recipe, length):
    """Change edges around triangles below the floor, where the search does not reach it."""
    farthest = MEND_FARTHEST * length
    raise_worst(work, recipe.floor, recipe.final_sigma, recipe.agreement, farthest)


def finishing(recipe, settings):
    """The recipe of the passes after the loop: for 3D angles, if it is these that are to be good.

    Sizes stay those of the embedding.
    """
    if settings.quality != "3d" or not recipe.embedded:
        return recipe
    return replace(
        recipe, final_sigma=0.0, least3=Recipe.least3, floor=Recipe.floor, weight3=0.0,
    )  # fmt: skip


def search_for_worst(work, recipe):
    """Search around all triangles with a small angle, in the space whose angles are to be good."""
    least3 = recipe.loop_least3 if recipe.embedded else 0.0
    for _ in range(2):
        flip_edges(work, recipe.final_sigma, (0.0, least3, recipe.agreement), DELAUNAY, 3)
        optimise_vertices(
            work, recipe.final_sigma, WORST_STEP, 8, least3, 20.0, recipe.agreement, SMALL,
            QUALITY_SWEEPS, directions=WORST_DIRECTIONS,
        )  # fmt: skip


def choose_recipe(settings, mesh, jagged):
    """The figures measured best for what is asked.

    Parameters
    ----------
    settings : RemeshSettings
    mesh : TriMesh
        The input.
    jagged : bool
        Whether the carrier had to be smoothed.
    """
    if settings.sigma > 0.0:
        if jagged:
            return Recipe(
                settings.sigma, settings.sigma, AREA, least3=12.0, floor=11.9, weight3=1.0,
                fits=(0.02,), ridge=0.165, first_search=(2, 2),
                later_search=(4,), last_search=(3,), hold=1.8, last_fit=0.045,
            )  # fmt: skip
        holds_shape = (
            len(label_boundaries(mesh)) > 0 and longest_stretch(settings, mesh) < STRETCHED
        )
        least3, floor = (24.0, 21.7) if holds_shape else (12.0, 11.9)
        return Recipe(
            LOOP_SIGMA * settings.sigma, settings.sigma, AREA, agreement=0.2, least3=least3,
            floor=floor, weight3=1.0, fits=(0.02, 0.02, 0.02), order=3, hold=0.34,
        )  # fmt: skip
    size = extent(mesh)
    if jagged:
        return Recipe(
            0.0101 * size, 0.0, least3=39.7, floor=39.5, fits=(0.1,), ridge=0.03,
            delaunay_rounds=0, first_search=(2, 2, 3), later_search=(4,),
        )  # fmt: skip
    return Recipe(
        0.0229 * size, 0.0, short=0.72, long=1.38, agreement=0.1, fits=(0.1, 0.1), order=3,
        hold=0.24,
    )  # fmt: skip


def longest_stretch(settings, mesh):
    """About how often longer than wide triangles get: sigma times the sharpest bend they follow."""
    length = settings.edge_length
    if length is None:
        area = face_areas(mesh.points, mesh.faces).sum()
        length = np.sqrt(2.0 * area / (np.sqrt(3.0) * (settings.vertices or len(mesh.points))))
    return settings.sigma / length


def extent(mesh):
    """Twice the root mean square distance of a surface from its centroid: the same if rotated."""
    sums = np.empty(5)
    area_and_moments(mesh.points, mesh.faces, sums)
    centre = sums[1:4] / sums[0]
    return 2.0 * float(np.sqrt(max(sums[4] / sums[0] - centre @ centre, 0.0)))


def first_length(work, recipe, settings):
    """First target length of the loop, from the count or the edge length asked for."""
    if settings.vertices is not None:
        return FIRST_LENGTH * length_for_count(work, recipe.sigma, settings.vertices)
    return settings.edge_length
