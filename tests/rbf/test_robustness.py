"""Awkward input, form by form: the answer of a dense twin, or one sentence on what to change.

Every trouble is given to scattered values (one level, several, global kernels, greedy centres) and
to surfaces (Hermite, offset triples), at scales from 1e-9 to 1e9. The twins weld, average, build
the full matrix and solve it with LAPACK.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RBFInterpolator
from scipy.spatial.distance import cdist

from meshes import InvalidCase, InvalidMesh, NotConverged
from rbf import (
    KERNELS,
    fit_global,
    fit_greedy,
    fit_hermite,
    fit_levels,
    fit_local,
    fit_offsets,
    fit_surface,
    fit_values,
)
from tests.rbf import reference
from tests.shapes import icosphere

RADIUS = 0.9  # support, for points of a spacing of about 0.25
SPACING = 0.25
TIGHT = 1e-11
SCALES = [1e-9, 1.0, 1e9]
GLOBAL = [name for name, kernel in KERNELS.items() if not kernel.compact]
VALUE_FORMS = ["values", "levels", "local", *GLOBAL]
SURFACE_FORMS = ["hermite", "offsets"]


# --- the troubles: points in a box of about 1, and nothing else in common ---------------------


def blob(rng):
    """Points with nothing wrong about them."""
    return rng.random((45, 3))


def duplicates(distance):
    """A third of the points again, so far away in each coordinate."""

    def make(rng):
        points = blob(rng)
        twins = points[:15] + distance * rng.choice([-1.0, 1.0], (15, 3))
        return np.concatenate([points, twins])[rng.permutation(60)]

    return make


def two_sheets(rng):
    """Two layers 0.05 apart, far within the support of each other."""
    flat = np.stack(np.meshgrid(np.arange(6) * 0.2, np.arange(5) * 0.2), axis=-1).reshape(-1, 2)
    flat = flat + rng.uniform(-0.03, 0.03, flat.shape)
    return np.concatenate([np.insert(flat, 2, height, axis=1) for height in (0.0, 0.05)])


def outlier(rng):
    """One point a hundred spacings away from all others."""
    return np.concatenate([blob(rng), [[100.0 * SPACING, 0.0, 0.0]]])


def plane(rng):
    """Points of one plane, across no axis."""
    return rng.random((45, 2)) @ np.array([[0.8, 0.6, 0.0], [-0.36, 0.48, 0.8]])


TROUBLES = {
    "none": blob,
    "exact duplicates": duplicates(0.0),
    "duplicates at 1e-12": duplicates(1e-12),
    "duplicates at 1e-7": duplicates(1e-7),
    "two sheets": two_sheets,
    "an outlier": outlier,
    "a plane": plane,
}
SPOTS = st.integers(0, 10**6), st.sampled_from(SCALES)


def values_at(points, rng):
    """A smooth function, and a little of what is not: duplicates contradict each other."""
    return np.sin(3.0 * points[:, 0]) + points[:, 1] * points[:, 2] + 0.1 * rng.random(len(points))


# --- the twins --------------------------------------------------------------------------------


def welded(points, data, distance):
    """Points with all that are nearer than the distance averaged into their first, one by one."""
    cluster = np.arange(len(points))
    for i, j in zip(*np.nonzero(np.triu(cdist(points, points) <= distance, 1))):
        cluster[cluster == cluster[j]] = cluster[i]
    first = np.unique(cluster)
    return points[first], np.stack([data[cluster == k].mean(axis=0) for k in first])


def dense_values(points, values, radius, queries):
    """Values at the queries of the one-level interpolant, from its full matrix."""
    kernel = KERNELS["wendland_c2"]
    weights = np.linalg.solve(kernel(cdist(points, points) / radius), values)
    return kernel(cdist(queries, points) / radius) @ weights


def dense_levels(points, values, queries):
    """Values at the queries of three levels; the first point in each cube is kept."""
    rest, total = values, 0.0
    for spacing in (4 * SPACING, 2 * SPACING, SPACING):
        cubes = np.floor((points - points.min(axis=0)) / spacing).astype(int)
        _, chosen = np.unique(cubes, axis=0, return_index=True)
        chosen = chosen if spacing > SPACING else np.arange(len(points))
        if len(chosen) < 20 and spacing > SPACING:
            continue
        level = welded(points[np.sort(chosen)], rest[np.sort(chosen)], 1e-4 * 5 * spacing / 6)
        places = np.concatenate([points, queries])
        found = dense_values(*level, 5 * spacing, places)
        rest, total = rest - found[: len(points)], total + found[len(points) :]
    return total


def dense_global(points, values, name, queries):
    """What scipy finds, with the tail that the kernel needs."""
    degree = KERNELS[name].polynomial_order - 1
    return RBFInterpolator(points, values, kernel=name, epsilon=1 / 0.3, degree=degree)(queries)


def dense_quintic(points, values, queries):
    """What scipy finds with r^5; NaN outside the box of the points, widened by a quarter."""
    found = RBFInterpolator(points, values, kernel="quintic", degree=2)(queries)
    margin = 0.25 * np.ptp(points, axis=0)
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    found[((queries <= low) | (queries >= high)).any(axis=1)] = np.nan
    return found


def queries_near(points, rng):
    """Places within the support of some point."""
    return points[rng.integers(0, len(points), 40)] + rng.uniform(-0.2, 0.2, (40, 3))


def fit_form(form, points, values, scale):
    """Our interpolant of values, and the twin's function (points, values, queries)."""
    if form == "values":
        ours = fit_values(points, values, RADIUS * scale, tolerance=TIGHT)
        return ours, lambda p, v, q: dense_values(*welded(p, v, 1e-4 * RADIUS / 6), RADIUS, q)
    if form == "levels":
        ours = fit_levels(points, values, 3, spacing=SPACING * scale, tolerance=TIGHT)
        return ours, dense_levels
    if form == "local":  # so few points are one patch: r^5 with a quadratic polynomial
        ours = fit_local(points, values, weld_distance=1e-5 * scale)
        return ours, lambda p, v, q: dense_quintic(*welded(p, v, 1e-5), q)
    ours = fit_global(points, values, form, 0.3 * scale)
    return ours, lambda p, v, q: dense_global(*welded(p, v, 1e-5), form, q)


