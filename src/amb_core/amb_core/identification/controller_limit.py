"""Does the PD law compute the currents at their limit too? What differs there: the limit, or the signal it derives.

The comparison of `controller_trials` leaves out the samples at the limit, which say nothing of the gains. But at the
edges of squares often no others show where the limit is and which signal is derived.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from amb_core.identification.controller_trials import BETTER, FOREIGN, TOPS, Trial, free_samples, left_by_gains
from amb_core.loop.control import ControllerParameters
from amb_core.loop.known_controller import UNLIMITED
from amb_core.loop.records import LoopRecord

_MEASURED = 0.03  # of the limit, rms, by which measured currents may differ at it
_NOISE = 3.0  # times what the law leaves of the currents below the limit, likewise

Arrays = NDArray[np.float64]


def shares_at_limit(controller: ControllerParameters, record: LoopRecord) -> Arrays:
    """Part of the current of each axis that the limited law leaves unexplained, where they differ at the limit.

    Parameters
    ----------
    controller : ControllerParameters
        A law that computes the currents below the limit.
    record : LoopRecord
        References, positions and currents.

    Returns
    -------
    ndarray, shape (axes,)
        Root mean square of the difference over that of the current about its mean (-), over all samples; 0 for an axis
        without a difference at the limit.
    """
    left = left_by_gains(controller, record)
    first = record.steps - len(left)
    current = record.current[first:]
    law = current - left
    free = free_samples(record, controller.current_limit)[first:]
    top = np.abs(current).max(axis=0)
    limit = np.full_like(top, controller.current_limit) if controller.current_limit < UNLIMITED else top
    rest = current - np.clip(law, -limit, limit)
    at_limit = ~free | (np.abs(law) > limit)
    allowed = _MEASURED * np.minimum(limit, top) + _NOISE * _rms(left, free)
    differs = np.count_nonzero(at_limit & (np.abs(rest) > allowed), axis=0) >= TOPS
    differs &= (np.count_nonzero(free, axis=0) > TOPS) & (_rms(rest, at_limit) > allowed)
    return np.where(differs, _shares(rest, current), 0.0)


def named_at_limit(controller: ControllerParameters, record: LoopRecord, shares: Arrays) -> Trial | None:
    """The law with another limit or derivative that leaves a fraction of what the given one leaves; None without one.

    Parameters
    ----------
    controller : ControllerParameters
        The law that differs at the limit.
    record : LoopRecord
        References, positions and currents.
    shares : ndarray, shape (axes,)
        From `shares_at_limit`.

    Returns
    -------
    Trial or None
        The simplest such law, the one of the given limit and derivative but for one of them first.
    """
    on_other = "measurement" if controller.derivative_on == "error" else "error"
    other = controller.model_copy(update={"derivative_on": on_other})
    axes, ends = len(shares), np.abs(record.current).max(axis=0)[shares > 0.0]
    for law, as_shown in ((controller, True), (other, False), (other, True)):
        left = _limited(law, record, as_shown)
        if left[shares > 0.0].max() <= min(BETTER * shares.max(), FOREIGN):
            same = np.ones((axes, 2)), np.zeros(axes)
            limits = tuple(ends.tolist()) if as_shown else ()
            return Trial(left, tuple(range(axes)), *same, other_derivative=law is other, limits=limits)
    return None


def _limited(controller: ControllerParameters, record: LoopRecord, as_shown: bool) -> Arrays:
    """Part of the currents that a law leaves with its limit, or with the range that they show; shape (axes,)."""
    left = left_by_gains(controller, record)
    current = record.current[record.steps - len(left) :]
    limit = controller.current_limit
    lowest, highest = (current.min(axis=0), current.max(axis=0)) if as_shown else (-limit, limit)
    return _shares(current - np.clip(current - left, lowest, highest), current)


def _shares(rest: Arrays, current: Arrays) -> Arrays:
    """Root mean square of what is left over that of the currents about their means, shape (axes,)."""
    moved = current.std(axis=0)
    return np.sqrt(np.mean(rest**2, axis=0)) / np.where(moved > 0.0, moved, np.inf)


def _rms(values: Arrays, rows: NDArray[np.bool_]) -> Arrays:
    """Root mean square of each column over the samples chosen, 0 without any; shape (axes,)."""
    count = np.maximum(np.count_nonzero(rows, axis=0), 1)
    return np.asarray(np.sqrt(np.sum(np.where(rows, values, 0.0) ** 2, axis=0) / count))
