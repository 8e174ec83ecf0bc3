"""Bode diagram of frequency responses, of models and measured, with confidence bands and coherence."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import IdentificationError
from amb_core.ground.units import UM
from amb_core.identification.frequency_response import LEVEL, FrequencyResponse
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Band, Curve, Item, Panel, Table
from amb_core.report.figures.entries import Entry, faint_entries
from amb_core.report.figures.style import FADED, GREY, MODELS, PLANT, Stroke, sentence
from amb_core.report.figures.thinning import extremes

STROKES = (PLANT, *MODELS)
MEASURED = 0.8  # width (pt)
BAND_POINTS = 400  # over the width of a panel
HEADROOM = 1.5  # factor above and below the curves that is free
REACH = 5.0  # likewise, as far as bands may extend the panel
MOST_COLUMNS = 4  # of chosen entries
FLOOR = 1e-9  # of the largest magnitude; what is less, as couplings that are zero but for rounding, is left out
HIGHEST_PHASE = 90.0  # degree; phases are drawn between this and a turn less, so that noise does not split -180
PHASES = (HIGHEST_PHASE - 360.0, HIGHEST_PHASE)


def bode_chart(
    responses: Sequence[FrequencyResponse],
    title: str = "Frequency response",
    level: float = LEVEL,
    entries: Sequence[Entry] | None = None,
) -> Chart:
    """Magnitude and phase over frequency, a column for each input, two rows for each output; coherence below.

    Cross terms that are no more than noise or rounding are faded, see `faint_entries`; the legend says so.

    Phases are wrapped, see `PHASES`.

    Parameters
    ----------
    responses : sequence of FrequencyResponse
        Responses of the same signals; each needs a label of its own. Zero frequency is left out.
    title : str, optional
        Title of the figure.
    level : float, optional
        Confidence of the bands, drawn where deviations are known (-).
    entries : sequence of tuple of str, optional
        Names of input and output of the entries that are drawn, a column each, up to four; by default all.

    Returns
    -------
    Chart
        The chart, ready to save.

    Raises
    ------
    IdentificationError
        If there is no response, or signals or labels do not fit together.
    """
    _check(responses)
    first = responses[0]
    diagram = _Diagram.of(responses, level)
    grid = _rows(first, entries)
    panels: list[Panel] = []
    for row in grid:
        panels += [diagram.magnitudes(*entry) for entry in row]
        panels += [diagram.phases(*entry) for entry in row]
    if any(response.coherence is not None for response in responses):
        drawn = dict.fromkeys(output for row in grid for output, _ in row)
        panels += [diagram.coherences(output) for output in sorted(drawn)]
    columns = len(grid[0])
    rows = -(-len(panels) // columns)
    return Chart(
        title,
        diagram.alt(),
        tuple(panels),
        columns,
        shared_x=True,
        size=(5.0 * columns + 0.5, 1.2 + 2.0 * rows),
        table=diagram.table(),
    )


def _rows(response: FrequencyResponse, entries: Sequence[Entry] | None) -> list[list[tuple[int, int]]]:
    """Output and input of the entries to draw, in rows of one length."""
    outputs, inputs = response.output_names, response.input_names
    if entries is None:
        return [[(output, place) for place in range(len(inputs))] for output in range(len(outputs))]
    unknown = [entry for entry in entries if entry[0] not in inputs or entry[1] not in outputs]
    if unknown or not entries:
        raise IdentificationError(
            f"entries {', '.join(':'.join(entry) for entry in unknown) or 'none'} cannot be drawn; there are the "
            f"inputs {', '.join(inputs)} and the outputs {', '.join(outputs)}"
        )
    chosen = [(outputs.index(output), inputs.index(of_input)) for of_input, output in entries]
    columns = next(count for count in range(MOST_COLUMNS, 0, -1) if len(chosen) % count == 0)
    return [chosen[start : start + columns] for start in range(0, len(chosen), columns)]


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


@dataclass(frozen=True, eq=False)
class _Diagram:
    """What the panels of a diagram share.

    Attributes
    ----------
    responses : sequence of FrequencyResponse
        The responses, without zero frequency.
    strokes : sequence of Stroke
        Their looks.
    over : Axis
        Of the frequency.
    level : float
        Confidence of the bands.
    floor : float
        Magnitude below which nothing is drawn.
    faint : ndarray of bool, shape (p, m)
        Entries that are faded.
    reason : str
        Why they are, for the legend.
    """

    responses: Sequence[FrequencyResponse]
    strokes: Sequence[Stroke]
    over: Axis
    level: float
    floor: float
    faint: NDArray[np.bool_]
    reason: str

    @classmethod
    def of(cls, responses: Sequence[FrequencyResponse], level: float) -> _Diagram:
        responses = [_of_positive_frequencies(response) for response in responses]
        strokes = [STROKES[number % len(STROKES)] for number in range(len(responses))]
        looks = [
            stroke if response.coherence is None else replace(stroke, width=MEASURED)
            for response, stroke in zip(responses, strokes, strict=True)
        ]
        ends = [response.frequency[[0, -1]] for response in responses]
        over = Axis("frequency (Hz)", log=True, limits=(float(np.min(ends)), float(np.max(ends))))
        floor = FLOOR * max(float(response.magnitude.max()) for response in responses)
        return cls(responses, looks, over, level, floor, *faint_entries(responses))

    def magnitudes(self, output: int, place: int) -> Panel:
        first = self.responses[0]
        factor, unit = _unit(first.output_units[output], first.input_units[place])
        entries = [factor * response.magnitude[:, output, place] for response in self.responses]
        seen = np.concatenate([entry[entry > factor * self.floor] for entry in entries])
        low, high = (float(seen.min()), float(seen.max())) if seen.size else (0.1, 1.0)  # nothing but zeros
        bands = [response.magnitude_band(self.level) for response in self.responses]
        known = [[factor * end[:, output, place] for end in band] for band in bands if band is not None]
        lowest = max(low / REACH, min([low / HEADROOM, *(float(band[0].min()) for band in known)]))
        highest = min(high * REACH, max([high * HEADROOM, *(float(band[1].max()) for band in known)]))
        items: list[Item] = []
        for response, stroke, entry, band in zip(self.responses, self.strokes, entries, bands, strict=True):
            if band is not None:
                ends = (np.clip(factor * end[:, output, place], lowest / REACH, highest * REACH) for end in band)
                items.append(self._band(response, stroke, ends))
            items.append(_curve(response, stroke, np.where(entry > factor * self.floor, entry, np.nan)))
        axis = Axis(f"magnitude ({unit})", log=True, limits=(lowest, highest))
        title = f"{first.input_names[place]} to {first.output_names[output]}"
        return Panel(self.over, axis, self._shown(items, output, place), title)

    def phases(self, output: int, place: int) -> Panel:
        items: list[Item] = []
        for response, stroke in zip(self.responses, self.strokes, strict=True):
            phase = np.degrees(response.phase[:, output, place])
            turns = 360.0 * np.ceil((phase - HIGHEST_PHASE) / 360.0)
            wrapped = phase - turns
            band = response.phase_band(self.level)
            if band is not None:
                ends = [np.clip(np.degrees(end[:, output, place]) - turns, *PHASES) for end in band]
                items += [self._band(response, stroke, ends, part) for part in _stretches(turns)]
            shown = response.magnitude[:, output, place] > self.floor
            wrapped[np.flatnonzero(np.diff(turns)) + 1] = np.nan  # no line from one end of the axis to the other
            items.append(_curve(response, stroke, np.where(shown, wrapped, np.nan)))
        return Panel(self.over, Axis("phase (°)", limits=PHASES), self._shown(items, output, place))

    def coherences(self, output: int) -> Panel:
        curves = [
            _curve(response, stroke, response.coherence[:, output])
            for response, stroke in zip(self.responses, self.strokes, strict=True)
            if response.coherence is not None
        ]
        name = self.responses[0].output_names[output]
        return Panel(self.over, Axis(f"coherence of {name}", limits=(0.0, 1.05)), tuple(curves))

    def _shown(self, items: list[Item], output: int, place: int) -> tuple[Item, ...]:
        """The items of an entry, faded if it is faint; no band lies over a curve."""
        items = sorted(items, key=lambda item: not isinstance(item, Band))
        if not self.faint[output, place]:
            return tuple(items)
        key = Curve(np.array([np.nan]), np.array([np.nan]), self.reason, Stroke(GREY, opacity=FADED))
        return (*(_faded(item) for item in items), key)

    def alt(self) -> str:
        first, limits = self.responses[0], self.over.limits
        assert limits is not None
        text = (
            f"Bode diagram from {', '.join(first.input_names)} to {', '.join(first.output_names)}, {limits[0]:.3g} to "
            f"{limits[1]:.4g} Hz, of: {'; '.join(response.label for response in self.responses)}."
        )
        for response in self.responses:
            if response.magnitude_deviation is not None:
                relative = response.magnitude_deviation / np.maximum(response.magnitude, np.finfo(float).tiny)
                half = 100.0 * response.half_width(self.level) * float(np.median(relative))
                text += f" The {100.0 * self.level:g} % bands of {response.label} are ±{half:.2g} % wide in the median."
        if self.reason:
            first = self.responses[0]
            names = [
                f"{first.input_names[place]} to {first.output_names[output]}"
                for output, place in np.argwhere(self.faint)
            ]
            text += f" {sentence(self.reason)}: {', '.join(names)}."
        return text

    def table(self) -> Table:
        """Magnitudes and phases at the powers of ten."""
        first, limits = self.responses[0], self.over.limits
        assert limits is not None
        powers = range(math.ceil(math.log10(limits[0])), math.floor(math.log10(limits[1])) + 1)
        rows = []
        for response in self.responses:
            band, phases = response.magnitude_band(self.level), np.degrees(np.angle(response.response))
            for output, place in np.ndindex(response.response.shape[1:]):
                factor, unit = _unit(first.output_units[output], first.input_units[place])
                for at in dict.fromkeys(int(np.argmin(np.abs(response.frequency - 10.0**power))) for power in powers):
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
        header = ("response", "entry", "frequency (Hz)", "magnitude", f"{100.0 * self.level:g} % band", "phase (°)")
        return Table(header, tuple(rows))

    def _band(
        self,
        response: FrequencyResponse,
        stroke: Stroke,
        ends: Iterable[NDArray[np.float64]],
        part: slice = slice(None),
    ) -> Band:
        frequency = response.frequency[part]
        low, high = (end[part] for end in ends)
        grid = np.geomspace(frequency[0], frequency[-1], BAND_POINTS)
        kept = np.unique(np.minimum(np.searchsorted(frequency, grid), len(frequency) - 1))
        label = f"{response.label}: {100.0 * self.level:g} % band"
        return Band(frequency[kept], low[kept], high[kept], label, stroke.colour)


def _of_positive_frequencies(response: FrequencyResponse) -> FrequencyResponse:
    if response.frequency[0] > 0.0:
        return response
    names = ("frequency", "response", "magnitude_deviation", "phase_deviation", "coherence")
    known = {name: getattr(response, name) for name in names if getattr(response, name) is not None}
    rest: dict[str, Any] = {name: part[1:] for name, part in known.items()}
    return replace(response, **rest)


def _stretches(turns: NDArray[np.float64]) -> list[slice]:
    """The parts of two samples and more over which a phase is wrapped by the same turns."""
    edges = [0, *(np.flatnonzero(np.diff(turns)) + 1).tolist(), len(turns)]
    return [slice(start, stop) for start, stop in itertools.pairwise(edges) if stop - start > 1]


def _curve(response: FrequencyResponse, stroke: Stroke, values: NDArray[np.float64]) -> Curve:
    x, y = extremes(np.log(response.frequency), values)
    return Curve(np.exp(x), y, response.label, stroke)


def _faded(item: Item) -> Item:
    if isinstance(item, Band):
        return replace(item, opacity=FADED)
    return replace(item, stroke=replace(item.stroke, opacity=FADED)) if isinstance(item, Curve) else item


def _unit(output: str, of_input: str) -> tuple[float, str]:
    """Factor from the unit of a response to the one that is drawn, and its name."""
    factor, output = (UM, "µm") if output == "m" else (1.0, output)
    return factor, f"{output or '1'}/{of_input}" if of_input else output or "1"