# --- scattered values -------------------------------------------------------------------------


def check_local(points, values, scale):
    """Local interpolants meet the data, or say that they cannot."""
    try:
        ours = fit_local(points * scale, values)
    except NotConverged as refusal:
        assert "average points that lie close together" in str(refusal)
        return
    np.testing.assert_allclose(ours.value(points * scale), values, atol=1e-5)


@pytest.mark.parametrize("form", VALUE_FORMS)
@pytest.mark.parametrize("trouble", TROUBLES)
@settings(max_examples=4, deadline=None, derandomize=True)
@given(*SPOTS)
def test_values_are_those_of_the_dense_twin(form, trouble, seed, scale):
    rng = np.random.default_rng(seed)
    points = TROUBLES[trouble](rng)
    values, queries = values_at(points, rng), queries_near(points, rng)
    if form == "cubic" and trouble == "a plane":
        with pytest.raises(InvalidCase, match="choose wendland_c2 or inverse_multiquadric"):
            fit_global(points * scale, values, form)
        return
    if form == "local" and trouble in ("a plane", "two sheets", "an outlier"):
        check_local(points, values, scale)  # scipy's matrix is singular, or nearly
        return
    ours, twin = fit_form(form, points * scale, values, scale)
    expected = twin(points, values, queries)
    np.testing.assert_allclose(ours.value(queries * scale), expected, atol=2e-6)


