"""Position sensors that are stuck, noisy, failed, coarse, or wrongly wired."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from amb_core.rig.emulation.faulty_signals import FaultySignals, named
from amb_core.rig.emulation.parameters import SensorFaultParameters

_MAINS = 50.0  # Hz
_OF_AXES = ("stuck", "noisy", "disturbed", "humming", "failed", "shifted", "clipped", "coarse")


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
    sample_rate : float
        Of the measurements (Hz).

    Raises
    ------
    ParameterError
        If a fault names an axis that the machine lacks.
    """

    def __init__(
        self, axes: tuple[str, ...], faults: SensorFaultParameters, seed: int, sample_rate: float = 10_000.0
    ) -> None:
        self._axes, self._rate = axes, sample_rate
        self._held: dict[int, float] = {}
        self._samples = 0
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
        numbers = faulty_axes(faults, self._axes)
        self._signals = FaultySignals("sensor", faults, self._axes, self._rate)
        self._faults, self._numbers = faults, numbers
        self._held = {axis: value for axis, value in self._held.items() if axis in numbers["stuck"]}
        self._right = not any(getattr(faults, name) for name in (*_OF_AXES, "inverted", "swapped", "turned", "scaled",
                                                                 "late", "slow"))  # fmt: skip

    def apply(self, position: NDArray[np.float64], on: bool = False) -> None:
        """Change measured positions (m), shape (axes,), in place; `on`: whether the amplifiers are."""
        if self._right:
            return
        faults, numbers = self._faults, self._numbers
        self._signals.apply(position)
        position[numbers["shifted"]] += faults.shift
        noisy = [*numbers["noisy"], *(numbers["disturbed"] if on else ())]
        if noisy:
            position[noisy] += faults.noise * self._generator.standard_normal(len(noisy))
        if humming := numbers["humming"]:
            position[humming] += faults.hum * math.sin(2.0 * math.pi * _MAINS * self._samples / self._rate)
            self._samples += 1
        if clipped := numbers["clipped"]:
            position[clipped] = np.clip(position[clipped], -faults.reach, faults.reach)
        if coarse := numbers["coarse"]:
            position[coarse] = np.rint(position[coarse] / faults.resolution) * faults.resolution
        for axis in numbers["stuck"]:
            position[axis] = self._held.setdefault(axis, float(position[axis]))
        position[numbers["failed"]] = math.nan


def faulty_axes(faults: SensorFaultParameters, axes: tuple[str, ...]) -> dict[str, list[int]]:
    """Numbers of the axes that each fault names.

    Raises
    ------
    ParameterError
        If the machine, with these axes, lacks one of them, or those swapped or turned are not two.
    """
    FaultySignals("sensor", faults, axes, 1.0)
    return {name: named("sensor", name, getattr(faults, name), axes) for name in _OF_AXES}
