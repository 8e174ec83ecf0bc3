"""Equations (1) to (4): the force law and its derivative along a trajectory, and the conclusions from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.force_law import (
    ForceTrajectory,
    electromagnet_force,
    force_trajectory,
    iron_path_length,
    trace_force,
    trace_gap,
)
from amb_core.plant.simulation.parameters import with_values
from amb_core.plant.trace import Trace
from amb_core.regions import Region, classify
from amb_core.regions.stretches import stretches
from amb_core.report.figures.force import force_chart, force_speed_chart
from amb_paper.study import Claim, DrawnFigure, Setting, Study, StudyResult, judged
from amb_paper.sweeps import REST, TOP_COIL, paper_sweep, sweep_settings

AMPLITUDE = 15e-6  # m, as in Fig. 2
WINDOWS = (100.0, 600.0, 1_690.0)  # Hz of the input in the middle of each trace: in regions A, B and C
TRACED = 200  # steps, 20 ms
TOP = 1  # coil +y
EXACT = 1e-9  # relative: rounding
DIFFERENCES = 1e-3  # relative: error of finite differences over an internal step
BARE_GAP, NEARLY_BARE_GAP = 0.02, 0.2  # relative: up to here (2) counts as exact with the air gap alone, or in part
INVERSE = (-1.5, -0.5)  # exponents that count as inverse proportionality

# Eq. (1) holds for a separate magnetic circuit without eddy currents. Averaged voltages give currents that are smooth
# enough for derivatives by differences.
VALUES = {
    **TOP_COIL,
    "magnetic_circuit.coupling": False,
    "iron.eddy_currents": False,
    "amplifier.switching": False,
}


@dataclass(frozen=True)
class Piece:
    """A piece of the sweep with every internal step: its region, its trace and the trajectory from it."""

    region: Region
    trace: Trace
    trajectory: ForceTrajectory


class ForceEquations(Study):
    """The identities on pieces of one sweep in regions A, B and C, and on arbitrary signals without a bearing."""

    name = "equations"
    heading = "Equations (1) to (4): the force law, and what it does not show"

    def run(self) -> StudyResult:
        """Simulate, evaluate the equations and the claims."""
        plant, pieces = traced_sweep()
        trajectories = {piece.region: piece.trajectory for piece in pieces}
        return StudyResult(
            [
                DrawnFigure.of("equations-force", force_chart(trajectories, "Force and eq. (4), region by region")),
                DrawnFigure.of("equations-speed", force_speed_chart(trajectories)),
            ],
            [
                force_law_claim(plant, pieces),
                gap_claim(plant, pieces),
                derivative_claim(trajectories),
                rearrangement_claim(trajectories, unrelated_signals(next(iter(trajectories.values())).constant)),
                inference_claim(trajectories),
            ],
            {
                "amplitude": Setting(f"{1e6 * AMPLITUDE:g} µm"),
                **sweep_settings(),
                "bearing": Setting("the electromagnet above the rotor alone, no cross-coupling", "stated: section 2.2"),
                "iron": Setting("of constant permeability", "stated: equation (1)"),
                "simplified": Setting("no eddy currents, average voltages"),
                "traced": Setting(
                    f"{TRACED} samples at each of {', '.join(f'{middle:g} Hz' for middle in WINDOWS)}, "
                    "every internal step"
                ),
            },
            [
                "(4) is (3) divided by the speed of the rotor and solved for the force. Its terms are not independent: "
                "at any speed the rates of force and current correspond to it, and the terms add up to the force of "
                "(2). The speed in the denominator does not mean that the force falls with it. (4) also holds in "
                "region A, where no force is lost, and for arbitrary signals without a bearing.",
            ],
        )


def traced_sweep() -> tuple[Plant, list[Piece]]:
    """The sweep up to the last window, with every internal step in the windows."""
    parameters, controller_parameters = with_values(PlantParameters(), ControllerParameters(), VALUES)
    plant, controller = Plant(parameters), PdController(controller_parameters)
    signal = paper_sweep(AMPLITUDE, controller_parameters.sample_rate)
    assert signal.frequency is not None  # a sweep has one
    rest = round(REST * controller_parameters.sample_rate)
    starts = [rest + int(np.searchsorted(signal.frequency, middle)) - TRACED // 2 for middle in WINDOWS]
    steps = starts[-1] + TRACED
    reference, position, current = np.zeros((steps, 2)), np.empty((steps, 2)), np.empty((steps, 2))
    reference[rest:] = signal.samples[: steps - rest]
    traced: dict[int, list[Trace]] = {start: [] for start in starts}
    for step in range(steps):
        position[step] = plant.position
        current[step] = controller.update(plant.position, reference[step])
        start = next((start for start in starts if start <= step < start + TRACED), None)
        if start is None:
            plant.advance(current[step])
        else:
            traced[start].append(plant.trace(current[step]))
    record = LoopRecord(0, plant.sample_time, reference, position, current)
    clearance = dict.fromkeys(record.axes, plant.parameters.rotor.backup_bearing_radius)
    parts = stretches(classify(record, clearance=clearance).states)
    pieces = []
    for start, traces in traced.items():
        middle = start + TRACED // 2
        region = next(one.region for one in parts if one.first_step <= middle < one.stop)
        trace = joined(traces)
        pieces.append(Piece(region, trace, force_trajectory(trace, plant, TOP)))
    return plant, pieces


def joined(traces: Sequence[Trace]) -> Trace:
    """One trace from consecutive ones, of a single bearing."""
    step = traces[0].time[1] - traces[0].time[0]
    arrays: dict[str, Any] = {
        item.name: np.concatenate([getattr(trace, item.name) for trace in traces])
        for item in fields(Trace)
        if item.name not in ("time", "bearing_b", "axial")
    }
    return Trace(time=step * np.arange(len(arrays["flux"])), **arrays)


def unrelated_signals(constant: float) -> ForceTrajectory:
    """Independent random signals of current and gap, and their force by eq. (2)."""
    time = np.linspace(0.0, 0.02, 40_001)
    random = np.random.default_rng(1)

    def wander() -> NDArray[np.float64]:
        """Sum of twelve tones of random frequency up to 1 kHz, between -1 and 1."""
        tones = [np.sin(2.0 * np.pi * (random.uniform(50.0, 1e3) * time + random.random())) for _ in range(12)]
        return np.mean(tones, axis=0)

    current, gap = 3.0 + 2.0 * wander(), 0.6e-3 + 0.2e-3 * wander()
    return ForceTrajectory.of(time, current, gap, constant * current**2 / gap**2, constant)


def force_law_claim(plant: Plant, pieces: Sequence[Piece]) -> Claim:
    """Eq. (1) against the force from the fluxes."""
    circuit, length = plant.parameters.magnetic_circuit, iron_path_length(plant)
    deviation = max(
        float(np.max(np.abs(
            electromagnet_force(circuit, length, one.trace.current[:, TOP], trace_gap(one.trace, plant, TOP))
            / trace_force(one.trace, plant, TOP) - 1.0
        )))
        for one in pieces
    )  # fmt: skip
    return Claim(
        id="eq-1",
        paper_figure="Eq. (1)",
        statement="The force of one electromagnet follows from its current and its gap, if electromagnets share no "
        "flux.",
        finding=f"along the trajectories the force from the fluxes deviates by {deviation:.1e} of itself at most; the "
        f"path through iron is {1e3 * length:.0f} mm long (of the cross-section of a pole)",
        verdict="agrees" if deviation < EXACT else "does not agree",
        reason="" if deviation < EXACT else "The deviation is more than rounding.",
    )


def gap_claim(plant: Plant, pieces: Sequence[Piece]) -> Claim:
    """Eq. (2) with the air gap alone."""
    excess = []
    for one in pieces:
        gap = trace_gap(one.trace, plant, TOP)
        bare = one.trajectory.constant * one.trace.current[:, TOP] ** 2 / gap**2
        excess.append(bare / trace_force(one.trace, plant, TOP) - 1.0)
    low, high = min(float(one.min()) for one in excess), max(float(one.max()) for one in excess)
    exact = max(abs(low), abs(high)) < BARE_GAP
    return Claim(
        id="eq-2",
        paper_figure="Eq. (2)",
        statement="With all constants in one factor the force is that factor times the square of current over air gap.",
        finding=f"with the air gap of the pole the force comes out {100 * low:.1f} to {100 * high:.1f} % too large; "
        "with the gap lengthened by half the iron path over its permeability it is exact",
        verdict=judged([exact], [max(abs(low), abs(high)) < NEARLY_BARE_GAP]),
        reason="" if exact else "The iron of (1) adds to the gap; it cannot be moved into the factor.",
    )


def derivative_claim(trajectories: Mapping[Region, ForceTrajectory]) -> Claim:
    """Eq. (3) against differences of the force."""
    error = {
        region: _rms(one.rate_by_law - one.force_rate) / _rms(one.force_rate) for region, one in trajectories.items()
    }
    holds = max(error.values()) < DIFFERENCES
    return Claim(
        id="eq-3",
        paper_figure="Eq. (3)",
        statement="The rate of the force follows from current, gap and their rates.",
        finding="; ".join(f"region {region.name}: {value:.1e} rms, relative" for region, value in error.items()),
        verdict="agrees" if holds else "does not agree",
        reason="" if holds else "The deviation is more than finite differences make.",
    )


def rearrangement_claim(trajectories: Mapping[Region, ForceTrajectory], unrelated: ForceTrajectory) -> Claim:
    """Eq. (4) in all regions and for signals without a bearing."""
    error = {f"region {region.name}": _deviation(one) for region, one in trajectories.items()}
    error["current and gap at random, without a bearing"] = _deviation(unrelated)
    holds = max(error.values()) < DIFFERENCES
    return Claim(
        id="eq-4",
        paper_figure="Eq. (4)",
        statement="Solved for the force, (3) expresses it by the rates of current, gap and force.",
        finding="; ".join(f"{name}: {value:.1e} rms, relative" for name, value in error.items()),
        verdict="agrees" if holds else "does not agree",
        reason="" if holds else "The deviation is more than finite differences make.",
        figure="equations-force",
    )


def inference_claim(trajectories: Mapping[Region, ForceTrajectory]) -> Claim:
    """Whether the force is inversely proportional to the speed of the gap."""
    exponents = {region: one.speed_exponent for region, one in trajectories.items()}
    inverse = [INVERSE[0] < exponent < INVERSE[1] for exponent in exponents.values()]
    return Claim(
        id="eq-4-inference",
        paper_figure="Section 2.2",
        statement="By (4) the force is inversely proportional to the speed of the rotor, so fast changes of its "
        "position cause a loss of force.",
        finding="exponent of the speed in the force that fits best: "
        + ", ".join(f"{exponent:+.2f} in region {region.name}" for region, exponent in exponents.items())
        + "; inverse proportionality would be -1",
        verdict=judged(inverse),
        reason=""
        if all(inverse)
        else "(4) only rearranges (3) and holds for any signals; the rates of force and current depend on the speed.",
        figure="equations-speed",
    )


def _deviation(one: ForceTrajectory) -> float:
    moving = one.moving
    return _rms((one.force_by_rates - one.force)[moving]) / _rms(one.force[moving])


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))
