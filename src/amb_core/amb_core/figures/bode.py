"""Bode diagram of frequency responses, of models and measured, with confidence bands and coherence."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from amb_core.errors import IdentificationError
from amb_core.figures.chart import Axis, Band, Chart, Curve, Item, Panel, Table
from amb_core.figures.renderers import renderers
from amb_core.figures.style import MODELS, PLANT, UM, Stroke
from amb_core.figures.thinning import SPANS, extremes
from amb_core.identification.frequency_response import LEVEL, FrequencyResponse

STROKES = (PLANT, *MODELS)
HEADROOM = 1.5  # factor above and below the curves that is free
REACH = 5.0  # likewise, as far as bands may extend the panel
HIGHEST_START = 90.0  # degree; phases start between this and a turn less, so that -180 is not drawn as 180


def bode_chart(
    responses: Sequence[FrequencyResponse], title: str = "Frequency response", level: float = LEVEL
) -> Chart:
    """Magnitude and phase over frequency, a column for each input, two rows for each output; coherence below.

    Phases are drawn within half a turn of those of one response, the first without coherence, that is of a model.

    Parameters
    ----------
    responses : sequence of FrequencyResponse
        Responses of the same signals; each needs a label of its own. Zero frequency is left out.
    title : str
        Title of the figure.
    level : float
        Confidence of the bands, drawn where deviations are known.

    Raises
    ------
    IdentificationError
        If there is no response, or signals or labels do not fit together.
    """
    _check(responses)
    first = responses[0]
    centre = next((response for response in responses if response.coherence is None), first)
    panels: list[Panel] = []
    frequencies = np.concatenate([response.frequency for response in responses])
    frequencies = frequencies[frequencies > 0.0]
    over = Axis("frequency (Hz)", log=True, limits=(float(frequencies.min()), float(frequencies.max())))
    for output, (output_name, output_unit) in enumerate(zip(first.output_names, first.output_units, strict=True)):
        entries = list(enumerate(zip(first.input_names, first.input_units, strict=True)))
        for place, (input_name, input_unit) in entries:
            heading = f"{input_name} to {output_name}"
            panels.append(_magnitudes(responses, output, place, over, _unit(output_unit, input_unit), heading, level))
        panels += [_phases(responses, centre, output, place, over, level) for place, _ in entries]
    if any(response.coherence is not None for response in responses):
        panels += [_coherences(responses, output, over) for output in range(len(first.output_names))]
    columns = len(first.input_names)
    rows = -(-len(panels) // columns)
    return Chart(
        title,
        _alt(responses, over, level),
        tuple(panels),
        columns,
        shared_x=True,
        size=(5.0 * columns + 0.5, 1.2 + 2.0 * rows),
        table=_table(responses, over, level),
    )


bode_figure, bode_page = renderers(bode_chart)


def _check(responses: Sequence[FrequencyResponse]) -> None:
    if not responses:
        raise IdentificationError("a Bode diagram needs at least one frequency response")
    first = responses[0]
    for name in ("input_names", "output_names", "input_units", "output_units"):
        for other in responses[1:]:
            if getattr(other, name) != getattr(first, name):
                raise IdentificationError(
                    f"responses in one diagram need the same {name.replace('_', ' ')}; there are "
                    f"{', '.join(getattr(first, name))} and {', '.join(getattr(other, name))}"
                )
    labels = [response.label for response in responses]
    if len(set(labels)) < len(labels):
        raise IdentificationError(f"responses in one diagram need different labels, not {', '.join(labels)}")
    if any(response.frequency[-1] <= 0.0 for response in responses):
        raise IdentificationError("a Bode diagram needs frequencies above 0 Hz")


def _magnitudes(
    responses: Sequence[FrequencyResponse],
    output: int,
    place: int,
    over: Axis,
    unit: tuple[float, str],
    heading: str,
    level: float,
) -> Panel:
    factor, name = unit
    items: list[Item] = []
    low, high, drawn = math.inf, 0.0, []
    for response, stroke in _with_strokes(responses):
        positive = response.frequency > 0.0
        values = factor * response.magnitude[positive, output, place]
        seen = values[values > 0.0]
        low, high = min(low, seen.min(initial=low)), max(high, seen.max(initial=high))
        band = response.magnitude_band(level)
        if band is not None:
            ends = [factor * end[positive, output, place] for end in band]
            drawn.append((ends[0].min(), ends[1].max()))
            items.append(_band(response, positive, ends[0], ends[1], level, stroke))
        items.append(_curve(response, positive, np.where(values > 0.0, values, np.nan), stroke))
    if not high > 0.0:
        low, high = 0.1, 1.0  # nothing but zeros
    lowest = max(low / REACH, min([low / HEADROOM, *(end for end, _ in drawn)]))
    highest = min(high * REACH, max([high * HEADROOM, *(end for _, end in drawn)]))
    return Panel(over, Axis(f"magnitude ({name})", log=True, limits=(lowest, highest)), _bands_first(items), heading)


def _phases(
    responses: Sequence[FrequencyResponse], centre: FrequencyResponse, output: int, place: int, over: Axis, level: float
) -> Panel:
    middle = np.degrees(centre.phase[:, output, place])
    middle -= 360.0 * math.ceil((middle[0] - HIGHEST_START) / 360.0)
    items: list[Item] = []
    for response, stroke in _with_strokes(responses):
        positive = response.frequency > 0.0
        phase = np.degrees(response.phase[:, output, place])
        near = np.interp(response.frequency, centre.frequency, middle)
        shift = -360.0 * np.round((phase - near) / 360.0)
        band = response.phase_band(level)
        if band is not None:
            low, high = ((np.degrees(end[:, output, place]) + shift)[positive] for end in band)
            items.append(_band(response, positive, low, high, level, stroke))
        items.append(_curve(response, positive, (phase + shift)[positive], stroke))
    return Panel(over, Axis("phase (°)"), _bands_first(items))


def _coherences(responses: Sequence[FrequencyResponse], output: int, over: Axis) -> Panel:
    items: list[Item] = []
    for response, stroke in _with_strokes(responses):
        if response.coherence is not None:
            positive = response.frequency > 0.0
            items.append(_curve(response, positive, response.coherence[positive, output], stroke))
    return Panel(over, Axis(f"coherence of {responses[0].output_names[output]}", limits=(0.0, 1.05)), tuple(items))


def _with_strokes(responses: Sequence[FrequencyResponse]) -> list[tuple[FrequencyResponse, Stroke]]:
    return [(response, STROKES[number % len(STROKES)]) for number, response in enumerate(responses)]


def _bands_first(items: list[Item]) -> tuple[Item, ...]:
    """So that no band lies over a curve."""
    return tuple(sorted(items, key=lambda item: not isinstance(item, Band)))


def _curve(
    response: FrequencyResponse, positive: NDArray[np.bool_], values: NDArray[np.float64], stroke: Stroke
) -> Curve:
    x, y = extremes(np.log(response.frequency[positive]), values)
    return Curve(np.exp(x), y, response.label, stroke)


def _band(
    response: FrequencyResponse,
    positive: NDArray[np.bool_],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    level: float,
    stroke: Stroke,
) -> Band:
    frequency = response.frequency[positive]
    grid = np.geomspace(frequency[0], frequency[-1], SPANS)
    kept = np.unique(np.minimum(np.searchsorted(frequency, grid), len(frequency) - 1))
    label = f"{response.label}: {100.0 * level:g} % band"
    return Band(frequency[kept], low[kept], high[kept], label, stroke.colour)


def _unit(output: str, of_input: str) -> tuple[float, str]:
    """Factor from the unit of a response to the one that is drawn, and its name."""
    factor, output = (UM, "µm") if output == "m" else (1.0, output)
    return factor, f"{output or '1'}/{of_input}" if of_input else output or "1"


def _alt(responses: Sequence[FrequencyResponse], over: Axis, level: float) -> str:
    first = responses[0]
    assert over.limits is not None
    text = (
        f"Bode diagram from {', '.join(first.input_names)} to {', '.join(first.output_names)}, {over.limits[0]:.3g} to "
        f"{over.limits[1]:.4g} Hz, of: {'; '.join(response.label for response in responses)}."
    )
    for response in responses:
        band = response.magnitude_band(level)
        if band is not None:
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                half = np.nanmedian(np.sqrt(band[1] / band[0])) - 1.0
            text += f" The {100.0 * level:g} % bands of {response.label} are ±{100.0 * half:.2g} % wide in the median."
    return text


def _table(responses: Sequence[FrequencyResponse], over: Axis, level: float) -> Table:
    """Magnitudes and phases at the powers of ten."""
    assert over.limits is not None
    powers = range(math.ceil(math.log10(over.limits[0])), math.floor(math.log10(over.limits[1])) + 1)
    first = responses[0]
    rows = []
    for response in responses:
        band, phases = response.magnitude_band(level), np.degrees(np.angle(response.response))
        for output, place in np.ndindex(response.response.shape[1:]):
            factor, unit = _unit(first.output_units[output], first.input_units[place])
            for power in powers:
                at = int(np.argmin(np.abs(response.frequency - 10.0**power)))
                entry = (at, output, place)
                around = "" if band is None else f"{factor * band[0][entry]:.3g} to {factor * band[1][entry]:.3g}"
                rows.append(
                    (
                        response.label,
                        f"{first.input_names[place]} to {first.output_names[output]}",
                        f"{response.frequency[at]:.4g}",
                        f"{factor * response.magnitude[entry]:.4g} {unit}",
                        around,
                        f"{phases[entry]:.1f}",
                    )
                )
    header = ("response", "entry", "frequency (Hz)", "magnitude", f"{100.0 * level:g} % band", "phase (°)")
    return Table(header, tuple(rows))
