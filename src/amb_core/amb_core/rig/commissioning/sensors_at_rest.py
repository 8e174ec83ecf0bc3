"""Sensors while the currents are off: signal, noise, resolution, resting place, and the rotor moved by hand."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.units import UM
from amb_core.loop.machine import Machine
from amb_core.rig.commissioning.finding import Finding
from amb_core.rig.commissioning.levitation import clearance_of

STEP = 0.5e-6  # m: largest step of a converter
_LINE = 0.6  # share of the variance in one line of the spectrum: mains, not noise
_SCALE = 0.25  # relative error of a gain
_TURN = 8.0  # deg
_STILL = 0.15  # of the clearance: less motion by hand is none
_OFFSET = 0.35  # of the clearance
PUSHES = {"+x": 0.0, "+y": 90.0, "-x": 180.0, "-y": 270.0}
"""Directions in which the rotor is pushed by hand, in the plane of a bearing (deg)."""


def noise_findings(position: NDArray[np.float64], names: tuple[str, ...], allowed: float) -> list[Finding]:
    """Sensors of a rotor that lies still.

    Parameters
    ----------
    position : ndarray, shape (steps, axes)
        Measured positions (m), at least a tenth of a second.
    names : tuple of str
        Of the axes.
    allowed : float
        Largest noise (m, rms).
    """
    findings = []
    for axis, name in enumerate(names):
        values = position[:, axis]
        if not np.isfinite(values).all():
            findings.append(
                Finding("sensor silent", (name,), "no signal: not connected, without supply, or out of range")
            )
            continue
        noise = float(values.std())
        if coarse := resolution_findings(position[:, axis : axis + 1], (name,)):
            findings += coarse
        elif noise > allowed or (_line(values) > _LINE and noise > 0.25 * allowed):
            line = _line(values) > _LINE
            cause = "a line of the mains: a ground loop" if line else "a loose shield, or an amplifier that switches"
            text = f"{UM * noise:.3g} um rms with the currents off; allowed: {UM * allowed:g} um; {cause}"
            findings.append(Finding("sensor hum" if line else "sensor noise", (name,), text))
    return findings


def resolution_findings(position: NDArray[np.float64], names: tuple[str, ...]) -> list[Finding]:
    """Converters of too few bits, from positions (m), shape (steps, axes): no two values are close to each other."""
    findings = []
    for axis, name in enumerate(names):
        steps = np.diff(np.unique(position[:, axis]))
        if len(steps) and steps.min() > STEP:
            text = f"its values are {UM * steps.min():.3g} um apart; allowed: {UM * STEP:g} um: too few bits"
            findings.append(Finding("sensor coarse", (name,), text))
    return findings


def _line(values: NDArray[np.float64]) -> float:
    """Share of the variance in the strongest line of the spectrum and its neighbours."""
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(len(values)))) ** 2
    power[:3] = 0.0
    peak = int(np.argmax(power))
    return float(power[max(peak - 2, 0) : peak + 3].sum() / max(power.sum(), 1e-300))


def place_findings(rest: NDArray[np.float64], machine: Machine, share: float) -> list[Finding]:
    """Where the rotor lies, by its sensors: within the clearance, and below the centre.

    Parameters
    ----------
    rest : ndarray, shape (axes,)
        Mean positions (m).
    machine : Machine
        Axes and clearances.
    share : float
        Largest resting radius over clearance.
    """
    findings = []
    for bearing in (each.name for each in machine.bearings):
        axes = machine.columns_of(bearing)
        clearance = clearance_of(machine, bearing)
        radius = float(np.linalg.norm(rest[axes]))
        if radius <= share * clearance:
            continue
        names = tuple(machine.axis_names[axis] for axis in axes)
        text = (
            f"the rotor lies at {UM * radius:.0f} um in bearing {bearing}, whose clearance is {UM * clearance:.0f} um: "
            "offset or scale of these sensors"
        )
        findings.append(Finding("sensor offset", names, text))
    return findings


def stiff_sensors(position: NDArray[np.float64]) -> list[int]:
    """Axes whose sensors repeat one value bit for bit."""
    return [axis for axis in range(position.shape[1]) if np.ptp(position[:, axis]) == 0.0]


def hand_findings(pushed: Mapping[str, Mapping[str, NDArray[np.float64]]], machine: Machine) -> list[Finding]:
    """The rotor pushed by hand onto its backup bearing towards +x, +y, -x and -y, bearing by bearing.

    Parameters
    ----------
    pushed : mapping of str to mapping of str to ndarray, shape (steps, axes)
        Measured positions (m) by bearing and push.
    machine : Machine
        Axes and clearances.
    """
    findings: list[Finding] = []
    every = machine.axis_names
    for bearing in (each.name for each in machine.bearings):
        axes = machine.columns_of(bearing)
        clearance = clearance_of(machine, bearing)
        pushes = pushed.get(bearing)
        if pushes is None or len(axes) != 2:
            continue
        true = np.array([[np.cos(np.radians(PUSHES[way])), np.sin(np.radians(PUSHES[way]))] for way in pushes])
        shown = np.array([values.mean(axis=0) for values in pushes.values()])
        middle = shown.mean(axis=0)
        gain = np.linalg.lstsq(true, (shown - middle) / clearance, rcond=None)[0].T  # sensors by directions
        findings += _of_bearing(gain, shown, middle, pushes, axes, every, clearance)
    return _once(findings)


def _of_bearing(
    gain: NDArray[np.float64],
    shown: NDArray[np.float64],
    middle: NDArray[np.float64],
    pushes: Mapping[str, NDArray[np.float64]],
    axes: list[int],
    every: tuple[str, ...],
    clearance: float,
) -> list[Finding]:
    own = gain[axes]
    names = tuple(every[axis] for axis in axes)
    others = [axis for axis in range(len(every)) if axis not in axes and np.abs(gain[axis]).max() > 1.0 - _SCALE]
    dead = [row for row in range(2) if np.abs(own[row]).max() < _STILL]
    if dead and others:
        pair = tuple(every[axis] for axis in (axes[dead[0]], others[0]))
        return [Finding("sensors swapped", pair, f"{pair[1]} follows the hand at the bearing of {pair[0]}")]
    if dead:
        return [Finding("sensor dead", (names[row],), "it does not follow the rotor moved by hand") for row in dead]
    if abs(own[0, 1]) > abs(own[0, 0]) and abs(own[1, 0]) > abs(own[1, 1]):
        return [Finding("sensors swapped", names, "each follows the hand along the other axis")]
    findings = [
        Finding("sensor reversed", (names[row],), "it falls when the rotor is pushed upwards along it")
        for row in range(2)
        if own[row, row] < 0.0
    ]
    signed = own * np.sign(np.diag(own))[:, np.newaxis]
    angle = np.degrees(0.5 * (np.arctan2(signed[0, 1], signed[0, 0]) - np.arctan2(signed[1, 0], signed[1, 1])))
    if not findings and abs(angle) > _TURN:
        findings.append(Finding("sensors turned", names, f"by {angle:.0f} deg against the hand's directions"))
    return findings + [
        one for row in range(2) for one in _of_sensor(row, own, shown, middle, pushes, axes, names, clearance)
    ]


def _of_sensor(
    row: int,
    own: NDArray[np.float64],
    shown: NDArray[np.float64],
    middle: NDArray[np.float64],
    pushes: Mapping[str, NDArray[np.float64]],
    axes: list[int],
    names: tuple[str, ...],
    clearance: float,
) -> list[Finding]:
    """Range, scale and offset of one sensor."""
    name, axis = names[row], axes[row]
    if any(np.ptp(values[:, axis]) == 0.0 for values in pushes.values()):
        text = f"it shows the same value from {UM * float(np.abs(shown[:, axis]).max()):.0f} um onwards"
        return [Finding("sensor clips", (name,), text)]
    size = float(np.linalg.norm(own[row]))
    if abs(size - 1.0) > _SCALE:
        text = f"it shows {100.0 * size:.0f} % of the motion by hand over the clearance"
        return [Finding("sensor scale", (name,), text)]
    if abs(middle[axis]) > _OFFSET * clearance:
        return [Finding("sensor offset", (name,), f"the middle of its motion by hand is at {UM * middle[axis]:.0f} um")]
    return []


def _once(findings: list[Finding]) -> list[Finding]:
    """Sensors that are swapped between two bearings are found in both."""
    by_axes = {(one.fault, frozenset(one.axes)): one for one in reversed(findings)}
    return list(by_axes.values())[::-1]
