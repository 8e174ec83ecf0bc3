"""The rotor's response to a sweep with the regions it ran through (the paper's Fig. 2, 3 and 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import RegionError
from amb_core.ground.units import UM
from amb_core.loop.records import LoopRecord
from amb_core.regions import Classification, Onset, Region
from amb_core.regions.stretches import stretches
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Item, Panel, Rule, Span, Table
from amb_core.report.figures.style import GREY, MEAN, MODEL, PLANT, REGIONS, Stroke, region_label, sentence
from amb_core.report.figures.thinning import extremes
from amb_core.report.linear_claim import NONE_FOUND, LinearClaim

BEAT = Stroke(GREY, width=5.0)
MEAN_TIME = 0.1  # s, longer than the periods of input and loop, shorter than a drift
HEADROOM = 0.08  # of the height of a panel, free above and below the curves


@dataclass(frozen=True)
class _Abscissa:
    """What the record is drawn over: a value of x for each sample that is shown, and for any step."""

    axis: Axis
    shown: slice
    x: NDArray[np.float64]  # of the samples shown, ascending
    first_step: int  # of the first sample shown

    def at(self, step: float) -> float:
        """Value at a step, or at the nearest one shown."""
        return float(np.interp(step - self.first_step, np.arange(len(self.x)), self.x))


def sweep_chart(
    record: LoopRecord,
    classification: Classification,
    frequency: NDArray[np.float64] | None = None,
    *,
    over: Literal["time", "frequency"] = "time",
    model: LoopRecord | None = None,
    axes: Sequence[str] = (),
    title: str = "Response to a sweep",
    frozen: Sequence[str] = (),
) -> Chart:
    """Position over time or over the instantaneous input frequency, in the colours of the regions.

    The onsets are those of the rotor. Long records are drawn by their extremes. Where A may not be said, since a region
    was not judged or a sensor stands still, the time without B, C and D has no letter.

    Parameters
    ----------
    record : LoopRecord
        Samples; position is NaN where they are missing.
    classification : Classification
        Of these samples.
    frequency : ndarray, shape (steps,), optional
        Frequency of the input at each sample (Hz), NaN where there is none; needed over frequency. Where it is known
        the mean of the position is drawn too: without periods slower than its window it shows the drift.
    over : {"time", "frequency"}, optional
        What the horizontal axis is; samples without a frequency are left out over frequency.
    model : LoopRecord, optional
        Response of a model to the same reference from the same step on, drawn over it. None for no model.
    axes : sequence of str, optional
        Names of the axes to show; by default those that are excited.
    title : str, optional
        Title of the figure.
    frozen : sequence of str, optional
        Positions that keep one value while their axis moves, see `RecordedRegions.frozen`.

    Returns
    -------
    Chart
        The chart, ready to save.

    Raises
    ------
    RegionError
        If it is to be drawn over frequency, and the frequency is not given or does not rise; if there is no such axis.
    """
    axes = tuple(axes) or _excited(record)
    unknown = [name for name in axes if name not in record.axes]
    if unknown:
        raise RegionError(f"no axis {', '.join(unknown)} in the record; its axes: {', '.join(record.axes)}")
    abscissa = _over_time(record) if over == "time" else _over_frequency(record, frequency)
    claim = LinearClaim.of(classification, frozen)
    regions = _regions(classification, abscissa, claim)
    panels = []
    for name in axes:
        column = record.axes.index(name)
        curves = _curves(record, model, abscissa, column, sweeping=frequency is not None)
        heights = np.concatenate([curve.y for curve in curves])
        low, high = np.nanmin(heights), np.nanmax(heights)
        margin = max(HEADROOM * (high - low), 1e-3)
        limits = (float(low - margin), float(high + margin))
        beats = _beats(classification, abscissa, column, limits[0] + 0.3 * margin)
        panels.append(Panel(abscissa.axis, Axis(f"{name} (µm)", limits=limits), (*regions, *curves, *beats)))
    size = (8.0, 4.8 if len(panels) == 1 else 3.4 * len(panels))
    alt = f"{_motion(record, abscissa, axes)} {_alt(classification, claim, model is not None)}"
    return Chart(title, alt, tuple(panels), shared_x=True, size=size, table=_onset_table(classification))


def rises(frequency: NDArray[np.float64] | None) -> bool:
    """Whether a frequency over time is that of one sweep that rises: NaN only before its start and after its end."""
    if frequency is None:
        return False
    known = np.flatnonzero(np.isfinite(frequency))
    return len(known) > 1 and bool(np.all(np.diff(frequency[known[0] : known[-1] + 1]) > 0.0))


def onset_text(onset: Onset) -> str:
    """Where a region begins, such as `242 Hz, 1.93 s`."""
    at = "" if np.isnan(onset.input_frequency) else f"{onset.input_frequency:.0f} Hz, "
    return f"{at}{onset.time:.2f} s" + (" (resonance)" if onset.resonance else "")


def _over_time(record: LoopRecord) -> _Abscissa:
    ends = (float(record.time[0]), float(record.time[-1]))
    return _Abscissa(Axis("time (s)", limits=ends), slice(None), record.time, record.first_step)


def _over_frequency(record: LoopRecord, frequency: NDArray[np.float64] | None) -> _Abscissa:
    if frequency is None or len(frequency) != record.steps or not rises(frequency):
        raise RegionError(
            "a response is drawn over frequency only where the frequency of each sample is known and rises, as in one "
            "sweep; draw it over time"
        )
    known = np.flatnonzero(np.isfinite(frequency))
    shown = slice(int(known[0]), int(known[-1]) + 1)
    x = frequency[shown]
    axis = Axis("input frequency (Hz)", limits=(float(x[0]), float(x[-1])))
    return _Abscissa(axis, shown, x, record.first_step + int(known[0]))


def _excited(record: LoopRecord) -> tuple[str, ...]:
    """Axes whose reference moves, all where none does."""
    moved = np.nanmax(record.reference, axis=0) > np.nanmin(record.reference, axis=0)
    return tuple(name for name, moves in zip(record.axes, moved, strict=True) if moves) or record.axes


def _regions(classification: Classification, abscissa: _Abscissa, claim: LinearClaim) -> list[Item]:
    items: list[Item] = []
    for stretch in stretches(classification.states):
        start, stop = abscissa.at(stretch.first_step), abscissa.at(stretch.stop)
        if stop > start:
            items.append(_span(stretch.region, start, stop, claim))
    for region, onset in classification.onsets.items():
        label = f"{region.name} begins: {onset_text(onset)}"
        items.append(Rule(abscissa.at(onset.step), label, REGIONS[region].boundary))
    return items


def _span(region: Region, start: float, stop: float, claim: LinearClaim) -> Span:
    if region is Region.A and not claim.holds():
        return Span(start, stop, NONE_FOUND, GREY)
    look = REGIONS[region]
    return Span(start, stop, region_label(region), look.colour, look.hatch, region.name)


def _curves(
    record: LoopRecord, model: LoopRecord | None, abscissa: _Abscissa, axis: int, *, sweeping: bool
) -> list[Curve]:
    curves = [Curve(*extremes(abscissa.x, UM * record.position[abscissa.shown, axis]), "position", PLANT)]
    if model is not None:
        modelled = np.full(record.steps, np.nan)
        offset = model.first_step - record.first_step
        part = model.position[max(-offset, 0) : record.steps - offset, axis]
        modelled[max(offset, 0) : max(offset, 0) + len(part)] = UM * part
        curves.append(Curve(*extremes(abscissa.x, modelled[abscissa.shown]), "model", MODEL))
    window = round(MEAN_TIME / record.sample_time)
    if sweeping and len(abscissa.x) > 2 * window:
        mean = np.convolve(UM * record.position[abscissa.shown, axis], np.full(window, 1.0 / window), "valid")
        middle = abscissa.x[window // 2 : window // 2 + len(mean)]
        curves.append(Curve(*extremes(middle, mean, spans=400), f"mean position over {MEAN_TIME:g} s", MEAN))
    return curves


def _beats(classification: Classification, abscissa: _Abscissa, axis: int, height: float) -> list[Curve]:
    """A bar at the bottom where the input beats with the sample rate."""
    last = abscissa.first_step + len(abscissa.x)
    shown = [state for state in classification.states if abscissa.first_step <= state.step < last]
    beating = [state.axes[axis].sampling_beat for state in shown]
    if not any(beating):
        return []
    x = np.array([abscissa.at(state.step) for state in shown])
    return [Curve(x, np.where(beating, height, np.nan), "input beats with the sample rate", BEAT)]


def _motion(record: LoopRecord, abscissa: _Abscissa, axes: Sequence[str]) -> str:
    """How far the axes that are drawn move, in the time that is drawn."""
    columns = [record.axes.index(name) for name in axes]
    reach = UM * np.nanmax(np.abs(record.position[abscissa.shown][:, columns]))
    time = record.time[abscissa.shown]
    where = f"Rotor position on {' and '.join(axes)} from {time[0]:.1f} s to {time[-1]:.1f} s"
    return f"{where}; it moves up to {reach:.0f} µm from the centre."


def _alt(classification: Classification, claim: LinearClaim, with_model: bool) -> str:
    text = "The response of a linear model is drawn over it. " if with_model else ""
    if not stretches(classification.states):
        return text + "It is too short for regions B and C."
    reservations = "".join(f" {sentence(what)}." for what in claim.reservations)
    if not classification.onsets and claim.holds():
        return text + f"It stays in region A, {REGIONS[Region.A].meaning}."
    if not classification.onsets:
        found = "No region is known" if claim.still else f"{sentence(claim.absent())} found"
        return text + f"{found}.{reservations}"
    begins = [
        f"{region.name} ({REGIONS[region].meaning}) begins at {onset_text(onset)}"
        for region, onset in classification.onsets.items()
    ]
    return text + "Of the regions, " + "; ".join(begins) + "." + reservations


def _onset_table(classification: Classification) -> Table:
    rows: list[tuple[str, ...]] = []
    of_parts: Sequence[tuple[str, dict[Region, Onset]]] = (
        ("rotor", classification.onsets),
        *classification.axis_onsets.items(),
    )
    for part, onsets in of_parts:
        rows += [
            (
                part,
                region_label(region),
                f"{onset.time:.3f}",
                "" if np.isnan(onset.input_frequency) else f"{onset.input_frequency:.1f}",
            )
            for region, onset in onsets.items()
        ]
    return Table(("part", "region", "begins at (s)", "input frequency (Hz)"), tuple(rows))
