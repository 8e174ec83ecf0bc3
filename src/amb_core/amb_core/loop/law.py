"""What every control law of the workbench offers: to the nodes, and to the loop without ROS."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from amb_core.ground.errors import ParameterError
from amb_core.ground.given_values import whole_number

HIGHEST_AXES = 1_000
"""Number of axes that a law of this library can have: far more than a machine has."""


@runtime_checkable
class ControlLaw(Protocol):
    """A control law with its state: one call of `update` per controller sample."""

    nominal_reference: NDArray[np.float64]
    """Reference position of each axis without an excitation (m), shape (axes,)."""

    @property
    def axes(self) -> int:
        """Number of axes."""

    @property
    def sample_rate(self) -> float:
        """Sample rate for which it is made (Hz)."""

    def reset(self) -> None:
        """Forget the past: the next sample is the first."""

    def update(self, position: ArrayLike, reference: ArrayLike) -> NDArray[np.float64]:
        """Control current references (A), shape (axes,), for a measured and a reference position (m) of each axis."""


def number_of_axes(axes: int) -> int:
    """The number of axes of a law; ParameterError for what is none."""
    count = whole_number("axes", axes, ParameterError)
    if not 1 <= count <= HIGHEST_AXES:
        raise ParameterError(f"axes = {count} is not allowed; allowed: 1 to {HIGHEST_AXES}")
    return count


def set_samples(
    position: NDArray[np.float64],
    reference: NDArray[np.float64],
    measured: ArrayLike,
    wanted: ArrayLike,
) -> None:
    """Copy the samples of a step into arrays of shape (axes,), in which anything of another length is refused.

    Parameters
    ----------
    position, reference : ndarray, shape (axes,)
        Receive the samples (m).
    measured, wanted : array_like, shape (axes,)
        Measured position and reference position (m).

    Raises
    ------
    ParameterError
        If they are not one number for each axis; NumPy would repeat a single one.
    """
    try:
        fit = len(measured) == len(wanted) == len(position)  # type: ignore[arg-type]
        position[:] = measured
        reference[:] = wanted
    except (TypeError, ValueError):
        fit = False
    if not fit:
        raise ParameterError(
            f"position: {_kind(measured)}, reference: {_kind(wanted)} is not allowed; allowed: {len(position)} numbers "
            "each, one for each axis"
        )


def _kind(values: ArrayLike) -> str:
    try:
        return f"{type(values).__name__} of shape {np.shape(values)}"
    except ValueError:  # rows of different lengths
        return type(values).__name__
