"""Where the energy goes: an account over traces of the plant."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from amb_core.plant.network import POLES
from amb_core.plant.plant import Plant, Trace

Rows = tuple[NDArray[np.float64], ...]


class EnergyAccount:
    """Energies of a run (J), summed over consecutive traces of one plant from the first row on.

    Powers are integrated by the trapezoidal rule over each internal step, with the voltages of that step at both ends:
    currents and flux rates jump with the voltages.

    Parameters
    ----------
    plant : Plant
        The plant that is traced.

    Attributes
    ----------
    electrical : float
        Delivered by the amplifiers.
    copper, eddy : float
        Lost in the windings and as eddy currents.
    stored : float
        Gained by the magnetic field.
    mechanical : float
        Work of the magnetic force on the rotor.
    work : float
        Work of the magnetic force without regard to sign: the scale of what `mechanical` is the balance of.
    kinetic, potential : float
        Gained by the rotor, in motion and in height.
    """

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._last: Rows | None = None
        self.electrical = self.copper = self.eddy = self.stored = 0.0
        self.mechanical = self.work = self.kinetic = self.potential = 0.0

    def add(self, trace: Trace) -> None:
        """Add the steps of a trace that starts where the one before ended."""
        rows: Rows = (
            trace.flux,
            trace.flux_rate,
            trace.current,
            trace.voltage,
            trace.position,
            trace.velocity,
            trace.force,
        )
        if self._last is not None:
            rows = tuple(np.concatenate(pair) for pair in zip(self._last, rows, strict=True))
        self._last = tuple(array[-1:] for array in rows)
        self._add_steps(*rows)

    def _add_steps(
        self,
        flux: NDArray[np.float64],
        flux_rate: NDArray[np.float64],
        current: NDArray[np.float64],
        voltage: NDArray[np.float64],
        position: NDArray[np.float64],
        velocity: NDArray[np.float64],
        force: NDArray[np.float64],
    ) -> None:
        network, circuit = self._plant.network, self._plant.parameters.magnetic_circuit
        rotor = self._plant.parameters.rotor
        applied = voltage[:-1]
        change = applied - voltage[1:]
        by_rate, by_current = np.split(network.solution[:, POLES:], [POLES])
        rates = flux_rate[:-1], flux_rate[1:] + change @ by_rate.T
        currents = current[:-1], current[1:] + change @ by_current.T
        half = 0.5 * self._plant.parameters.integration.internal_step
        self.electrical += half * sum(float(np.sum(applied * side)) for side in currents)
        self.copper += half * sum(float(np.sum(circuit.coil_resistance * side**2)) for side in currents)
        self.eddy += half * sum(float(np.sum(side * (side @ network.eddy_coefficient))) for side in rates)
        push = np.sum(force * velocity, axis=1)
        self.mechanical += half * float(np.sum(push[:-1] + push[1:]))
        self.work += half * float(np.sum(np.abs(push[:-1]) + np.abs(push[1:])))
        self.stored += self._field(flux[-1], position[-1]) - self._field(flux[0], position[0])
        self.kinetic += 0.5 * rotor.mass * float(np.sum(velocity[-1] ** 2 - velocity[0] ** 2))
        self.potential += rotor.mass * rotor.gravity * float(position[-1, 1] - position[0, 1])

    def _field(self, flux: NDArray[np.float64], position: NDArray[np.float64]) -> float:
        gap = self._plant.parameters.magnetic_circuit.air_gap
        reluctance = self._plant.network.reluctance(position[0], position[1], gap)
        return 0.5 * float(flux @ reluctance @ flux)
