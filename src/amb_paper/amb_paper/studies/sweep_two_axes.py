"""Fig. 3: the two-axis bearing under a sweep on y, over the instantaneous frequency, in its regions."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from amb_core.report.figures.sweep import sweep_chart
from amb_paper.study import LINEAR_IRON, Claim, DrawnFigure, Setting, Study, StudyResult, judged
from amb_paper.sweeps import (
    SLOW_AMPLIFIER,
    SLOW_NOTE,
    SLOW_VALUE,
    SweptBearing,
    in_order,
    order_reason,
    sweep_bearing,
    sweep_settings,
)

AMPLITUDE = 15e-6  # m, as in Fig. 2; the paper does not state its value


class TwoAxisSweep(Study):
    """The sweep on y with table 1 and with a slower amplifier; also on x, for the effect of gravity."""

    name = "fig3"
    heading = "Fig. 3: the two-axis bearing under a sweep"
    against = LINEAR_IRON

    def run(self) -> StudyResult:
        """Simulate, classify, draw, evaluate."""
        voltage = SLOW_AMPLIFIER["amplifier.supply_voltage"]
        names = {"fig3": "supply of table 1", "fig3-slow-amplifier": f"slow amplifier, {voltage:g} V"}
        settings = {"fig3": {}, "fig3-slow-amplifier": SLOW_AMPLIFIER}
        on_y = {figure: sweep_bearing(AMPLITUDE, values) for figure, values in settings.items()}
        on_x = {figure: sweep_bearing(AMPLITUDE, values, axis="x") for figure, values in settings.items()}
        return self.result(
            [figure_of(figure, bearing, names[figure]) for figure, bearing in on_y.items()],
            [
                regions_claim(on_y["fig3"], on_y["fig3-slow-amplifier"]),
                gravity_claim(
                    {names["fig3"]: (on_y["fig3"], on_x["fig3"])},
                    {names["fig3-slow-amplifier"]: (on_y["fig3-slow-amplifier"], on_x["fig3-slow-amplifier"])},
                ),
            ],
            {
                "amplitude": Setting(f"{1e6 * AMPLITUDE:g} µm"),
                **sweep_settings(),
                "second bearing": Setting(SLOW_VALUE, "against table 1"),
            },
            [
                "The boundaries come from the region classifier of this project, since the algorithm of the paper is "
                "not public. It distinguishes a slow oscillation from beats of the input with the sample rate, which "
                "the grey bars mark.",
                SLOW_NOTE,
            ],
        )


def figure_of(name: str, bearing: SweptBearing, description: str) -> DrawnFigure:
    """Position on y over the frequency of the input."""
    title = f"Two axes, sweep of {1e6 * AMPLITUDE:g} µm on y: {description}"
    chart = sweep_chart(
        bearing.record, bearing.classification, bearing.frequency, over="frequency", axes=("y",), title=title
    )
    return DrawnFigure.of(name, chart)


def regions_claim(paper: SweptBearing, slow: SweptBearing) -> Claim:
    """Whether the regions of the bearing with one axis occur, and in the same order."""
    return Claim(
        id="two-axis-regions",
        paper_figure="Fig. 3",
        statement="A bearing with two axes goes through the same regions as one with a single axis: with rising "
        "frequency its bias drifts, then it oscillates slowly.",
        finding=f"table 1: {paper.summary}; slow amplifier: {slow.summary}",
        verdict=judged([in_order(paper)], [in_order(slow)]),
        reason=order_reason([paper], slow),
        figure="fig3-slow-amplifier",
    )


def gravity_claim(
    swept: Mapping[str, tuple[SweptBearing, SweptBearing]],
    changed: Mapping[str, tuple[SweptBearing, SweptBearing]],
) -> Claim:
    """Whether the nonlinear behaviour begins at a lower frequency if the sweep acts along gravity.

    Parameters
    ----------
    swept, changed : mapping
        Under a description, the same bearing swept on y and on x; `changed` with another value than the paper states.
    """
    earlier = [
        [linear_up_to(on_y) < linear_up_to(on_x) for on_y, on_x in bearings.values()] for bearings in (swept, changed)
    ]
    return Claim(
        id="two-axis-gravity",
        paper_figure="Fig. 3",
        statement="The behaviour is more pronounced in the vertical direction, because of gravity.",
        finding="; ".join(
            f"{name}: swept on y {on_y.summary}, swept on x {on_x.summary}"
            for name, (on_y, on_x) in {**swept, **changed}.items()
        ),
        verdict=judged(*earlier),
        reason="" if all(earlier[0]) else "Swept on x, the bearing leaves region A no later.",
        figure="fig3",
    )


def linear_up_to(bearing: SweptBearing) -> float:
    """Frequency of the input at which region A ends (Hz), or up to which it was swept."""
    begins = [onset.input_frequency for onset in bearing.onsets.values()]
    return min(begins, default=float(np.nanmax(bearing.frequency)))
