"""Records from which distortion and coherence can be measured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import SpectrumError
from amb_core.loop.records import LoopRecord

STILL = 1e-15
"""Motion (m) of a signal that stands still: far below any sensor, far above the rounding of positions."""


def axes_of(records: Sequence[LoopRecord]) -> tuple[str, ...]:
    """The axes of the machine that all records are of.

    Raises
    ------
    SpectrumError
        If a record has other axes than the first one.
    """
    axes = tuple(records[0].axes)
    for record in records:
        if tuple(record.axes) != axes:
            raise SpectrumError(
                f"the records are of different machines: axes {', '.join(axes)} and {', '.join(record.axes)}"
            )
    return axes


def moving(signal: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which columns of a reference or of positions (m), shape (..., axes), move; shape (axes,)."""
    return np.asarray(np.ptp(signal.reshape(-1, signal.shape[-1]), axis=0) > STILL)


def require_motion(axes: Sequence[str], reference: NDArray[np.float64], position: NDArray[np.float64]) -> None:
    """Refuse a position that stands still although its reference moves; shapes (..., axes).

    Raises
    ------
    SpectrumError
        If there is one; the message names its axis.
    """
    still = [axis for axis, stuck in zip(axes, moving(reference) & ~moving(position), strict=True) if stuck]
    if still:
        raise SpectrumError(
            f"the position does not move on {' and '.join(still)} while the reference does: a dead or stuck sensor; "
            "needed: positions that follow their reference"
        )
