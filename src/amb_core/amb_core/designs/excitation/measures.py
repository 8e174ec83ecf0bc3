"""Measures of a trial: how far the simulated response is from the linear one, and how often limits act.

The deviation is the same for signals of every kind. It compares the response with that of the linearised loop to the
very same signal, so it needs neither a period nor a certain spectrum. The best linear approximation is by definition
the linear system that leaves the smallest error. Any other one, that of `linearize` included, leaves as much or more:
so the deviation is an upper bound for the nonlinear distortion of this signal (Pintelon and Schoukens, System
Identification: A Frequency Domain Approach, 2nd ed., Wiley 2012, section 3.4), apart from noise, which is taken out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.designs.excitation.linear_response import LinearResponse
from amb_core.loop.records import LoopRecord

DEVIATION = "deviation from the response of the linearised loop to the same signal"
"""Name of the measure in answers."""


@dataclass(frozen=True)
class AxisMeasure:
    """Measures of an excited axis in one trial, over the whole signal.

    Attributes
    ----------
    axis : {"x", "y"}
        The axis.
    deviation : float
        Rms of the position less the linear response, both without mean values, over that of the linear response (-).
        The power of the noise at rest is taken out.
    fit : float
        100 (1 - rms error / standard deviation of the position), with the linear response as the model (percent). Here
        a shift of the mean position counts as an error.
    clipped : float
        Share of the samples with a control current at or beyond its limit (-).
    slewed : float
        Share (-) of the samples after which the current changes further than the voltage can drive it within a sample.
    """

    axis: str
    deviation: float
    fit: float
    clipped: float
    slewed: float


def measure_trial(
    record: LoopRecord,
    rest: int,
    axes: Sequence[int],
    linear: LinearResponse,
    current_limit: float,
    slew_rate: float | None,
) -> tuple[AxisMeasure, ...]:
    """Measures of the excited axes.

    Parameters
    ----------
    record : LoopRecord
        The trial: `rest` samples at rest, then the whole signal. The second half of the rest shows the noise.
    rest : int
        Samples before the excitation.
    axes : sequence of int
        Excited axes, 0 for x and 1 for y.
    linear : LinearResponse
        Of the linearised loop to the signal.
    current_limit, slew_rate : float
        Limits of the control current (A, A/s).
    """
    still = record.position[rest // 2 : rest]
    moved = record.position[rest:] - still.mean(axis=0)
    error = moved - linear.position
    noise = still.var(axis=0)
    strength = linear.position.std(axis=0)
    current = record.current[rest:]
    clipped = np.mean(np.abs(current) >= current_limit, axis=0)
    change = np.abs(np.diff(current, axis=0, prepend=record.current[rest - 1 : rest] if rest else current[:1]))
    slewed = np.mean(change > (np.inf if slew_rate is None else slew_rate * record.sample_time), axis=0)
    return tuple(
        AxisMeasure(
            axis="xy"[axis],
            deviation=_ratio(error[:, axis].var() - noise[axis], strength[axis]),
            fit=100.0 * (1.0 - _ratio(np.mean(error[:, axis] ** 2) - noise[axis], moved[:, axis].std())),
            clipped=float(clipped[axis]),
            slewed=float(slewed[axis]),
        )
        for axis in axes
    )


def worst_measures(trials: Sequence[Sequence[AxisMeasure]]) -> tuple[AxisMeasure, ...]:
    """The worst values of each axis over several trials of the same axes."""
    return tuple(
        AxisMeasure(
            axis=of_axis[0].axis,
            deviation=max(item.deviation for item in of_axis),
            fit=min(item.fit for item in of_axis),
            clipped=max(item.clipped for item in of_axis),
            slewed=max(item.slewed for item in of_axis),
        )
        for of_axis in zip(*trials, strict=True)
    )


def _ratio(power: NDArray[np.float64] | float, over: NDArray[np.float64] | float) -> float:
    """Root of a power, zero where noise explains all of it, over a standard deviation."""
    return float(np.sqrt(max(float(power), 0.0)) / over) if over > 0.0 else float("inf")
