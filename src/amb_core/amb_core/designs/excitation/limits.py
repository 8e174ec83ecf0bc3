"""Limits within which an excitation is certified, and how much of each limit a trial uses."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from amb_core.designs.excitation.measures import AxisMeasure
from amb_core.designs.excitation.trial import Trial
from amb_core.ground.parameters import Parameters, quantity
from amb_core.regions import Region
from amb_core.regions.distortion import Distortion

FEWEST_SEEDS = 4


class Limits(Parameters):
    """Limits within which an excitation is certified, in addition to region A."""

    distortion_limit: float = quantity(
        0.05, "-", "largest deviation and largest nonlinear distortion of an axis over its linear response", 1e-3, 1.0
    )
    least_fit: float = quantity(
        90.0, "percent", "smallest fit of the linearised loop on an axis; a shift of the mean is an error", 0.0, 99.9
    )
    saturation_limit: float = quantity(
        0.01,
        "-",
        "largest share of samples with a clipped control current, and of those with a slew beyond the voltage",
        0.0,
        1.0,
    )
    seeds: int = quantity(
        FEWEST_SEEDS, "-", "seeds of a signal with a random part that must all be within the limits", FEWEST_SEEDS, 64
    )


@dataclass(frozen=True)
class Use:
    """How much of a limit is used.

    Attributes
    ----------
    share : float
        1 at the limit, above 1 beyond it; infinite where only the side is known.
    what : str
        The limit, with the value that was found and the value that is allowed.
    """

    share: float
    what: str


def use_of_trial(trial: Trial, limits: Limits, drift_threshold: float) -> Use:
    """The limit of which a trial uses most.

    Parameters
    ----------
    trial : Trial
        A simulated trial.
    limits : Limits
        Limits of distortion, fit and saturation.
    drift_threshold : float
        Drift of the bias that counts as one (m).

    Returns
    -------
    Use
        The limit, and how much of it is used.
    """
    return max(_uses_of_trial(trial, limits, drift_threshold), key=lambda use: use.share)


def use_of_distortion(distortion: Distortion, axes: tuple[str, ...], limits: Limits) -> Use:
    """The axis whose distortion, its upper confidence bound, uses most of the limit."""
    uses = []
    for axis in axes:
        place = distortion.axes.index(axis)
        ratio, upper = float(distortion.ratio[place]), float(distortion.upper_ratio[place])
        text = f"nonlinear distortion on {axis}: {100.0 * ratio:.2g} %, at most {100.0 * upper:.2g} % at 95 %"
        uses.append(Use(upper / limits.distortion_limit, f"{text}, limit {100.0 * limits.distortion_limit:g} %"))
    return max(uses, key=lambda use: use.share)


def _uses_of_trial(trial: Trial, limits: Limits, drift_threshold: float) -> Iterator[Use]:
    if trial.classified > Region.A:
        yield Use(math.inf, f"region {trial.classified.name}")
    axis = int(np.argmax(np.nan_to_num(np.abs(trial.bias_shift))))
    shift = abs(float(trial.bias_shift[axis]))
    if not math.isnan(shift):
        yield Use(
            shift / drift_threshold,
            f"region B: the bias on {'xy'[axis]} moves by {1e6 * shift:.2g} um, limit {1e6 * drift_threshold:g} um",
        )
    for measure in trial.measures:
        yield from _uses_of_axis(measure, limits)
    if not trial.measures:
        yield Use(math.inf, f"region {trial.region.name}")


def _uses_of_axis(measure: AxisMeasure, limits: Limits) -> Iterator[Use]:
    axis = measure.axis
    yield Use(
        measure.deviation / limits.distortion_limit,
        f"deviation from the linear response on {axis}: {100.0 * measure.deviation:.2g} %, "
        f"limit {100.0 * limits.distortion_limit:g} %",
    )
    yield Use(
        (100.0 - measure.fit) / (100.0 - limits.least_fit),
        f"fit of the linearised loop on {axis}: {measure.fit:.1f} %, least {limits.least_fit:g} %",
    )
    for name, value in (
        ("clipping of the control current", measure.clipped),
        ("slew beyond the voltage", measure.slewed),
    ):
        # Shares of samples jump with the amplitude, so they do not serve for interpolation
        yield Use(
            math.inf if value > limits.saturation_limit else 0.0,
            f"{name} on {axis}: {100.0 * value:.2g} % of the samples, limit {100.0 * limits.saturation_limit:g} %",
        )
