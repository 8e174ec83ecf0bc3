"""Section 2.2: the causes of the regions, found by switching off one effect of the loop at a time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from amb_core.regions import Region
from amb_core.report.figures.sweep_comparison import sweep_comparison_chart
from amb_paper.study import LINEAR_IRON, Claim, DrawnFigure, Setting, Study, StudyResult, judged
from amb_paper.sweeps import (
    ONE_AXIS,
    SLOW_AMPLIFIER,
    SLOW_NOTE,
    SLOW_VALUE,
    SweptBearing,
    sweep_bearing,
    sweep_settings,
)

AMPLITUDE = 15e-6  # m, as in Fig. 2
ALL = "as it is"
SLEW, GRAVITY, POLARITY, STOP = (
    "no slew limit",
    "no gravity",
    "coil currents may be negative",
    "no limit in the controller",
)
AVERAGE = "average voltage, no switching"
POLARITY_ALONE, FORCE_LAW = "none of the limits but polarity", "none of the limits: the force law alone"
CENTRED = "none of the limits, no gravity"

# Why these combinations: see `SWITCHES`. A control current reference of 100 A is never reached.
_NO_DUTY_LIMIT = {"amplifier.switching": False, "amplifier.limits": False}
_NO_STOP = {"controller.current_limit": 100.0}
_NO_LIMITS = _NO_DUTY_LIMIT | _NO_STOP | {"amplifier.unipolar": False}
CASES: dict[str, dict[str, Any]] = {
    ALL: {},
    AVERAGE: {"amplifier.switching": False},
    SLEW: _NO_DUTY_LIMIT,
    POLARITY: {"amplifier.unipolar": False},
    GRAVITY: {"rotor.gravity": 0.0},
    STOP: _NO_STOP,
    POLARITY_ALONE: _NO_DUTY_LIMIT | _NO_STOP,
    FORCE_LAW: _NO_LIMITS,
    CENTRED: _NO_LIMITS | {"rotor.gravity": 0.0},
}

SWITCHES = (
    "The slew limit is the limit on the amplifiers' duty cycles. It can be removed only if their voltages are "
    "averaged, so averaging alone is shown too. This also removes the limit on coil currents. Amplifiers with limits "
    "always clip the references of coil currents at zero. The effect of polarity therefore follows from a comparison "
    "of the loops without limits, with and without it."
)


@dataclass(frozen=True)
class RotorSpeed:
    """Speed of the rotor under the sweep: sine amplitudes (m/s) and the frequency of the input (Hz)."""

    fastest: float
    fastest_at: float
    at_onset: float


class Causes(Study):
    """The sweep through a bearing with 1 DOF, and through the same without one effect."""

    values: ClassVar[Mapping[str, Any]]
    title: ClassVar[str]
    bearing: ClassVar[str]
    notes: ClassVar[tuple[str, ...]]
    against = LINEAR_IRON

    def run(self) -> StudyResult:
        """Simulate all cases, draw, evaluate."""
        runs = {name: sweep_bearing(AMPLITUDE, {**ONE_AXIS, **self.values, **case}) for name, case in CASES.items()}
        chart = sweep_comparison_chart([run.case(name) for name, run in runs.items()], title=self.title)
        claims = [cause_claim(self.name, runs), speed_claim(self.name, rotor_speed(runs[ALL]), runs[ALL])]
        return self.result(
            [DrawnFigure.of(self.name, chart)],
            [replace(claim, statement=f"{claim.statement} Here {self.bearing}.") for claim in claims],
            {
                "amplitude": Setting(f"{1e6 * AMPLITUDE:g} µm"),
                **sweep_settings(),
                "bearing": Setting("one axis, electromagnets above and below", "stated: footnote 5"),
                "supply": Setting(self.bearing, "stated: table 1"),
            },
            [*self.notes, SWITCHES, effects_note(runs)],
        )


class PaperCauses(Causes):
    """With the amplifiers of table 1."""

    name = "causes"
    heading = "Section 2.2: the cause, one effect switched off at a time"
    values: ClassVar[Mapping[str, Any]] = {}
    bearing = "with the supply of table 1"
    title = "Supply of table 1: the sweep without one effect at a time"
    notes = (
        "An identity such as (4) does not show a cause. An experiment does: the same sweep through the same bearing, "
        "without one of the effects that could be the cause.",
    )


class SlowAmplifierCauses(Causes):
    """With the slow amplifiers, whose bearing goes through all regions."""

    name = "causes-slow-amplifier"
    heading = "Section 2.2: the cause with a slow amplifier, one effect switched off at a time"
    values: ClassVar[Mapping[str, Any]] = SLOW_AMPLIFIER
    bearing = "with the slow amplifier"
    title = "Slow amplifier: the sweep without one effect at a time"
    notes = (SLOW_NOTE,)
    against: ClassVar[Mapping[str, Setting]] = {"supply": Setting(SLOW_VALUE, "against table 1"), **LINEAR_IRON}


def cause_claim(figure: str, runs: Mapping[str, SweptBearing]) -> Claim:
    """Which regions remain without all limits of amplifiers and controller, with the force law alone."""
    remain = [region for region in runs[ALL].onsets if region in runs[FORCE_LAW].onsets]
    gone = [region for region in runs[ALL].onsets if region not in remain]
    reasons = []
    if gone:
        reasons.append(
            f"With the force law alone there is no {' and no '.join(region.name for region in gone)}: "
            "that comes from currents that cannot follow their references."
        )
    if gone and Region.B in remain and Region.B not in runs[CENTRED].onsets:
        reasons.append(
            "The drift remains where the weight holds the rotor off the centre: alternating currents add to the "
            "negative stiffness, since the force goes with their square."
        )
    if gone and remain and not runs[CENTRED].onsets:
        reasons.append("Without gravity too, all is linear up to the end of the sweep.")
    return Claim(
        id=f"{figure}-force-law",
        paper_figure="Section 2.2",
        statement="The root cause of the nonlinear behaviour lies in the force law.",
        finding=f"as it is: {runs[ALL].summary}; with force law and gravity, but without limits on slew rate, polarity "
        f"and controller output: {runs[FORCE_LAW].summary}; without gravity too: {runs[CENTRED].summary}",
        verdict=judged([region in remain for region in runs[ALL].onsets]),
        reason=" ".join(reasons),
        figure=figure,
    )


def speed_claim(figure: str, speed: RotorSpeed | None, run: SweptBearing) -> Claim:
    """Whether the rotor moves faster where the regions begin than before."""
    faster = speed is not None and speed.at_onset >= speed.fastest
    finding = (
        f"no region begins ({run.summary})"
        if speed is None
        else f"the rotor moves fastest, at {1e3 * speed.fastest:.2g} mm/s, in region A at {speed.fastest_at:.0f} Hz; "
        f"where region A ends it moves at {1e3 * speed.at_onset:.2g} mm/s"
    )
    return Claim(
        id=f"{figure}-rotor-speed",
        paper_figure="Section 2.2",
        statement="Sudden and large changes of the rotor's position cause the loss of force.",
        finding=finding,
        verdict=judged([faster]),
        reason=""
        if faster
        else "Above the loop's bandwidth the rotor hardly moves; it is the current that has to change ever faster.",
        figure=figure,
    )


def rotor_speed(run: SweptBearing) -> RotorSpeed | None:
    """Speed of the rotor in region A and where it ends; None if it does not end.

    From the amplitude of the response at the frequency of the input, which the classifier reports.
    """
    if not run.onsets:
        return None
    end = min(onset.step for onset in run.onsets.values())
    linear = [
        state for state in run.classification.states if state.step <= end and state.axis("y").input_amplitude > 0.0
    ]
    frequency = np.array([state.axis("y").input_frequency for state in linear])
    speed = 2.0 * np.pi * frequency * np.array([state.axis("y").response_amplitude for state in linear])
    fastest = int(np.argmax(speed))
    return RotorSpeed(float(speed[fastest]), float(frequency[fastest]), float(speed[-1]))


def effects_note(runs: Mapping[str, SweptBearing]) -> str:
    """Effect of each switch on each region, in words."""
    parts = []
    for name, run in runs.items():
        if name == ALL:
            continue
        if np.array_equal(run.record.position, runs[ALL].record.position):
            parts.append(f"{name}: the same samples, bit for bit")
            continue
        changes = [change(region, runs[ALL], run) for region in (Region.B, Region.C, Region.D)]
        parts.append(f"{name}: {', '.join(filter(None, changes))}")
    return f"As it is: {runs[ALL].summary}. " + "; ".join(parts) + "."


def change(region: Region, before: SweptBearing, after: SweptBearing) -> str:
    """Change of a region, such as `C gone`; empty if it is in neither."""
    old, new = before.onsets.get(region), after.onsets.get(region)
    if new is None:
        return f"{region.name} gone" if old is not None else ""
    text = f"{region.name} from {new.input_frequency:.0f} Hz"
    return text if old is not None else f"{text}, new"
