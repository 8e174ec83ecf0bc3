"""A validation as a section of a report: a table for each test, with badges, and what to do about those that failed."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from amb_core.figures.residuals import residuals_chart
from amb_core.identification.validation import ChiSquareTest, Validation
from amb_core.identification.validation.report import advice
from amb_core.identification.validation.simulation import NEEDED_FIT
from amb_core.report.document import Badge, Block, Cell, FigureBlock, Prose, Section, State, TableBlock
from amb_core.units import UM

HEADING = "Validation"
_STATES: dict[str, State] = {"validated": "good", "validated with reservations": "limited", "not validated": "bad"}


def verdict_badge(validation: Validation) -> Badge:
    """The verdict, linked to the section."""
    return Badge(validation.verdict, _STATES[validation.verdict], HEADING)


def fit_badge(fit: float) -> Badge:
    """A closed-loop fit (percent), good where it reaches what validation asks for."""
    return Badge(f"{fit:.2f} %", "good" if fit >= NEEDED_FIT else "bad", HEADING)


def validation_reason(validation: Validation) -> str:
    """Why the verdict is what it is, in a sentence."""
    loop = validation.closed_loop
    share = f"{100.0 * validation.residuals.independence.unexplained:.3g} % of the residuals' variance"
    if loop is None:
        found = "past inputs explain nothing" if validation.independent else f"past inputs explain {share}"
        return f"The closed loop was not checked; of the residuals, {found}."
    if not loop.stable:
        return "Model and controller make an unstable loop."
    worst = float(np.min(loop.fit))
    text = f"Model and controller make a stable loop that follows with {worst:.2f} % or more"
    if not loop.follows:
        return f"{text}; {NEEDED_FIT:g} % are needed."
    return f"{text}." if validation.unreserved else f"{text}, but past inputs explain {share}."


def validation_section(validation: Validation) -> Section:
    """All tests as tables, advice, and the figure of the residuals."""
    blocks: list[Block] = [
        Prose(
            "Validated on the data that the model was identified from. Data of another experiment are more conclusive."
        ),
        Prose(validation_reason(validation)),
    ]
    blocks += [Prose(f"{text[:1].upper()}{text[1:]}") for text in (*validation.notes, *advice(validation))]
    blocks += [*_closed_loop(validation), _prediction(validation), _residuals(validation), *_frequency(validation)]
    tests = (validation.residuals, validation.model.input_names, validation.model.output_names)
    return Section(HEADING, [*blocks, FigureBlock(residuals_chart(*tests).page(), "Residuals")])


def _closed_loop(validation: Validation) -> list[Block]:
    loop = validation.closed_loop
    if loop is None:
        return []
    values = zip(
        validation.model.output_names, loop.fit_without_means, loop.fit, UM * np.asarray(loop.offset), strict=True
    )
    rows = [(name, f"{alone:.2f} %", fit_badge(fit), f"{offset:.3g} µm") for name, alone, fit, offset in values]
    stability = "stable" if loop.stable else "unstable"
    caption = (
        f"Closed loop: {stability}, largest pole {np.abs(loop.poles[0]):.5f}; "
        "from the reference alone, with the known controller"
    )
    return [
        TableBlock(
            ("output", "fit, deviations alone", "fit, means added", "measured minus simulated mean"), rows, caption
        )
    ]


def _prediction(validation: Validation) -> TableBlock:
    rows = []
    for horizon in validation.horizons:
        time = 1e3 * horizon * validation.model.sample_time
        fits = (f"{value:.2f} %" for value in validation.prediction.fit_at(horizon))
        rows.append((f"{horizon}", f"{time:g} ms", *fits))
    header = ("steps ahead", "time", *(f"fit of {name}" for name in validation.model.output_names))
    return TableBlock(header, rows, "Prediction from the filtered state")


def _residuals(validation: Validation) -> TableBlock:
    tests = validation.residuals
    rows: list[Sequence[Cell]] = []
    for name, joint, alone in (
        ("white", tests.whiteness, tests.whiteness_by_output),
        ("independent of past inputs", tests.independence, tests.independence_by_output),
    ):
        explained = f"{100.0 * joint.unexplained:.3g} %"
        statistic = f"{joint.statistic:.4g} of {joint.limit:.4g}"
        rows.append((name, *(_passed(test) for test in alone), _passed(joint), statistic, explained))
    header = (
        "residuals are",
        *validation.model.output_names,
        "together",
        "statistic of its limit",
        "explained variance",
    )
    caption = f"Residuals: {tests.samples} one-step errors, chi-square tests at 99 % over {tests.lags} lags"
    return TableBlock(header, rows, caption)


def _passed(test: ChiSquareTest) -> Badge:
    return Badge(f"{'yes' if test.passed else 'no'} (p = {test.p_value:.2g})", "good" if test.passed else "limited")


def _frequency(validation: Validation) -> list[Block]:
    comparison = validation.frequency
    if not comparison.bands or comparison.measured is None:
        return []
    rows = [
        (
            f"{band.low:g} to {band.high:g} Hz",
            f"{band.lines}",
            *(
                _percent(value)
                for value in (band.difference, band.largest, band.deviation, band.within, band.plant_difference)
            ),
        )
        for band in comparison.bands
    ]
    source = "inputs" if comparison.measured.open_loop else "reference"
    caption = (
        f"Frequency response of the model against that estimated from the {source}: "
        f"{comparison.measured.response.label}"
    )
    header = (
        *("band", "lines", "median difference", "largest", "deviation of the estimate"),
        *("within 99 %", "from the linearised plant"),
    )
    return [TableBlock(header, rows, caption)]


def _percent(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.2f} %" if value < 10.0 else f"{value:.1f} %"
