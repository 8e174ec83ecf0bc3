"""Correlations of the residuals with themselves and with the inputs, with the bands of a true model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from amb_core.identification.validation import ChiSquareTest, ResidualTests
from amb_core.identification.validation.residuals import CONFIDENCE
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Band, Curve, Item, Panel, Points, Span, Table
from amb_core.report.figures.style import BLUE, GREY, SKY, VERMILION, Stroke

LAG = "lag (samples)"


def residuals_chart(
    tests: ResidualTests,
    input_names: Sequence[str] = ("i_x", "i_y"),
    output_names: Sequence[str] = ("x", "y"),
    title: str = "Residuals of the one-step prediction",
) -> Chart:
    """Autocorrelation of each residual, and its correlation with each input, over the lag; 99 % bands shaded.

    Parameters
    ----------
    tests : ResidualTests
        From `check_residuals`, or the `residuals` of a `Validation`.
    input_names, output_names : sequence of str, optional
        Names of the signals.
    title : str, optional
        Title of the figure.

    Returns
    -------
    Chart
        The chart, ready to save.
    """
    past = np.arange(1, tests.lags + 1)
    around = np.arange(-tests.lags, tests.lags + 1)
    panels = []
    for column, name in enumerate(output_names):
        heading = f"residual {name}: {_verdict(tests.whiteness_by_output[column], 'white')}"
        items = _items(past, tests.autocorrelation[1:, column, column], tests.band, past > 0)
        panels.append(Panel(Axis(LAG), Axis("autocorrelation (-)"), items, heading))
    for row, driven in enumerate(input_names):
        for column, name in enumerate(output_names):
            heading = f"{name} after {driven}"
            if row == 0:
                heading += f": {_verdict(tests.independence_by_output[column], 'independent')}"
            feedback = Span(-tests.lags - 0.5, 0.5, "feedback answers the residual: not tested", GREY, "/")
            items = _items(around, tests.cross_correlation[:, column, row], tests.band, around > 0)
            panels.append(Panel(Axis(LAG), Axis("correlation (-)"), (feedback, *items), heading))
    rows = [
        ("whiteness", *_numbers(tests.whiteness)),
        ("independence of past inputs", *_numbers(tests.independence)),
    ]
    alt = (
        f"Correlations of the residuals over lags to {tests.lags} samples. At {100.0 * CONFIDENCE:g} % they "
        f"are {_verdict(tests.whiteness, 'white')}, and {_verdict(tests.independence, 'independent')} of past inputs."
    )
    table = Table(("test of all outputs together", "statistic", "limit", "p", "explained variance"), tuple(rows))
    columns = len(output_names)
    size = (4.8 * max(columns, 2), 1.2 + 2.4 * (1 + len(input_names)))
    return Chart(title, alt, tuple(panels), columns, size=size, table=table)


def _items(
    lags: NDArray[np.int64], correlation: NDArray[np.float64], band: float, tested: NDArray[np.bool_]
) -> tuple[Item, ...]:
    """Stems, which show each lag, and the band."""
    ends = np.array([lags[0] - 0.5, lags[-1] + 0.5])
    half = np.array([band, band])
    outside = tested & (np.abs(correlation) > band)
    stems = np.column_stack([np.zeros(len(lags)), correlation, np.full(len(lags), np.nan)]).ravel()
    items: list[Item] = [
        Band(ends, -half, half, "99 % band of a true model", SKY),
        Curve(np.repeat(lags, 3), stems, "", Stroke(BLUE, width=1.0)),
        Points(lags[~outside], correlation[~outside], "correlation", BLUE, "circle"),
    ]
    if outside.any():
        items.append(Points(lags[outside], correlation[outside], "outside of the band", VERMILION, "diamond"))
    return tuple(items)


def _verdict(test: ChiSquareTest, word: str) -> str:
    return f"{word if test.passed else f'not {word}'} (p = {test.p_value:.2g})"


def _numbers(test: ChiSquareTest) -> tuple[str, ...]:
    return (
        f"{test.statistic:.4g}",
        f"{test.limit:.4g}",
        f"{test.p_value:.2g}",
        f"{100 * test.unexplained:.2g} %",
    )
