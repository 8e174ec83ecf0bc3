"""Synthetic telemetry with known onsets of the regions, or none: random linear loops with what a bearing may add.

`draw` is the basic set; the others each answer one question: are lines that were there before the excitation, slow
oscillations of any frequency, and lightly damped modes distinguished from a nonlinear bearing?
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from amb_core.excitation import excitation_from_request, generate
from amb_core.loop.records import LoopRecord
from amb_core.regions import Region

RATE = 10_000.0
CLEARANCE = {"x": 250e-6, "y": 250e-6}  # m
FAMILIES = ("drift", "oscillation", "contact", "resonance", "beat", "noise")
PLANTED = {"drift": Region.B, "oscillation": Region.C, "contact": Region.D}
OTHER_EXCITATIONS = {
    "square": {"amplitude": 20e-6},
    "multisine": {"amplitude": 20e-6, "frequency_start": 5.0, "frequency_end": 2000.0},
    "prbs": {"amplitude": 20e-6},
    "white_noise": {"amplitude": 10e-6},
}


@dataclass
class Case:
    """Telemetry with a planted onset, or none."""

    family: str
    record: LoopRecord
    frequency: NDArray[np.float64] | None
    onset: int | None


class Loop:
    """A closed loop with stiffness and damping that act on the control error (the paper's control law)."""

    def __init__(self, random: np.random.Generator, damping: tuple[float, float]) -> None:
        natural, ratio = 2.0 * np.pi * random.uniform(40.0, 80.0), random.uniform(*damping)
        self.natural = natural / (2.0 * np.pi)
        self._tracking = self._discrete([2.0 * ratio * natural, natural**2], natural, ratio)
        self._force = self._discrete([natural**2], natural, ratio)

    @staticmethod
    def _discrete(numerator: list[float], natural: float, ratio: float) -> tuple[NDArray, NDArray]:
        b, a, _ = cont2discrete((numerator, [1.0, 2.0 * ratio * natural, natural**2]), 1.0 / RATE)
        return b.ravel(), a

    def track(self, reference: NDArray[np.float64]) -> NDArray[np.float64]:
        return lfilter(*self._tracking, reference)

    def pushed(self, force: NDArray[np.float64]) -> NDArray[np.float64]:
        """Position under a force, in units of the static deflection."""
        return lfilter(*self._force, force)


def draw(family: str, random: np.random.Generator) -> Case:
    loop = Loop(random, (0.08, 0.25) if family == "resonance" else (0.35, 0.7))
    lead = round(random.uniform(0.2, 0.6) * RATE)
    excitation, frequency = excite(family, random)
    steps = lead + len(excitation)
    time = np.arange(steps) / RATE
    reference = np.zeros((steps, 2))
    reference[lead:, 1] = excitation
    position = np.zeros((steps, 2))
    position[:, 1] = random.uniform(-70e-6, 20e-6) + loop.track(reference[:, 1])
    position[:, 0] = 0.02 * (position[:, 1] - position[0, 1])
    if family == "resonance":
        position[:, 1] *= min(1.0, 200e-6 / np.abs(position[:, 1]).max())
    for axis in range(2):
        position[:, axis] += random.normal(scale=random.uniform(0.02e-6, 0.5e-6), size=steps)
        hum = loop.pushed(random.normal(size=steps))
        position[:, axis] += random.uniform(0.0, 0.2e-6) * hum / hum.std()
    whole = None if frequency is None else np.concatenate([np.full(lead, np.nan), frequency])
    onset = None
    if family == "beat":
        order = random.integers(3, 12)
        rate_of_change = 2.0 * np.pi * np.cumsum(np.nan_to_num(whole)) / RATE
        drive = np.sin(order * rate_of_change + random.uniform(0.0, 2.0 * np.pi)) * (time > lead / RATE)
        position[:, 1] += random.uniform(2e-6, 50e-6) * loop.pushed(drive)
    elif family in PLANTED:
        lowest = {"drift": 200.0, "oscillation": 150.0, "contact": 40.0}[family]
        target = random.uniform(lowest, 4000.0)
        onset = int(np.searchsorted(np.nan_to_num(whole), target))
        since = np.maximum(time - onset / RATE, 0.0)
        if family == "drift":
            slope = random.choice([-1.0, 1.0]) * np.exp(random.uniform(np.log(5e-6), np.log(300e-6)))
            position[:, 1] += np.clip(slope * since, -150e-6, 150e-6)
        elif family == "oscillation":
            slow = random.uniform(25.0, min(110.0, target / 3.5))
            rise = 1.0 - np.exp(-since / random.uniform(0.002, 0.03))
            amplitude = np.exp(random.uniform(np.log(2e-6), np.log(40e-6)))
            position[:, 1] += amplitude * rise * np.sin(2.0 * np.pi * slow * since + random.uniform(0.0, 2.0 * np.pi))
        else:
            position[:, 1] -= 300e-6 * (1.0 - np.exp(-since / 0.01))
            onset = int(np.argmax(np.hypot(position[:, 0], position[:, 1]) >= 250e-6))
    return Case(family, LoopRecord(0, 1.0 / RATE, reference, position, np.zeros_like(position)), whole, onset)


def excite(family: str, random: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Samples of an excitation and their frequency."""
    if family == "noise" and random.random() < 0.7:
        kinds = [*OTHER_EXCITATIONS, "nothing"]
        kind = kinds[random.integers(len(kinds))]
        if kind == "nothing":
            return np.zeros(int(8 * RATE)), None
        request = {"duration": 8.0, "axes": "y", **OTHER_EXCITATIONS[kind]}
        return generate(excitation_from_request(kind, request), RATE).samples[:, 1], None
    request = {
        "amplitude": random.uniform(5e-6, 50e-6),
        "duration": 20.0,
        "frequency_start": 10.0,
        "frequency_end": 5000.0,
        "spacing": ["linear", "logarithmic"][random.integers(2)],
        "axes": "y",
    }
    signal = generate(excitation_from_request("sweep", request), RATE)
    return signal.samples[:, 1], signal.frequency


# -- what turns, hums and rings


def draw_constant_line(random: np.random.Generator, drift: bool) -> Case:
    """Hum or unbalance of 1 to 10 um that is there from the start; optionally with a drift of 2 to 40 um/s."""
    record, frequency, _ = _linear(random, "sweep" if drift or random.random() < 0.7 else _other(random))
    time = np.arange(record.steps) / RATE
    turning = random.random() < 0.6
    base = random.uniform(8.0, 120.0) if turning else random.choice([50.0, 60.0, 100.0])
    amplitude = np.exp(random.uniform(np.log(1e-6), np.log(10e-6)))
    phase = random.uniform(0.0, 2.0 * np.pi, 3)
    for order, share in ((1, 1.0), (2, 0.3 * random.random()), (3, 0.1 * random.random())):
        angle = 2.0 * np.pi * order * base * time + phase[order - 1]
        record.position[:, 1] += share * amplitude * np.sin(angle)
        record.position[:, 0] += share * amplitude * (np.cos(angle) if turning else 0.4 * np.sin(angle))
    onset = None
    if drift:
        target = random.uniform(300.0, 0.4 * np.nanmax(frequency))
        onset = int(np.searchsorted(np.nan_to_num(frequency), target))
        slope = random.choice([-1.0, 1.0]) * np.exp(random.uniform(np.log(2e-6), np.log(40e-6)))
        record.position[:, 1] += np.clip(slope * np.maximum(time - onset / RATE, 0.0), -100e-6, 100e-6)
    return Case("drift" if drift else "line", record, frequency, onset)


def draw_slow_line(random: np.random.Generator) -> Case:
    """A line of 3 um from 1 to 120 Hz that sets in during a sweep of at least three times its frequency.

    Eight of its periods and two seconds of the sweep are left.
    """
    record, frequency, lead = _linear(random, "sweep")
    time = np.arange(record.steps) / RATE
    slow = np.exp(random.uniform(np.log(1.0), np.log(120.0)))
    first = max(np.searchsorted(np.nan_to_num(frequency), 3.3 * slow), lead + 0.5 * RATE)
    last = record.steps - (8.0 / slow + 2.0) * RATE
    onset = int(random.uniform(first, max(first, last)))
    since = np.maximum(time - onset / RATE, 0.0)
    phase = random.uniform(0.0, 2.0 * np.pi)
    rise = 1.0 - np.exp(-since * slow)
    record.position[:, 1] += 3e-6 * rise * np.sin(2.0 * np.pi * slow * since + phase)
    return Case("slow", record, frequency, onset)


def draw_light_mode(random: np.random.Generator) -> Case:
    """A linear loop with a mode from 15 to 200 Hz and a damping ratio of 0.01, under any excitation."""
    kind = "sweep" if random.random() < 0.5 else _other(random)
    record, frequency, _ = _linear(random, kind)
    natural = 2.0 * np.pi * np.exp(random.uniform(np.log(15.0), np.log(200.0)))
    mode = Loop._discrete([natural**2], natural, 0.01)
    ringing = lfilter(*mode, record.reference[:, 1])
    share = min(random.uniform(0.05, 0.5), 100e-6 / max(np.abs(ringing).max(), 1e-12))
    record.position[:, 1] += share * ringing
    return Case("mode", record, frequency, None)


def _other(random: np.random.Generator) -> str:
    return list(OTHER_EXCITATIONS)[random.integers(len(OTHER_EXCITATIONS))]


def _linear(random: np.random.Generator, kind: str) -> tuple[LoopRecord, NDArray[np.float64] | None, int]:
    """A linear loop at rest and then under an excitation on y; its record, the frequency of a sweep, and the rest."""
    loop = Loop(random, (0.35, 0.7))
    lead = round(random.uniform(0.6, 1.5) * RATE)
    if kind == "sweep":
        request: dict[str, object] = {
            "amplitude": random.uniform(5e-6, 50e-6),
            "duration": random.uniform(12.0, 20.0),
            "frequency_start": 10.0,
            "frequency_end": random.uniform(2000.0, 5000.0),
            "spacing": ["linear", "logarithmic"][random.integers(2)],
        }
    else:
        request = {"duration": 8.0, **OTHER_EXCITATIONS[kind]}
    signal = generate(excitation_from_request(kind, {"axes": "y", **request}), RATE)
    steps = lead + len(signal.samples)
    reference, position = np.zeros((2, steps, 2))
    reference[lead:, 1] = signal.samples[:, 1]
    position[:, 1] = random.uniform(-70e-6, 20e-6) + loop.track(reference[:, 1])
    position[:, 0] = 0.02 * (position[:, 1] - position[0, 1])
    for axis in range(2):
        position[:, axis] += random.normal(scale=random.uniform(0.02e-6, 0.5e-6), size=steps)
        hum = loop.pushed(random.normal(size=steps))
        position[:, axis] += random.uniform(0.0, 0.2e-6) * hum / hum.std()
    record = LoopRecord(0, 1.0 / RATE, reference, position, np.zeros_like(position))
    known = None if signal.frequency is None else np.concatenate([np.full(lead, np.nan), signal.frequency])
    return record, known if kind == "sweep" else None, lead