@pytest.mark.parametrize("name", [*GLOBAL, "wendland_c2"])
@pytest.mark.parametrize("trouble", TROUBLES)
@settings(max_examples=2, deadline=None, derandomize=True)
@given(*SPOTS)
def test_greedy_centres_give_the_interpolant_of_their_points(name, trouble, seed, scale):
    rng = np.random.default_rng(seed)
    points = TROUBLES[trouble](rng)
    values, queries = values_at(points, rng), queries_near(points, rng)
    compact = name == "wendland_c2"
    options = {"support_radius": RADIUS * scale} if compact else {"scale": 0.3 * scale}
    if name == "cubic" and trouble == "a plane":
        with pytest.raises(InvalidCase, match="choose wendland_c2 or inverse_multiquadric"):
            fit_greedy(points * scale, values, 0.2, name, **options)
        return
    fit = fit_greedy(points * scale, values, 0.2, name, first=10, **options)
    chosen = points[fit.centres], values[fit.centres]
    kept = welded(*chosen, 1e-5)
    assert len(np.unique(fit.centres)) == len(fit.centres) == fit.counts[-1]
    found = fit.interpolant.value(queries * scale)
    if compact:
        supported = cdist(queries, kept[0]).min(axis=1) < RADIUS
        np.testing.assert_array_equal(np.isfinite(found), supported)
        expected = dense_values(*kept, RADIUS, queries)
        np.testing.assert_allclose(found[supported], expected[supported], atol=1e-6)
        at_points = dense_values(*kept, RADIUS, points)
    else:
        np.testing.assert_allclose(found, dense_global(*kept, name, queries), atol=1e-6)
        at_points = dense_global(*kept, name, points)
    error = np.abs(at_points - values)
    assert fit.largest[-1] == pytest.approx(error.max(), abs=1e-6)
    assert fit.rms[-1] == pytest.approx(np.sqrt(np.mean(error**2)), abs=1e-6)
    assert fit.largest[-1] <= 0.2 or len(fit.centres) == len(points)


# --- surfaces ---------------------------------------------------------------------------------


