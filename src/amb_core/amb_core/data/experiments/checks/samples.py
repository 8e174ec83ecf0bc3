"""Checks of the samples themselves: finite, gaps, sample time, clipping, offsets."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments.checks.report import Finding, Severity
from amb_core.data.experiments.dataset import IdentificationData
from amb_core.ground.errors import IdentificationError
from amb_core.ground.sample_times import same_sample_time

_SHORT_GAP = 100  # steps: one block of telemetry
_HELD_SHARE = 0.4  # of samples equal to the one before in all outputs; from this share the outputs count as held
_FLAT_RUN = 3  # samples in a row at an extreme value
_PILE = 5  # a value that occurs so many times as often as the next one is where a signal is clipped
_MANY = 20  # samples at an extreme value, that need not be in a row
_FEW_VALUES = 16  # of a signal with discrete levels, such as a square wave or PRBS
_REGULAR = 0.8  # of the movements of held outputs, whole multiples of the hold apart
_APART = 0.2  # of the range: a clipped signal comes close to where it is cut, a channel that drops out does not
_DRIFT = 0.25  # share of the variance that a line over an experiment explains


def check_finite(data: IdentificationData) -> Finding:
    """NaN and infinite values; no method accepts them.

    Parameters
    ----------
    data : IdentificationData
        Data of any plant.

    Returns
    -------
    Finding
        An error that names the first such value.
    """
    wrong = 0
    where = ""
    for index, item in enumerate(data.experiments):
        invalid = ~np.isfinite(item.signals)
        wrong += int(invalid.any(axis=1).sum())
        if invalid.any() and not where:
            row, column = np.argwhere(invalid)[0]
            names = [*data.input_names, *data.output_names, *(f"reference of {name}" for name in data.output_names)]
            where = f"{names[column]}, first at step {item.first_step + row} of experiment {index}"
    if not wrong:
        return Finding("finite", Severity.INFO, "all values are finite")
    return Finding(
        "finite",
        Severity.ERROR,
        f"{wrong} of {data.samples} samples hold NaN or infinite values",
        where,
        "leave them out with --repair split (in Python: split_at_invalid)",
    )


def check_gaps(data: IdentificationData) -> Finding:
    """Missing samples between experiments of one run; each experiment has its own unknown initial state.

    Parameters
    ----------
    data : IdentificationData
        Data of any plant.

    Returns
    -------
    Finding
        Number and length of the gaps.
    """
    gaps = data.gaps
    if not gaps:
        return Finding("gaps", Severity.INFO, "no samples are missing")
    missing = sum(gap.steps for gap in gaps)
    short = sum(gap.steps < _SHORT_GAP for gap in gaps)
    return Finding(
        "gaps",
        Severity.WARNING,
        f"{len(gaps)} gaps of {missing} samples in all, {short} of them shorter than {_SHORT_GAP}",
        ", ".join(f"steps {gap.first_step} to {gap.stop - 1}" for gap in gaps[:3]) + (" ..." if len(gaps) > 3 else ""),
        "each part has its own initial state; if this happens often, record telemetry instead of single samples",
    )


def check_sample_time(data: IdentificationData, expected: float | None = None) -> Finding:
    """Compares the sample time with the expected one, and checks whether the outputs were sampled more slowly.

    If outputs repeat in all channels at once, something slower than the record holds them. An example is a record at
    the controller's rate that was resampled to a higher one. A model of such data describes the hold, not the plant.

    Parameters
    ----------
    data : IdentificationData
        Data with finite values.
    expected : float, optional
        Expected sample time (s); None if there is none.

    Returns
    -------
    Finding
        An error if the sample times differ, a warning if the outputs repeat.
    """
    sample_time = data.sample_time
    if expected is not None and not same_sample_time(sample_time, expected):
        return Finding(
            "sample time",
            Severity.ERROR,
            f"{sample_time:g} s, but {expected:g} s is expected",
            advice=f"decimate by {expected / sample_time:.0f}"
            if expected > 1.5 * sample_time
            else "take data at the rate of the controller, or correct its rate",
        )
    moves, pairs = 0, 0
    for item in data.experiments:
        moves += int(np.any(item.outputs[1:] != item.outputs[:-1], axis=1).sum())
        pairs += item.steps - 1
    held = 1.0 - moves / pairs if pairs else 0.0
    factor = max(2, round(pairs / moves)) if moves else 2
    if moves and held > _HELD_SHARE and _regular(data, factor):
        return Finding(
            "sample time",
            Severity.WARNING,
            f"{100.0 * held:.0f} % of the samples repeat the one before in all outputs, as if each were held for "
            f"{factor} samples of {sample_time:g} s",
            "outputs",
            f"if they were recorded every {factor * sample_time:g} s, keep every {factor}. sample; otherwise the "
            "sensor is too coarse for this excitation",
        )
    if _interpolated(data) > _HELD_SHARE:
        return Finding(
            "sample time",
            Severity.WARNING,
            f"{100.0 * _interpolated(data):.0f} % of the samples lie exactly between their neighbours in all outputs, "
            f"as if they were interpolated to {sample_time:g} s",
            "outputs",
            "take the samples as they were recorded: interpolated ones hold no dynamics above their own rate",
        )
    return Finding("sample time", Severity.INFO, f"{sample_time:g} s")


def check_clipping(data: IdentificationData, limits: Mapping[str, float] | None = None) -> Finding:
    """Signals at a known limit, and flat tops: many samples in a row at exactly the largest or the smallest value.

    A value counts as clipped if it occurs in runs of three samples and five times as often as the next value;
    quantised signals stay below that at their peaks. Signals with few levels (square waves, PRBS) are left out.

    Parameters
    ----------
    data : IdentificationData
        The data.
    limits : mapping of str to float, optional
        Known limits on the magnitude of signals by name, in the units of the signals, removed offsets included. By
        default only flat tops are found.

    Returns
    -------
    Finding
        A warning that names the clipped signals.

    Raises
    ------
    IdentificationError
        If a limit has a name that no signal of the data has.
    """
    names = (*data.input_names, *data.output_names)
    if unknown := sorted(set(limits or {}) - set(names)):
        raise IdentificationError(f"there is no signal {unknown[0]!r} to have a limit; there are {', '.join(names)}")
    clipped: list[str] = []
    outputs_cut = False
    for name, signal, offset in _signals(data):
        limit = (limits or {}).get(name)
        at_limit = None if limit is None else np.abs(signal + offset) >= limit * (1.0 - 1e-9)
        share = float(np.mean(at_limit)) if at_limit is not None else float(np.mean(cut_samples(signal)))
        if share > 0.0:
            reason = "at the limit" if at_limit is not None else "at a flat top"
            clipped.append(f"{name} {100.0 * share:.2g} % {reason}")
            outputs_cut = outputs_cut or name in data.output_names
    if not clipped:
        return Finding("clipping", Severity.INFO, "no signal is clipped")
    advice = (
        "the sensor cannot see these samples: reduce the excitation, or leave them out"
        if outputs_cut
        else "inputs recorded behind the limit are still the true ones; if these are not, reduce the excitation"
    )
    return Finding("clipping", Severity.WARNING, f"clipped samples: {', '.join(clipped)}", advice=advice)


def check_offsets(data: IdentificationData) -> Finding:
    """Means and drift: identification removes the mean of each signal, which is right for one operating point.

    Parameters
    ----------
    data : IdentificationData
        Data with finite values.

    Returns
    -------
    Finding
        The signals that drift, or whose means differ between experiments.
    """
    drifting, apart = [], []
    for kind in ("input", "output"):
        for column, name in enumerate(getattr(data, f"{kind}_names")):
            parts = [getattr(item, f"{kind}s")[:, column] for item in data.experiments]
            if any(_line_share(part) > _DRIFT for part in parts):
                drifting.append(name)
            spread = max(float(np.ptp(part)) for part in parts)
            if np.ptp([part.mean() for part in parts]) > 0.5 * spread > 0.0:
                apart.append(name)
    if drifting:
        return Finding(
            "offsets",
            Severity.WARNING,
            f"a straight line explains more than {100.0 * _DRIFT:.0f} % of the variance",
            ", ".join(drifting),
            "the operating point drifts: remove it with --drift prefilter (in Python also: detrend(data, 'linear')), "
            "or choose a part without drift",
        )
    if apart:
        return Finding(
            "offsets",
            Severity.WARNING,
            "the means of the experiments differ by more than half of the range of the signals",
            ", ".join(apart),
            "the experiments have different operating points: detrend each separately, and expect the plant to differ",
        )
    means = np.concatenate([data.input_offset, data.output_offset]) + np.average(
        [np.hstack([item.inputs, item.outputs]).mean(axis=0) for item in data.experiments],
        axis=0,
        weights=[item.steps for item in data.experiments],
    )
    labels = zip((*data.input_names, *data.output_names), means, (*data.input_units, *data.output_units), strict=True)
    return Finding(
        "offsets",
        Severity.INFO,
        "operating point " + ", ".join(f"{name} {mean:.4g} {unit}".strip() for name, mean, unit in labels),
    )


def _regular(data: IdentificationData, factor: int) -> bool:
    """Whether the outputs move every so many samples, as if they were held; those of a coarse sensor move at any."""
    regular, moves = 0, 0
    for item in data.experiments:
        rows = np.flatnonzero(np.any(item.outputs[1:] != item.outputs[:-1], axis=1))
        regular += int(np.count_nonzero(np.diff(rows) % factor == 0))
        moves += max(len(rows) - 1, 0)
    return regular >= _REGULAR * moves


def _interpolated(data: IdentificationData) -> float:
    """Share of the moving samples that lie on the straight line between their neighbours, in all outputs."""
    between, moving = 0, 0
    for item in data.experiments:
        moves = item.outputs[2:] - item.outputs[:-2]
        bend = item.outputs[1:-1] - 0.5 * (item.outputs[2:] + item.outputs[:-2])
        rounding = 1e-9 * np.abs(item.outputs).max(axis=0, initial=0.0)
        moved = (np.abs(moves) > 4.0 * rounding).any(axis=1)
        between += int(np.count_nonzero((np.abs(bend) <= rounding).all(axis=1) & moved))
        moving += int(np.count_nonzero(moved))
    return between / moving if moving else 0.0


def _signals(data: IdentificationData) -> Iterator[tuple[str, NDArray[np.float64], NDArray[np.float64]]]:
    """Name, samples of all experiments and removed trend of each input and output."""
    for kind in ("input", "output"):
        for column, name in enumerate(getattr(data, f"{kind}_names")):
            yield (
                name,
                np.concatenate([getattr(item, f"{kind}s")[:, column] for item in data.experiments]),
                np.concatenate(
                    [
                        getattr(item, f"{kind}_trend")[0, column]
                        + getattr(item, f"{kind}_trend")[1, column] * item.time(data.sample_time)
                        for item in data.experiments
                    ]
                ),
            )


def cut_samples(signal: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Samples at a largest or smallest value at which the signal is clipped."""
    values, counts = np.unique(signal, return_counts=True)
    cut = np.zeros(len(signal), bool)
    if len(values) <= _FEW_VALUES:
        return cut
    for extreme, neighbour in ((-1, -2), (0, 1)):
        if abs(values[extreme] - values[neighbour]) > _APART * np.ptp(np.delete(values, extreme)):
            continue
        at = signal == values[extreme]
        edges = np.diff(np.concatenate([[0], at.astype(np.int8), [0]]))
        runs = np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1)
        if (runs.max() >= _FLAT_RUN or counts[extreme] >= _MANY) and counts[extreme] >= _PILE * counts[neighbour]:
            cut |= at
    return cut


def _line_share(signal: NDArray[np.float64]) -> float:
    """Share of the variance that a straight line explains."""
    time = np.arange(len(signal)) - 0.5 * (len(signal) - 1)
    rest = signal - signal.mean()
    rest = rest / (np.abs(rest).max() or 1.0)  # no square over- or underflows
    variance = float(rest @ rest)
    return float((time @ rest) ** 2 / (time @ time) / variance) if variance > 0.0 and len(signal) > 2 else 0.0
