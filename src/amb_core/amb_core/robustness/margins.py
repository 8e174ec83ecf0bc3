"""Classical margins, disk margins and the delay margin of a stable loop.

Classical and delay margins are those of each axis with all other loops closed. A disk margin alpha of skew sigma holds
for every perturbation f of gain and phase of the set

    f = (1 + (1 - sigma)/2 delta) / (1 - (1 + sigma)/2 delta),    |delta| < alpha,

and is 1/||S + (sigma - 1)/2||_inf for one signal, 1/max_omega mu(S + (sigma - 1)/2 I) for several that are perturbed
independently of each other: at the outputs (S_o), at the inputs (S_i), or at both at once (the whole closed loop).

Source: P. Seiler, A. Packard and P. Gahinet, An introduction to disk margins, IEEE Control Systems Magazine 40 (2020).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from amb_core.linear import Arrays, LinearSystem
from amb_core.linear.peak import Peak, peak_gain
from amb_core.robustness.crossings import gain_crossovers, phase_crossovers
from amb_core.robustness.feedback import Feedback
from amb_core.robustness.mu import Block, MuPeak, mu_peak


def reciprocal(value: float) -> float:
    """1 / value, infinite for 0: where nothing is seen of a perturbation, any size of it is borne."""
    return 1.0 / value if value else math.inf


@dataclass(frozen=True)
class ClassicalMargins:
    """Margins of one axis, all others closed; infinite where the loop crosses nothing.

    Attributes
    ----------
    axis : str
        Its name.
    gain_up, gain_down : Peak
        Factors above and below 1 by which the gain may change, with the frequency at which the loop then oscillates.
    phase : Peak
        Phase (rad) by which the loop may be turned either way, with its frequency.
    delay : Peak
        Additional delay (s) that the loop tolerates, with its frequency.
    """

    axis: str
    gain_up: Peak
    gain_down: Peak
    phase: Peak
    delay: Peak


@dataclass(frozen=True)
class DiskMargin:
    """A disk margin: what is guaranteed, and the smallest perturbation found that makes the loop unstable.

    Attributes
    ----------
    where : str
        Axis, `outputs`, `inputs`, or `inputs and outputs`.
    guaranteed, broken : float
        alpha that holds, and alpha of a perturbation that puts a pole on the unit circle.
    frequency : float
        Of the peak (Hz).
    skew : float
        sigma.
    """

    where: str
    guaranteed: float
    broken: float
    frequency: float
    skew: float

    @property
    def gain(self) -> tuple[float, float]:
        """Smallest and largest factor of gain alone within the margin; infinite if any larger one is borne."""
        return gain_of(self.guaranteed, self.skew)

    @property
    def phase(self) -> float:
        """Phase (rad) within the margin, without change of gain; pi if any phase is borne."""
        return phase_of(self.guaranteed, self.skew)


def gain_of(alpha: float, skew: float = 0.0) -> tuple[float, float]:
    """Range of gains in the disk alpha: (2 - alpha (1 - sigma))/(2 + alpha (1 + sigma)) and its counterpart."""
    if math.isinf(alpha):
        return (skew - 1.0) * reciprocal(1.0 + skew), math.inf
    low = (2.0 - alpha * (1.0 - skew)) / (2.0 + alpha * (1.0 + skew))
    below = 2.0 - alpha * (1.0 + skew)
    return low, (2.0 + alpha * (1.0 - skew)) / below if below > 0.0 else math.inf


def phase_of(alpha: float, skew: float = 0.0) -> float:
    """Phase (rad) at gain 1 in the disk alpha: arccos((1 + low high)/(low + high))."""
    low, high = gain_of(alpha, skew)
    cosine = low if math.isinf(high) else (1.0 + low * high) / (low + high)
    return math.pi if abs(cosine) > 1.0 else math.acos(cosine)


def classical_margins(feedback: Feedback) -> tuple[ClassicalMargins, ...]:
    """Gain, phase and delay margins of each axis, all others closed.

    Parameters
    ----------
    feedback : Feedback
        A stable loop.

    Returns
    -------
    tuple of ClassicalMargins
        One for each axis, in their order.

    Raises
    ------
    RobustnessError
        If the loop is not stable.
    """
    feedback.require_stable()
    return tuple(margins_of_loop(name, feedback.at_axis(axis)) for axis, name in enumerate(feedback.axes))


def disk_margin_of_axis(feedback: Feedback, axis: int, skew: float = 0.0) -> DiskMargin:
    """Disk margin of one output, all other loops closed; exact, so both bounds are the same.

    Parameters
    ----------
    feedback : Feedback
        A stable loop.
    axis : int
        Index of the output.
    skew : float, optional
        sigma (-): 0 for disks of equal gain up and down.

    Returns
    -------
    DiskMargin
        The margin of the axis.

    Raises
    ------
    RobustnessError
        If the loop is not stable.
    """
    feedback.require_stable()
    one = [feedback.inputs + axis]
    peak = peak_gain(feedback.closed.part(one, one).plus(np.array([[0.5 * (skew - 1.0)]])))
    alpha = reciprocal(peak.value)
    return DiskMargin(feedback.axes[axis], alpha, alpha, peak.frequency, skew)


def disk_margins(feedback: Feedback, frequency: Arrays, skew: float = 0.0) -> tuple[DiskMargin, ...]:
    """Disk margins of several signals at once: at all outputs, at all inputs, and at both.

    Parameters
    ----------
    feedback : Feedback
        A stable loop.
    frequency : ndarray, shape (f,)
        Frequencies (Hz) of the search; peaks between them are refined.
    skew : float, optional
        sigma (-): 0 for disks of equal gain up and down.

    Returns
    -------
    tuple of DiskMargin
        Three margins, in this order.

    Raises
    ------
    RobustnessError
        If the loop is not stable.
    """
    feedback.require_stable()
    m, size = feedback.inputs, feedback.inputs + feedback.outputs
    places = {"outputs": range(m, size), "inputs": range(m), "inputs and outputs": range(size)}
    shifted = feedback.closed.plus(0.5 * (skew - 1.0) * np.eye(size))
    alone = [peak_gain(shifted.part([place], [place])) for place in range(size)]
    margins = []
    for where, signals in places.items():
        mu = disk_peak(feedback.closed.part(list(signals), list(signals)), frequency, skew)
        # Together they bear no more than each alone, whose peak is exact and may lie between the frequencies.
        one = max((alone[place] for place in signals), key=lambda peak: peak.value)
        upper, at = max((mu.upper, mu.frequency), (one.value, one.frequency))
        margins.append(DiskMargin(where, reciprocal(upper), reciprocal(max(mu.lower, one.value)), at, skew))
    return tuple(margins)


def disk_peak(sensitivity: LinearSystem, frequency: Arrays, skew: float = 0.0) -> MuPeak:
    """Bounds of the largest mu of S + (sigma - 1)/2 I over independent complex perturbations of all its signals."""
    size = len(sensitivity.c)
    system = sensitivity.plus(0.5 * (skew - 1.0) * np.eye(size))
    return mu_peak(system, [Block(f"f_{number + 1}") for number in range(size)], frequency)


def margins_of_loop(name: str, loop: LinearSystem) -> ClassicalMargins:
    """Gain, phase and delay margins of an open loop of one signal in negative feedback, which must be stable."""
    at_phase, at_gain = phase_crossovers(loop), gain_crossovers(loop)
    values = loop.response(at_phase)[:, 0, 0]
    factors = [
        Peak(-1.0 / value.real, float(at))
        for value, at in zip(values, at_phase, strict=True)
        if value.real < 0.0 and abs(value.imag) < 1e-4 * abs(value)
    ]
    nothing_up, nothing_down = Peak(math.inf, math.nan), Peak(0.0, math.nan)
    up = min((item for item in factors if item.value > 1.0), key=lambda item: item.value, default=nothing_up)
    down = max((item for item in factors if item.value < 1.0), key=lambda item: item.value, default=nothing_down)
    turned = np.angle(-loop.response(at_gain)[:, 0, 0])  # from -1: positive for a lead over -180 degrees
    phases = [Peak(abs(float(turn)), float(at)) for turn, at in zip(turned, at_gain, strict=True)]
    delays = [
        Peak(float(turn % (2.0 * np.pi)) / (2.0 * np.pi * float(at)), float(at))
        for turn, at in zip(turned, at_gain, strict=True)
        if at > 0.0
    ]
    nothing = Peak(math.inf, math.nan)
    return ClassicalMargins(
        name,
        up,
        down,
        min(phases, key=lambda item: item.value, default=nothing),
        min(delays, key=lambda item: item.value, default=nothing),
    )
