"""Fig. 5: the rig, a rotor in two bearings, under a sweep of 100 um on the y axis of one of them."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from amb_core.ground.units import UM
from amb_core.plant import RigidRotorParameters, uniform_shaft
from amb_core.regions import Region, RegionParameters
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.sweep import sweep_chart
from amb_core.report.figures.sweep_comparison import sweep_comparison_chart
from amb_core.report.pages import Answer
from amb_paper.study import Claim, DrawnFigure, Setting, Study, StudyResult, with_another_value
from amb_paper.sweeps import SweptBearing, sweep_bearing, sweep_settings

AMPLITUDE = 100e-6  # m
RIGID = RigidRotorParameters()
LENGTH, DENSITY = 0.45, 7850.0  # m, kg/m^3; of a uniform shaft with the mass of the rigid rotor
BENDING_MODES = 1  # the next one is near 3/7 of the sample rate, where the input beats

RIG: dict[str, Any] = {"rotor.model": "rigid", "iron.saturation": True, "iron.hysteresis": True}
ON_MEASUREMENT = {"controller.derivative_on": "measurement"}
WIDE_LIMIT = {"controller.current_limit": 10.0}
RAISED = {"controller.nominal_reference": [0.0, 40e-6, 0.0, 40e-6]}
CONFIGURED, SURVIVING = "derivative on the error, 3 A", "derivative on the measurement, 10 A"
OTHER_VALUE = "the derivative on the measurement, without which the rotor falls"
OPTIONS: Mapping[str, dict[str, Any]] = {
    CONFIGURED: {},
    "derivative on the measurement, 3 A": ON_MEASUREMENT,
    "derivative on the error, 10 A": WIDE_LIMIT,
    "derivative on the error, 10 A, no hysteresis": WIDE_LIMIT | {"iron.hysteresis": False},
    "derivative on the error, 10 A, reference raised by 40 µm": WIDE_LIMIT | RAISED,
    "derivative on the error, 10 A, no gravity": WIDE_LIMIT | {"rotor.gravity": 0.0},
    SURVIVING: ON_MEASUREMENT | WIDE_LIMIT,
}
"""Options, by derivative and limit of the control current; all else as in config/rig.yaml."""

SETTLED = 200.0  # Hz; above, the rotor no longer follows the reference
HIGH = 1_000.0  # Hz; above, motion slower than SLOW_BAND is much slower than the input
SLOW_BAND = (5.0, 100.0)  # Hz; slower is drift of the bias
SLOW = RegionParameters().oscillation_threshold
DRIFT = RegionParameters().drift_threshold
BIAS_TIME = 0.5  # s, over which the mean is taken
PROMINENT = 2.0  # ratio of a resonance to the response beside it
VISIBLE = 0.05  # share of the largest movement above which a resonance is visible in a figure that shows both
BESIDE = (60.0, 150.0)  # Hz from a resonance, for the response beside it
SHORT = 0.02  # s, some periods of the input


class RigSweep(Study):
    """Sweep of 100 um to 5 kHz, and the options under which the rotor survives its resonance."""

    name = "fig5"
    heading = "Fig. 5: the rig under a sweep"

    def run(self) -> StudyResult:
        """Simulate the options with the rigid rotor, then the surviving one with a flexible rotor."""
        tried = {name: sweep_bearing(AMPLITUDE, RIG | change) for name, change in OPTIONS.items()}
        rigid = tried[SURVIVING]
        flexible, bending = _sweep_flexible()
        ends = {name: _end(swept) for name, swept in tried.items()}
        of_survivor = [
            judge_drift(bias(rigid), Region.B in rigid.onsets),
            judge_slow(*slow_component(rigid), reported=Region.C in rigid.onsets),
            judge_resonances(
                float(np.max(np.abs(rigid.record.position[:, 1] - np.median(rigid.record.position[:, 1])))),
                {frequency: resonance(flexible, frequency) for frequency in bending},
            ),
        ]
        return StudyResult(
            [DrawnFigure.of(name, chart) for name, chart in _charts(tried, flexible).items()],
            [
                judge_survival(ends),
                *(with_another_value(claim, OTHER_VALUE) for claim in of_survivor),
            ],
            _settings(bending),
            [
                "A sweep ends when the rotor touches a backup bearing. Options of the loop, and where it ends: "
                + "; ".join(f"{name}: {_end_text(end)}" for name, end in ends.items())
                + f"; flexible rotor, {SURVIVING}: {_end_text(_end(flexible))}."
            ],
        )


def _charts(tried: dict[str, SweptBearing], flexible: SweptBearing) -> dict[str, Chart]:
    """The rigid rotor with the option that survives, the flexible one, and all options."""
    rigid = tried[SURVIVING]
    return {
        "fig5": sweep_chart(
            rigid.record, rigid.classification, rigid.frequency, over="frequency", axes="y",
            title=f"100 µm sweep of the rigid rotor, {SURVIVING}",
        ),
        "fig5-flexible": sweep_chart(
            flexible.record, flexible.classification, flexible.frequency, over="frequency", axes="y",
            title=f"100 µm sweep of a flexible rotor, {SURVIVING}",
        ),
        "fig5-options": sweep_comparison_chart(
            [swept.case(name) for name, swept in tried.items()],
            title="100 µm sweep of the rigid rotor, by options",
        ),
    }  # fmt: skip


def _settings(bending: Sequence[float]) -> dict[str, Setting]:
    return {
        "amplitude": Setting(f"{UM * AMPLITUDE:g} µm, bearing A", "stated: section 2.3"),
        **sweep_settings("stated: section 2.3"),
        "mass of the rotor": Setting(f"{RIGID.mass:g} kg", "stated: table 1"),
        "rotor": Setting(
            f"rigid, or a uniform shaft of {LENGTH:g} m that bends at "
            f"{', '.join(f'{frequency:.0f}' for frequency in bending)} Hz"
        ),
        "iron": Setting(
            "of the rigid rotor's bearings with saturation and hysteresis, of the flexible one's linear",
            "assumed: section 2.4 has saturation and hysteresis, without values",
        ),
        "derivative": Setting("on the measurement", "against Fig. 10"),
        "control current limit": Setting(f"{WIDE_LIMIT['controller.current_limit']:g} A"),
    }


def bias(swept: SweptBearing) -> NDArray[np.float64]:
    """Means of y (m) over BIAS_TIME each, above the frequencies at which the rotor follows."""
    y = swept.record.position[swept.frequency > SETTLED, 1]
    window = round(BIAS_TIME / swept.record.sample_time)
    means: NDArray[np.float64] = y[: len(y) // window * window].reshape(-1, window).mean(axis=1)
    return means


def slow_component(swept: SweptBearing) -> tuple[float, float]:
    """Largest amplitude of y in the slow band (m), and the input frequency there (Hz), above HIGH; 0 and NaN if none.

    The end of the sweep is left out: at the Nyquist frequency a sampled sine beats with itself.
    """
    high = (swept.frequency > HIGH) & (swept.frequency < 0.45 / swept.record.sample_time)
    y, frequency = swept.record.position[high, 1], swept.frequency[high]
    if len(y) * swept.record.sample_time * SLOW_BAND[0] < 1.0:
        return 0.0, math.nan
    band = butter(2, SLOW_BAND, "bandpass", fs=1.0 / swept.record.sample_time, output="sos")
    slow = np.abs(sosfiltfilt(band, y - y.mean()))
    place = int(np.argmax(slow))
    return float(slow[place]), float(frequency[place])


@dataclass(frozen=True)
class Resonance:
    """The largest response of y near a frequency: its amplitude (m), and its ratio to the median beside it."""

    amplitude: float
    prominence: float


def resonance(swept: SweptBearing, frequency: float) -> Resonance:
    """Contribution of a resonance at a frequency (Hz) to the response; NaN if the sweep did not reach it."""
    window = round(SHORT / swept.record.sample_time)
    count = swept.record.steps // window
    y = swept.record.position[: count * window, 1].reshape(count, window)
    size, distance = 0.5 * np.ptp(y, axis=1), np.abs(swept.frequency[: count * window : window] - frequency)
    near, beside = size[distance < BESIDE[0]], size[(distance >= BESIDE[0]) & (distance < BESIDE[1])]
    if not len(near) or not len(beside):
        return Resonance(math.nan, math.nan)
    return Resonance(float(near.max()), float(near.max() / np.median(beside)))


def judge_survival(ends: Mapping[str, float | None]) -> Claim:
    """Whether the rig survives the sweep as configured, or with other options, which have None in `ends` (Hz)."""
    through = [name for name, end in ends.items() if end is None]
    if CONFIGURED in through:
        verdict: Answer = "agrees"
    else:
        verdict = "agrees in part" if through else "does not agree"
    return Claim(
        id="rig-survives",
        paper_figure="Fig. 5",
        statement="The rig remains levitated under a sweep of 100 µm from 10 Hz to 5 kHz.",
        finding=f"{CONFIGURED}: {_end_text(ends[CONFIGURED])}. Of {len(ends)} options tried, it gets to the end with "
        + ("; ".join(through) or "none")
        + ".",
        verdict=verdict,
        reason=""
        if verdict == "agrees"
        else "At its resonance the rotor moves more than its reference, and it hangs low by its weight: together this "
        "takes up the whole clearance. Above the resonance, the derivative of the reference drives the control current "
        "into its limits. The paper does not state what keeps its rig levitated. Its section 3.2 calls the controllers "
        "PID; their integral part would carry the weight.",
        figure="fig5",
    )


def judge_drift(means: NDArray[np.float64], reported: bool) -> Claim:
    """Whether the bias (m) drifts above the resonance, and the classifier reports region B for it."""
    span = float(np.ptp(means)) if len(means) else 0.0
    drifts = span >= DRIFT
    return Claim(
        id="rig-drifts",
        paper_figure="Fig. 5",
        statement="During the sweep the level about which the rotor moves drifts (region B).",
        finding=f"Above {SETTLED:g} Hz the mean of y moves by {UM * span:.1f} µm"
        + (f", between {UM * means.min():.1f} and {UM * means.max():.1f} µm" if len(means) else "")
        + (". The classifier reports region B." if reported else ". The classifier does not report region B."),
        verdict="agrees" if drifts and reported else "agrees in part" if drifts else "does not agree",
        reason=f"It moves by less than the threshold of the classifier, {UM * DRIFT:g} µm."
        if not drifts
        else ""
        if reported
        else "It is slow: the classifier requires the bias to move by its threshold within the span of its test.",
        figure="fig5",
    )


def judge_slow(amplitude: float, frequency: float, *, reported: bool) -> Claim:
    """Whether y moves slowly (m) while the input is fast (Hz), and the classifier reports region C for it."""
    there = amplitude >= SLOW
    return Claim(
        id="rig-moves-slowly",
        paper_figure="Fig. 5",
        statement="Under excitation of high frequency a component of low frequency emerges (region C).",
        finding=f"Between {SLOW_BAND[0]:g} and {SLOW_BAND[1]:g} Hz y moves by up to {UM * amplitude:.1f} µm, largest "
        f"with an input of {frequency:.0f} Hz."
        if there
        else "Nothing above the threshold of the classifier.",
        verdict="agrees" if there and reported else "agrees in part" if there else "does not agree",
        reason="Slow motion comes in bursts where a harmonic of the input folds to a low frequency at the sample rate. "
        "The classifier separates this beating of a sampled loop from an oscillation of the loop itself, region C."
        if there and not reported
        else ""
        if there
        else "Above its resonance the rotor hardly moves.",
        figure="fig5",
    )


def judge_resonances(reach: float, bending: Mapping[float, Resonance]) -> Claim:
    """Whether resonances are easily seen: of the rigid rotor by its reach (m), of bending by frequency (Hz)."""
    rigid = reach > AMPLITUDE
    there = any(one.prominence >= PROMINENT for one in bending.values())
    seen = any(one.prominence >= PROMINENT and one.amplitude >= VISIBLE * reach for one in bending.values())
    verdict: Answer = "agrees" if rigid and seen else "agrees in part" if rigid or there else "does not agree"
    bends = ", ".join(
        f"{UM * one.amplitude:.1f} µm at {frequency:.0f} Hz, {one.prominence:.1f} times the response beside it"
        for frequency, one in bending.items()
    )
    return Claim(
        id="rig-resonates",
        paper_figure="Fig. 5",
        statement="Some critical resonances of the rotor are easily seen in the response.",
        finding=f"At the resonance of the loop the rotor moves by {UM * reach:.0f} µm, {reach / AMPLITUDE:.1f} times "
        f"its reference. A flexible rotor moves at its bending frequencies: {bends}.",
        verdict=verdict,
        reason=""
        if verdict == "agrees"
        else "The shaft is assumed, since the paper does not describe its own. It bends far above the bandwidth of the "
        "loop, where its bending is visible, but small compared with the resonance of the loop."
        if there
        else "The shaft is assumed, since the paper does not describe its own, and its bending is hardly visible.",
        figure="fig5-flexible",
    )


def _sweep_flexible() -> tuple[SweptBearing, list[float]]:
    """The sweep with a uniform shaft and linear iron, and the frequencies at which it bends (Hz)."""
    diameter = math.sqrt(4.0 * RIGID.mass / (math.pi * DENSITY * LENGTH))
    shaft = uniform_shaft(
        LENGTH, diameter, (RIGID.bearing_a, RIGID.bearing_b), bending_modes=BENDING_MODES, density=DENSITY
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "shaft.npz"
        shaft.save(path)
        change = {"rotor.model": "flexible", "flexible_rotor.modal_data": str(path)}
        swept = sweep_bearing(AMPLITUDE, OPTIONS[SURVIVING] | change)
    return swept, [float(frequency) for frequency in shaft.natural_frequencies[4::2]]


def _end(swept: SweptBearing) -> float | None:
    """Frequency at which the sweep ended early (Hz)."""
    return float(swept.frequency[-1]) if swept.plant.delevitated else None


def _end_text(end: float | None) -> str:
    return "to the end" if end is None else f"{end:.0f} Hz"