def surface_points(trouble, rng):
    """Points, unit normals and what is expected of near-duplicates: on a ball where it can be."""
    points = TROUBLES[trouble](rng)
    if trouble in ("two sheets", "a plane"):
        normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
        if trouble == "two sheets":
            normals[: len(points) // 2] *= -1.0
        else:
            normals[:] = np.cross([0.8, 0.6, 0.0], [-0.36, 0.48, 0.8])
        return points, normals
    normals = points - 0.5
    return points, normals / np.linalg.norm(normals, axis=1)[:, None]


def dense_surface(form, points, normals, queries, offset):
    """Values at the queries from the full matrix of the form, lengths in supports."""
    kernel = KERNELS["wendland_c2"]
    points, queries = points / RADIUS, queries / RADIUS
    if form == "offsets":
        step = offset / RADIUS
        triples = np.concatenate([points, points + step * normals, points - step * normals])
        right = np.repeat([0.0, step, -step], len(points))
        return RADIUS * dense_values(triples, right, 1.0, queries)
    matrix = reference.hermite_matrix(kernel, points, normals)
    right = np.tile([0.0, reference.SCALE], len(points))
    weights = np.linalg.solve(matrix, right).reshape(-1, 2)
    slopes = -reference.SCALE * weights[:, 1, None] * normals
    centres = np.concatenate([points, weights[:, :1], slopes], axis=1)
    return RADIUS * reference.kernel_sum(kernel, queries, centres)[0]


@pytest.mark.parametrize("form", SURFACE_FORMS)
@pytest.mark.parametrize("trouble", TROUBLES)
@settings(max_examples=2, deadline=None, derandomize=True)
@given(*SPOTS)
def test_surfaces_are_those_of_the_dense_twin(form, trouble, seed, scale):
    rng = np.random.default_rng(seed)
    points, normals = surface_points(trouble, rng)
    queries = queries_near(points, rng)
    fit = {"hermite": fit_hermite, "offsets": fit_offsets}[form]
    ours = fit(points * scale, normals, support_radius=RADIUS * scale, tolerance=TIGHT)
    first = np.array([k for k, p in enumerate(points) if (cdist([p], points[:k]) > 1e-5).all()])
    assert ours.report.welded == len(points) - len(first)
    assert ours.report.damped == 0
    offset = getattr(ours, "offset", 0.0) / scale
    expected = dense_surface(form, points[first], normals[first], queries, offset)
    np.testing.assert_allclose(ours.value(queries * scale) / scale, expected, atol=1e-6)


@pytest.mark.parametrize("form", SURFACE_FORMS)
@settings(max_examples=2, deadline=None, derandomize=True)
@given(*SPOTS)
def test_a_spike_a_hundred_mean_edges_long_leaves_the_rest_as_it_is(form, seed, scale):
    mesh = icosphere(2)
    vertex = np.random.default_rng(seed).integers(len(mesh.points))
    edge = np.linalg.norm(mesh.points[mesh.faces[:, 0]] - mesh.points[mesh.faces[:, 1]], axis=1)
    points = np.array(mesh.points)
    tip = points[vertex] = points[vertex] * (1.0 + 100.0 * edge.mean())
    surface = fit_surface(mesh.with_points(points * scale), form=form)
    plain = fit_surface(mesh.with_points(mesh.points * scale), form=form)
    assert surface.support_radius == pytest.approx(plain.support_radius, rel=0.1)
    assert surface.is_supported(tip * scale * np.linspace(0.1, 1.0, 50)[:, None]).all()
    away = mesh.points[mesh.points @ mesh.points[vertex] < 0.2]
    projected, _ = surface.project(away * 1.01 * scale)
    np.testing.assert_allclose(np.linalg.norm(projected, axis=1) / scale, 1.0, atol=3e-3)


# --- too little, or nothing that counts ---------------------------------------------------------

FITS = {
    "values": (fit_values, {"support_radius": 1.0}),
    "levels": (fit_levels, {"spacing": 0.2}),
    "gaussian": (fit_global, {"kernel": "gaussian", "scale": 1.0}),
    "inverse_multiquadric": (fit_global, {"kernel": "inverse_multiquadric", "scale": 1.0}),
    "multiquadric": (fit_global, {"kernel": "multiquadric", "scale": 1.0}),
    "greedy": (fit_greedy, {"tolerance": 0.1, "kernel": "gaussian", "scale": 1.0}),
    "hermite": (fit_hermite, {"support_radius": 1.0}),
    "offsets": (fit_offsets, {"support_radius": 1.0}),
}


@pytest.mark.parametrize("form", FITS)
@pytest.mark.parametrize("copies", [1, 30])
@pytest.mark.parametrize("scale", SCALES)
def test_one_point_has_an_interpolant_once_its_length_is_given(form, copies, scale):
    fit, options = FITS[form]
    lengths = {"support_radius", "spacing", "scale"}
    options = {k: v * scale if k in lengths else v for k, v in options.items()}
    points = np.tile([[0.3, -0.2, 0.7]], (copies, 1)) * scale
    if form in SURFACE_FORMS:
        surface = fit(points, np.tile([[0.0, 0.0, 2.0]], (copies, 1)), **options)
        value, gradient = surface.value_and_gradient(points[:1] + [[0.0, 0.0, 1e-3 * scale]])
        assert value[0] == pytest.approx(1e-3 * scale, rel=0.02)
        np.testing.assert_allclose(gradient[0], [0.0, 0.0, 1.0], atol=0.05)
        return
    fitted = fit(points, np.full(copies, 5.0), **options)
    fitted = getattr(fitted, "interpolant", fitted)
    assert fitted.value(points[:1])[0] == pytest.approx(5.0, rel=1e-9)
    away = fitted.value(points[:1] + [[0.5 * scale, 0.0, 0.0]])[0]
    kernel = KERNELS[options.get("kernel", "wendland_c2")]
    share = 1.0 if form == "multiquadric" else kernel(0.5)  # the tail is all of it
    assert away == pytest.approx(5.0 * share, rel=1e-9)


@pytest.mark.parametrize("form", FITS)
def test_one_point_without_a_length_is_told_which_one_to_give(form):
    fit, options = FITS[form]
    word = next(k for k in ("support_radius", "spacing", "scale") if k in options)
    options = {k: v for k, v in options.items() if k != word}
    with pytest.raises(InvalidCase, match=f"two distinct ones: give {word}"):
        fit(np.ones((1, 3)), np.ones((1, 3)) if form in SURFACE_FORMS else np.ones(1), **options)


@pytest.mark.parametrize("form", FITS)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_named(form, bad):
    fit, options = FITS[form]
    points = np.random.default_rng(0).random((40, 3))
    data = points + 1.0 if form in SURFACE_FORMS else points[:, 0]
    for spoiled, name in ((points, "points"), (data, "normals" if data.ndim == 2 else "values")):
        broken = np.array(spoiled)
        broken[7:9] = bad
        given_points, given_data = (broken, data) if name == "points" else (points, broken)
        with pytest.raises(InvalidMesh, match=f"{name} has 2 rows .* first is row 7.*remove"):
            fit(given_points, given_data, **options)
    for option in {"support_radius", "spacing", "scale", "tolerance"} & options.keys():
        with pytest.raises(InvalidCase, match=f"{option} .*positive"):
            fit(points, data, **{**options, option: bad})
    interpolant = fit(points, data, **options)
    interpolant = getattr(interpolant, "interpolant", interpolant)
    queries = np.array([[np.nan, 0.5, 0.5], [0.5, 0.5, 0.5]])
    np.testing.assert_array_equal(np.isnan(interpolant.value(queries)), [True, False])


@pytest.mark.parametrize("form", ["gaussian", "inverse_multiquadric", "multiquadric", "greedy"])
@pytest.mark.parametrize("ridge", [-1.0, np.nan, np.inf, "gcv"])
def test_ridge_of_global_kernels_is_checked(form, ridge):
    fit, options = FITS[form]
    points = np.random.default_rng(0).random((40, 3))
    with pytest.raises(InvalidCase, match="ridge must be at least 0 and finite"):
        fit(points, points[:, 0], ridge=ridge, **options)


def test_levels_whose_thinned_points_do_not_reach_the_others_are_refused():
    points = np.random.default_rng(0).random((200, 3))
    with pytest.raises(InvalidCase, match="at least 2 where there are several levels"):
        fit_levels(points, points[:, 0], support_per_spacing=1.0)
    assert len(fit_levels(points, points[:, 0], 1, support_per_spacing=1.0).levels) == 1
    several = fit_levels(points, points[:, 0], 3, support_per_spacing=2.0)
    np.testing.assert_allclose(several.value(points), points[:, 0], atol=1e-6)


def test_a_kernel_that_does_not_fit_is_answered_with_those_that_do():
    points = np.random.default_rng(0).random((40, 3))
    with pytest.raises(InvalidCase, match=r"wendland_c2, wendland_c4, wendland_c6$"):
        fit_hermite(points, points + 1.0, kernel="wendland_c0")


@pytest.mark.parametrize("form", ["values", "local", "hermite", "offsets"])
@pytest.mark.parametrize("distance", [-1.0, np.nan, np.inf])
def test_a_weld_distance_that_makes_no_sense_is_refused(form, distance):
    fit = {"local": fit_local, **{name: FITS[name][0] for name in FITS}}[form]
    points = np.random.default_rng(0).random((40, 3))
    data = points + 1.0 if form in SURFACE_FORMS else points[:, 0]
    with pytest.raises(InvalidCase, match="weld_distance must be at least 0 and finite"):
        fit(points, data, weld_distance=distance)


@pytest.mark.parametrize("distance", [None, 1e-3])
@pytest.mark.parametrize("copies", [1, 30])
def test_local_interpolants_ask_for_two_points(copies, distance):
    with pytest.raises(InvalidCase, match=r"two distinct ones.* give two at least"):
        fit_local(np.ones((copies, 3)), np.ones(copies), weld_distance=distance)
