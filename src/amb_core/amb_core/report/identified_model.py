"""The sections of a report on the model identified from a recording: model, frequency response, validation."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Literal

import numpy as np

from amb_core.analysis import recorded_data
from amb_core.errors import IdentificationError
from amb_core.figures.bode import bode_chart
from amb_core.figures.comparison import comparison_chart
from amb_core.figures.entries import Entry, entries_from
from amb_core.figures.order import order_chart
from amb_core.figures.residuals import residuals_chart
from amb_core.identification import Identification, identify
from amb_core.identification.controller_choice import ALLOWED, needs_controller
from amb_core.identification.validation import Validation, validate
from amb_core.report.document import Block, FigureBlock, Listing, Prose, Section, TableBlock

if TYPE_CHECKING:
    from amb_core.loop.known_controller import KnownController
    from amb_core.recording import Recording


def identified_sections(
    recording: Recording,
    run: int,
    order: int | Literal["auto"],
    controller: KnownController | None,
    tell: Callable[[str], None],
    entries: str = "",
) -> list[Section]:
    """Identify a model from the last experiment of a run, and validate it on the same data.

    Raises
    ------
    BagError, IdentificationError
        If there is no such experiment, the data determine no model, or the controller is not known.
    """
    data = recorded_data(recording, run)
    if controller is None and needs_controller(data):
        raise IdentificationError(f"the bag lacks the controller's parameters; name it with --controller: {ALLOWED}")
    drawn = entries_from(entries, data.input_names, data.output_names)
    tell("identifying")
    result = identify(data, order, controller=controller)
    tell("validating")
    validation = validate(
        result.model, data, controller, uncertainty=result.uncertainty, plant=recording.plant_parameters()
    )
    return [_model(result, validation), _responses(validation, drawn), _validation(validation)]


def _model(result: Identification, validation: Validation) -> Section:
    blocks: list[Block] = [Prose(f"{result.summary}.")]
    blocks += [Prose(f"Warning: {finding.check}: {finding.text}.") for finding in result.report.warnings]
    if result.uncertainty is not None:
        blocks.append(Prose(f"{result.uncertainty.summary}."))
    blocks.append(_poles(result))
    if result.order_selection is not None:
        blocks.append(FigureBlock(order_chart(result.order_selection).page(), "Choice of the order"))
    loop = validation.closed_loop
    if loop is not None:
        longest = int(np.argmax([record.steps for record in loop.measured]))
        simulated = loop.simulated[longest]
        if simulated is not None:
            page = comparison_chart(loop.measured[longest], {"model": simulated}).page()
            blocks.append(FigureBlock(page, "Response of plant and model"))
    return Section("Identified model", blocks)


def _poles(result: Identification) -> TableBlock:
    """Poles as rates in continuous time, with their standard deviations where those are known."""
    model = result.model
    poles = model.poles()
    deviations = None if result.uncertainty is None else result.uncertainty.pole_deviations()
    rows = []
    for number, pole in enumerate(poles):
        if pole.imag < 0.0:
            continue
        rate = np.log(pole) / model.sample_time
        kind = "unstable" if abs(pole) > 1.0 else "stable"
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


def _validation(validation: Validation) -> Section:
    tests = (validation.residuals, validation.model.input_names, validation.model.output_names)
    return Section(
        "Validation",
        [
            Prose(
                "Validated on the data that the model was identified from. Data of another experiment are more "
                "conclusive."
            ),
            Listing(validation.report(), "All tests"),
            FigureBlock(residuals_chart(*tests).page(), "Residuals"),
        ],
    )
