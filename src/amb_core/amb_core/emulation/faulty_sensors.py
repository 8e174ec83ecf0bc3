"""Position sensors that are stuck, noisy, failed, or wrongly wired."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from amb_core.emulation.parameters import SensorFaultParameters
from amb_core.errors import ParameterError


class FaultySensors:
    """The position sensors of a machine with faults on request.

    Parameters
    ----------
    axes : tuple of str
        Names of the axes.
    faults : SensorFaultParameters
        The faults.
    seed : int
        Of the noise.

    Raises
    ------
    ParameterError
        If a fault names an axis that the machine lacks.
    """

    def __init__(self, axes: tuple[str, ...], faults: SensorFaultParameters, seed: int) -> None:
        self._axes = axes
        self._held: dict[int, float] = {}
        self.restart(seed)
        self.configure(faults)

    def restart(self, seed: int) -> None:
        """Begin the noise anew."""
        self._generator = np.random.default_rng(seed)

    def configure(self, faults: SensorFaultParameters) -> None:
        """Use other faults from now on. A sensor that stays stuck keeps its value.

        Raises
        ------
        ParameterError
            If a fault names an axis that the machine lacks; nothing changes.
        """
        stuck, noisy, failed = faulty_axes(faults, self._axes)
        self._source, self._sign = wiring(faults, self._axes)
        self._stuck, self._noisy, self._failed, self._noise = stuck, noisy, failed, faults.noise
        self._held = {axis: value for axis, value in self._held.items() if axis in stuck}
        self._right = not (stuck or noisy or failed or faults.inverted or faults.swapped)

    def apply(self, position: NDArray[np.float64]) -> None:
        """Change measured positions (m), shape (axes,), in place."""
        if self._right:
            return
        position[:] = self._sign * position[self._source]
        if self._noisy:
            position[self._noisy] += self._noise * self._generator.standard_normal(len(self._noisy))
        for axis in self._stuck:
            position[axis] = self._held.setdefault(axis, float(position[axis]))
        position[self._failed] = math.nan


def faulty_axes(faults: SensorFaultParameters, axes: tuple[str, ...]) -> tuple[list[int], list[int], list[int]]:
    """Numbers of the axes whose sensors are stuck, noisy and failed.

    Raises
    ------
    ParameterError
        If the machine, with these axes, lacks one of them.
    """
    wiring(faults, axes)
    stuck, noisy, failed = (_numbers(name, getattr(faults, name), axes) for name in ("stuck", "noisy", "failed"))
    return stuck, noisy, failed


def wiring(faults: SensorFaultParameters, axes: tuple[str, ...]) -> tuple[list[int], NDArray[np.float64]]:
    """Number of the sensor that is plugged in at each axis, and the sign of its signal there, shape (axes,).

    Raises
    ------
    ParameterError
        If the machine, with these axes, lacks one of them, or the swapped ones are not two.
    """
    source, sign = list(range(len(axes))), np.ones(len(axes))
    sign[_numbers("inverted", faults.inverted, axes)] = -1.0
    swapped = _numbers("swapped", faults.swapped, axes)
    if len(swapped) not in (0, 2):
        raise ParameterError(
            f"parameter 'faults.sensor.swapped' = '{faults.swapped}' is not allowed; allowed: two axes"
        )
    if swapped:
        source[swapped[0]], source[swapped[1]] = swapped[1], swapped[0]
    return source, sign


def _numbers(fault: str, names: str, axes: tuple[str, ...]) -> list[int]:
    """Numbers of the axes that a text such as `x_a, y_b` names."""
    asked = names.replace(",", " ").split()
    for name in asked:
        if name not in axes:
            raise ParameterError(f"parameter 'faults.sensor.{fault}' names axis '{name}'; axes: {', '.join(axes)}")
    return [axis for axis, name in enumerate(axes) if name in asked]
