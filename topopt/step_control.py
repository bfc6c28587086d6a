"""How far a step goes: the metric D of the step's quadratic programme, and who adapts it.

A rule is an immutable value, so that a step that is rejected or a run that is resumed leaves no
trace in it. `scale` is the one number that changes.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

SUFFICIENT = 1e-4  # share of the predicted decrease that a step must deliver (Armijo)


@dataclass(frozen=True)
class FixedStep:
    """D = M / tau with the thesis's constant tau; every step is taken, J may rise.

    Parameters
    ----------
    scale : float
        tau.
    """

    scale: float
    monotone: ClassVar[bool] = False

    def metric(self, mass, concavity):
        """D (n,) for the lumped mass (n,) and the concavity (n,) of the compliance."""
        return mass / self.scale

    def rejected(self):
        """The rule after a step that did not decrease J enough."""
        return self

    def accepted(self, first_try):
        """The rule after a step that was taken."""
        return self


@dataclass(frozen=True)
class ControlledStep(FixedStep):
    """D = M / tau; tau shrinks until J decreases and grows again when it does at once.

    Parameters
    ----------
    scale : float
        tau.
    longest : float
        Where tau stops growing; D no longer counts beyond.
    """

    longest: float = np.inf
    monotone: ClassVar[bool] = True
    shrink: ClassVar[float] = 0.25
    grow: ClassVar[float] = 2.0

    def rejected(self):
        return replace(self, scale=self.shrink * self.scale)

    def accepted(self, first_try):
        longer = min(self.grow * self.scale, self.longest)
        return replace(self, scale=longer) if first_try else self


@dataclass(frozen=True)
class VariableMetricStep:
    """D = M / tau_max + (c / 6) S, S the concavity: about M (1 / tau_max + c phi w).

    Parameters
    ----------
    scale : float
        c; 6 bounds the compliance's second derivative and is always accepted.
    floor : float
        1 / tau_max, keeps D positive in the void.

    Notes
    -----
    A diagonal stand-in for the variable metric of L. Blank and C. Rupprecht, An extension of the
    projected gradient method to a Banach space setting with application in structural topology
    optimization, SIAM J. Control Optim. 55 (2017).
    """

    scale: float
    floor: float
    monotone: ClassVar[bool] = True
    shrink: ClassVar[float] = 0.8
    grow: ClassVar[float] = 3.0
    least: ClassVar[float] = 0.05

    def metric(self, mass, concavity):
        """D (n,) for the lumped mass (n,) and the concavity (n,) of the compliance."""
        return mass * self.floor + self.scale / 6.0 * concavity

    def rejected(self):
        """The rule after a step that did not decrease J enough."""
        return replace(self, scale=self.grow * self.scale)

    def accepted(self, first_try):
        """The rule after a step that was taken."""
        return replace(self, scale=max(self.shrink * self.scale, self.least))


STEPS = ("controlled", "variable_metric", "fixed")
StepRule = FixedStep | VariableMetricStep


def first_rule(settings, pressure, concavity):
    """The rule that the settings name.

    Parameters
    ----------
    settings : OptimizationSettings
        Its `step` and `tau`.
    pressure : float [Pa]
        gamma / eps.
    concavity : float [Pa]
        The mean over the domain of 6 phi w at the start. tau = 1 / concavity is safe where the
        part is loaded evenly; half of that is the first tau if the settings name none.
    """
    if settings.step == "variable_metric":
        return VariableMetricStep(6.0, 0.01 * pressure)
    tau = 0.5 / max(concavity, pressure) if settings.tau is None else settings.tau
    return FixedStep(tau) if settings.step == "fixed" else ControlledStep(tau, 1e4 / pressure)


def sufficient_decrease(before, after, slope):
    """Whether J fell from `before` to `after` by the Armijo share of the slope dJ(d) < 0."""
    return after <= before + SUFFICIENT * slope and after <= before
