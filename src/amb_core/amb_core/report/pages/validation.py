"""A validation as a section of a report: a table for each test, with badges, and what to do about those that failed."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from amb_core.ground.units import UM
from amb_core.identification.fit import BELOW_ZERO_MEANING, fit_text
from amb_core.identification.validation import ChiSquareTest, Condition, Validation, Verdict
from amb_core.identification.validation.report import shows_below_zero
from amb_core.report.figures.residuals import residuals_chart
from amb_core.report.pages.document import Badge, Block, Cell, FigureBlock, Prose, Section, State, TableBlock

HEADING = "Validation"
_STATES: dict[Verdict, State] = {
    Verdict.VALIDATED: "good",
    Verdict.RESERVATIONS: "limited",
    Verdict.NOT_VALIDATED: "bad",
}
_WORDS = {Verdict.VALIDATED: "holds", Verdict.RESERVATIONS: "reservation", Verdict.NOT_VALIDATED: "fails"}


def verdict_badge(validation: Validation) -> Badge:
    """The verdict, linked to the section."""
    return Badge(validation.verdict, _STATES[validation.verdict], HEADING)


def fit_badge(validation: Validation, fit: float) -> Badge:
    """A closed-loop fit (percent), in the colour of its condition."""
    (condition,) = (one for one in validation.conditions if one.key == "closed_loop_fit")
    return Badge(fit_text(fit), _STATES[condition.level], HEADING)


def validation_reason(validation: Validation) -> str:
    """Why the verdict is what it is, in a sentence."""
    failed = validation.failed
    if not failed:
        apply = [one for one in validation.conditions if one.checked]
        return f"All {len(apply)} conditions that apply hold, of {len(validation.conditions)}."
    worst = [one for one in failed if one.level is failed[0].level]
    findings = "; ".join(f"{one.name}: {one.finding}" for one in worst)
    return f"{len(worst)} of {len(validation.conditions)} conditions {_DO_NOT[failed[0].level]}: {findings}."


_DO_NOT = {Verdict.RESERVATIONS: "leave reservations", Verdict.NOT_VALIDATED: "fail"}


def validation_section(validation: Validation) -> Section:
    """The conditions of the verdict, all tests as tables, and the figure of the residuals."""
    blocks: list[Block] = [Prose(validation_reason(validation)), _conditions(validation.conditions)]
    blocks += [Prose(f"{text[:1].upper()}{text[1:]}") for text in validation.notes]
    blocks += [
        *_closed_loop(validation),
        _prediction(validation),
        *_below_zero(validation),
        _residuals(validation),
        *_frequency(validation),
    ]
    tests = (validation.residuals, validation.model.input_names, validation.model.output_names)
    return Section(HEADING, [*blocks, FigureBlock(residuals_chart(*tests).page(), "Residuals")])


def _conditions(conditions: Sequence[Condition]) -> TableBlock:
    rows = [
        (
            one.name,
            _badge(one),
            one.finding,
            one.limit,
            one.advice,
        )
        for one in conditions
    ]
    return TableBlock(("condition", "", "finding", "allowed", "what to do"), rows, "Conditions of the verdict")


def _badge(one: Condition) -> Badge:
    if one.checked:
        return Badge(_WORDS[one.level], _STATES[one.level])
    return Badge("does not apply") if one.passed else Badge("not checked", _STATES[one.level])


def _closed_loop(validation: Validation) -> list[Block]:
    loop = validation.closed_loop
    if loop is None:
        return []
    values = zip(
        validation.model.output_names, loop.fit_without_means, loop.fit, UM * np.asarray(loop.offset), strict=True
    )
    rows = [
        (name, fit_text(alone), fit_badge(validation, fit), f"{offset:.3g} µm") for name, alone, fit, offset in values
    ]
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
        fits = (fit_text(value) for value in validation.prediction.fit_at(horizon))
        rows.append((f"{horizon}", f"{time:g} ms", *fits))
    header = ("steps ahead", "time", *(f"fit of {name}" for name in validation.model.output_names))
    return TableBlock(header, rows, "Prediction from the filtered state")


def _below_zero(validation: Validation) -> list[Block]:
    """What a fit below 0 % means, where a table has one."""
    return [Prose(BELOW_ZERO_MEANING)] if shows_below_zero(validation) else []


def _residuals(validation: Validation) -> TableBlock:
    tests = validation.residuals
    rows: list[Sequence[Cell]] = []
    for name, joint, alone in (
        ("white", tests.whiteness, tests.whiteness_by_output),
        ("independent of past inputs", tests.independence, tests.independence_by_output),
    ):
        explained = f"{100.0 * joint.unexplained:.3g} %"
        statistic = f"{joint.statistic:.4g} of {joint.limit:.4g}"
        rows.append((name, *(f"p = {test.p_value:.2g}" for test in alone), _passed(joint), statistic, explained))
    header = (
        "residuals are",
        *validation.model.output_names,
        "together",
        "statistic of its limit",
        "explained variance",
    )
    caption = f"Residuals: {tests.samples} one-step errors, chi-square tests at 99.9 % over {tests.lags} lags"
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
