"""Section 3.3: ARX models against the state-space model, both identified from the square waves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from amb_core.ground.units import UM
from amb_core.identification import StateSpaceModel, identify, simulate_closed_loop
from amb_core.identification.closed_loop import DivergenceError
from amb_core.identification.estimate.arx import arx
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.parameters import SensorParameters
from amb_core.plant.simulation import simulate
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Item, Panel, Points, Table
from amb_core.report.figures.style import BLUE, GREEN, ORANGE, PURPLE, REFERENCE, VERMILION, Marker, Stroke
from amb_core.report.figures.thinning import extremes
from amb_paper.graph_experiment import SETTLING
from amb_paper.square_waves import EXPERIMENT, ORDER
from amb_paper.study import LINEAR_IRON, Claim, DrawnFigure, Setting, Study, StudyResult

NOISES = (0.0, 0.1e-6, 1e-6)  # m, standard deviation of the sensors' noise; none in the paper's simulation
LAGS = (2, 3, 5, 8, 10, 15, 20, 30)
SAME_ORDER = ORDER // 2  # lags with which ARX has as many states as the state-space model
LARGE = 3.0  # times the error of the state-space model, above which a transient counts as large
SHOWN = 0.06  # s, after an edge


@dataclass(frozen=True)
class Transient:
    """Response of a model to the square waves without noise.

    Attributes
    ----------
    noise : float
        Standard deviation of the sensors' noise in its data (m).
    lags : int
        Lags of ARX; 0 for the state-space model.
    states : int
        Number of states.
    error : float
        Largest distance between the model's and the plant's position (m); infinite if its loop diverges.
    """

    noise: float
    lags: int
    states: int
    error: float


class ArxTransients(Study):
    """ARX and PEM on the same data, with and without noise; their simulated closed loops compared with the plant's."""

    name = "arx"
    heading = "Section 3.3: ARX models and their transients"
    against = LINEAR_IRON

    def run(self) -> StudyResult:
        """Simulate, identify, compare."""
        controller = ControllerParameters()
        records = {noise: _record(noise, controller) for noise in NOISES}
        truth = records[0.0]  # what the models should give: the response without noise
        transients: list[Transient] = []
        shown: dict[str, LoopRecord] = {}
        for noise, record in records.items():
            model = identify(record, ORDER, "pem", controller).model
            transient, response = _follow(model, truth, controller, noise, 0)
            transients.append(transient)
            shown["state space"] = response or truth
            for lags in LAGS:
                candidate = arx(record.current, record.position, record.sample_time, lags)
                transient, simulated = _follow(candidate, truth, controller, noise, lags)
                transients.append(transient)
                if lags == SAME_ORDER and simulated is not None:
                    shown["ARX"] = simulated
        return self.result(
            [
                DrawnFigure.of("arx-transient", _response_chart(truth, shown)),
                DrawnFigure.of("arx-error", _error_chart(transients)),
            ],
            claims(transients),
            {
                "data": Setting(f"the square waves of Fig. 13, {truth.steps:,} samples"),
                "noise of the sensors": Setting(", ".join(f"{UM * noise:g} µm" for noise in NOISES)),
                "ARX": Setting(f"least squares, {LAGS[0]} to {LAGS[-1]} lags of both positions and both currents"),
                "state space": Setting(f"PEM, order {ORDER}", "assumed, as stated for Fig. 13"),
            },
            [
                "ARX fits the next sample by least squares, and noise of the sensors enters its regressors. At a high "
                "sample rate the position hardly changes from sample to sample, so little noise is enough to bias a "
                "short ARX model. Errors are deviations from the response of the plant without noise.",
            ],
        )


def claims(transients: Sequence[Transient]) -> list[Claim]:
    """Evaluation of the paper's statements on ARX."""
    ratios, findings = {}, []
    for noise in NOISES:
        same = next(one for one in transients if (one.noise, one.lags) == (noise, SAME_ORDER))
        pem = next(one for one in transients if (one.noise, one.lags) == (noise, 0))
        ratios[noise] = same.error / pem.error
        best = min((one for one in transients if one.noise == noise and one.lags), key=lambda one: one.error)
        findings.append(
            f"noise {UM * noise:g} µm: ARX of {same.states} states is off by up to {_um(same.error)}, the best ARX "
            f"({best.lags} lags, {best.states} states) by {_um(best.error)}, PEM of {pem.states} by {_um(pem.error)}"
        )
    large = [noise for noise, ratio in ratios.items() if ratio >= LARGE]
    everywhere = len(large) == len(ratios)
    return [
        Claim(
            id="arx-transients",
            paper_figure="Section 3.3",
            statement="ARX models of a fast sampled plant may be biased at high frequencies, which shows as very large "
            "transients; state-space models with prediction focus do not have them.",
            finding="; ".join(findings),
            verdict="agrees" if everywhere else "agrees in part" if large else "does not agree",
            reason=""
            if everywhere
            else "Only with "
            + " and ".join(f"{UM * noise:g} µm" for noise in large)
            + f" of noise are the transients of ARX more than {LARGE:g} times as large."
            if large
            else f"At no noise are the transients of ARX more than {LARGE:g} times as large.",
            figure="arx-transient",
        )
    ]


