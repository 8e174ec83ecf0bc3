"""A certificate as a page: the verdict first, then what it rests on."""

from __future__ import annotations

import math
from pathlib import Path

from amb_core.ground.errors import AmbError
from amb_core.ground.given_values import path_of, require_kind
from amb_core.report.figures.robustness import mu_chart, sensitivity_chart
from amb_core.report.pages.certificate_trace import header_table, signature_section, trace_section
from amb_core.report.pages.document import (
    Badge,
    Block,
    FigureBlock,
    Prose,
    Report,
    Section,
    State,
    TableBlock,
    VerdictStrip,
)
from amb_core.report.pages.writer import write_report
from amb_core.robustness.assessment import Assessment
from amb_core.robustness.certificate import Certificate, Statement
from amb_core.robustness.certificate_json import certificate_json, compared_values
from amb_core.robustness.margins import DiskMargin, reciprocal
from amb_core.robustness.measured import MeasuredSensitivity

SENSITIVITY = "Sensitivity"
WORDS: dict[Statement, str] = {
    "restricted": "not certified as a whole: a band only",
    "predicted": "predicted, not certified",
}
STATES: dict[Statement, State] = {
    "certified": "good",
    "certified with reservations": "limited",
    "predicted": "limited",
    "restricted": "limited",
    "not certified": "bad",
}


def certificate_report(certificate: Certificate, title: str = "Robustness certificate") -> Report:
    """The page of a certificate."""
    rows = [(one.name, _result(one.passed), one.finding) for one in certificate.checks]
    trace = certificate.trace
    opening: list[Block] = [] if trace is None else [header_table(trace)]
    opening.append(TableBlock(("check", "result", "finding"), rows, "Checks"))
    opening += [Prose(f"Warning: {text}.") for text in certificate.warnings]
    sections = []
    if certificate.assessment is not None:
        sections = robustness_sections(certificate)
    sections.append(_inputs(certificate))
    if trace is not None:
        sections += [trace_section(trace), signature_section(trace)]
    return Report(
        title,
        "What was checked, and what each check found. Sizes of the assumed perturbations and limits are at the end.",
        opening,
        sections,
        "The same inputs give the same numbers: amb certify --again certificate.json computes them again.",
        _strip(certificate),
    )


def write_certificate(certificate: Certificate, folder: str | Path) -> Path:
    """Write certificate.html and certificate.json into a folder, which is made; returns the page.

    A certificate.pdf of before is removed: it may say the contrary.

    Raises
    ------
    AmbError
        If they cannot be written.
    """
    require_kind("certificate", certificate, Certificate, "what certify returns", AmbError)
    page = path_of("folder", folder) / "certificate.html"
    values, printed = page.with_suffix(".json"), page.with_suffix(".pdf")
    try:
        printed.unlink(missing_ok=True)
    except OSError as problem:
        raise AmbError(f"{printed}: of another certificate, and cannot be removed: {problem.strerror}") from None
    write_report(certificate_report(certificate), page)
    try:
        values.write_text(certificate_json(certificate), encoding="utf-8")
    except OSError as problem:
        raise AmbError(f"{values}: cannot be written: {problem.strerror}") from None
    return page


def _result(passed: bool) -> Badge:
    return Badge("passed", "good") if passed else Badge("failed", "bad")


def _strip(certificate: Certificate) -> VerdictStrip:
    """The verdict, and the peak sensitivity and zone of each axis."""
    outcome = Badge(WORDS.get(certificate.statement, certificate.statement), STATES[certificate.statement])
    assessment, numbers = certificate.assessment, []
    if assessment is not None:
        bounds = {} if assessment.bounds is None else {item.name: item for item in assessment.bounds.axes}
        for axis in assessment.axes:
            one = bounds.get(axis.name)
            value, zone = (one.sensitivity.value, one.zone) if one else (axis.sensitivity.value, axis.zone)
            sure = f" with {100.0 * assessment.settings.confidence:g} %" if one else ""
            numbers.append(
                (f"peak sensitivity, {axis.name}{sure}", Badge(f"{value:.3f}, zone {zone}", section=SENSITIVITY))
            )
    return VerdictStrip(outcome, certificate.verdict, numbers)


