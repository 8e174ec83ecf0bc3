"""The same sweep through several loops, one above the other: what each does to the regions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import RegionError
from amb_core.ground.units import UM
from amb_core.loop.records import LoopRecord
from amb_core.regions import Classification, Region
from amb_core.regions.stretches import stretches
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Item, Panel, Rule, Span, Table
from amb_core.report.figures.style import PLANT, REGIONS, region_label
from amb_core.report.figures.sweep import rises
from amb_core.report.figures.thinning import extremes

SPANS = 400  # of the axis, each drawn by its extremes: the panels are small
ROOM = 1.03  # free space on the right, which keeps a line at the end visible
PANEL_HEIGHT, MARGINS = 1.25, 1.5  # inch


@dataclass(frozen=True)
class SweepCase:
    """A loop under the sweep.

    Attributes
    ----------
    name : str
        What is special about it.
    record : LoopRecord
        Its samples.
    frequency : ndarray, shape (steps,)
        Frequency of the input at each step (Hz), rising; NaN outside the sweep.
    classification : Classification
        Of these samples.
    """

    name: str
    record: LoopRecord
    frequency: NDArray[np.float64]
    classification: Classification


def sweep_comparison_chart(cases: Sequence[SweepCase], axis: str = "y", title: str = "The same sweep") -> Chart:
    """Position over input frequency (logarithmic) for each loop, in the colours of the regions, on the same axes.

    Parameters
    ----------
    cases : sequence of SweepCase
        At least one, from top to bottom.
    axis : str, optional
        Its name.
    title : str, optional
        Title of the figure.

    Returns
    -------
    Chart
        The chart, ready to save.

    Raises
    ------
    RegionError
        If the frequency of a case does not rise, or a case has no such axis.
    """
    for case in cases:
        if axis not in case.record.axes:
            raise RegionError(f"{case.name}: no axis {axis!r}; its axes: {', '.join(case.record.axes)}")
        if not rises(case.frequency):
            raise RegionError(f"{case.name}: sweeps are compared only where the frequency of their input rises")
    number = cases[0].record.axes.index(axis)
    frequencies = np.concatenate([case.frequency[np.isfinite(case.frequency)] for case in cases])
    horizontal = Axis(
        "input frequency (Hz)", log=True, limits=(float(frequencies.min()), ROOM * float(frequencies.max()))
    )
    reach = UM * max(float(np.nanmax(np.abs(case.record.position[:, number]))) for case in cases)
    vertical = Axis(f"{axis} (µm)", limits=(-1.05 * reach, 1.05 * reach))
    panels = [Panel(horizontal, vertical, _items(case, number), case.name) for case in cases]
    height = MARGINS + PANEL_HEIGHT * len(cases)
    return Chart(title, _alt(cases), tuple(panels), shared_x=True, size=(8.0, height), table=_table(cases))


def onset_summary(case: SweepCase) -> str:
    """Where the regions begin, such as `B from 417 Hz, D from 1839 Hz`, or how far A reaches."""
    onsets = case.classification.onsets.items()
    if not onsets:
        return f"A up to {np.nanmax(case.frequency):.0f} Hz"
    return ", ".join(f"{region.name} from {onset.input_frequency:.0f} Hz" for region, onset in onsets)


def _items(case: SweepCase, axis: int) -> tuple[Item, ...]:
    known = np.flatnonzero(np.isfinite(case.frequency))
    shown = slice(int(known[0]), int(known[-1]) + 1)
    frequency, first_step = case.frequency[shown], case.record.first_step + int(known[0])
    steps = np.arange(len(frequency))
    items: list[Item] = []
    for stretch in stretches(case.classification.states):
        start, stop = np.interp([stretch.first_step - first_step, stretch.stop - first_step], steps, frequency)
        if stop > start:
            look = REGIONS[stretch.region]
            label = region_label(stretch.region)
            items.append(Span(float(start), float(stop), label, look.colour, look.hatch))
    # Spans of equal width on the logarithmic axis.
    logarithm, position = extremes(np.log(frequency), UM * case.record.position[shown, axis], SPANS)
    if Region.D in case.classification.onsets:
        items.append(
            Rule(
                case.classification.onsets[Region.D].input_frequency, region_label(Region.D), REGIONS[Region.D].boundary
            )
        )
    return (*items, Curve(np.exp(logarithm), position, "position", PLANT))


def _alt(cases: Sequence[SweepCase]) -> str:
    return f"Rotor position under the same sweep in {len(cases)} loops. " + " ".join(
        f"{case.name}: {onset_summary(case)}." for case in cases
    )


def _table(cases: Sequence[SweepCase]) -> Table:
    rows = []
    for case in cases:
        onsets = case.classification.onsets
        begins = [
            f"{onsets[region].input_frequency:.0f}" if region in onsets else "none"
            for region in (Region.B, Region.C, Region.D)
        ]
        rows.append((case.name, *begins, f"{np.nanmax(case.frequency):.0f}"))
    return Table(("loop", "B from (Hz)", "C from (Hz)", "D from (Hz)", "swept up to (Hz)"), tuple(rows))
