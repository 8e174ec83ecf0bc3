"""What excitations did to the bearing in simulation: position and its mean, from rest on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from amb_core.figures.chart import Axis, Chart, Curve, Item, Panel, Table
from amb_core.figures.renderers import renderers
from amb_core.figures.style import MEAN, PLANT, UM, region_label
from amb_core.figures.thinning import extremes

if TYPE_CHECKING:
    from amb_core.excitation_design import Trial

MEAN_TIME = 0.2  # s, whole periods of slow square waves
SETTLED = 0.5  # s after the release of the rotor, whose fall into place would be the largest motion in the figure


def trial_chart(trials: Mapping[str, Trial], axis: str = "y", title: str = "Excitations tried in simulation") -> Chart:
    """Position over time with its running mean, a panel for each trial.

    Parameters
    ----------
    trials : mapping of str to Trial
        From `amb_core.excitation_design.TrialBench`, by name.
    axis : {"x", "y"}
        Axis to show.
    title : str
        Title of the figure.
    """
    panels = tuple(_panel(name, trial, axis) for name, trial in trials.items())
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


trial_figure, trial_page = renderers(trial_chart)


def _panel(name: str, trial: Trial, axis: str) -> Panel:
    record = trial.record
    shown = slice(min(round(SETTLED / record.sample_time), record.steps // 2), None)
    time, position = record.time[shown], UM * record.position[shown, "xy".index(axis)]
    items: list[Item] = [Curve(*extremes(time, position), "position", PLANT)]
    window = round(MEAN_TIME / record.sample_time)
    if len(time) > 2 * window:
        mean = _running_mean(position, window)
        middle = time[window // 2 : window // 2 + len(mean)]
        items.append(Curve(*extremes(middle, mean, spans=300), f"its mean over {MEAN_TIME:g} s", MEAN))
    return Panel(Axis("time (s)"), Axis(f"{axis} (µm)"), tuple(items), f"{name}: region {region_label(trial.region)}")


def _running_mean(values: NDArray[np.float64], window: int) -> NDArray[np.float64]:
    total = np.concatenate([[0.0], np.cumsum(values)])
    mean: NDArray[np.float64] = (total[window:] - total[:-window]) / window
    return mean
