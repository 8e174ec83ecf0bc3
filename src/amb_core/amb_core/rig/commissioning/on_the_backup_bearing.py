"""Coils, amplifiers and loop while the rotor lies on its backup bearing: small currents on one axis after another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from amb_core.loop.records import LoopRecord
from amb_core.rig.commissioning.bench import Bench
from amb_core.rig.commissioning.both_ways import TURN, late_findings, noise_when_on, turn_of
from amb_core.rig.commissioning.dynamics import axis_dynamics
from amb_core.rig.commissioning.expected import Expected
from amb_core.rig.commissioning.finding import FaultName, Finding
from amb_core.rig.commissioning.tones import ToneResponse, response_to, tone_set

SETTLE, WINDOW = 0.15, 0.5  # s
QUIET, LONGEST = 40e-9, 4  # m, of noise from which on tones are played longer, and how many times at most
LOW, HIGH, TONES = 40.0, 1200.0, 9  # Hz
SEEN = 3.2  # deviations from which on a response is one
GAIN, FORCE = 1.5, 2.5  # factors from which on the gain of one axis is wrong, and that of all of them
LATE, MODEST = 3.0, 0.6  # samples that a first levitation can do without, and that do not disturb the gain
CLEAR, FEWEST = 0.2, 7  # relative deviation of a tone that says something, and how many of them decide
UNSURE = 0.15  # relative deviation from which on a gain says nothing
LOWEST = 150.0  # Hz up to which the sign is read


def on_the_backup_bearing(
    bench: Bench,
    expected: Expected | None,
    moved: bool,
    before: list[Finding],
    dead: list[str],
    rest: LoopRecord,
) -> list[Finding]:
    """Sign, connection, angle, gain and delay of every axis, by currents that cannot move the rotor off.

    Parameters
    ----------
    bench : Bench
        The target, off.
    expected : Expected
        Of the model of the machine.
    moved : bool
        Whether the sensors were checked by hand: what is wrong then concerns the coils.
    before : list of Finding
        Those of the sensors.
    dead : list of str
        Axes without a sensor that moves.
    rest : LoopRecord
        With the currents off.
    """
    names = bench.machine.axis_names
    noise = float(np.diff(rest.position, axis=0).std(axis=0).max()) / np.sqrt(2.0)
    window = WINDOW * float(np.clip(round((noise / QUIET) ** 2), 1, LONGEST))
    tones = tone_set(LOW, HIGH, TONES, window, 0.7)
    records = [bench.tones_at_rest(tones, axis, SETTLE, window) for axis in range(len(names))]
    if findings := noise_when_on(records[0], rest, names):
        return findings
    every = [response_to(tones, record) for record in records]
    response = matrix_of(every)  # tones, sensors, coils
    deviation = (
        np.array([one.deviation for one in every]).T
        / np.abs(np.array([one.current[:, axis] for axis, one in enumerate(every)])).T[:, np.newaxis, :]
    )
    strength = np.sqrt(np.mean(np.abs(response / np.maximum(deviation, 1e-12)) ** 2, axis=0))  # sensors, coils
    swapped = {name for one in before if one.fault in ("sensors swapped", "sensors turned") for name in one.axes}
    words: dict[str, FaultName] = (
        {"swapped": "coils swapped", "reversed": "coils reversed", "turned": "coils turned", "none": "coil dead"}
        if moved
        else {"swapped": "swapped", "reversed": "reversed", "turned": "turned", "none": "no response"}
    )
    silent = [axis for axis in range(len(names)) if names[axis] not in dead and strength[:, axis].max() < SEEN]
    for axis in silent:
        findings.append(Finding(words["none"], (names[axis],), "its current moves nothing"))
    if silent or dead:
        return findings
    size = np.log(np.abs(response) + 1e-12).mean(axis=0)
    driven = linear_sum_assignment(-size.T)[1].tolist()  # sensor by coil; contact is stiffer along one axis
    for axis, sensor in enumerate(driven):
        if sensor != axis and not {names[axis], names[sensor]} & swapped:
            text = f"the current of {names[axis]} moves {names[sensor]}"
            findings.append(Finding(words["swapped"], tuple(sorted((names[axis], names[sensor]))), text))
    if findings or driven != list(range(len(names))):
        return list({one.axes: one for one in findings}.values())
    findings = _signs(bench, tones.frequency, response, before, words["reversed"])
    if findings or expected is None:
        return findings
    return _dynamics_at_rest(bench, expected, tones.frequency, response, deviation, before, words["turned"])


def _signs(
    bench: Bench,
    frequency: NDArray[np.float64],
    response: NDArray[np.complex128],
    before: list[Finding],
    word: FaultName,
) -> list[Finding]:
    reversed_sensors = {name for one in before if one.fault == "sensor reversed" for name in one.axes}
    return [
        Finding(word, (name,), "its current moves the rotor the wrong way")
        for axis, name in enumerate(bench.machine.axis_names)
        if _pulls_back(response[:, axis, axis], frequency) != (name in reversed_sensors)
    ]


def _dynamics_at_rest(
    bench: Bench,
    expected: Expected,
    frequency: NDArray[np.float64],
    response: NDArray[np.complex128],
    deviation: NDArray[np.float64],
    before: list[Finding],
    word: FaultName,
) -> list[Finding]:
    inverse, of_model = np.linalg.inv(response), expected.plant.response(frequency)
    model = np.linalg.inv(of_model)
    of_sensors = {name for one in before for name in one.axes}
    findings: list[Finding] = []
    for pair, angle in turn_of(inverse @ of_model, bench.machine).items():
        if abs(angle) > TURN and not of_sensors & set(pair):
            text = f"by {np.degrees(np.arctan(angle)):.0f} deg against the sensors"
            findings.append(Finding(word, pair, text))
    if findings:
        return findings
    gains: dict[str, float] = {}
    for axis, name in enumerate(bench.machine.axis_names):
        if name in of_sensors:
            continue
        relative = deviation[:, axis, axis] / np.abs(response[:, axis, axis])
        clear = relative < CLEAR
        if np.sum(clear) < FEWEST:  # the levitated rotor will show it
            continue
        one = axis_dynamics(
            inverse[clear, axis, axis], model[clear, axis, axis], frequency[clear], relative[clear], expected.fastest,
            1.0 / bench.rate, contact=True,
        )  # fmt: skip
        findings += late_findings(name, one, LATE)
        if one.gain_error < UNSURE and one.delay < MODEST:
            gains[name] = abs(one.gain) / float(expected.resting[axis])
    return findings or _gains_at_rest(gains)


def _pulls_back(response: NDArray[np.complex128], frequency: NDArray[np.float64]) -> bool:
    """Whether a positive current moves the rotor down: a passive contact answers with a lag of 0 to 180 deg."""
    low = frequency <= max(LOWEST, frequency[1])
    return bool(np.sum((response[low] * np.exp(0.25j * np.pi) / np.abs(response[low])).real) < 0.0)


def _gains_at_rest(gains: dict[str, float]) -> list[Finding]:
    """One axis with another gain than the others, or all of them with one at which no loop would hold."""
    findings = []
    for name, size in gains.items():
        others = [other for of, other in gains.items() if of != name]
        if others and max(size, 1.0 / size) > GAIN < max(size / (usual := float(np.median(others))), usual / size):
            findings.append(
                Finding("amplifier gain", (name,), f"{size:.2f} times the expected force; others {usual:.2f}")
            )
    if not findings and any(max(size, 1.0 / size) > FORCE for size in gains.values()):
        text = ", ".join(f"{name} {size:.2f}" for name, size in gains.items())
        findings.append(
            Finding("force", (), f"over mass, relative to the model: {text}; bias, mass, or scale of all axes")
        )
    return findings


def matrix_of(every: list[ToneResponse]) -> NDArray[np.complex128]:
    """Responses of all positions to the current of one axis after another, shape (tones, sensors, coils)."""
    return np.stack([one.position / one.current[:, axis : axis + 1] for axis, one in enumerate(every)], axis=2)
