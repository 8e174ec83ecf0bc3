"""Fig. 2: the bearing with 1 DOF under a sweep compared with an identified linear model, and its regions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from amb_core.excitation import Multisine, generate
from amb_core.identification import Identification, identify, nrmse_fit, simulate_closed_loop
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant
from amb_core.plant.simulation import simulate
from amb_core.regions import Region
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.sweep import sweep_chart
from amb_core.report.figures.sweep_comparison import sweep_comparison_chart
from amb_paper.study import LINEAR_IRON, Claim, DrawnFigure, Setting, Study, StudyResult, judged
from amb_paper.sweeps import (
    ONE_AXIS,
    SLOW_AMPLIFIER,
    SLOW_NOTE,
    SLOW_VALUE,
    TOP_COIL,
    SweptBearing,
    in_order,
    order_reason,
    sweep_bearing,
    sweep_settings,
)

AMPLITUDE = 15e-6  # m; the paper does not state its value
TOP_COIL_AMPLITUDES = (10e-6, 15e-6, 20e-6, 25e-6, 30e-6)  # m
TOP_COIL_CHANGES: dict[str, dict[str, Any]] = {
    "control current limit 10 A": {"controller.current_limit": 10.0},
    "no cross-coupling": {"magnetic_circuit.coupling": False},
}
VOLTAGES = (300.0, 150.0, 75.0, 50.0, 30.0)  # V, of the supply: from that of table 1 to that of the slow amplifier
ORDER = 6  # of two bearings: rotor (2) and current loop (1) of each
EXCITATIONS = tuple(  # of the two copies; so small that the bearing stays in region A
    Multisine(amplitude=1e-6, frequency_start=11.0, frequency_end=1_000.0, duration=2.0, axes="y", seed=seed)
    for seed in (1, 2)
)
NO_LIMIT = 100.0  # A, of the controller in the loop of the model: never reached in the sweep, so the loop is linear
NEAR = 0.25  # by how much frequencies that are "approximately the same" may differ


@dataclass(frozen=True)
class Pole:
    """The dominant pole pair of a loop.

    Attributes
    ----------
    natural, damped : float
        Magnitude and imaginary part over 2 pi (Hz).
    """

    natural: float
    damped: float


PAPER, TOP, SLOW = "fig2", "fig2-top-coil", "fig2-slow-amplifier"
NAMES = {
    PAPER: f"two electromagnets, supply of table 1, {VOLTAGES[0]:g} V",
    TOP: "top coil alone, as in equation (1), table 1",
    SLOW: f"two electromagnets, slow amplifier, {SLOW_AMPLIFIER['amplifier.supply_voltage']:g} V",
}
"""Bearings by figure; the last one has another value than the paper states."""


class OneAxisSweep(Study):
    """The sweep of three bearings, each compared with its identified model."""

    name = "fig2"
    heading = "Fig. 2: the bearing with one axis under a sweep, and a linear model"
    against = LINEAR_IRON

    def run(self) -> StudyResult:
        """Simulate, classify, identify, draw, evaluate."""
        scan = {
            voltage: sweep_bearing(AMPLITUDE, {**ONE_AXIS, "amplifier.supply_voltage": voltage}) for voltage in VOLTAGES
        }
        top = {amplitude: sweep_bearing(amplitude, TOP_COIL) for amplitude in TOP_COIL_AMPLITUDES}
        bearings = {
            PAPER: scan[VOLTAGES[0]],
            TOP: top[AMPLITUDE],
            SLOW: scan[SLOW_AMPLIFIER["amplifier.supply_voltage"]],
        }
        figures, fits, poles = [], {}, {}
        for figure, bearing in bearings.items():
            identification = identify_bearing(bearing)
            model = model_response(identification, bearing)
            fits[figure] = region_a_fit(bearing, model)
            poles[figure] = dominant_pole(identification, bearing.controller.sample_rate)
            title = f"One axis, sweep of {1e6 * AMPLITUDE:g} µm: {NAMES[figure]}"
            chart = sweep_chart(
                bearing.record, bearing.classification, bearing.frequency, model=model, axes=("y",), title=title
            )
            figures.append(DrawnFigure.of(figure, chart))
        figures += [DrawnFigure.of(name, chart) for name, chart in _comparisons(top, scan).items()]
        return self.result(
            figures,
            [
                linear_claim({PAPER: fits[PAPER], TOP: fits[TOP]}, {SLOW: fits[SLOW]}),
                order_claim(bearings),
                frequency_claim(bearings, poles),
                delevitation_claim(bearings),
            ],
            _settings(),
            [
                top_coil_note(top),
                SLOW_NOTE,
                "The library identifies plants with two inputs and two outputs. Two copies of the bearing, each with "
                "its own random signal, make such a plant. The model of the second copy is simulated under the sweep, "
                "in a loop without limits, since a linear loop has none.",
            ],
        )


def _comparisons(top: dict[float, SweptBearing], scan: dict[float, SweptBearing]) -> dict[str, Chart]:
    """The top coil alone by amplitude, and two electromagnets by supply voltage."""
    return {
        "fig2-top-coil-amplitudes": sweep_comparison_chart(
            [bearing.case(f"{1e6 * amplitude:g} µm") for amplitude, bearing in top.items()],
            title="Top coil alone, table 1: sweeps of rising amplitude",
        ),
        "fig2-supply-voltage": sweep_comparison_chart(
            [bearing.case(f"supply voltage {voltage:g} V") for voltage, bearing in scan.items()],
            title="Two electromagnets: the same sweep with increasingly slow amplifiers",
        ),
    }


def _settings() -> dict[str, Setting]:
    return {
        "amplitude": Setting(f"{1e6 * AMPLITUDE:g} µm"),
        **sweep_settings(),
        "first bearing": Setting("electromagnets above and below the rotor", "assumed, as in footnote 5"),
        "second bearing": Setting("the electromagnet above the rotor alone", "assumed, as in equation (1)"),
        "third bearing": Setting(f"as the first, with {SLOW_VALUE}", "against table 1"),
        "control current limit": Setting(f"{ControllerParameters().current_limit:g} A"),
        "identification": Setting(
            f"PEM, order {ORDER}, on two bearings under different random-phase multisines of "
            f"{1e6 * EXCITATIONS[0].amplitude:g} µm, {EXCITATIONS[0].frequency_start:g} Hz to "
            f"{EXCITATIONS[0].frequency_end:g} Hz"
        ),
    }


def top_coil_note(top: Mapping[float, SweptBearing]) -> str:
    """Where the top coil alone leads through all regions, over amplitudes and with other assumptions."""
    orders = {f"{1e6 * amplitude:g} µm": bearing for amplitude, bearing in top.items()}
    ordered = [amplitude for amplitude, bearing in top.items() if in_order(bearing)]
    others = [
        f"{name}: {1e6 * amplitude:g} µm {sweep_bearing(amplitude, TOP_COIL | change).summary}"
        for name, change in TOP_COIL_CHANGES.items()
        for amplitude in ordered
    ]
    return (
        "With the top coil alone, as in equation (1), the values of table 1 lead through regions B, C and D in order "
        f"at {', '.join(f'{1e6 * amplitude:g}' for amplitude in ordered) or 'none of the'} µm: "
        + "; ".join(f"{name}: {bearing.summary}" for name, bearing in orders.items())
        + ". Region C there depends on what the paper does not state of Fig. 2: "
        + "; ".join(others)
        + "."
    )


def identify_bearing(bearing: SweptBearing) -> Identification:
    """A model of two copies of a bearing with 1 DOF, from data in region A."""
    copies = []
    for excitation in EXCITATIONS:
        signal = generate(excitation, bearing.controller.sample_rate)
        rest = int(np.argmax(np.isfinite(bearing.frequency)))
        record = simulate(
            Plant(bearing.plant.parameters), PdController(bearing.controller), rest + signal.steps, signal.samples, rest
        )
        copies.append(record.window(rest, signal.steps))
    reference, position, current = (
        np.column_stack([getattr(copy, name)[:, 1] for copy in copies]) for name in ("reference", "position", "current")
    )
    both = LoopRecord(copies[0].first_step, copies[0].sample_time, reference, position, current)
    return identify(both, ORDER, "pem", bearing.controller)


def model_response(identification: Identification, bearing: SweptBearing) -> LoopRecord:
    """The model in the loop without limits under the reference of the sweep, which acts on the second copy, y."""
    unlimited = bearing.controller.model_copy(update={"current_limit": NO_LIMIT})
    rest = int(np.argmax(np.isfinite(bearing.frequency)))
    return simulate_closed_loop(identification.model, unlimited, bearing.record.reference[rest:], rest)


def region_a_fit(bearing: SweptBearing, model: LoopRecord) -> tuple[float, float]:
    """Fit of the model (percent) to the response about its mean, in region A and beyond it."""
    first = model.first_step
    end = min((onset.step for onset in bearing.onsets.values()), default=bearing.record.steps)
    parts = []
    for span in (slice(first, end), slice(end, None)):
        measured = bearing.record.position[span, 1:]
        modelled = model.position[span.start - first : None if span.stop is None else span.stop - first, 1:]
        moving = len(measured) > 1
        parts.append(
            float(nrmse_fit(measured - measured.mean(), modelled - modelled.mean())[0]) if moving else float("nan")
        )
    return parts[0], parts[1]


def dominant_pole(identification: Identification, sample_rate: float) -> Pole:
    """The slowest oscillating pole pair of the model's loop, of the second copy."""
    assert identification.closed_loop_poles is not None  # the data are of the bearing's loop
    swinging = identification.closed_loop_poles[identification.closed_loop_poles.imag > 0.0]
    rates = np.log(swinging) * sample_rate / (2.0 * np.pi)
    slowest = rates[np.argmin(np.abs(rates))]
    return Pole(float(np.abs(slowest)), float(slowest.imag))


