"""Signal path from the rotor to the controller and back: sensor noise, converters, computation delay."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from amb_core.plant.parameters import PlantParameters

_NOISE_BLOCK = 4096


class Sensing:
    """Measured positions: with noise, in steps of the converter. The low-pass is part of the kernel.

    Parameters
    ----------
    parameters : PlantParameters
        The plant; only its `sensor` and `converters` are used.
    axes : int
        Number of measured positions.
    stream : int, optional
        Number of the stream of noise: others are independent. Axes keep their noise whatever other streams there are.

    Attributes
    ----------
    real : bool
        Whether a measurement differs from the position at all.
    """

    def __init__(self, parameters: PlantParameters, axes: int, stream: int = 0) -> None:
        self._stream = stream
        self._sensor, self._resolution = parameters.sensor, parameters.converters.position_resolution
        self._axes = axes
        self.real = parameters.sensor.noise > 0.0 or self._resolution > 0.0
        self.reset()

    def reset(self) -> None:
        """Restart the noise: it is the same after every reset."""
        key = (self._stream,) if self._stream else ()
        seed = np.random.SeedSequence(self._sensor.noise_seed, spawn_key=key)
        self._generator = np.random.Generator(np.random.PCG64(seed))
        self._noise = np.empty((0, self._axes))
        self._used = 0

    def measure(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Measured positions (m) of the next sample."""
        if self._sensor.noise > 0.0:
            if self._used == len(self._noise):
                self._noise = self._sensor.noise * self._generator.standard_normal((_NOISE_BLOCK, self._axes))
                self._used = 0
            position = position + self._noise[self._used]
            self._used += 1
        return quantise(position, self._resolution)


def quantise(values: NDArray[np.float64], resolution: float) -> NDArray[np.float64]:
    """Values rounded to whole steps of a converter; 0 for none."""
    return values if resolution == 0.0 else np.asarray(np.rint(values / resolution) * resolution)