def robustness_sections(certificate: Certificate) -> list[Section]:
    """The sections on sensitivity, margins and structured singular value."""
    assessment = certificate.assessment
    assert assessment is not None
    return [_sensitivity(certificate, assessment), *_known(certificate), _margins(assessment), _structured(assessment)]


def _sensitivity(certificate: Certificate, assessment: Assessment) -> Section:
    bounds = {item.name: item for item in assessment.bounds.axes} if assessment.bounds is not None else {}
    rows = []
    for axis in assessment.axes:
        one = bounds.get(axis.name)
        rows.append(
            (
                axis.name,
                f"{axis.sensitivity.value:.4f} at {axis.sensitivity.frequency:.4g} Hz",
                axis.zone,
                "" if one is None else f"{one.sensitivity.value:.4f}",
                "" if one is None else one.zone,
                "" if one is None else f"{one.sensitivity_of_all.value:.4f}",
                f"{axis.complementary.value:.4f} at {axis.complementary.frequency:.4g} Hz",
            )
        )
    percent = f"{100.0 * assessment.settings.confidence:g} %"
    header = (
        "axis", "peak of |S|", "zone", f"bound with {percent}", f"zone with {percent}", "bound with all parameters",
        "peak of |T|",
    )  # fmt: skip
    limits = ", ".join(f"{limit:g}" for limit in assessment.settings.sensitivity_limits)
    blocks: list[Block] = [
        TableBlock(header, rows, "Peaks and zones after ISO 14839-3"),
        Prose(
            f"Limits of the zones: {limits}; check them against the standard. All axes together: largest singular "
            f"value of S {assessment.sensitivity.value:.4f} at {assessment.sensitivity.frequency:.4g} Hz, of T "
            f"{assessment.complementary.value:.4f} at {assessment.complementary.frequency:.4g} Hz."
        ),
        FigureBlock(sensitivity_chart(assessment, certificate.measured).page()),
    ]
    if certificate.measured is not None:
        blocks.append(Prose(_compared(certificate.measured, assessment)))
    if certificate.displacement:
        blocks.append(TableBlock(("axis", "zone"), list(certificate.displacement.items()), "Zones after ISO 14839-2"))
    return Section(SENSITIVITY, blocks)


def _known(certificate: Certificate) -> list[Section]:
    """Of which frequencies something is stated, and by what."""
    known, assessment = certificate.known, certificate.assessment
    if known is None or known.empty or assessment is None or assessment.bounds is None:
        return []
    settings = certificate.settings
    no = "nothing: no statement"
    slower = f"modes as above that ring down within {settings.mode_ring_down:g} s use up {known.slower:.2g} there"
    if known.slower >= 1.0:
        slower = "the residuals show no slower modes"
    below = f"taken as wrong as at its lower end; {slower}" if known.reaches_down else no
    above = (
        f"a mass, and modes of damping ratio {settings.mode_damping:g} or more and {settings.mode_gain:g} times its "
        f"motion or less: they use up {known.beyond:.2g} of what the loop tolerates"
    )
    rows = [
        (f"below {known.low:.3g} Hz", below),
        (
            known.text,
            f"the data; modes that the model may lack have a damping ratio of {settings.mode_damping:g} or more and "
            f"ring down within {settings.mode_ring_down:g} s",
        ),
        (f"above {known.high:.4g} Hz", above if known.reaches_up else f"{no}; {above}"),
    ]
    motion = ", ".join(f"{name} {1e6 * value:.3g} µm" for name, value in (certificate.amplitude or {}).items())
    text = (
        f"Of what the loop tolerates at a frequency, the error of the response and the models use up "
        f"{assessment.bounds.small_gain:.2g} at most, at {assessment.bounds.small_gain_frequency:.4g} Hz. Motions in "
        f"the data, from the middle: {motion}. Nothing is stated of larger ones."
    )
    return [
        Section(
            "What is known", [TableBlock(("frequency", "what the bounds rest on"), rows, "Frequencies"), Prose(text)]
        )
    ]


