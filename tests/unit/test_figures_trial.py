"""Trials of excitations are drawn on one scale, without the rotor's fall into place."""

from __future__ import annotations

import numpy as np

from amb_core.designs.excitation import Trial
from amb_core.loop.records import LoopRecord
from amb_core.regions import Region
from amb_core.report.figures.drawing import Curve, Panel
from amb_core.report.figures.trial import SETTLED, trial_chart


def trial(region: Region, bias: float, steps: int) -> Trial:
    """A rotor that falls from the centre to a bias (m) within a tenth of a second."""
    position = np.zeros((steps, 2))
    position[1000:, 1] = bias
    record = LoopRecord(0, 1e-4, np.zeros((steps, 2)), position, np.zeros((steps, 2)))
    return Trial(region, region, {}, np.array([0.0, bias]), record)


def curves(panel: Panel) -> list[Curve]:
    return [item for item in panel.items if isinstance(item, Curve)]


def test_panels_share_the_scale_of_what_comes_after_the_fall() -> None:
    chart = trial_chart({"noise": trial(Region.B, -90e-6, 20_000), "pulses": trial(Region.A, -60e-6, 20_000)})
    assert [panel.title for panel in chart.panels] == [
        "noise: region B drifting bias",
        "pulses: region A steady bias",
    ]
    limits = {panel.y.limits for panel in chart.panels}
    assert len(limits) == 1
    low, high = limits.pop() or (0.0, 0.0)
    assert -95.0 < low < -90.0 and -60.0 < high < -55.0
    assert all(curve.x[0] >= SETTLED for panel in chart.panels for curve in curves(panel))
    assert chart.table is not None
    assert chart.table.rows[0] == ("noise", "B drifting bias", "-90.0")


def test_a_trial_that_ends_early_shows_its_second_half() -> None:
    chart = trial_chart({"pulses": trial(Region.D, -60e-6, 2_500)})
    (position,) = curves(chart.panels[0])
    assert position.label == "position"
    assert position.x[0] == 0.125
