"""The one rule of how far a model is validated: all conditions of it, with their findings, limits and advice.

Every command, service, page and certificate takes its word from `judge`. A finding is significant below a probability
of 1e-3 for a true model, all alternatives of a condition counted. A deviation that is significant and matters refuses
a model; one that is significant and small, or a condition that is not known, leaves reservations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from amb_core.data.experiments import Severity
from amb_core.data.experiments.checks.distortion import LARGE_DISTORTION, LOW_COHERENCE
from amb_core.identification.controller_check import NOT_CHECKED
from amb_core.identification.controller_trials import FOREIGN
from amb_core.identification.progress import FOCUSED, PEM
from amb_core.identification.validation.deviations import Deviation
from amb_core.identification.validation.measures import Measures
from amb_core.identification.validation.model_error import LEAST_ACTION, MATTERS, RESOLVED, BandError
from amb_core.identification.validation.possible import LAGS
from amb_core.identification.validation.residuals import ChiSquareTest
from amb_core.identification.validation.ringing import NOTABLE, SHARE
from amb_core.identification.validation.verdict import SIGNIFICANT, Condition, Verdict

SHORT_OF_POSSIBLE = 10.0
"""Points of fit that a model may lack to what the data allow."""
OVERLAP = 0.05
"""Share of the samples of the identification that the data may hold again."""

MOST_NAMED = 2
"""Kinds of deviation that are named beside the one that matters most."""

NOTABLE_TONE = 0.01
"""Share of the variance of the residuals from which a tone is named."""

NOTED = "clipping"
"""Of the checks of a recording the one that is a note only: currents at their limit are recorded behind it, so they are
the true ones, and the loop is simulated with the limit."""

_ANEW = "identify the model anew; name the method of one that comes from no data"

_RESERVED, _REFUSED = Verdict.RESERVATIONS, Verdict.NOT_VALIDATED


def judge(measures: Measures) -> tuple[Condition, ...]:
    """All conditions on a model, in the order of `RULES`."""
    return tuple(rule(measures) for rule, *_ in RULES)


def _stable(measures: Measures) -> Condition:
    key, name, limit = "closed_loop", "the closed loop is stable", "all poles inside the unit circle"
    poles = measures.loop_poles
    if poles is None:
        return _not_checked(
            key, name, measures.without_loop, limit,
            "give the controller of the experiment (--controller) and the units of the signals",
        )  # fmt: skip
    finding = f"largest pole {np.abs(poles[0]):.5f}"
    if measures.closed_loop_stable:
        return Condition(key, name, finding, limit)
    return Condition(
        key, name, finding, limit, _REFUSED,
        "The bearing's loop is stable: identify from data of region A with all axes excited, and try a higher order",
    )  # fmt: skip


def _controller(measures: Measures) -> Condition:
    key, name = "controller", "the controller computed the recorded currents"
    limit = f"all but {100.0 * FOREIGN:g} % of them (rms), and no other law fits far better"
    check = measures.controller_check
    if check.severity is Severity.INFO and not check.what.startswith(NOT_CHECKED):
        return Condition(key, name, check.what, limit)
    where = f"{check.where}: " if check.where else ""
    advice = check.advice or "name the controller of the experiment with --controller"
    checked = not check.what.startswith(NOT_CHECKED)
    return Condition(key, name, f"{where}{check.what}", limit, _RESERVED, advice, checked)


def _sound(measures: Measures) -> Condition:
    key, name = "samples", "the samples are as they were measured"
    limit = "no check of the recording warns"
    findings = [one for one in measures.findings if one.severity is not Severity.INFO and one.check != NOTED]
    if not findings:
        return Condition(key, name, "nothing found", limit)
    texts = [f"{one.check}: {one.where + ': ' if one.where else ''}{one.what}" for one in findings]
    advice = "; ".join(dict.fromkeys(one.advice for one in findings if one.advice))
    return Condition(key, name, "; ".join(texts), limit, _RESERVED, advice)


def _followed(measures: Measures) -> Condition:
    key, name = "closed_loop_fit", "the closed loop follows as well as the data allow"
    limit = f"{SHORT_OF_POSSIBLE:g} points below what a true model reaches, beside chance"
    loop, possible = measures.closed_loop, measures.possible_fit
    if loop is None and measures.closed_loop_stable:
        return _not_checked(key, name, measures.without_loop, limit, "give the reference (--reference)")
    if loop is None or not loop.stable:
        why = "there is no stable closed loop to simulate"
        return _not_checked(key, name, why, limit, "see the condition of a stable closed loop")
    if possible is None:
        why = "too few samples to find what a true model reaches"
        return _not_checked(key, name, why, limit, "record longer")
    names = measures.model.output_names
    texts = [
        f"{axis} {fit:.2f} % of {best:.2f} ± {spread:.2g} %"
        for axis, fit, best, spread in zip(names, loop.fit, possible.fit, possible.deviation, strict=True)
    ]
    short = possible.fit - loop.fit - possible.chance(SIGNIFICANT)
    if np.all(short <= SHORT_OF_POSSIBLE):
        return Condition(key, name, ", ".join(texts), limit)
    return Condition(key, name, ", ".join(texts), limit, _REFUSED, _why_short(measures, short > SHORT_OF_POSSIBLE))


def _why_short(measures: Measures, poor: np.ndarray) -> str:
    loop = measures.closed_loop
    assert loop is not None
    if measures.controller_check.severity is not Severity.INFO:
        return (
            "The controller did not compute the recorded currents, so the simulated loop is another one: give the "
            "controller of this experiment first"
        )
    spread = np.vstack([record.position for record in loop.measured]).std(axis=0)
    if np.any(poor & (np.abs(loop.offset) > 0.5 * (1.0 - 0.01 * loop.fit) * spread)):
        return (
            "The simulated rotor rests elsewhere: load or operating point differ from those of the identification; "
            "identify at this operating point, or compare deviations"
        )
    best = np.broadcast_to(measures.evidence.best_fit, loop.fit.shape)
    if np.any(poor & (np.nan_to_num(best, nan=100.0) < 100.0 - SHORT_OF_POSSIBLE)):
        return (
            f"The response of the loop itself is not linear ({measures.evidence.brief}): a linear loop would fit to "
            f"about {float(np.nanmin(best)):.0f} % at most. Excite less, and see `amb distortion`"
        )
    return (
        "The closed loop follows poorly: see the conditions on the response, raise the order, and use data of region A"
    )


def _predicted(measures: Measures) -> Condition:
    key, name = "one_step_fit", "one step is predicted as well as the data allow"
    limit = f"{SHORT_OF_POSSIBLE:g} points below what the past of all signals explains"
    fit, possible = measures.one_step_fit, measures.possible_one_step_fit
    rows = zip(measures.model.output_names, fit, possible, strict=True)
    finding = ", ".join(f"{axis} {reached:.2f} % of {best:.2f} %" for axis, reached, best in rows)
    if np.all(possible - fit <= SHORT_OF_POSSIBLE):
        return Condition(key, name, finding, limit)
    return Condition(key, name, finding, limit, _REFUSED, "raise the order, or identify from data of this kind")


def _response(measures: Measures) -> Condition:
    key, name = "response", "the frequency response agrees where the data say anything"
    limit = f"{MATTERS:g} % where the loop acts, up to {MATTERS / LEAST_ACTION:g} % where it hardly does, beside chance"
    bands = measures.band_errors
    if not bands:
        return _not_checked(
            key, name, "the data say nothing at any frequency", limit,
            "excite all axes, independently or in turn, and give the reference",
        )  # fmt: skip
    where = f"{bands[0].low:.3g} to {max(band.high for band in bands):.4g} Hz"
    errors = [(band, band.error > band.limit) for band in bands if band.error > 0.0]
    significant = _beyond_chance(errors, len(bands))
    if not significant:
        return Condition(key, name, f"no error beside chance from {where}", limit)
    worst = max(significant, key=lambda band: band.error / band.limit)
    finding = (
        f"{worst.error:.3g} % off from {worst.input_name} at {worst.low:.3g} to {worst.high:.3g} Hz, allowed "
        f"{worst.limit:.3g} %; the data say something from {where}"
    )
    level = _REFUSED if worst.error > worst.limit else _RESERVED
    advice = "excite these frequencies in the identification, at this amplitude, or raise the order"
    return Condition(key, name, finding, limit, level, _by_few_samples(measures, worst, len(bands)) or advice)


_Found = TypeVar("_Found", BandError, Deviation)


def _beyond_chance(found: Sequence[tuple[_Found, bool]], count: int) -> list[_Found]:
    """Of so many findings, each with whether it matters, those that are significant.

    An error that does not matter is excused where the noise in the data of the identification explains it too.
    """
    return [one for one, matters in found if count * (one.p_value if matters else one.p_estimated) < SIGNIFICANT]


def _by_few_samples(measures: Measures, one: BandError | Deviation, count: int) -> str:
    """What to do about an error that a model from so few samples is bound to have; empty for any other."""
    if count * one.p_estimated < SIGNIFICANT:
        return ""
    return (
        f"the model was estimated from {measures.model.samples} samples, whose noise alone may cause such an error: "
        "identify from longer data"
    )


def _deviations(measures: Measures) -> Condition:
    key, name = "deviations", "gains, dead times, stiffness and modes agree"
    limit = "an error of the response as above, beside chance"
    kinds = measures.deviations
    if not kinds:
        return _not_checked(key, name, "the data say nothing of any kind", limit, "record longer, and excite all axes")
    significant = _beyond_chance([(one, one.size > 1.0) for one in kinds], len(kinds))
    if not significant:
        return Condition(key, name, f"none of {len(kinds)} kinds deviates", limit)
    worst = max(significant, key=lambda one: one.size)
    beside = [one.text for one in significant if one is not worst]
    finding = "; ".join([f"{worst.text}, {worst.size:.2g} times the error that matters", *beside[:MOST_NAMED]])
    level = _REFUSED if worst.size > 1.0 else _RESERVED
    advice = "is it another bearing or operating point? Otherwise identify anew"
    return Condition(key, name, finding, limit, level, _by_few_samples(measures, worst, len(kinds)) or advice)


def _ringing(measures: Measures) -> Condition:
    key, name = "ringing", "no mode is missing"
    limit = f"{NOTABLE:g} times what is explained beside it, with {100.0 * SHARE:g} % of the motion there"
    one = measures.ringing
    if one is None:
        why = "too few samples, or residuals that are multiples of one another"
        return _not_checked(key, name, why, limit, "record longer")
    p_value = one.p_value if one.share > SHARE else one.p_estimated
    if not (p_value < SIGNIFICANT and one.height > NOTABLE):
        return Condition(key, name, "no narrow peak in what the past explains of the residuals", limit)
    finding = f"the residuals ring at {one.frequency:.4g} Hz"
    advice = "raise the order, or remove a disturbance of this frequency"
    if one.share <= SHARE:
        finding += f", with {100.0 * one.share:.2g} % of the motion there"
        return Condition(key, name, finding, limit, _RESERVED, advice)
    here = [band for band in measures.band_errors if band.low <= one.frequency < band.high]
    if len(here) == len(measures.model.input_names) and all(band.error <= band.limit for band in here):
        finding += ", where the response agrees"
        return Condition(key, name, finding, limit, _RESERVED, advice)
    return Condition(key, name, finding, limit, _REFUSED, advice)


def _independent(measures: Measures) -> Condition:
    return _by_chance(
        "independence", "the residuals are independent of past inputs", measures.residuals.independence,
        "past inputs explain", "",
        "The plant part misses dynamics. Raise the order; if that does not help, the plant is nonlinear, or its "
        "operating point differs from that of the identification",
    )  # fmt: skip


def _white(measures: Measures) -> Condition:
    tested, removed = measures.residuals.whiteness, ", ".join(f"{one:.4g} Hz" for one in measures.removed_tones)
    heard = [] if tested.passed else [one for one in measures.tones if one.share > NOTABLE_TONE]
    tones = ", ".join(f"{one.frequency:.4g} Hz ({100.0 * one.share:.2g} %)" for one in heard)
    beside = f"; they hold tones of {tones}" if tones else ""
    beside += f"; tones of {removed} are left out of all signals" if removed else ""
    advice = (
        "A tone, as of an unbalance or of the mains, is a disturbance and no fault of the plant part; it affects "
        "predictions. Record without it, or at another speed, to see what else there is"
    )
    if not tones and not (removed and tested.passed):
        advice = (
            "The noise part is too simple, or the plant nonlinear. This affects predictions and the stated "
            "uncertainty, less the design of a controller"
        )
    one = _by_chance("whiteness", "the residuals are white", tested, "their past explains", beside, advice)
    return replace(one, level=_RESERVED, advice=advice) if removed else one


def _by_chance(key: str, name: str, test: ChiSquareTest, cause: str, beside: str, advice: str) -> Condition:
    """A test of the residuals; those that fail leave reservations."""
    finding = f"p = {test.p_value:.2g}; {cause} {100.0 * test.unexplained:.3g} % of their variance{beside}"
    limit = f"chance, p = {SIGNIFICANT:g}"
    if test.passed:
        return Condition(key, name, finding, limit)
    return Condition(key, name, finding, limit, _RESERVED, advice)


def _distortion(measures: Measures) -> Condition:
    key, name = "distortion", "the response is linear"
    limit = f"{100.0 * LARGE_DISTORTION:g} % beyond the noise, where distortion is measured"
    measured, coherence = measures.evidence.distortion, measures.evidence.coherence
    if measured is None:
        if coherence is None:
            why, advice = measures.evidence.coherence_problem, "excite with a multisine, see `amb distortion`"
            return _not_checked(key, name, f"distortion not measured, {why}", limit, advice)
        noise = measures.white and measures.independent  # then nothing but noise spoils the coherence
        if noise or not np.any(coherence.ratio > LOW_COHERENCE):
            return Condition(key, name, measures.evidence.brief, limit)
        best = float(np.nanmin(measures.evidence.best_fit))
        finding = (
            f"the loop may not be linear: {measures.evidence.brief}; a linear one fits to about {best:.0f} % at most"
        )
        return Condition(key, name, finding, limit, _RESERVED, "excite less, and see `amb distortion`")
    by_noise = np.nan_to_num(measured.noise_ratio) ** 2 / measured.periods
    if not np.any(measured.ratio**2 - by_noise > LARGE_DISTORTION**2):
        return Condition(key, name, measures.evidence.brief, limit)
    return Condition(key, name, measures.evidence.brief, limit, _RESERVED, "excite less, and see `amb distortion`")


def _fresh(measures: Measures) -> Condition:
    key, name = "fresh_data", "the data are not those of the identification"
    limit = f"{100.0 * OVERLAP:g} % of their samples in common"
    if np.isnan(measures.overlap):
        if measures.model.method and not measures.model.samples:
            return _not_applying(key, name, "the model names no samples that it was estimated from", limit)
        return _not_checked(key, name, "the model has no fingerprint of its data", limit, _ANEW)
    if not measures.overlap > OVERLAP:
        return Condition(
            key, name, "no samples in common" if measures.overlap == 0.0 else "hardly any in common", limit
        )
    finding = f"about {100.0 * measures.overlap:.0f} % of the samples of the identification are in these data"
    return Condition(key, name, finding, limit, _RESERVED, "validate on another experiment")


def _converged(measures: Measures) -> Condition:
    key, name, limit = "convergence", "the search of the identification converged", "no further step promises anything"
    search, method = measures.search, measures.model.method
    if search is None:
        if method and method != PEM and not method.endswith(FOCUSED):
            return _not_applying(key, name, f"the method ({method}) searches no parameters", limit)
        return _not_checked(key, name, "the model does not hold how its search ended", limit, _ANEW)
    finding = f"{search.iterations} steps, {100.0 * search.left:.2g} % of the squared error left"
    if search.converged:
        return Condition(key, name, finding, limit)
    return Condition(key, name, finding, limit, _RESERVED, "lower the order, or use data with more noise than rounding")


def _decided(measures: Measures) -> Condition:
    key, name = "poles", "the data decide which poles are stable"
    limit, method = "no interval of a pole contains 1", measures.model.method
    if measures.undecided is None:
        if method and method != PEM:
            return _not_applying(key, name, f"the method ({method}) states no uncertainty", limit)
        return _not_checked(key, name, "the uncertainty of the model is not known", limit, _ANEW)
    if not measures.undecided:
        return Condition(key, name, "they do", limit)
    return Condition(key, name, measures.undecided, limit, _RESERVED, "record longer, or excite low frequencies more")


def _noise(measures: Measures) -> Condition:
    key, name = "noise_model", "the model has a noise part of its own"
    limit = "a gain K"
    if np.any(measures.model.k) and not measures.noise_from_data:
        return Condition(key, name, "it has", limit)
    estimated = "for the predictions one was estimated from these data"
    finding = f"it has none, K = 0: {estimated if measures.noise_from_data else 'nor do these data give one'}"
    advice = "none is needed for the design of a controller; to predict, identify the model, or give it a gain"
    return Condition(key, name, finding, limit, _RESERVED, advice)


def _not_checked(key: str, name: str, why: str, limit: str, advice: str) -> Condition:
    """A condition that there is nothing to check with: it leaves reservations."""
    return Condition(key, name, f"{NOT_CHECKED}: {why}", limit, _RESERVED, advice, checked=False)


def _not_applying(key: str, name: str, why: str, limit: str) -> Condition:
    """A condition that does not concern this model."""
    return Condition(key, name, f"does not apply: {why}", limit, checked=False)


Rule = Callable[[Measures], Condition]

RULES: tuple[tuple[Rule, str, str, str], ...] = (
    (_stable, "closed loop stable", "poles of model and controller", "refused; not known: reservations"),
    (_controller, "controller", "recorded currents against those it computes from the recorded positions",
     "reservations, also if it is not known"),
    (_sound, "samples", "frozen, missing, repeated, coarse or exchanged signals, outliers, and slow drift",
     "reservations"),
    (_followed, "closed-loop fit", "simulated from the reference alone; compared with what a regression of up to "
     f"{LAGS[-1]} lags on the references reaches, whatever the model, each axis: more than {SHORT_OF_POSSIBLE:g} "
     "points worse", "refused; not known: reservations"),
    (_predicted, "one-step fit", "compared with what 25 past samples of all signals explain, but for tones, each axis: "
     f"more than {SHORT_OF_POSSIBLE:g} points worse", "refused"),
    (_response, "response by frequency", f"error from each input in bands in which noise leaves less than "
     f"{RESOLVED:g} % open: significant and above {MATTERS:g} % / T, at most {MATTERS / LEAST_ACTION:g} %",
     "refused; smaller: reservations"),
    (_deviations, "kinds of deviation", "gain, dead time, stiffness of each axis and of all, frequency of each mode, "
     "one after the other: significant beyond those before, and an error of the response above the same limit",
     "refused; smaller: reservations"),
    (_ringing, "missing modes", "lightly damped resonators driven by past errors and inputs explain significantly more "
     f"of the errors at a frequency, {NOTABLE:g} times as much as beside it, with {100.0 * SHARE:g} % of the motion; "
     "tones, and what gains, dead times and stiffness would do, are left out",
     "refused; smaller, or where the response agrees: reservations"),
    (_independent, "independence", "score test of the residuals, without tones that the reference lacks, on the "
     "inputs of 25 samples before", "reservations"),
    (_white, "whiteness", "portmanteau test of the residuals over 25 lags", "reservations"),
    (_distortion, "distortion", f"above {100.0 * LARGE_DISTORTION:g} % beyond the noise where it can be measured; else "
     f"noise and distortion above {100.0 * LOW_COHERENCE:g} % with residuals that are not noise",
     "reservations, also where neither is measured"),
    (_fresh, "other data", f"more than {100.0 * OVERLAP:g} % of the samples of the identification, by content",
     "reservations, also if it is not known"),
    (_converged, "convergence", "the search of `pem` or of simulation focus, which the model holds",
     "reservations, also if it is not known"),
    (_decided, "stability of poles", "an interval of 99 % of a pole of a model of `pem` contains 1, which the model "
     "holds", "reservations, also if it is not known"),
    (_noise, "noise part", "a model without a gain, K = 0, gets one from the data, with which the rest is judged",
     "reservations"),
)  # fmt: skip
"""Each rule with its name, what is done, and what a failure does: the table of the documentation."""


def rule_table() -> str:
    """The rules as a table in Markdown."""
    rows = [f"| {name} | {what} | {effect} |" for _, name, what, effect in RULES]
    return "\n".join(["| condition | what is compared, and what fails | a failure |", "|---|---|---|", *rows])