def _compared(measured: MeasuredSensitivity, assessment: Assessment) -> str:
    values = compared_values(measured, assessment)
    if not values["frequencies"]:
        return f"Measured: {measured.method}. Nowhere is it known well enough to be compared with the model."
    peaks = ", ".join(f"{name} {value:.4f}" for name, value in values["peaks"].items())
    return (
        f"Measured: {measured.method}. Peaks: {peaks}. Difference from the model at {values['frequencies']} "
        f"frequencies from {values['from_hz']:.4g} to {values['to_hz']:.4g} Hz, where the measurement is coherent and "
        f"known to 0.1 dB: {values['worst_difference_db']:.2f} dB at most, {values['median_difference_db']:.3f} dB "
        "median."
    )


def _margins(assessment: Assessment) -> Section:
    rows = [
        (
            axis.name,
            f"{decibel(axis.margins.gain_up.value)} at {axis.margins.gain_up.frequency:.4g} Hz",
            f"{decibel(axis.margins.gain_down.value)} at {axis.margins.gain_down.frequency:.4g} Hz",
            f"{math.degrees(axis.margins.phase.value):.1f}° at {axis.margins.phase.frequency:.4g} Hz",
            f"{1e6 * axis.margins.delay.value:.4g} us at {axis.margins.delay.frequency:.4g} Hz",
        )
        for axis in assessment.axes
    ]
    disks = [_disk(item) for item in (*(axis.disk for axis in assessment.axes), *assessment.disks)]
    header = ("axis", "gain up", "gain down", "phase", "delay")
    blocks: list[Block] = [
        TableBlock(header, rows, "Classical margins of each axis, all others closed"),
        TableBlock(("where", "alpha", "broken at", "gain", "phase", "frequency"), disks, "Disk margins"),
    ]
    if assessment.bounds is not None:
        gap, percent = assessment.bounds.gap, f"{100.0 * assessment.settings.confidence:g} %"
        worst = ", ".join(f"{item.name} {reciprocal(item.disk.value):.4f}" for item in assessment.bounds.axes)
        blocks.append(
            Prose(
                f"With {percent} of the models: disk margins {worst}, of all outputs "
                f"{reciprocal(assessment.bounds.outputs.value):.4f}; nu-gap at most {gap.worst.value:.4f}, of which "
                f"the loop tolerates {gap.margin:.4f}."
            )
        )
    return Section("Margins", blocks)


def _structured(assessment: Assessment) -> Section:
    mu = assessment.mu
    worst = (
        f"One of {1.0 / mu.lower:.3f} times their size puts a pole within {assessment.on_circle:.1g} of the unit "
        f"circle, at {mu.lower_frequency:.4g} Hz."
        if mu.lower
        else "No perturbation was found that makes the loop unstable."
    )
    size = f"{1.0 / mu.upper:.3f} times" if mu.upper else "any size of"
    text = f"The loop tolerates {size} the assumed perturbations together. {worst}"
    return Section("Structured singular value", [Prose(text), FigureBlock(mu_chart(assessment).page())])


def _inputs(certificate: Certificate) -> Section:
    rows = [(name, value) for name, value in certificate.inputs.items()]
    settings = [(name, f"{value}") for name, value in certificate.settings.model_dump().items()]
    return Section(
        "Inputs",
        [
            TableBlock(("input", "SHA-256"), rows, "What was read"),
            TableBlock(("setting", "value"), settings, "What was assumed and demanded"),
        ],
    )


def _disk(item: DiskMargin) -> tuple[str, str, str, str, str, str]:
    low, high = item.gain
    return (
        item.where,
        f"{item.guaranteed:.4f}",
        f"{item.broken:.4f}",
        f"{decibel(low)} to {decibel(high)}",
        f"±{math.degrees(item.phase):.1f}°",
        f"{item.frequency:.4g} Hz",
    )


def decibel(value: float) -> str:
    """A gain margin in dB; any where nothing limits it."""
    return "any" if value <= 0.0 or math.isinf(value) else f"{20.0 * math.log10(value):.2f} dB"