def linear_claim(fits: Mapping[str, tuple[float, float]], changed: Mapping[str, tuple[float, float]]) -> Claim:
    """Whether the models follow the bearings (by figure) in region A, and deviate beyond."""
    holds = [
        [holds for inside, beyond in some.values() for holds in (inside > 70.0, beyond < inside - 20.0)]
        for some in (fits, changed)
    ]
    return Claim(
        id="one-axis-linear-model",
        paper_figure="Fig. 2",
        statement="At low frequencies the bearing behaves as the identified linear model does, like a low-pass; as "
        "the frequency rises it deviates from it.",
        finding="; ".join(
            f"{NAMES[figure]}: the model fits the rotor's motion in region A to {inside:z.0f} %, beyond it to "
            f"{beyond:z.0f} %"
            for figure, (inside, beyond) in {**fits, **changed}.items()
        ),
        verdict=judged(*holds),
        reason="" if all(holds[0]) else "A model is worse in region A, or better beyond, than stated.",
        figure=PAPER,
    )


def order_claim(bearings: Mapping[str, SweptBearing]) -> Claim:
    """Whether A, B, C and D come in this order; bearings by figure."""
    stated = [bearings[PAPER], bearings[TOP]]
    return Claim(
        id="one-axis-regions",
        paper_figure="Fig. 2",
        statement="With rising frequency the bearing is first linear (A), then its bias drifts (B), then, abruptly, "
        "it oscillates much more slowly than its input (C).",
        finding=_summaries(bearings),
        verdict=judged([in_order(bearing) for bearing in stated], [in_order(bearings[SLOW])]),
        reason=order_reason(stated, bearings[SLOW]),
        figure=TOP,
    )


