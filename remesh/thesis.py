"""The thesis's Algorithm 2 as it stands (section 3.5), every rule a parameter."""

import numpy as np

from remesh.collapse import collapse_short_edges
from remesh.flip import THESIS, flip_edges
from remesh.smooth import BOSSEN_HECKBERT, smooth_vertices
from remesh.split import split_long_edges
from remesh.sweeps import PliantLoop, length_for_count

UNBOUNDED = 1e3  # of the target length: the thesis sets no upper limit on collapsing


def run_thesis(work, gaps, settings, rng, progress):
    """Algorithm 2: collapse short edges until few are left, split long ones, flip, smooth.

    Parameters
    ----------
    work : WorkMesh
    gaps : TriangleFidelity or ImplicitFidelity
        Settles the vertices on the surface.
    settings : RemeshSettings
    rng : numpy.random.Generator
    progress : callable

    Returns
    -------
    float
        The target 6D length.
    """
    length = settings.edge_length
    if length is None:
        length = length_for_count(work, settings.sigma, settings.vertices)
    for i in range(settings.iterations):
        collapse_until_few(work, settings, length, rng)
        rules = settings.thesis
        split_long_edges(work, rules.split_above * length, settings.sigma, rules.least_agreement)
        flip_all(work, settings)
        smooth_chosen(work, settings, length, None)
        gaps.settle(work)
        flip_all(work, settings)
        progress("loop", (i + 1) / settings.iterations)
    return length


def collapse_until_few(work, settings, length, rng):
    """The inner loop: collapse, smooth a random part, flip; until few short edges give way."""
    rules = settings.thesis
    for _ in range(rules.inner_limit):
        short = rules.collapse_below * length
        waiting = int((PliantLoop(work, settings.sigma, (0, 0, 0)).edge_lengths() < short).sum())
        if waiting == 0:
            break
        done = collapse_short_edges(
            work, short, UNBOUNDED * length, settings.sigma, (0.0, 0.0, rules.least_agreement)
        )
        work.compact()
        chosen = rng.random(len(work.links)) < rules.smoothing_fraction
        smooth_chosen(work, settings, length, chosen)
        flip_all(work, settings)
        if done <= rules.least_success * waiting:
            break


def smooth_chosen(work, settings, length, chosen):
    """Bossen-Heckbert smoothing of the chosen vertices (all if None)."""
    rules = settings.thesis
    smooth_vertices(
        work, settings.sigma, (0.0, 0.0, rules.least_agreement), BOSSEN_HECKBERT, rules.alpha,
        length, rules.clip, chosen,
    )  # fmt: skip


def flip_all(work, settings):
    """Flip by the thesis's rule until nothing flips (at most 10 times)."""
    rules = settings.thesis
    limits = np.array([0.0, 0.0, rules.least_agreement])
    flip_edges(work, settings.sigma, limits, THESIS, 10, rules.ridge_angle)
