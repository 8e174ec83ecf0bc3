"""The section of a report on the robustness of the identified model with the controller of its recording."""

from __future__ import annotations

import math

from amb_core.ground.errors import AmbError
from amb_core.ground.progress import Progress
from amb_core.identification import Identification
from amb_core.identification.validation import Validation
from amb_core.loop.known_controller import KnownController
from amb_core.plant import PlantParameters
from amb_core.report.figures.robustness import sensitivity_chart
from amb_core.report.pages.certificate import STATES, WORDS, decibel
from amb_core.report.pages.document import Badge, Block, FigureBlock, Prose, Section, TableBlock
from amb_core.robustness import Assessment, Certificate, Recorded, certify_from_data

HEADING = "Robustness"


def certificate_of_recording(
    result: Identification,
    validation: Validation,
    controller: KnownController | None,
    plant: PlantParameters | None,
    progress: Progress,
) -> Certificate | str:
    """The certificate of a model that was identified from a recording; or why there is none."""
    if controller is None:
        return "the controller is not known"
    law = controller.at_rate(result.data.sample_rate)
    try:
        return certify_from_data(
            result.model, law, Recorded(result.data, law, plant), validation=validation,
            uncertainty=result.uncertainty, progress=lambda stage: progress(stage, 0, None),
        )  # fmt: skip
    except AmbError as problem:
        return str(problem)


def robustness_badge(certificate: Certificate | str) -> Badge:
    """The verdict in a few words, linked to the section."""
    if isinstance(certificate, str):
        return Badge("not computed", section=HEADING)
    assessment, state = certificate.assessment, STATES[certificate.statement]
    if assessment is None:
        return Badge("not certified: unstable loop", state, HEADING)
    if not certificate.certified:
        return Badge(WORDS.get(certificate.statement, "not certified"), state, HEADING)
    assert assessment.bounds is not None
    zone = max(item.zone for item in assessment.bounds.axes)  # A is the best
    percent = f"{100.0 * assessment.settings.confidence:g} %"
    return Badge(f"{certificate.statement}, zone {zone} with {percent}", state, HEADING)


def robustness_section(certificate: Certificate | str) -> Section:
    """Verdict, margins with the bounds that the data allow, and the sensitivity over frequency."""
    if isinstance(certificate, str):
        return Section(HEADING, [Prose(f"Not computed: {certificate}.")])
    blocks: list[Block] = [Prose(certificate.verdict)]
    blocks += [Prose(f"Warning: {text}.") for text in certificate.warnings]
    assessment = certificate.assessment
    if assessment is not None:
        blocks += [
            _margins(assessment),
            FigureBlock(sensitivity_chart(assessment, certificate.measured).page(), "Sensitivity"),
            Prose(
                "The loop is that of the recording; the assumed perturbations and the limits are the defaults. "
                "amb certify takes other controllers, perturbations and limits, a second recording for the validation "
                "and a swept sine, and writes a page to be signed, with worst cases and hashes of its inputs."
            ),
        ]
    return Section(HEADING, blocks)


def _margins(assessment: Assessment) -> TableBlock:
    bounds = {} if assessment.bounds is None else {item.name: item for item in assessment.bounds.axes}
    percent = f"{100.0 * assessment.settings.confidence:g} %"
    rows = []
    for axis in assessment.axes:
        one = bounds.get(axis.name)
        rows.append(
            (
                axis.name,
                f"{axis.sensitivity.value:.3f} at {axis.sensitivity.frequency:.4g} Hz, zone {axis.zone}",
                f"{one.sensitivity.value:.3f}, zone {one.zone}" if one else "not known",
                f"{decibel(axis.margins.gain_down.value)} to {decibel(axis.margins.gain_up.value)}",
                f"{math.degrees(axis.margins.phase.value):.1f}°",
                f"{1e6 * axis.margins.delay.value:.4g} µs",
                f"{axis.disk.guaranteed:.3f}",
            )
        )
    header = ("axis", "peak of |S|", f"bound with {percent}", "gain", "phase", "delay", "disk margin")
    return TableBlock(header, rows, "Margins of each axis, all others closed")