def frequency_claim(bearings: Mapping[str, SweptBearing], poles: Mapping[str, Pole]) -> Claim:
    """Whether the slow oscillations have the frequency of the dominant pole; bearings and poles by figure."""
    findings: list[str] = []
    near: dict[str, list[bool]] = {}
    for figure, bearing in bearings.items():
        states = bearing.states_in(Region.C)
        if not states:
            near[figure] = [False]
            findings.append(f"{NAMES[figure]}: no slow oscillation")
            continue
        pole = poles[figure]
        frequency = float(np.median([state.axis("y").oscillation_frequency for state in states]))
        near[figure] = [abs(frequency / other - 1.0) < NEAR for other in (pole.damped, pole.natural)]
        findings.append(
            f"{NAMES[figure]}: the slow oscillation has {frequency:.0f} Hz (median), the dominant pole of the "
            f"model's loop {pole.damped:.1f} Hz damped, {pole.natural:.1f} Hz undamped"
        )
    stated = near[PAPER] + near[TOP]
    verdict = judged(stated, near[SLOW])
    if verdict == "agrees":
        reason = ""
    elif verdict == "does not agree":
        reason = "No slow oscillation is within a quarter of either frequency, or there is none."
    elif any(stated):
        reason = (
            "With the values of table 1 a bearing does not oscillate slowly, or farther than a quarter from the damped "
            "or the undamped frequency."
        )
    else:
        reason = f"Only a bearing with {SLOW_VALUE}, against table 1, oscillates within a quarter of these frequencies."
    return Claim(
        id="slow-oscillation-frequency",
        paper_figure="Fig. 2",
        statement="The slow oscillation has about the frequency of the dominant pole of the linear closed loop.",
        finding="; ".join(findings),
        verdict=verdict,
        reason=reason,
        figure=TOP,
    )


def delevitation_claim(bearings: Mapping[str, SweptBearing]) -> Claim:
    """Whether D follows the other regions; bearings by figure."""
    last = {
        figure: Region.D in bearing.onsets
        and bearing.onsets[Region.D].step == max(onset.step for onset in bearing.onsets.values())
        for figure, bearing in bearings.items()
    }
    verdict = judged([last[PAPER], last[TOP]], [last[SLOW]])
    return Claim(
        id="one-axis-delevitation",
        paper_figure="Fig. 2",
        statement="If the frequency rises further, the bearing delevitates (D).",
        finding=_summaries(bearings),
        verdict=verdict,
        reason="" if verdict == "agrees" else "Not every bearing delevitates within the sweep.",
        figure=PAPER,
    )


def _summaries(bearings: Mapping[str, SweptBearing]) -> str:
    return "; ".join(f"{NAMES[figure]}: {bearing.summary}" for figure, bearing in bearings.items())
