"""Conditioning of data: remove and store trends, reduce the sample rate, omit invalid samples, advance inputs.

Every function leaves its argument unchanged and returns new data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments.dataset import IdentificationData, require_data
from amb_core.data.experiments.experiment import Experiment, line
from amb_core.ground.errors import IdentificationError, one_line
from amb_core.ground.given_values import number, require_kind, whole_number, whole_numbers

_PASS_BAND = 0.8  # share of the new Nyquist frequency that decimation passes
_ATTENUATION = 80.0  # dB above the new Nyquist frequency
HIGHEST_FACTOR = 1_000


def detrend(
    data: IdentificationData, kind: Literal["mean", "linear"] = "mean", *, common: bool = False
) -> IdentificationData:
    """Remove means or straight lines from inputs, outputs and reference; they are kept in the experiments.

    Parameters
    ----------
    data : IdentificationData
        The data.
    kind : str, optional
        `mean`, or `linear` for the least-squares line over the time of the run.
    common : bool, optional
        Remove the same trend from all experiments, as is right for parts of one run at one operating point; by default
        each experiment has its own.

    Returns
    -------
    IdentificationData
        The data less their trends.

    Raises
    ------
    IdentificationError
        If `kind` is not allowed or a value is not finite.
    """
    require_data(data)
    if not isinstance(kind, str) or kind not in ("mean", "linear"):
        raise IdentificationError(f"detrending by {one_line(repr(kind), 80)} is not allowed; allowed: mean, linear")
    if not all(np.isfinite(item.signals).all() for item in data.experiments):
        raise IdentificationError("data with values that are not finite have no trend; use split_at_invalid first")
    require_kind("common", common, (bool, np.bool_), "True or False", IdentificationError)
    groups = [data.experiments] if common else [(item,) for item in data.experiments]
    experiments: list[Experiment] = []
    for group in groups:
        times = [item.time(data.sample_time) for item in group]
        for name in ("input", "output", "reference"):
            signals = [_signal(item, name) for item in group]
            if signals[0] is None or any(signal is None for signal in signals):
                continue
            trend = _trend(np.concatenate(times), np.concatenate([s for s in signals if s is not None]), kind)
            group = tuple(_less(item, name, trend, time) for item, time in zip(group, times, strict=True))
        experiments += group
    return replace(data, experiments=tuple(experiments))


def restore(data: IdentificationData) -> IdentificationData:
    """Add the removed trends again (to rounding).

    Parameters
    ----------
    data : IdentificationData
        Data with or without removed trends.

    Returns
    -------
    IdentificationData
        The data as they were recorded.
    """
    require_data(data)
    experiments = []
    for item in data.experiments:
        time = item.time(data.sample_time)
        for name in ("input", "output", "reference"):
            item = _less(item, name, -getattr(item, f"{name}_trend"), time)
        experiments.append(item)
    return replace(data, experiments=tuple(experiments))


def decimate(data: IdentificationData, factor: int) -> IdentificationData:
    """Keep every `factor`-th sample of the low-passed data; no phase is added.

    A symmetric FIR filter (Kaiser window, 80 dB) passes up to 0.8 of the new Nyquist frequency. It filters all
    signals alike, so a linear relation between them does not change. Only samples that need no values outside the
    experiment are kept, so each experiment loses about 25 new samples at either end. The kept steps are multiples of
    `factor`, and the first step counts new samples.

    An input that was held over each old sample is not held over the new ones: trust a model of decimated data up to a
    third of the new Nyquist frequency.

    Parameters
    ----------
    data : IdentificationData
        Data with finite values.
    factor : int
        Old samples for each new one, 2 to 1000.

    Returns
    -------
    IdentificationData
        The data at the lower rate.

    Raises
    ------
    IdentificationError
        If the factor is not an integer from 2 to 1000, a value is not finite or an experiment is too short.

    References
    ----------
    A. V. Oppenheim and R. W. Schafer, Discrete-Time Signal Processing, 3rd edition, 2010, sections 4.6 and 7.5.
    """
    from scipy import signal  # the import takes most of a second; programs that do not need it should not wait for it

    require_data(data)
    wanted = number("factor", factor, IdentificationError)
    if not (2 <= wanted <= HIGHEST_FACTOR and wanted.is_integer()):  # not NaN
        raise IdentificationError(f"factor {factor} is not allowed; allowed: integers from 2 to {HIGHEST_FACTOR}")
    factor = int(wanted)
    length, beta = signal.kaiserord(_ATTENUATION, (1.0 - _PASS_BAND) / factor)
    length |= 1  # odd, so that the delay is a number of samples
    taps = signal.firwin(length, 0.5 * (1.0 + _PASS_BAND) / factor, window=("kaiser", beta))
    experiments = []
    for index, item in enumerate(data.experiments):
        if not np.isfinite(item.signals).all():
            raise IdentificationError("data with values that are not finite cannot be filtered; use split_at_invalid")
        centre = item.first_step + length // 2  # step of the first filtered sample
        skipped = -centre % factor
        if item.steps < length + skipped:
            raise IdentificationError(
                f"experiment {index} has {item.steps} samples; decimation by {factor} needs {length + skipped} or more"
            )

        def kept(samples: NDArray[np.float64], start: int = skipped) -> NDArray[np.float64]:
            return np.asarray(signal.oaconvolve(samples, taps[:, np.newaxis], mode="valid", axes=0)[start::factor])

        experiments.append(
            replace(
                item,
                inputs=kept(item.inputs),
                outputs=kept(item.outputs),
                reference=None if item.reference is None else kept(item.reference),
                first_step=(centre + skipped) // factor,
            )
        )
    return replace(data, experiments=tuple(experiments), sample_time=data.sample_time * factor)


def split_at_invalid(data: IdentificationData, shortest: int = 1) -> IdentificationData:
    """Leave out samples that are not finite: the parts between them become separate experiments.

    Parameters
    ----------
    data : IdentificationData
        The data.
    shortest : int, optional
        Fewest samples of an experiment that is kept; the others are left out as well.

    Returns
    -------
    IdentificationData
        Data with finite values.

    Raises
    ------
    IdentificationError
        If nothing is left.
    """
    require_data(data)
    shortest = whole_number("shortest", shortest, IdentificationError)
    experiments = []
    for item in data.experiments:
        valid = np.isfinite(item.signals).all(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], valid.astype(np.int8), [0]]))) + item.first_step
        experiments += [
            item.window(int(start), int(stop))
            for start, stop in edges.reshape(-1, 2)
            if stop - start >= max(shortest, 1)
        ]
    if not experiments:
        raise IdentificationError(f"no stretch of {max(shortest, 1)} finite samples is left")
    return replace(data, experiments=tuple(experiments))


def advance_inputs(data: IdentificationData, steps: Sequence[int]) -> IdentificationData:
    """Pair each output with an input of `steps` samples earlier (negative: later), one number for each input.

    This removes dead time from the data: a model then needs no state for each sample of dead time. With -1, outputs
    that respond within the sample (D not 0) respond one sample later, so methods with D = 0 apply.

    Parameters
    ----------
    data : IdentificationData
        Data of any plant.
    steps : sequence of int
        Steps of each input.

    Returns
    -------
    IdentificationData
        The paired samples; steps that lack a partner are left out.

    Raises
    ------
    IdentificationError
        If there are not as many numbers as inputs, or an experiment has no sample left.
    """
    require_data(data)
    steps = whole_numbers("steps", steps, IdentificationError)
    if len(steps) != len(data.input_names):
        raise IdentificationError(f"{len(data.input_names)} inputs need as many numbers of steps, not {len(steps)}")
    back, ahead = max(0, *steps), max(0, *(-step for step in steps))
    experiments = []
    for index, item in enumerate(data.experiments):
        if item.steps <= back + ahead:
            raise IdentificationError(
                f"experiment {index} has {item.steps} samples; more than {back + ahead} are needed to move its inputs"
            )
        kept = item.window(item.first_step + back, item.stop - ahead)
        columns = [item.inputs[back - step : back - step + kept.steps, column] for column, step in enumerate(steps)]
        trend = item.input_trend.copy()
        trend[0] -= trend[1] * np.asarray(steps) * data.sample_time
        experiments.append(replace(kept, inputs=np.column_stack(columns), input_trend=trend))
    return replace(data, experiments=tuple(experiments))


def _signal(item: Experiment, name: str) -> NDArray[np.float64] | None:
    signal: NDArray[np.float64] | None = item.reference if name == "reference" else getattr(item, f"{name}s")
    return signal


def _trend(time: NDArray[np.float64], signal: NDArray[np.float64], kind: str) -> NDArray[np.float64]:
    """Offset and slope of the least-squares line, or the mean and no slope; shape (2, channels)."""
    mean = signal.mean(axis=0)
    if kind == "mean" or len(time) < 2:
        return np.vstack([mean, np.zeros_like(mean)])
    centred = time - time.mean()
    slope = centred @ (signal - mean) / (centred @ centred)
    return np.vstack([mean - slope * time.mean(), slope])


def _less(item: Experiment, name: str, trend: NDArray[np.float64], time: NDArray[np.float64]) -> Experiment:
    """An experiment from which a trend has been removed."""
    signal = _signal(item, name)
    if signal is None:
        return item
    field = "reference" if name == "reference" else f"{name}s"
    removed = getattr(item, f"{name}_trend") + trend
    return replace(item, **{field: signal - line(trend, time), f"{name}_trend": removed})
