"""A validation in words and numbers: one line, one page of plain text, and values for JSON."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments import IdentificationData
from amb_core.ground.results import plain
from amb_core.identification.fit import BELOW_ZERO_MEANING, fit_text
from amb_core.identification.validation.judged import JudgedMeasures
from amb_core.identification.validation.residuals import ChiSquareTest, ResidualTests
from amb_core.identification.validation.simulation import ClosedLoop
from amb_core.identification.validation.verdict import Condition, Verdict
from amb_core.linear.model.state_space import StateSpaceModel

WIDTH = 100
_OUTPUTS_ABREAST = 3  # in a table of one column for each output


def summary_line(validation: JudgedMeasures) -> str:
    """The verdict and the main numbers in one line."""
    model = validation.model
    parts = []
    if validation.closed_loop_stable is not None:
        parts.append(f"closed loop {_word(validation.closed_loop_stable, 'stable', 'unstable')}")
    if validation.closed_loop is not None:
        parts.append(f"closed-loop fit {_by_output(validation, validation.fit)}")
    parts.append(f"one-step fit {_by_output(validation, validation.one_step_fit)}")
    if validation.evidence.measured:
        parts.append(validation.evidence.brief)
    parts.append(_word(validation.white, "residuals white", "residuals not white"))
    parts.append(_word(validation.independent, "independent of past inputs", "dependent on past inputs"))
    return f"{validation.verdict}: {model.method or 'model'}, order {model.order}; {'; '.join(parts)}"


def shows_below_zero(validation: JudgedMeasures) -> bool:
    """Whether a fit of the closed loop or of a prediction that reports show is below 0 %."""
    loop = validation.closed_loop
    shown = [validation.prediction.fit_at(horizon) for horizon in validation.horizons]
    shown += [] if loop is None else [loop.fit_without_means, loop.fit]
    return bool(np.min(np.concatenate(shown)) < 0.0)


def report_text(validation: JudgedMeasures) -> str:
    """One page of text, 100 columns at most."""
    lines = [*_heading(validation), "", *_closed_loop(validation), "", *_distortion(validation), ""]
    lines += [*_prediction(validation), ""]
    lines += [*_residuals(validation), "", *_frequency(validation), ""]
    lines += [f"VERDICT      {validation.verdict.replace('not', 'NOT')}"]
    for one in validation.conditions:
        lines += _row(one)
    lines += [line for text in validation.notes for line in _item(text)]
    return "\n".join(lines) + "\n"


def report_values(validation: JudgedMeasures) -> dict[str, Any]:
    """All numbers as plain values; values that are not finite are None."""
    comparison = validation.frequency
    values = {
        "validated": validation.validated,
        "verdict": validation.verdict,
        "summary": validation.summary,
        "conditions": [_condition_values(one) for one in validation.conditions],
        "response_errors": [asdict(band) for band in validation.band_errors],
        "deviations": [asdict(one) for one in validation.deviations],
        "possible_fit_percent": None if validation.possible_fit is None else validation.possible_fit.fit.tolist(),
        "overlap": validation.overlap,
        "model": _model_values(validation.model),
        "data": _data_values(validation.data),
        "outputs": list(validation.model.output_names),
        "prediction": {
            "horizons": validation.prediction.horizons.tolist(),
            "fit_percent": validation.prediction.fit.tolist(),
        },
        "residuals": _residual_values(validation.residuals),
        "closed_loop": None if validation.closed_loop is None else _loop_values(validation.closed_loop),
        "frequency_response": {
            "measured": comparison.measured and comparison.measured.response.label,
            "bands": [asdict(band) for band in comparison.bands],
        },
        "distortion": validation.evidence.as_dict(),
        "notes": list(validation.notes),
        "advice": advice(validation),
    }
    return dict(plain(values))


def _condition_values(condition: Condition) -> dict[str, Any]:
    return {
        "key": condition.key,
        "name": condition.name,
        "finding": condition.finding,
        "limit": condition.limit,
        "level": condition.level,
        "passed": condition.passed,
        "checked": condition.checked,
        "advice": condition.advice,
    }


def _model_values(model: StateSpaceModel) -> dict[str, Any]:
    return {
        "method": model.method,
        "order": model.order,
        "source": model.source,
        "samples": model.samples,
        "unstable_poles": [[pole.real, pole.imag] for pole in model.unstable_poles().tolist()],
    }


def _data_values(data: IdentificationData) -> dict[str, Any]:
    return {
        "samples": data.samples,
        "sample_time": data.sample_time,
        "sources": [item.source for item in data.experiments],
        "first_steps": [item.first_step for item in data.experiments],
    }


def _residual_values(residuals: ResidualTests) -> dict[str, Any]:
    return {
        "lags": residuals.lags,
        "deviation": residuals.deviation.tolist(),
        "mean": residuals.mean.tolist(),
        "whiteness": _test_values(residuals.whiteness),
        "independence": _test_values(residuals.independence),
    }


def _loop_values(loop: ClosedLoop) -> dict[str, Any]:
    return {
        "stable": loop.stable,
        "largest_pole": float(np.abs(loop.poles[0])),
        "fit_percent": loop.fit.tolist(),
        "fit_without_means_percent": loop.fit_without_means.tolist(),
        "offset": loop.offset.tolist(),
    }


def advice(validation: JudgedMeasures) -> list[str]:
    """What to do about each condition that does not hold, in a sentence or two."""
    return [f"{one.name[:1].upper()}{one.name[1:]}: {one.finding}. {one.advice}." for one in validation.failed]


_MARKS = {Verdict.VALIDATED: "ok", Verdict.RESERVATIONS: "RESERVED", Verdict.NOT_VALIDATED: "FAILED"}


def _row(one: Condition) -> list[str]:
    """A condition with its finding; its limit and advice if it does not hold."""
    text = f"{one.name}: {one.finding}"
    if not one.passed:
        text += f" (limit: {one.limit}). {one.advice[:1].upper()}{one.advice[1:]}."
    mark = f"    {_MARKS[one.level] if one.checked or not one.passed else '-':<9}"
    return textwrap.wrap(text, WIDTH, initial_indent=mark, subsequent_indent=" " * len(mark))


def _heading(validation: JudgedMeasures) -> list[str]:
    model, data = validation.model, validation.data
    unstable, count = len(model.unstable_poles()), len(data.experiments)
    experiments = f"{count} experiment{'s' if count > 1 else ''}"
    sources = ", ".join(dict.fromkeys(item.source or "unknown source" for item in data.experiments))
    return [
        "VALIDATION OF A MODEL",
        f"model        {model.method or 'unknown method'}, order {model.order}, {unstable} unstable poles, "
        f"from {model.samples} samples of {model.source or 'unknown source'}",
        f"data         {data.samples} samples of {data.sample_time:g} s in {experiments}: {sources}",
    ]


def _closed_loop(validation: JudgedMeasures) -> list[str]:
    loop = validation.closed_loop
    if loop is None:
        if validation.loop_poles is None:
            return ["CLOSED LOOP  not checked"]
        return [f"CLOSED LOOP  {_stability(validation)}; not simulated: {validation.without_loop}"]
    return [
        f"CLOSED LOOP  {_stability(validation)}; from the reference alone, with the known controller",
        *_table(
            ("", validation.model.output_names),
            ("fit, deviations alone (%)", _fits(loop.fit_without_means)),
            ("fit, means added (%)", _fits(loop.fit)),
            *_possible(validation),
            ("measured minus simulated mean (um)", [f"{1e6 * value:.3g}" for value in loop.offset]),
        ),
    ]


def _stability(validation: JudgedMeasures) -> str:
    assert validation.loop_poles is not None
    word = _word(bool(validation.closed_loop_stable), "stable", "UNSTABLE")
    return f"{word}, largest pole {np.abs(validation.loop_poles[0]):.5f}"


def _possible(validation: JudgedMeasures) -> list[tuple[str, Sequence[str]]]:
    possible = validation.possible_fit
    if possible is None:
        return []
    values = zip(possible.fit, possible.deviation, strict=True)
    return [("fit that the data allow (%)", [f"{fit:.2f} ± {spread:.2g}" for fit, spread in values])]


def _distortion(validation: JudgedMeasures) -> list[str]:
    rows = ["DISTORTION   of these data; a linear loop does not follow it"]
    return rows + [line for text in validation.evidence.lines for line in _item(text)]


def _prediction(validation: JudgedMeasures) -> list[str]:
    names = validation.model.output_names
    rows: list[tuple[str, Sequence[str]]] = [("", names)]
    for horizon in validation.horizons:
        time = 1e3 * horizon * validation.model.sample_time
        fit = validation.prediction.fit_at(horizon)
        rows.append((f"{horizon} steps ({time:g} ms)", _fits(fit)))
    return [
        "PREDICTION   fit in percent from the filtered state, so many steps ahead",
        *_table(*rows),
        *_below_zero(validation),
    ]


def _fits(values: NDArray[np.float64]) -> list[str]:
    return [fit_text(value).removesuffix(" %") for value in values]


def _below_zero(validation: JudgedMeasures) -> list[str]:
    """What a fit below 0 means, where one is shown."""
    return _item(BELOW_ZERO_MEANING) if shows_below_zero(validation) else []


def _residuals(validation: JudgedMeasures) -> list[str]:
    tests, names = validation.residuals, validation.model.output_names
    units = ", ".join(dict.fromkeys(unit for unit in validation.model.output_units if unit))
    label = f"standard deviation ({units})" if units else "standard deviation"
    rows = [f"RESIDUALS    {tests.samples} one-step errors, chi-square tests at 99.9 % over {tests.lags} lags"]
    rows += _table(("", names), (label, [f"{value:.3g}" for value in tests.deviation]))
    for name, joint, alone in (
        ("white", tests.whiteness, tests.whiteness_by_output),
        ("independent of past inputs", tests.independence, tests.independence_by_output),
    ):
        again = [("", names)] if len(names) > _OUTPUTS_ABREAST else []
        rows += _table(*again, (name, [f"p = {test.p_value:.2g}" for test in alone]))
        rows.append(
            f"    {'together: ' + _verdict(joint):<34}statistic {joint.statistic:.4g}, limit {joint.limit:.4g}; "
            f"explains {100 * joint.unexplained:.3g} % of the variance"
        )
    return rows


def _frequency(validation: JudgedMeasures) -> list[str]:
    comparison = validation.frequency
    source = "not estimated" if comparison.measured is None else comparison.measured.response.label
    open_loop = comparison.measured is not None and comparison.measured.open_loop
    rows = [
        f"FREQUENCY    from the {'inputs' if open_loop else 'reference'}, without a model: {source}",
        "    differences of the model in percent",
        f"    {'band (Hz)':<18}{'lines':>6}{'median':>10}{'largest':>10}{'deviation':>12}{'within 99 %':>13}"
        f"{'linearised plant':>18}",
    ]
    for band in comparison.bands:
        rows.append(
            f"    {f'{band.low:g} to {band.high:g}':<18}{band.lines:>6}{_percent(band.difference):>10}"
            f"{_percent(band.largest):>10}{_percent(band.deviation):>12}{_percent(band.within):>13}"
            f"{_percent(band.plant_difference):>18}"
        )
    return rows if comparison.bands else rows[:1]


def _percent(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.2f}" if value < 10.0 else f"{value:.1f}"


def _table(*rows: tuple[str, Sequence[str]]) -> list[str]:
    """Rows of a label and a value for each output; the values of many outputs below one another."""
    count = len(rows[0][1])
    return [
        f"    {label:<34}" + "".join(f"{value:>20}" for value in values[first : first + _OUTPUTS_ABREAST])
        for first in range(0, count, _OUTPUTS_ABREAST)
        for label, values in rows
    ]


def _item(text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent="  - ", subsequent_indent="    ")


def _by_output(validation: JudgedMeasures, fit: Any) -> str:
    return ", ".join(
        f"{name} {fit_text(value)}" for name, value in zip(validation.model.output_names, fit, strict=True)
    )


def _verdict(test: ChiSquareTest) -> str:
    return f"{_word(test.passed, 'yes', 'NO')} (p = {test.p_value:.2g})"


def _word(truth: bool, yes: str, no: str) -> str:
    return yes if truth else no


def _test_values(test: ChiSquareTest) -> dict[str, Any]:
    return {
        "passed": test.passed,
        "statistic": test.statistic,
        "limit": test.limit,
        "degrees": test.degrees,
        "p_value": test.p_value,
        "unexplained": test.unexplained,
    }
