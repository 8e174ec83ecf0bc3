"""The same sweep through several loops: one panel each on the same axes, with the regions where they begin."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from amb_core.ground.errors import RegionError
from amb_core.loop.records import LoopRecord
from amb_core.regions import AxisState, Classification, Judged, Onset, Region, RegionState
from amb_core.report.figures.drawing import Curve, Rule, Span
from amb_core.report.figures.sweep_comparison import SweepCase, onset_summary, sweep_comparison_chart

ALL_JUDGED = Judged({}, {}, 0.7)
STEPS = 20_000
FREQUENCY = np.linspace(10.0, 1_000.0, STEPS)


def case(name: str, begins: dict[Region, int]) -> SweepCase:
    onsets = {region: Onset(step, 1e-4 * step, float(FREQUENCY[step]), False) for region, step in begins.items()}
    states = []
    for step in range(99, STEPS, 100):
        region = max((one for one, begin in begins.items() if begin <= step), default=Region.A)
        since = onsets.get(region, Onset(0, 0.0, math.nan, False))
        axis = AxisState(region, since, *[0.0] * 8, sampling_beat=False)
        states.append(RegionState(step, (axis, replace(axis, name="y")), (), region, since, 0.0, True))
    position = np.column_stack([np.zeros(STEPS), 1e-5 * np.sin(0.1 * np.arange(STEPS))])
    record = LoopRecord(0, 1e-4, position, position, position)
    return SweepCase(name, record, FREQUENCY, Classification(states, onsets, {"x": {}, "y": onsets}, ALL_JUDGED))


FALLS = case("falls", {Region.B: 5_000, Region.D: STEPS - 1})
STAYS = case("stays", {})


def test_regions_begin_at_their_frequency_in_each_panel() -> None:
    chart = sweep_comparison_chart([FALLS, STAYS])
    assert [panel.title for panel in chart.panels] == ["falls", "stays"]
    falls, stays = ([item for item in panel.items if isinstance(item, Span | Rule)] for panel in chart.panels)
    assert [item.start for item in falls[:2]] == pytest.approx([10.0, FREQUENCY[5_000]])
    assert falls[-1].x == pytest.approx(1_000.0)
    assert len(stays) == 1
    assert chart.panels[0].y == chart.panels[1].y


def test_onsets_are_in_the_table_and_in_the_text() -> None:
    chart = sweep_comparison_chart([FALLS, STAYS])
    assert chart.table is not None
    assert chart.table.rows[0] == ("falls", "258", "none", "1000", "1000")
    assert onset_summary(STAYS) == "A up to 1000 Hz"
    assert onset_summary(FALLS) in chart.alt


def test_long_records_are_thinned() -> None:
    (curve,) = (item for item in sweep_comparison_chart([STAYS]).panels[0].items if isinstance(item, Curve))
    assert len(curve.x) < 2_000


def test_a_frequency_that_does_not_rise_is_refused() -> None:
    falling = SweepCase("falling", STAYS.record, FREQUENCY[::-1], STAYS.classification)
    with pytest.raises(RegionError, match="falling: sweeps are compared only where"):
        sweep_comparison_chart([falling])
