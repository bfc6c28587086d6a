"""Interpolants with compact support: a sum of Wendland kernels that knows where it is defined."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from meshes import InvalidCase
from rbf import evaluate_kernels, hessian_kernels, project_kernels
from rbf.condition import extreme_eigenvalues
from rbf.curvature import principal_curvatures
from rbf.sum_kernels import ROWS, HermiteSum, ValueOnly
from rbf.threads import in_parts

TOLERANCE = 1e-6  # of the projection, |S| in support radii
LONGEST_STEP = 1.0 / 12.0  # of the projection, in support radii: half a spacing
LEAST_SLOPE = 0.2  # a gradient flatter than this does not carry a step
MOST_STEPS = 20
NO_RUNS = np.empty(0, np.int64), np.empty((0, 2), np.int64)


@dataclass(frozen=True)
class FitReport:
    """How a fit went.

    Attributes
    ----------
    iterations : int
        Of conjugate gradients.
    residual : float
        True relative residual of the linear system, in the 2-norm.
    value_error, misfit : float
        Deviation of the values from the data, largest and root mean square, in their unit.
    slope_error : float
        Largest deviation of the normal derivatives (NaN if the form prescribes none).
    condition : float
        Condition number of the preconditioned system, as the iteration saw it.
    bad_pivots : int
        Pivots of the preconditioner that were noise.
    welded : int
        Points that were dropped because they nearly coincide with another.
    damped : int
        Points whose values may give way, because they contradict a close neighbour.
    added : int
        Points that were added where edges were long.
    ridge : float
        Added to the diagonal of the values.
    """

    iterations: int
    residual: float
    value_error: float
    misfit: float
    slope_error: float
    condition: float
    bad_pivots: int
    welded: int = 0
    damped: int = 0
    added: int = 0
    ridge: float = 0.0


class CompactInterpolant:
    """S(x) = sum_j a_j phi(|x - x_j| / c) + (derivative terms), defined within c of the centres.

    Built by the fit functions. Satisfies `meshes.ImplicitSurface`.

    Attributes
    ----------
    points : (n, 3) float array
        The data sites that were fitted (after welding), in the order given.
    support_radius, spacing : float
        In the unit of the points.
    kernel : Kernel
    report : FitReport
    """

    def __init__(self, points, fit):
        system, kernel, support_radius, spacing, origin, unit, report = fit
        self.points = points
        self.kernel, self.support_radius, self.spacing = kernel, support_radius, spacing
        self.report = report
        self._origin, self._unit = origin, unit
        self._system = system
        self._grid = system.centre_grid
        self._form, self._centres = system.form, system.centres
        self._tree = None

    iterations = property(lambda self: self.report.iterations)
    residual = property(lambda self: self.report.residual)
    condition = property(lambda self: self.report.condition)

    def value(self, points):
        """S at points (n, 3): (n,), NaN outside the support."""
        if isinstance(self._form, HermiteSum):
            return self.value_and_gradient(points)[0]
        points = _checked(points)
        values, form = np.empty(len(points)), ValueOnly(self._form.profile)
        results = (float(self._unit), 1.0), values, np.empty((0, 3))
        self._run(evaluate_kernels.evaluate, points, *NO_RUNS, *results, form=form)
        return values

    def gradient(self, points):
        """Gradient of S at points (n, 3): (n, 3), NaN outside the support."""
        return self.value_and_gradient(points)[1]

    def value_and_gradient(self, points):
        """Value (n,) and gradient (n, 3) at points (n, 3); NaN outside the support."""
        points = _checked(points)
        values, gradients = np.empty(len(points)), np.empty((len(points), 3))
        units = float(self._unit), float(self._unit / self.support_radius)
        self._run(evaluate_kernels.evaluate, points, *NO_RUNS, units, values, gradients)
        return values, gradients

    def hessian(self, points):
        """Second derivatives of S at points (n, 3): (n, 3, 3), NaN outside the support.

        Raises
        ------
        InvalidCase
            If the interpolant is not twice differentiable: the Hermite form needs a kernel from
            C4 on, values alone one from C2 on.
        """
        needed = 4 if isinstance(self._form, HermiteSum) else 2
        if self.kernel.smoothness < needed:
            raise InvalidCase(
                f"second derivatives do not exist with kernel {self.kernel.name!r}: fit with "
                f'"wendland_c{needed}" or smoother'
            )
        points = _checked(points)
        results = np.empty((len(points), 3, 3))
        centres = np.zeros((ROWS[HermiteSum], self._centres.shape[1]))
        centres[: len(self._centres)] = self._centres
        profile = self._form.profile
        self._run(hessian_kernels.hessians, points, results, form=profile, centres=centres)
        results *= self._unit / self.support_radius**2
        return results

    def curvatures(self, points):
        """Principal curvatures (n, 2) of the level sets at points (n, 3), the larger first.

        Positive where the surface is convex; errors as `hessian`.
        """
        return principal_curvatures(self.gradient(points), self.hessian(points))

    def condition_number(self, neighbours=24):
        """Condition number of the interpolation matrix, estimated by Lanczos iterations.

        Costs some twenty solves. Not to be confused with `condition`, that of the preconditioned
        system, on which the number of iterations depends.
        """
        coefficients = self._centres[3:].copy()
        try:
            smallest, largest = extreme_eigenvalues(self._system, neighbours)
        finally:
            self._centres[3:] = coefficients
        return largest / smallest

    def distance_to_data(self, points):
        """Distance (n,) from points (n, 3) to the nearest data site.

        Beyond `support_radius` the interpolant is undefined; beyond half of it, it is defined but
        falls back to 0 and says nothing about the surface.
        """
        if self._tree is None:
            self._tree = cKDTree(self.points)
        return self._tree.query(np.asarray(points, dtype=float))[0]

    def is_supported(self, points):
        """Whether S is defined at points (n, 3): (n,) bool."""
        return np.isfinite(self.value(points))

    def project(
        self,
        points,
        tolerance=TOLERANCE,
        refresh_gradient=1,
        longest_step=LONGEST_STEP,
        steps=MOST_STEPS,
    ):
        """Walk points (n, 3) down the gradient to S = 0.

        x <- x - S g / max(|g|^2, 0.04), the step clipped, until |S| is below the tolerance where
        the gradient is not flat.

        Parameters
        ----------
        points : (n, 3) float array
            Not much farther from the surface than one spacing.
        tolerance, longest_step : float
            On |S| and on the length of a step, in support radii.
        refresh_gradient : int
            Renew the direction every so many steps: 1, or 3 as the thesis does.
        steps : int
            Most steps.

        Returns
        -------
        projected, normals : (n, 3) float arrays
            NaN where a point has no support, or did not converge.

        Raises
        ------
        InvalidCase
            If `refresh_gradient` is not at least 1.

        Notes
        -----
        Thesis Algorithm 1.
        """
        projected, normals, _ = self.project_with_steps(
            points, tolerance, refresh_gradient, longest_step, steps
        )
        return projected, normals

    def project_with_steps(
        self,
        points,
        tolerance=TOLERANCE,
        refresh_gradient=1,
        longest_step=LONGEST_STEP,
        steps=MOST_STEPS,
    ):
        """`project`, and how many steps (n,) each point took."""
        if refresh_gradient < 1:
            raise InvalidCase(f"refresh_gradient must be at least 1, got {refresh_gradient}")
        slope_unit = self._unit / self.support_radius
        settings = (
            float(tolerance) / slope_unit,
            float(longest_step),
            LEAST_SLOPE / slope_unit,
            int(steps),
            int(refresh_gradient),
        )
        scaled = _checked(points) - self._origin
        scaled /= self.support_radius
        taken = np.zeros(len(scaled), np.int64)
        states = np.full((len(scaled), 4), np.nan)
        status = np.full(len(scaled), project_kernels.MOVED)
        waiting = np.arange(len(scaled))
        while len(waiting):
            part = (taken[waiting], states[waiting], status[waiting])
            place = {"origin": np.zeros(3), "unit": 1.0}
            scaled[waiting] = self._run(
                project_kernels.project, scaled[waiting], settings, *part, **place
            )
            taken[waiting], states[waiting], status[waiting] = part
            waiting = waiting[part[2] == project_kernels.MOVED]
        failed = status != project_kernels.CONVERGED
        normals = states[:, :3] / np.sqrt(states[:, 3:])
        projected = scaled * self.support_radius + self._origin
        projected[failed], normals[failed] = np.nan, np.nan
        return projected, normals, taken

    def _run(self, kernel, points, *results, form=None, centres=None, origin=None, unit=None):
        """Run a kernel over the cells of queries (n, 3); returns them in support radii."""
        origin = self._origin if origin is None else origin
        unit = self.support_radius if unit is None else unit
        scaled, order, keys, starts = self._grid.bin_queries(points, origin, unit)
        form = self._form if form is None else form
        centres = self._centres if centres is None else centres
        place = form, scaled, order, keys, starts, centres, self._grid.arrays
        in_parts(kernel, len(keys), *place, *results)
        return scaled


def _checked(points):
    """Points as contiguous floats (n, 3)."""
    points = np.ascontiguousarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InvalidCase(f"points must have shape (n, 3), got {points.shape}")
    return points
