"""Signals on their way between plant and target: plugged in wrongly, turned, scaled, late, or behind a low-pass."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import ParameterError
from amb_core.rig.emulation.parameters import CoilFaultParameters, SensorFaultParameters

Faults = SensorFaultParameters | CoilFaultParameters


class FaultySignals:
    """What sensors and coils have in common: mixing of axes, low-pass and delay.

    Parameters
    ----------
    kind : str
        `sensor` or `coil`, for messages.
    faults : SensorFaultParameters or CoilFaultParameters
        The faults.
    axes : tuple of str
        Names of the axes.
    sample_rate : float
        Of the signals (Hz).

    Raises
    ------
    ParameterError
        If a fault names an axis that the machine lacks.
    """

    def __init__(self, kind: str, faults: Faults, axes: tuple[str, ...], sample_rate: float) -> None:
        self._mixing = mixing(kind, faults, axes)
        self._slow, self._late = (named(kind, name, getattr(faults, name), axes) for name in ("slow", "late"))
        self._share = 1.0 - math.exp(-2.0 * math.pi * faults.corner / sample_rate)
        self._filtered: NDArray[np.float64] | None = None
        self._waiting: deque[NDArray[np.float64]] = deque(maxlen=round(faults.late_steps) + 1)

    def apply(self, signals: NDArray[np.float64]) -> None:
        """Change signals of all axes, shape (axes,), in place."""
        signals[:] = self._mixing @ signals
        if self._slow:
            now = signals[self._slow]
            self._filtered = now if self._filtered is None else self._filtered + self._share * (now - self._filtered)
            signals[self._slow] = self._filtered
        if self._late:
            self._waiting.append(signals[self._late])
            signals[self._late] = self._waiting[0]


def mixing(kind: str, faults: Faults, axes: tuple[str, ...]) -> NDArray[np.float64]:
    """Signal at each axis (row) per signal of each axis (column), without dynamics.

    Raises
    ------
    ParameterError
        If the machine lacks an axis, or the swapped or turned ones are not two.
    """
    matrix = np.eye(len(axes))
    for fault in ("turned", "swapped"):
        pair = named(kind, fault, getattr(faults, fault), axes)
        if len(pair) not in (0, 2):
            raise ParameterError(
                f"parameter 'faults.{kind}.{fault}' = '{getattr(faults, fault)}' is not allowed; allowed: two axes"
            )
        if pair:
            angle = math.radians(faults.angle)
            turn = [[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]]
            matrix[pair] = (turn if fault == "turned" else np.eye(2)[::-1]) @ matrix[pair]
    matrix[named(kind, "inverted", faults.inverted, axes)] *= -1.0
    matrix[named(kind, "scaled", faults.scaled, axes)] *= faults.scale
    return matrix


def named(kind: str, fault: str, names: str, axes: tuple[str, ...]) -> list[int]:
    """Numbers of the axes that a text such as `x_a, y_b` names.

    Raises
    ------
    ParameterError
        If the machine lacks one of them.
    """
    asked = names.replace(",", " ").split()
    for name in asked:
        if name not in axes:
            raise ParameterError(f"parameter 'faults.{kind}.{fault}' names axis '{name}'; axes: {', '.join(axes)}")
    return [axis for axis, name in enumerate(axes) if name in asked]
