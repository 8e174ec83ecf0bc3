"""Fig. 13 and 14: the model from square waves in closed loop, as orbit and over time, before and after adding means."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.units import UM
from amb_core.identification import Identification, StateSpaceModel, nrmse_fit, simulate_closed_loop
from amb_core.loop.records import LoopRecord
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Curve
from amb_core.report.figures.loop import orbit_chart, response_chart
from amb_core.report.figures.thinning import extremes, thinned_path
from amb_core.report.pages import Answer
from amb_paper.graph_experiment import SETTLING, equality_claim
from amb_paper.square_waves import EXPERIMENT, model_from_squares
from amb_paper.study import LINEAR_IRON, Claim, DrawnFigure, Setting, Study, StudyResult, Workplace

REPLICATES = 90.0  # percent; fit of both axes above which the model counts as replicating the response
ORBIT, RESPONSE = "Orbit of plant and model", "Response of plant and model to square waves"
HIDDEN, SPANS = 0.5, 500  # um and spans of time, coarse enough for two panels side by side
VISIBLE_OFFSET = 0.1e-6  # m; a smaller one is none
SMALL_OFFSET = 0.1  # share of the original offset that may remain after adding the means


@dataclass(frozen=True)
class Means:
    """The closed loop of a model without and with the means of the data, compared with the plant.

    Attributes
    ----------
    without, added : LoopRecord
        Simulated under the reference of the experiment.
    fit_without, fit_added : ndarray, shape (2,)
        Their NRMSE fits of x and y (percent).
    offset_without, offset_added : ndarray, shape (2,)
        Mean of the plant's position less theirs (m).
    """

    without: LoopRecord
    added: LoopRecord
    fit_without: NDArray[np.float64]
    fit_added: NDArray[np.float64]
    offset_without: NDArray[np.float64]
    offset_added: NDArray[np.float64]

    @classmethod
    def of(cls, model: StateSpaceModel, measured: LoopRecord) -> Means:
        """Simulate a model both ways."""
        detrended = replace(model, input_offset=np.zeros(2), output_offset=np.zeros(2))
        runs = [
            simulate_closed_loop(
                one, EXPERIMENT.controller, measured.reference, measured.first_step, measured.current[0]
            )
            for one in (detrended, model)
        ]
        fits = [nrmse_fit(measured.position, run.position) for run in runs]
        offsets = [(measured.position - run.position).mean(axis=0) for run in runs]
        return cls(runs[0], runs[1], fits[0], fits[1], offsets[0], offsets[1])

    def dynamics(self, measured: LoopRecord) -> NDArray[np.float64]:
        """Fit of the simulation without means after removal of its constant error (percent), shape (2,)."""
        return nrmse_fit(measured.position, self.without.position + self.offset_without)


class SquareWaves(Study):
    """Square waves through the ROS graph; the model from them, validated in closed loop."""

    name = "fig13"
    heading = "Fig. 13 and 14: square waves, and the model identified from them"
    against = LINEAR_IRON
    parallel = False

    def run(self) -> StudyResult:
        """Run in the usual workplace."""
        return self.run_at(Workplace())

    def run_at(self, workplace: Workplace) -> StudyResult:
        """Record, identify, simulate, draw."""
        without = EXPERIMENT.without_ros()
        through = EXPERIMENT.through_ros(workplace.folder / "bags", without)
        identification = model_from_squares(without)
        measured = without.excited
        means = Means.of(identification.model, measured)
        excitation = EXPERIMENT.signal.parameters.model_dump()
        return self.result(
            [
                DrawnFigure.of("fig13", _side_by_side(ORBIT, orbit_chart, _thinner_orbit, measured, means)),
                DrawnFigure.of("fig14", _side_by_side(RESPONSE, response_chart, _thinner_response, measured, means)),
            ],
            claims(identification, means, means.dynamics(measured)),
            {
                "amplitude of the squares": Setting(f"{UM * excitation['amplitude']:g} µm", "stated: section 4"),
                "squares": Setting(
                    f"{excitation['frequency']:g} Hz, {excitation['duration'] / 2:g} s on x, then the same on y"
                ),
                "before": Setting(f"{SETTLING * measured.sample_time:g} s at rest"),
                "sample rate": Setting(f"{1.0 / measured.sample_time:g} Hz", "stated: section 3.2"),
                "order of the model": Setting(f"{identification.model.order}", "stated: section 4"),
                "method": Setting("subspace, then PEM with prediction focus", "stated: sections 3.3 and 3.4"),
                "subspace method": Setting("SSARX"),
                "samples": Setting(f"{measured.steps:,}", "result"),
                "poles": Setting(_poles(identification), "result"),
                "bag": Setting(str(Path("bags") / EXPERIMENT.name), "result"),
            },
            [
                "The model is identified from data without their means, as is usual. In closed loop it then moves "
                "about the centre, while the rotor hangs below it. Adding the means of currents and positions to the "
                "model corrects this.",
                identification.summary + ".",
            ],
            ours=[equality_claim("square-waves", "Fig. 13, 14", without, through)],
        )

    def files_are_whole(self, folder: Path) -> bool:
        """Whether the bag exists."""
        return EXPERIMENT.is_kept(folder / "bags")


def claims(identification: Identification, means: Means, dynamics: NDArray[np.float64]) -> list[Claim]:
    """Evaluation of the paper's statements on Fig. 13 and 14; `dynamics` is the fit without the offset (percent)."""
    return [_dynamics_claim(dynamics), *_offset_claims(means), _unstable_plant_claim(identification)]


