"""Responses to sweeps of several amplitudes below one another, over one frequency axis (as in the paper's Fig. 8)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from amb_core.errors import RegionError
from amb_core.figures.chart import Chart, Item, Panel, Rule, Table
from amb_core.figures.renderers import renderers
from amb_core.figures.sweep import onset_text, sweep_chart
from amb_core.records import LoopRecord
from amb_core.regions import Classification, Region


@dataclass(frozen=True)
class SweepResponse:
    """What a sweep did.

    Attributes
    ----------
    record : LoopRecord
        Samples of the loop.
    classification : Classification
        Their regions.
    frequency : ndarray, shape (steps,)
        Frequency of the input at each sample (Hz); NaN where there is none.
    """

    record: LoopRecord
    classification: Classification
    frequency: NDArray[np.float64]


def sweep_series_chart(
    responses: Mapping[str, SweepResponse], axis: str = "y", title: str = "Responses to sweeps of several amplitudes"
) -> Chart:
    """Position over the instantaneous input frequency, a panel for each sweep, in the colours of the regions.

    Parameters
    ----------
    responses : mapping of str to SweepResponse
        At least one, by what tells them apart, such as the amplitude.
    axis : {"x", "y"}
        Axis to show.
    title : str
        Title of the figure.

    Raises
    ------
    RegionError
        If there is no response, or one whose frequency does not rise.
    """
    if not responses:
        raise RegionError("a series of sweeps needs at least one; none is given")
    panels, sentences, rows = [], [], []
    highest = max(float(np.nanmax(response.frequency)) for response in responses.values())
    for name, response in responses.items():
        onsets = response.classification.onsets
        chart = sweep_chart(
            response.record, response.classification, response.frequency, over="frequency", axes=axis, title=name
        )
        panels.append(_over_all(chart.panels[0], name, highest))
        begins = [f"{region.name} at {onset_text(onset)}" for region, onset in onsets.items()]
        sentences.append(f"{name}: {', '.join(begins) or 'region A throughout'}.")
        rows.append((name, *(_frequency(response, region) for region in list(Region)[1:])))
    header = ("sweep", *(f"{region.name} from (Hz)" for region in list(Region)[1:]))
    alt = f"Position on {axis} over the input frequency for {len(panels)} sweeps. " + " ".join(sentences)
    size = (8.0, 1.4 + 1.9 * len(panels))
    return Chart(title, alt, tuple(panels), shared_x=True, size=size, table=Table(header, tuple(rows)))


sweep_series_figure, sweep_series_page = renderers(sweep_series_chart)


def _over_all(panel: Panel, name: str, highest: float) -> Panel:
    """The panel over the frequencies of all, with lines that are named alike in each."""
    assert panel.x.limits is not None
    items: list[Item] = [
        replace(item, label=item.label.partition(":")[0]) if isinstance(item, Rule) else item for item in panel.items
    ]
    return replace(panel, x=replace(panel.x, limits=(panel.x.limits[0], highest)), items=tuple(items), title=name)


def _frequency(response: SweepResponse, region: Region) -> str:
    onset = response.classification.onsets.get(region)
    return "" if onset is None else f"{onset.input_frequency:.0f}" + (" (resonance)" if onset.resonance else "")
