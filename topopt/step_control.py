"""How far a step goes: the metric D of the step's quadratic programme, and who adapts it.

A rule is an immutable value, so that a step that is rejected or a run that is resumed leaves no
trace in it. `scale` is the one number that changes.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

SUFFICIENT = 1e-4  # share of the predicted decrease that a step must deliver (Armijo)
LONGEST = 1e4  # tau gamma / eps beyond which M / tau no longer counts


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
class VariableMetricStep(ControlledStep):
    """D = M / tau + (c / 6) S, S the concavity: about M (1 / tau + c phi w); tau as controlled.

    Where the part is loaded the second term holds the step back, so that tau can grow without
    rejections; where it is not, the interface is free to move. The compliance's own curvature is
    at most that of c = 6.

    Parameters
    ----------
    scale, longest : float
        As in `ControlledStep`.
    share : float
        c; grows with a rejection, falls back to 1 with acceptances.

    Notes
    -----
    A diagonal stand-in for the variable metric of L. Blank and C. Rupprecht, An extension of the
    projected gradient method to a Banach space setting with application in structural topology
    optimization, SIAM J. Control Optim. 55 (2017).
    """

    share: float = 1.0
    least: ClassVar[float] = 1.0
    most: ClassVar[float] = 6.0

    def metric(self, mass, concavity):
        return super().metric(mass, concavity) + self.share / self.most * concavity

    def rejected(self):
        return replace(super().rejected(), share=min(3.0 * self.share, self.most))

    def accepted(self, first_try):
        share = max(0.8 * self.share, self.least) if first_try else self.share
        return replace(super().accepted(first_try), share=share)


@dataclass(frozen=True)
class LearningMetricStep(VariableMetricStep):
    """The same with a smaller c: the base of a metric that learns the stiff directions itself."""

    share: float = 0.5
    least: ClassVar[float] = 0.5


RULES = {"controlled": ControlledStep, "variable_metric": VariableMetricStep, "fixed": FixedStep}
LEARNING_RULES = {"controlled": ControlledStep, "variable_metric": LearningMetricStep}


def first_rule(settings, pressure, concavity):
    """The rule that the settings name.

    Parameters
    ----------
    settings : OptimizationSettings
        Its `method`, `step` and `tau`.
    pressure : float [Pa]
        gamma / eps.
    concavity : float [Pa]
        The mean over the domain of 6 phi w at the start. tau = 1 / concavity is safe where the
        part is loaded evenly; half of that is the first tau if the settings name none.
    """
    tau = 0.5 / max(concavity, pressure) if settings.tau is None else settings.tau
    rule = (LEARNING_RULES if settings.method == "vmpt" else RULES)[settings.step]
    return rule(tau) if rule is FixedStep else rule(tau, LONGEST / pressure)


def sufficient_decrease(before, after, slope):
    """Whether J fell from `before` to `after` by the Armijo share of the slope dJ(d) < 0."""
    return after <= before + SUFFICIENT * slope and after <= before
