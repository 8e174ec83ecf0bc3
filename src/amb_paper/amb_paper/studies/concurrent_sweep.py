"""Fig. 15: a sweep on both axes at once, compared with the model from square waves."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from amb_core.excitation import Sweep
from amb_core.ground.units import UM
from amb_core.identification import simulate_closed_loop
from amb_core.identification.focus.sweep_error import SweepError, sweep_error
from amb_core.plant import PlantParameters
from amb_core.regions import Classification, Region, classify
from amb_core.report.figures.sweep import onset_text, sweep_chart
from amb_core.report.figures.sweep_error import sweep_error_chart
from amb_paper import square_waves
from amb_paper.graph_experiment import SETTLING, GraphExperiment, equality_claim
from amb_paper.square_waves import model_from_squares
from amb_paper.study import LINEAR_IRON, Claim, DrawnFigure, Setting, Study, StudyResult, Workplace, judged

SWEEP = Sweep(amplitude=50e-6, frequency_start=11.0, frequency_end=400.0, duration=5.0, axes="both")
EXPERIMENT = GraphExperiment("fig15-sweep", SWEEP)
GOOD = 0.1  # relative error of a model that represents the bearing
USELESS = 0.5  # relative error of a model that no longer does


class ConcurrentSweep(Study):
    """The sweep through the ROS graph, and the model of Fig. 13 under the same reference."""

    name = "fig15"
    heading = "Fig. 15: a sweep on both axes at once, plant and model"
    against = LINEAR_IRON
    parallel = False

    def run(self) -> StudyResult:
        """Run in the usual workplace."""
        return self.run_at(Workplace())

    def run_at(self, workplace: Workplace) -> StudyResult:
        """Record, classify, simulate the model, compare."""
        without = EXPERIMENT.without_ros()
        through = EXPERIMENT.through_ros(workplace.folder / "bags", without)
        model = model_from_squares(square_waves.EXPERIMENT.without_ros()).model
        measured = without.excited
        simulated = simulate_closed_loop(
            model, EXPERIMENT.controller, measured.reference, measured.first_step, measured.current[0]
        )
        signal = EXPERIMENT.signal
        assert signal.frequency is not None
        frequency = signal.frequency[: measured.steps]
        known = np.concatenate([np.full(SETTLING, np.nan), frequency])
        clearance = dict.fromkeys(without.record.axes, PlantParameters().rotor.backup_bearing_radius)
        classification = classify(without.record, clearance=clearance, delevitated=without.delevitated, frequency=known)
        errors = sweep_error(measured, simulated, frequency)
        title = "Sweep on both axes: plant and model from square waves"
        chart = sweep_chart(without.record, classification, known, over="frequency", model=simulated, title=title)
        return self.result(
            [DrawnFigure.of("fig15", chart), DrawnFigure.of("fig15-error", sweep_error_chart(errors))],
            claims(errors, classification, float(frequency[-1]), without.delevitated),
            {
                "excitation": Setting(
                    f"sine of {UM * SWEEP.amplitude:g} µm on x and y at once, swept from {SWEEP.frequency_start:g} Hz "
                    f"to {SWEEP.frequency_end:g} Hz",
                    "stated: section 4",
                ),
                "spacing and duration": Setting(f"{SWEEP.spacing}, {SWEEP.duration:g} s"),
                "control current limit": Setting(f"{EXPERIMENT.controller.current_limit:g} A"),
                "model": Setting(f"that of Fig. 13, order {model.order}, with its means", "stated: section 4"),
                "samples": Setting(
                    f"{measured.steps:,} of {signal.steps:,} at {1.0 / measured.sample_time:g} Hz", "result"
                ),
                "bag": Setting(str(Path("bags") / EXPERIMENT.name), "result"),
            },
            [
                "Model and plant have the same controller, with the same limit of the control current. Where the sweep "
                "reaches that limit, the model drifts too, but less than the plant.",
            ],
            ours=[equality_claim("concurrent-sweep", "Fig. 15", without, through)],
        )

    def files_are_whole(self, folder: Path) -> bool:
        """Whether the bag exists."""
        return EXPERIMENT.is_kept(folder / "bags")


def claims(errors: SweepError, classification: Classification, last: float, delevitated: bool) -> list[Claim]:
    """Evaluation of the paper's statements on Fig. 15; the plant's response ends at the frequency `last` (Hz)."""
    good_at_first = [bool(good) for good in errors.relative[0] < GOOD]
    departs = [bool(useless) for useless in errors.relative[-1] > USELESS]
    follows = [_until(errors, axis, GOOD) for axis in range(2)]
    return [
        Claim(
            id="sweep-low-frequency",
            paper_figure="Fig. 15",
            statement="The model from square waves represents the bearing at low frequencies.",
            finding=f"error relative to the movement, {errors.edges[0]:.0f} Hz to {errors.edges[1]:.0f} Hz: "
            f"x {100 * errors.relative[0, 0]:.1f} %, y {100 * errors.relative[0, 1]:.1f} %; "
            f"below {100 * GOOD:g} % up to {follows[0]:.0f} Hz on x and {follows[1]:.0f} Hz on y",
            verdict=judged(good_at_first),
            reason="" if all(good_at_first) else f"The error is {100 * GOOD:g} % or more from the start.",
            figure="fig15-error",
        ),
        Claim(
            id="sweep-departure",
            paper_figure="Fig. 15",
            statement="Above, the bearing becomes increasingly nonlinear, and the model does not follow it.",
            finding=f"error relative to the movement, {errors.edges[-2]:.0f} Hz to {errors.edges[-1]:.0f} Hz: "
            f"x {100 * errors.relative[-1, 0]:.0f} %, y {100 * errors.relative[-1, 1]:.0f} %; the bias that the model "
            f"misses there: x {UM * errors.mean[-1, 0]:.1f} µm, y {UM * errors.mean[-1, 1]:.1f} µm",
            verdict=judged(departs),
            reason="" if all(departs) else f"The error stays below {100 * USELESS:g} % on at least one axis.",
            figure="fig15-error",
        ),
        _regions_claim(classification, last, delevitated),
    ]


def _regions_claim(classification: Classification, last: float, delevitated: bool) -> Claim:
    onsets = "; ".join(f"{region.name} from {onset_text(onset)}" for region, onset in classification.onsets.items())
    missing = [region.name for region in (Region.B, Region.C) if region not in classification.onsets]
    ends = f"The rotor delevitates at {last:.0f} Hz. " if delevitated else ""
    return Claim(
        id="sweep-regions",
        paper_figure="Fig. 15",
        statement="In this sweep the bearing reaches regions B and C up to 400 Hz, which the model cannot show.",
        finding=onsets or "region A throughout",
        verdict="agrees" if not missing else "agrees in part" if classification.onsets else "does not agree",
        reason=""
        if not missing
        else f"{ends}It shows no {' and no '.join(missing)}. Where the bearing falls depends on the limit of "
        "the control current, which the paper does not state, nor the data of its iron.",
        figure="fig15",
    )


def _until(errors: SweepError, axis: int, limit: float) -> float:
    """Frequency up to which the relative error of an axis stays below a limit in all bands (Hz)."""
    beyond = np.flatnonzero(errors.relative[:, axis] >= limit)
    return float(errors.edges[beyond[0] if beyond.size else -1])
