"""The sections of a report on the model identified from a recording: model, frequency response, validation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from amb_core.data.analysis import recorded_data
from amb_core.data.controller_choice import ALLOWED, needs_controller
from amb_core.ground.errors import IdentificationError
from amb_core.ground.progress import Progress
from amb_core.identification import Identification, identify
from amb_core.identification.validation import Validation, Verdict
from amb_core.report.figures.bode import bode_chart
from amb_core.report.figures.comparison import comparison_chart, longest_of, title_of_longest
from amb_core.report.figures.entries import Entry, entries_from
from amb_core.report.figures.order import order_chart
from amb_core.report.pages.document import Badge, Block, Cell, FigureBlock, Prose, Section, TableBlock
from amb_core.report.pages.robustness import certificate_of_recording, robustness_badge, robustness_section
from amb_core.report.pages.validation import HEADING as VALIDATION
from amb_core.report.pages.validation import fit_badge, validation_reason, validation_section, verdict_badge

if TYPE_CHECKING:
    from amb_core.loop.known_controller import KnownController
    from amb_core.loop.records import LoopRecord
    from amb_core.recording import Recording
    from amb_core.robustness import Certificate


HEADING = "Identified model"
ZOOM = 0.05  # s


@dataclass(frozen=True)
class IdentifiedModel:
    """The model of a recording, its validation or the reason why there is none, and the sections that show both."""

    result: Identification
    validation: Validation | None
    not_validated_because: str
    sections: list[Section]
    robustness: Badge | None = None

    @property
    def verdict(self) -> Badge:
        """The verdict of the validation; not validated where none is possible."""
        if self.validation is None:
            return Badge(Verdict.NOT_VALIDATED, "bad", VALIDATION)
        return verdict_badge(self.validation)

    @property
    def reason(self) -> str:
        """Why the verdict is what it is, in a sentence."""
        if self.validation is None:
            return f"The data allow no validation: {self.not_validated_because}."
        return validation_reason(self.validation)

    @property
    def badges(self) -> list[tuple[str, Badge]]:
        """Robustness, if it was asked for, fit of each output, order and unstable poles, each with its name."""
        model = self.result.model
        fits = [] if self.validation is None else _fits(self.validation)
        unstable = Badge(str(len(model.unstable_poles())), section=HEADING)
        robust = [] if self.robustness is None else [("robustness", self.robustness)]
        return [*robust, *fits, ("order", Badge(str(model.order), section=HEADING)), ("unstable poles", unstable)]


def _fits(validation: Validation) -> list[tuple[str, Badge]]:
    """Of each output in closed loop, or one step ahead where the loop was not simulated."""
    names = validation.model.output_names
    return [
        (f"closed-loop fit, {name}", fit_badge(validation, fit))
        for name, fit in zip(names, validation.fit, strict=False)
    ] or [
        (f"one-step fit, {name}", Badge(f"{fit:.2f} %", section=VALIDATION))
        for name, fit in zip(names, validation.one_step_fit, strict=True)
    ]


def identified_model(
    recording: Recording,
    run: int,
    order: int | Literal["auto"],
    controller: KnownController | None,
    progress: Progress,
    entries: str = "",
    certified: bool = False,
) -> IdentifiedModel:
    """Identify a model from the last experiment of a run, validate it on the same data, and certify it if wanted.

    Raises
    ------
    BagError, IdentificationError
        If there is no such experiment, the data determine no model, or the controller is not known.
    """
    data = recorded_data(recording, run)
    if controller is None and needs_controller(data):
        raise IdentificationError(f"the bag lacks the controller's parameters; name it with --controller: {ALLOWED}")
    drawn = entries_from(entries, data.input_names, data.output_names)
    progress("identifying", 0, None)
    result = identify(data, order, controller=controller)
    progress("validating", 0, None)
    validation, why_not = _validation(result, recording, run)
    sections = [_model(result, validation)]
    if validation is None:
        sections.append(Section(VALIDATION, [Prose(f"Not possible: {why_not}.")]))
    else:
        sections += [_responses(validation, drawn), validation_section(validation)]
    if not certified:
        return IdentifiedModel(result, validation, why_not, sections)
    certificate: Certificate | str = f"the data allow no validation of the model: {why_not}"
    if validation is not None:
        plant = recording.plant_parameters(run)
        certificate = certificate_of_recording(result, validation, controller, plant, progress)
    sections.append(robustness_section(certificate))
    return IdentifiedModel(result, validation, why_not, sections, robustness_badge(certificate))


def _validation(result: Identification, recording: Recording, run: int) -> tuple[Validation | None, str]:
    """On the data of the estimate; or why it is not possible, as of too few of them."""
    try:
        return result.validated(recording.plant_parameters(run)), ""
    except IdentificationError as problem:
        return None, str(problem)


def _model(result: Identification, validation: Validation | None) -> Section:
    blocks: list[Block] = [Prose(f"{result.summary}.")]
    blocks += [Prose(f"Warning: {finding.check}: {finding.text}.") for finding in result.report.warnings]
    if result.uncertainty is not None:
        blocks.append(Prose(f"{result.uncertainty.summary}."))
    blocks.append(_poles(result))
    if result.order_selection is not None:
        blocks.append(FigureBlock(order_chart(result.order_selection).page(), "Choice of the order"))
    loop = None if validation is None else validation.closed_loop
    if loop is not None:
        longest = longest_of(loop.measured)
        simulated = loop.simulated[longest]
        if simulated is not None:
            page = comparison_chart(loop.measured[longest], {"model": simulated}).page()
            blocks.append(FigureBlock(page, title_of_longest("Response of plant and model", loop.measured)))
            blocks += _worst(loop.measured[longest], simulated)
    return Section(HEADING, blocks)


def _worst(measured: LoopRecord, simulated: LoopRecord) -> list[Block]:
    """The short stretch about the largest error: a long record shows neither its course nor the model's."""
    steps = round(ZOOM / measured.sample_time)
    if measured.steps < 2 * steps:
        return []
    error = np.nan_to_num(np.abs(measured.position - simulated.position)).max(axis=1)
    start = int(np.clip(np.argmax(error) - steps // 2, 0, measured.steps - steps))
    parts = [record.window(record.first_step + start, steps) for record in (measured, simulated)]
    page = comparison_chart(parts[0], {"model": parts[1]}).page()
    return [FigureBlock(page, f"The {1e3 * ZOOM:g} ms about the largest error")]


def _poles(result: Identification) -> TableBlock:
    """Poles as rates in continuous time, with their standard deviations where those are known."""
    model = result.model
    poles = model.poles()
    deviations = None if result.uncertainty is None else result.uncertainty.pole_deviations()
    rows: list[Sequence[Cell]] = []
    for number, pole in enumerate(poles):
        if pole.imag < 0.0:
            continue
        rate = np.log(pole) / model.sample_time
        kind = Badge("unstable", "limited") if abs(pole) > 1.0 else "stable"
        frequency = f"{abs(rate) / (2.0 * math.pi):.1f} Hz"
        damping = f"{-rate.real / abs(rate):.3f}"
        shown = f"{pole.real:.6f}" if pole.imag == 0.0 else f"{pole.real:.6f} ± {pole.imag:.6f}j"
        known = "" if deviations is None else f"{deviations[number].max():.2g}"
        rows.append((shown, known, frequency, damping, kind))
    return TableBlock(
        ("pole z", "standard deviation (worse of real and imaginary part)", "natural frequency", "damping ratio", ""),
        rows,
        "Poles of the plant",
    )


def _responses(validation: Validation, entries: list[Entry] | None) -> Section:
    return Section(
        "Frequency response",
        [
            Prose("From control currents to positions. Bands hold the response with a confidence of 99 %."),
            FigureBlock(bode_chart(validation.frequency.responses, entries=entries).page()),
        ],
    )
