"""Faults that are looked for on the backup bearing and levitated alike: angle, delay, low-pass, noise when on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.units import UM
from amb_core.loop.machine import Machine
from amb_core.loop.records import LoopRecord
from amb_core.rig.commissioning.dynamics import AxisDynamics
from amb_core.rig.commissioning.finding import Finding

TURN = 0.15  # tangent of the angle from which on axes are turned
SURE = 3.0  # deviations from which on there is a delay
_NOISE, _LEAST = 4.0, 0.3e-6  # times the noise with the currents off, and m from sample to sample


def late_findings(name: str, one: AxisDynamics, late: float) -> list[Finding]:
    """Delay or low-pass of one axis."""
    if one.delay < late or one.delay < SURE * one.delay_error:
        return []
    if one.misfit[1] < 0.7 * one.misfit[0] and one.lag > 0.0:
        return [Finding("low-pass", (name,), f"of {1e3 * one.lag:.2g} ms: a filter of sensor or amplifier")]
    text = f"{one.delay:.1f} samples more than the model has: converters, or a step between measuring and writing"
    return [Finding("delay", (name,), text)]


def turn_of(ratio: NDArray[np.complex128], machine: Machine) -> dict[tuple[str, str], float]:
    """Tangent of the angle between sensors and magnets, by bearing; from H^-1 P."""
    names, tangents = machine.axis_names, {}
    for bearing in machine.bearings:
        axes = machine.columns_of(bearing.name)
        if len(axes) == 2:
            i, j = axes
            one, other = (np.median((ratio[:, a, b] / ratio[:, b, b]).real) for a, b in ((j, i), (i, j)))
            tangents[names[i], names[j]] = float(0.5 * (one - other))
    return tangents


def noise_when_on(still: LoopRecord, rest: LoopRecord, names: tuple[str, ...]) -> list[Finding]:
    """Noise from sample to sample, which the motion of the rotor hardly changes, against that with the currents off."""
    findings = []
    now, before = (np.diff(record.position, axis=0).std(axis=0) for record in (still, rest))
    for axis, name in enumerate(names):
        if now[axis] > max(_NOISE * before[axis], _LEAST):
            text = f"{UM * now[axis]:.2g} um from sample to sample, {UM * before[axis]:.2g} um with the currents off"
            findings.append(Finding("noise when on", (name,), text + ": amplifiers that disturb the sensors"))
    return findings
