"""What excitations did to the bearing in simulation: position and its mean, from rest on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.units import UM
from amb_core.loop.records import LoopRecord
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Panel, Table
from amb_core.report.figures.style import MEAN, PLANT, region_label
from amb_core.report.figures.thinning import extremes

if TYPE_CHECKING:
    from amb_core.designs.excitation import Trial

MEAN_TIME = 0.2  # s, whole periods of slow square waves
SETTLED = 0.5  # s after the release of the rotor, whose fall into place would be the largest motion in the figure


def trial_chart(trials: Mapping[str, Trial], axis: str = "y", title: str = "Excitations tried in simulation") -> Chart:
    """Position over time with its running mean, a panel for each trial, all on one scale.

    Parameters
    ----------
    trials : mapping of str to Trial
        From `amb_core.designs.excitation.TrialBench`, by name.
    axis : {"x", "y"}, optional
        Axis to show.
    title : str, optional
        Title of the figure.

    Returns
    -------
    Chart
        The chart, ready to save.
    """
    shown = {name: _settled(trial) for name, trial in trials.items()}
    position = np.concatenate([UM * record.position[:, "xy".index(axis)] for record in shown.values()])
    margin = 0.05 * float(np.ptp(position)) + 1.0
    vertical = Axis(f"{axis} (µm)", limits=(float(position.min()) - margin, float(position.max()) + margin))
    panels = tuple(
        Panel(
            Axis("time (s)"),
            vertical,
            _curves(record, "xy".index(axis)),
            f"{name}: region {region_label(trials[name].region)}",
        )
        for name, record in shown.items()
    )
    rows = tuple(
        (name, region_label(trial.region), f"{UM * trial.bias_shift['xy'.index(axis)]:.1f}")
        for name, trial in trials.items()
    )
    alt = f"Position on {axis} over time. " + " ".join(
        f"{name}: region {region_label(trial.region)}." for name, trial in trials.items()
    )
    size = (8.0, 1.6 + 2.2 * len(panels))
    return Chart(
        title, alt, panels, shared_x=True, size=size, table=Table(("trial", "region", "shift of the bias (µm)"), rows)
    )


def _settled(trial: Trial) -> LoopRecord:
    """The trial after the fall into place; half of a trial that is not longer than that."""
    record = trial.record
    first = min(round(SETTLED / record.sample_time), record.steps // 2)
    return record.window(record.first_step + first, record.steps - first)


def _curves(record: LoopRecord, axis: int) -> tuple[Curve, ...]:
    time, position = record.time, UM * record.position[:, axis]
    curves = [Curve(*extremes(time, position), "position", PLANT)]
    window = round(MEAN_TIME / record.sample_time)
    if len(time) > 2 * window:
        mean = _running_mean(position, window)
        middle = time[window // 2 : window // 2 + len(mean)]
        curves.append(Curve(*extremes(middle, mean, spans=300), f"its mean over {MEAN_TIME:g} s", MEAN))
    return tuple(curves)


def _running_mean(values: NDArray[np.float64], window: int) -> NDArray[np.float64]:
    total = np.concatenate([[0.0], np.cumsum(values)])
    mean: NDArray[np.float64] = (total[window:] - total[:-window]) / window
    return mean