def _record(noise: float, controller: ControllerParameters) -> LoopRecord:
    signal = EXPERIMENT.signal
    plant = Plant(PlantParameters(sensor=SensorParameters(noise=noise)))
    record = simulate(plant, PdController(controller), SETTLING + signal.steps, signal.samples, SETTLING)
    return record.window(SETTLING, signal.steps)


def _follow(
    model: StateSpaceModel, truth: LoopRecord, controller: ControllerParameters, noise: float, lags: int
) -> tuple[Transient, LoopRecord | None]:
    try:
        simulated = simulate_closed_loop(model, controller, truth.reference, truth.first_step, truth.current[0])
    except DivergenceError:
        return Transient(noise, lags, model.order, float("inf")), None
    # The first transient belongs to the unknown state at the first sample, not to the model.
    later = slice(SETTLING, None)
    error = float(np.hypot(*(simulated.position - truth.position)[later].T).max())
    return Transient(noise, lags, model.order, error), simulated


def _response_chart(truth: LoopRecord, shown: dict[str, LoopRecord]) -> Chart:
    """One edge on each axis: plant, ARX and state space of the noisiest data."""
    looks = {"state space": Stroke(VERMILION, "dash"), "ARX": Stroke(PURPLE, "dashdot")}
    panels = []
    for axis, name in enumerate("xy"):
        jumps = np.flatnonzero(np.abs(np.diff(truth.reference[:, axis])) > 0.0) + 1
        start = int(jumps[len(jumps) // 2]) - round(0.1 * SHOWN / truth.sample_time)
        part = slice(start, start + round(SHOWN / truth.sample_time))
        time = 1e3 * (truth.time[part] - truth.time[start])
        curves = [
            Curve(*extremes(time, UM * truth.reference[part, axis]), "reference", REFERENCE),
            Curve(*extremes(time, UM * truth.position[part, axis]), "plant, without noise", Stroke(BLUE, width=1.8)),
        ]
        curves += [
            Curve(*extremes(time, UM * record.position[part, axis]), label, looks[label])
            for label, record in shown.items()
        ]
        panels.append(Panel(Axis("time (ms)"), Axis(f"{name} (µm)"), tuple(curves)))
    noise = UM * NOISES[-1]
    title = f"An edge on x and on y: models of {ORDER} states from data with {noise:g} µm of noise"
    alt = f"After an edge of the reference: plant, and closed loops of {' and '.join(shown)} of {ORDER} states."
    return Chart(title, alt, tuple(panels), columns=2, size=(11.0, 4.6))


def _error_chart(transients: Sequence[Transient]) -> Chart:
    looks: tuple[tuple[str, Marker], ...] = ((BLUE, "circle"), (ORANGE, "square"), (GREEN, "diamond"))
    items: list[Item] = []
    for noise, (colour, marker) in zip(NOISES, looks, strict=True):
        mine = [one for one in transients if one.noise == noise]
        label = f"noise {UM * noise:g} µm"
        finite = [one for one in mine if one.lags and np.isfinite(one.error)]
        x, y = np.array([one.states for one in finite]), np.array([UM * one.error for one in finite])
        items.append(Curve(x, y, f"ARX, {label}", Stroke(colour)))
        items.append(Points(x, y, "", colour, marker))
        pem = next(one for one in mine if not one.lags)
        point = np.array([pem.states]), np.array([UM * pem.error])
        items.append(Points(*point, f"PEM, {label}", colour, marker, filled=False))
    finite_errors = [UM * one.error for one in transients if np.isfinite(one.error)]
    limits = (0.8 * min(finite_errors), 1.25 * max(finite_errors))
    panel = Panel(Axis("number of states"), Axis("largest error (µm)", log=True, limits=limits), tuple(items))
    rows = tuple(
        (
            f"{UM * one.noise:g}",
            f"ARX, {one.lags} lags" if one.lags else "PEM",
            str(one.states),
            f"{UM * one.error:.2f}" if np.isfinite(one.error) else "diverges",
        )
        for one in transients
    )
    worst = max(one.error for one in transients)
    alt = f"Largest error of the closed loop over the number of states; the largest of all is {_um(worst)}."
    table = Table(("noise (µm)", "model", "states", "largest error (µm)"), rows)
    return Chart("Largest error of the models in closed loop", alt, (panel,), size=(8.0, 5.2), table=table)


def _um(value: float) -> str:
    return f"{UM * value:.1f} µm" if np.isfinite(value) else "infinitely much"
