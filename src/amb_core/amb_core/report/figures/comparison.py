"""Models in closed loop over the measured response (the paper's Fig. 14 and 15), and all figures of a validation."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from amb_core.ground.units import UM
from amb_core.identification.fit import fit_text
from amb_core.identification.frequency_response import FrequencyResponse
from amb_core.identification.validation import Validation, nrmse_fit
from amb_core.loop.records import LoopRecord
from amb_core.report.figures.bode import bode_chart
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Panel
from amb_core.report.figures.entries import Entry
from amb_core.report.figures.prediction import prediction_chart
from amb_core.report.figures.residuals import residuals_chart
from amb_core.report.figures.style import MODELS, PLANT, REFERENCE, Stroke
from amb_core.report.figures.thinning import extremes

TITLE = "Closed loop of model and controller next to the data"
DEVIATIONS = "deviations alone"


def comparison_chart(
    measured: LoopRecord,
    simulated: Mapping[str, LoopRecord],
    title: str = TITLE,
    strokes: Sequence[Stroke] = MODELS,
    without_error: Collection[str] = (),
) -> Chart:
    """Measured and simulated positions over time, and their difference, axes in s and um.

    Parameters
    ----------
    measured : LoopRecord
        Record of the loop.
    simulated : mapping of str to LoopRecord
        Records of models in the loop under the same reference, by name.
    title : str, optional
        Title of the figure.
    strokes : sequence of Stroke, optional
        Look of the models' curves, in turn.
    without_error : collection of str, optional
        Models whose error is not drawn: an offset would hide that of the others.

    Returns
    -------
    Chart
        The chart, ready to save.
    """
    panels, sentences = [], []
    fits = {name: nrmse_fit(measured.position, record.position) for name, record in simulated.items()}
    for axis, name in enumerate(measured.axes):
        curves = [
            Curve(*extremes(measured.time, UM * measured.reference[:, axis]), "reference", REFERENCE),
            Curve(*extremes(measured.time, UM * measured.position[:, axis]), "measured", PLANT),
        ]
        errors = []
        for number, (label, record) in enumerate(simulated.items()):
            stroke = strokes[number % len(strokes)]
            curves.append(Curve(*extremes(record.time, UM * record.position[:, axis]), label, stroke))
            if label in without_error:
                continue
            error = UM * (measured.position[:, axis] - record.position[:, axis])
            errors.append(Curve(*extremes(record.time, error), label, stroke))
        heading = f"{name}: " + ", ".join(f"{label} {fit_text(fit[axis], 1)}" for label, fit in fits.items())
        panels.append(Panel(Axis("time (s)"), Axis(f"{name} (µm)"), tuple(curves), heading))
        panels.append(Panel(Axis("time (s)"), Axis(f"error {name} (µm)"), tuple(errors)))
    for label, fit in fits.items():
        parts = [f"{fit_text(value, 1)} on {name}" for name, value in zip(measured.axes, fit, strict=True)]
        sentences.append(f"{label} fits to {', '.join(parts[:-1])}{' and ' if parts[1:] else ''}{parts[-1]}")
    alt = (
        f"Measured position of the rotor from {measured.time[0]:.2f} s to {measured.time[-1]:.2f} s, and that of "
        f"models in closed loop with the same controller: {'; '.join(sentences)}."
    )
    return Chart(title, alt, tuple(panels), shared_x=True, size=(9.0, 4.5 * len(measured.axes)))


def longest_of(records: Sequence[LoopRecord]) -> int:
    """Place of the longest record, the only one that a figure shows."""
    return int(np.argmax([record.steps for record in records]))


def title_of_longest(title: str, records: Sequence[LoopRecord]) -> str:
    """The title of a figure of the longest record; it names the steps where there are others, of which nothing is seen.

    Parameters
    ----------
    title : str
        What the figure shows.
    records : sequence of LoopRecord
        All parts; at least one.

    Returns
    -------
    str
        The title, with the part that it is of.
    """
    if len(records) == 1:
        return title
    shown = records[longest_of(records)]
    steps = f"steps {shown.first_step} to {shown.first_step + shown.steps - 1}"
    return f"{title}, the longest of {len(records)} parts ({steps}); fits are of this part"


def save_validation_figures(
    folder: str | Path, validations: Mapping[str, Validation], entries: Sequence[Entry] | None = None
) -> list[str]:
    """Write response, prediction, Bode diagram and residuals of one or more models, validated on the same data.

    Parameters
    ----------
    folder : path
        Made if it does not exist.
    validations : mapping of str to Validation
        By name of the model; at least one.
    entries : sequence of tuple of str, optional
        Entries of the Bode diagram, see `bode_chart`; by default all.

    Returns
    -------
    list of str
        Names of the figures, without endings: `response` of the longest experiment, where the closed loop is known,
        `prediction`, `bode`, and `residuals` or, of more models, `residuals_1` and so on.

    Raises
    ------
    AmbError
        If a file cannot be written.
    """
    one = next(iter(validations.values()))
    names = ["prediction", "bode"]
    predictions = {label: item.prediction for label, item in validations.items()}
    drawn = (predictions, one.data.sample_time, one.model.output_names)
    prediction_chart(*drawn).save(folder, "prediction")
    responses = _responses(validations)
    bode_chart(responses, entries=entries).save(folder, "bode")
    measured, simulated = _closed_loops(validations)
    if measured and simulated:
        title = title_of_longest(TITLE, measured)
        response = (measured[longest_of(measured)], simulated, title, MODELS, (DEVIATIONS,))
        comparison_chart(*response).save(folder, "response")
        names.insert(0, "response")
    for number, (label, item) in enumerate(validations.items(), start=1):
        name = "residuals" if len(validations) == 1 else f"residuals_{number}"
        tests = (item.residuals, item.model.input_names, item.model.output_names, f"Residuals of {label}")
        residuals_chart(*tests).save(folder, name)
        names.append(name)
    return names


def _closed_loops(validations: Mapping[str, Validation]) -> tuple[Sequence[LoopRecord], dict[str, LoopRecord]]:
    """The measured experiments and, by name, the models' simulations of the longest, without those that diverge."""
    loops = {label: item.closed_loop for label, item in validations.items() if item.closed_loop is not None}
    if not loops:
        return (), {}
    one = next(iter(loops.values()))
    longest = longest_of(one.measured)
    if len(validations) == 1:
        simulated = {"model, means added": one.simulated[longest], DEVIATIONS: one.without_means[longest]}
    else:
        simulated = {label: loop.simulated[longest] for label, loop in loops.items()}
    return one.measured, {label: record for label, record in simulated.items() if record is not None}


def _responses(validations: Mapping[str, Validation]) -> list[FrequencyResponse]:
    """What the models are compared with, which is the same for all, and the response of each."""
    one = next(iter(validations.values())).frequency
    if len(validations) == 1:
        return list(one.responses)
    models = [replace(item.frequency.model, label=f"model {label}") for label, item in validations.items()]
    measured = [] if one.measured is None else [one.measured.response]
    return [*measured, *models, *([] if one.plant is None else [one.plant])]
