"""The measured recipe: pliant loop, exact count, fits and searches."""

from dataclasses import dataclass

import numpy as np

from meshes.quality import face_areas
from remesh.adjust import fit_vertices, match_volume
from remesh.flip import DELAUNAY, flip_edges
from remesh.optimise import optimise_vertices
from remesh.smooth import AREA, UNIFORM
from remesh.sweeps import FIRST_LENGTH, PliantLoop, length_for_count
from remesh.tips import keep_tips

LAST_AGREEMENT, LAST_TANGENTIAL = 0.2, 0.03


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
    weight3 : float
        Its weight in the cost of the general search.
    loop_least3 : float [degrees]
        3D angle below which the loop makes no triangle.
    search_steps : tuple of float
        First steps of the general search.
    fits : tuple of float
        Tangential damping of each point-to-plane fit.
    ridge : float
        Weight of offset differences across edges in the fits.
    order : int
        Samples per triangle: order^2.
    delaunay_rounds : int
        Last rounds of the loop that flip for angles instead of valences.
    last_step : float
        First step of a last search by the surface's own normals; 0 for none.
    """

    sigma: float
    final_sigma: float
    weights: int = UNIFORM
    short: float = 0.7
    long: float = 1.4
    agreement: float = 0.3
    least3: float = 38.0
    weight3: float = 0.0
    loop_least3: float = 8.0
    search_steps: tuple = (0.15, 0.08, 0.05)
    fits: tuple = (0.05, 0.03)
    ridge: float = 0.0
    order: int = 2
    delaunay_rounds: int = 2
    last_step: float = 0.0

    @property
    def embedded(self):
        """Whether the result's angles are meant in 6D."""
        return self.final_sigma > 0.0


def run_recipe(work, gaps, recipe, settings, volume, length, vertices, progress):
    """Take a work mesh through the loop, the fits and the searches."""
    keep_tips(work, tip_length(work, recipe, length, vertices))
    loop = PliantLoop(
        work, recipe.sigma, (20.0, recipe.loop_least3, recipe.agreement), recipe.weights,
        recipe.short, recipe.long,
    )  # fmt: skip
    length = loop.run(
        length, settings.iterations, vertices, recipe.delaunay_rounds, recipe.final_sigma,
        lambda share: progress("loop", share),
    )  # fmt: skip
    if vertices is not None:
        loop.meet_count(vertices, length)
    work.compact()
    gaps.settle(work)
    if settings.fit:
        fit_vertices(
            work, gaps, recipe.final_sigma, (0.0, 0.0, recipe.agreement), ridge=recipe.ridge,
            order=recipe.order, normal_only=True,
        )  # fmt: skip
        progress("fit", 0.3)
    if settings.optimise:
        for step in recipe.search_steps:
            general_search(work, recipe, step)
        progress("optimise", 0.5)
    if settings.fit:
        fit_and_search(work, gaps, recipe, settings.optimise)
        if recipe.last_step > 0.0 and settings.optimise:
            adapt_to_surface(work, gaps, recipe)
        progress("fit", 1.0)
    if settings.optimise:
        improve_worst(work, recipe)
        progress("optimise", 1.0)
    if settings.fit and volume is not None:
        match_volume(work, volume)
    return length


def tip_length(work, recipe, length, vertices):
    """3D length that edges will have near a tip, where the surface bends by one radian per edge."""
    if vertices is not None:
        length = length_for_count(work, recipe.final_sigma, vertices)
    return length / np.sqrt(1.0 + (recipe.final_sigma / length) ** 2)


def general_search(work, recipe, step, directions=8, passes=3):
    """Improve all angles by pattern search, then flip for angles."""
    optimise_vertices(
        work, recipe.final_sigma, step, 2, recipe.least3, recipe.weight3, recipe.agreement,
        directions=directions,
    )  # fmt: skip
    guard3 = recipe.loop_least3 if recipe.embedded else 0.0
    flip_edges(work, recipe.final_sigma, (20.0, guard3, recipe.agreement), DELAUNAY, passes)


def fit_and_search(work, gaps, recipe, search):
    """Point-to-plane fits of the vertices, with a search between them."""
    limits = (20.0 if recipe.embedded else 0.0, recipe.least3, recipe.agreement)
    for i, tangential in enumerate(recipe.fits):
        fit_vertices(work, gaps, recipe.final_sigma, limits, tangential, recipe.ridge, recipe.order)
        if search and i < len(recipe.fits) - 1:
            general_search(work, recipe, 0.04, directions=6, passes=2)


def adapt_to_surface(work, gaps, recipe):
    """Flip and search by the surface's own normals, which a smoothed carrier lacks; fit again."""

    def search():
        limits = (20.0, recipe.loop_least3, LAST_AGREEMENT)
        flip_edges(work, recipe.final_sigma, limits, DELAUNAY, 4)
        optimise_vertices(
            work, recipe.final_sigma, recipe.last_step, 2, recipe.least3, recipe.weight3,
            LAST_AGREEMENT, directions=6,
        )  # fmt: skip
        flip_edges(work, recipe.final_sigma, limits, DELAUNAY, 3)

    gaps.on_surface(work, search)
    limits = (20.0, recipe.least3, recipe.agreement)
    fit_vertices(
        work, gaps, recipe.final_sigma, limits, LAST_TANGENTIAL, recipe.ridge, recipe.order
    )


def improve_worst(work, recipe, rounds=10):
    """Search around the few worst triangles alone, with shorter and shorter steps."""
    step = 0.2
    for _ in range(rounds):
        if recipe.embedded:
            moved, visited = optimise_vertices(
                work, recipe.sigma, step, 2, recipe.least3, 20.0, recipe.agreement, 0.1
            )
        else:
            moved, visited = optimise_vertices(
                work, 0.0, step, 8, recipe.least3, 20.0, recipe.agreement, recipe.least3
            )
        if visited == 0:
            break
        if moved < 0.5 * visited:
            step *= 0.6


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
    size = extent(mesh)
    if settings.sigma > 0.0:
        if jagged:
            return Recipe(
                settings.sigma, settings.sigma, AREA, least3=12.0, weight3=1.0,
                fits=(0.05, 0.03, 0.03), ridge=0.17,
                last_step=0.02,
            )  # fmt: skip
        return Recipe(
            settings.sigma, settings.sigma, AREA, agreement=0.1, least3=12.0, weight3=1.0,
            fits=(0.05, 0.03, 0.03), order=3,
        )  # fmt: skip
    if jagged:
        return Recipe(0.0101 * size, 0.0, fits=(0.25,), ridge=0.03, delaunay_rounds=0)
    return Recipe(
        0.0229 * size, 0.0, short=0.72, long=1.38, agreement=0.1, fits=(0.2, 0.15), order=3
    )


def extent(mesh):
    """Twice the root mean square distance of a surface from its centroid: the same if rotated."""
    areas = face_areas(mesh.points, mesh.faces)
    centres = mesh.points[mesh.faces].mean(axis=1)
    total = areas.sum()
    middle = areas @ centres / total
    return 2.0 * float(np.sqrt(areas @ ((centres - middle) ** 2).sum(axis=1) / total))


def first_length(work, recipe, settings):
    """First target length of the loop, from the count or the edge length asked for."""
    if settings.vertices is not None:
        return FIRST_LENGTH * length_for_count(work, recipe.sigma, settings.vertices)
    return settings.edge_length
