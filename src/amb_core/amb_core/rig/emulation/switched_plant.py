"""The plant behind amplifiers that a target switches on and off.

Off, the rotor rests where the plant's reset puts it, or where a hand holds it, and the sensors show that position; with
their noise if the rotor can lie on its backup bearing. The sample in which the amplifiers are switched on is sample 0
of the plant, so the samples from then onwards are those of a simulation from its reset, bit for bit; with noise at rest
that first one has other noise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import PlantError
from amb_core.plant import Plant
from amb_core.plant.sensing import Sensing

_NOISE_OFF = 7  # stream of the noise while the amplifiers are off: that of the plant begins with its samples


class SwitchedPlant:
    """A plant with its amplifiers.

    Parameters
    ----------
    plant : Plant
        The plant; it is reset.

    Attributes
    ----------
    position : sequence of float
        Measured position of each axis (m).
    coil_current : ndarray, shape (coils,)
        Measured coil currents (A), in the order of `Plant.coil_currents`; 0 while the amplifiers are off.
    fault : str
        Why the amplifiers report a fault; empty if they do not. The rotor touched a backup bearing that is not part of
        the model, or the model does not hold any more: the rotor stays where it is until the amplifiers are off.
    """

    position: Sequence[float]
    coil_current: NDArray[np.float64]

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._no_current = np.zeros(len(plant.coil_currents))
        self._sensing = Sensing(plant.parameters, len(plant.machine.axes), _NOISE_OFF)
        self._noisy = self._sensing.real and plant.parameters.backup_bearing.contact
        self._hand: NDArray[np.float64] | None = None
        self._rest()

    def hold(self, position: NDArray[np.float64] | None) -> None:
        """Hold the rotor by hand at a position (m), shape (axes,), while the amplifiers are off; None lets it go."""
        self._hand = position

    def advance(self, enabled: bool, currents: NDArray[np.float64]) -> None:
        """One sample with the amplifiers on, with control current references (A), or off."""
        if not enabled:
            if self._moved:
                self._rest()
            elif self._hand is not None or self._noisy:
                self.position = self._sensing.measure(self._resting if self._hand is None else self._hand).tolist()
        elif not self.fault:
            self._move(currents)

    def _move(self, currents: NDArray[np.float64]) -> None:
        self._moved = True
        try:
            self.position = self._plant.advance(currents)
        except PlantError as problem:
            self.fault = str(problem)
            return
        self.coil_current = self._plant.coil_currents
        if self._plant.delevitated:
            self.fault = f"the rotor touched the backup bearing at sample {self._plant.samples} of this levitation"

    def _rest(self) -> None:
        self._plant.reset()
        self._moved = False
        self.fault = ""
        self.position = self._plant.position
        self._resting = self._plant.sensed
        self.coil_current = self._no_current