def _dynamics_claim(dynamics: NDArray[np.float64]) -> Claim:
    good = dynamics >= REPLICATES
    return Claim(
        id="square-waves-dynamics",
        paper_figure="Fig. 13, 14",
        statement="A state-space model of tenth order from square waves replicates the pattern of the orbit and "
        "the dynamic response, in closed loop with the known controller.",
        finding=f"fit apart from the offset: x {dynamics[0]:.2f} %, y {dynamics[1]:.2f} %",
        verdict=_answer(bool(good.all()), bool(good.any())),
        reason="" if good.all() else f"A fit below {REPLICATES:g} % is not a replication.",
        figure="fig14",
    )


def _offset_claims(means: Means) -> list[Claim]:
    before, after = np.abs(means.offset_without), np.abs(means.offset_added)
    visible = before[1] > VISIBLE_OFFSET
    missed = visible and before[1] > before[0] and means.fit_without[1] < means.fit_added[1]
    mended = bool(visible and after[1] <= SMALL_OFFSET * before[1])
    return [
        Claim(
            id="square-waves-offset",
            paper_figure="Fig. 13",
            statement="The model cannot give the offset in the vertical direction, since it was fitted to detrended "
            "data.",
            finding=f"offset of the plant from the model: x {_um(means.offset_without[0])}, "
            f"y {_um(means.offset_without[1])}; fit x {means.fit_without[0]:.2f} %, y {means.fit_without[1]:.2f} %",
            verdict=_answer(bool(missed)),
            reason=""
            if missed
            else "The model has the offset even without the means."
            if visible
            else "The plant has no offset from it.",
            figure="fig13",
        ),
        Claim(
            id="square-waves-means",
            paper_figure="Fig. 13, 15",
            statement="Adding the mean values of the response to the model corrects this error.",
            finding=f"offset left: x {_um(means.offset_added[0])}, y {_um(means.offset_added[1])}; "
            f"fit x {means.fit_added[0]:.2f} %, y {means.fit_added[1]:.2f} %",
            verdict=_answer(mended, bool(visible and after[1] < before[1])),
            reason=""
            if mended
            else f"More than {100 * SMALL_OFFSET:g} % of the offset is left."
            if visible
            else "There is no offset to correct.",
            figure="fig13",
        ),
    ]


def _unstable_plant_claim(identification: Identification) -> Claim:
    unstable, largest = len(identification.model.unstable_poles()), _largest(identification)
    return Claim(
        id="unstable-plant",
        paper_figure="Section 3.3",
        statement="With prediction focus and the right order, state-space models of the unstable plant can be "
        "identified directly from data of the closed loop.",
        finding=f"{unstable} unstable plant poles; the largest pole of model and controller has magnitude "
        f"{largest:.4f}",
        verdict=_answer(unstable > 0 and identification.stable, unstable > 0),
        reason="" if unstable and identification.stable else "The plant has no unstable pole, or its loop is unstable.",
        figure="fig14",
    )


def _answer(all_of_it: bool, part: bool = False) -> Answer:
    return "agrees" if all_of_it else "agrees in part" if part else "does not agree"


def _side_by_side(
    title: str,
    chart_of: Callable[[LoopRecord, LoopRecord], Chart],
    thinner: Callable[[Curve], Curve],
    measured: LoopRecord,
    means: Means,
) -> Chart:
    """One chart for the model without the means, left, and with them, right."""
    left, right = chart_of(measured, means.without), chart_of(measured, means.added)
    panels = []
    for row in zip(left.panels, right.panels, strict=True):
        for what, fit, panel in zip(("without", "with"), (means.fit_without, means.fit_added), row, strict=True):
            curves = [thinner(item) for item in panel.items if isinstance(item, Curve)]
            curves[-1] = replace(curves[-1], label="model")
            heading = panel.title or f"fit x {fit[0]:.1f} %, y {fit[1]:.1f} %"
            panels.append(replace(panel, items=tuple(curves), title=f"{what} the means; {heading}"))
    alt = f"{left.alt} That is without the means of the data. With them: {right.alt}"
    return Chart(title, alt, tuple(panels), columns=2, shared_x=left.shared_x, size=(12.0, left.size[1]))


def _thinner_orbit(curve: Curve) -> Curve:
    path = thinned_path(np.column_stack([curve.x, curve.y]), HIDDEN)
    return replace(curve, x=path[:, 0], y=path[:, 1])


def _thinner_response(curve: Curve) -> Curve:
    x, y = extremes(curve.x, curve.y, SPANS)
    return replace(curve, x=x, y=y)


def _largest(identification: Identification) -> float:
    poles = identification.closed_loop_poles
    return float("inf") if poles is None else float(np.abs(poles).max())


def _poles(identification: Identification) -> str:
    rate = (
        np.log(identification.model.unstable_poles().astype(complex)) / identification.model.sample_time / (2.0 * np.pi)
    )
    return f"unstable ones of the plant at {', '.join(f'{value.real:.2f} Hz' for value in rate)} (s / 2 pi)"


def _um(value: float) -> str:
    return f"{UM * value:z.2f} µm"
