"""Energy balance over traces of the plant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import trapezoid

from amb_core.plant.network import POLES
from amb_core.plant.plant import Plant
from amb_core.plant.trace import Trace


class EnergyAccount:
    """Energies of a run (J), summed over consecutive traces of one plant, both radial bearings together.

    A thrust bearing and the motion along the axis, which exchange no energy with them, are not part of it.

    Create it in the state of the plant at which the first trace begins. Powers are integrated by the trapezoidal rule
    over each internal step, with the voltages of that step at both ends: currents and flux rates jump with them.

    Parameters
    ----------
    plant : Plant
        The plant that is traced.

    Attributes
    ----------
    electrical : float
        Delivered by the amplifiers.
    copper, eddy : float
        Lost in the windings, and as eddy currents of the pole fluxes in thin laminations.
    stored : float
        Gained by the magnetic field in air gaps and linear iron.
    iron : float
        Taken up by nonlinear iron: field, hysteresis loss, eddy currents of the fluxes that circulate in its rings.
    diffusion : float
        Taken up by the diffusion into laminations and solid journals: lost, but for the field of the flux that the
        mean flux does not have.
    mechanical : float
        Work of the magnetic forces on the rotor.
    work : float
        Work of the magnetic forces with absolute values: the scale of the balance in `mechanical`.
    contact, disturbance : float
        Work of the backup bearings, and of external force and unbalance, on the rotor.
    kinetic, strain, potential : float
        Gained by the rotor as kinetic, strain and potential energy.
    damping : float
        Lost by the rotor to its surroundings.
    """

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._last: Trace | None = None
        self._steps = plant.samples * plant.parameters.steps_per_sample
        self.electrical = self.copper = self.eddy = self.stored = self.iron = self.diffusion = 0.0
        self.mechanical = self.work = self.contact = self.disturbance = 0.0
        self.kinetic = self.strain = self.potential = self.damping = 0.0

    @property
    def circuit_residual(self) -> float:
        """Electrical energy that is neither lost, stored nor done as work on the rotor (J)."""
        taken_up = self.copper + self.eddy + self.stored + self.iron + self.diffusion
        return self.electrical - taken_up - self.mechanical

    @property
    def rotor_residual(self) -> float:
        """Work on the rotor that is neither stored in it nor lost (J)."""
        gained = self.kinetic + self.strain + self.potential
        return self.mechanical + self.contact + self.disturbance - gained - self.damping

    def add(self, trace: Trace) -> None:
        """Add the steps of a trace that starts where the previous one ended."""
        if self._last is not None:
            trace = _each(lambda *pair: np.concatenate(pair), self._last, trace)
        self._last = _each(lambda rows: rows[-1:], trace)
        bearing: Trace | None = trace
        while bearing is not None:
            self._add_circuit(bearing)
            bearing = bearing.bearing_b
        self.iron += float(trace.iron_energy[-1] - trace.iron_energy[0])
        self.diffusion += float(trace.diffusion_energy[-1] - trace.diffusion_energy[0])
        self._add_disturbance(trace)
        if self._plant.rotor is None:
            self._add_point_mass(trace)
        else:
            self._add_rotor(trace)
        self._steps += len(trace.time) - 1

    def _add_circuit(self, trace: Trace) -> None:
        network, circuit = self._plant.network, self._plant.parameters.magnetic_circuit
        applied = trace.voltage[:-1]
        change = applied - trace.voltage[1:]
        by_rate, by_current = np.split(network.solution[:, POLES:], [POLES])
        rates = trace.flux_rate[:-1], trace.flux_rate[1:] + change @ by_rate.T
        currents = trace.current[:-1], trace.current[1:] + change @ by_current.T
        if self._plant.parameters.iron.laminations == "diffusion":  # means over the steps, and no other eddy currents
            currents = trace.current[:-1], trace.current[:-1]
            rates = np.zeros((1, POLES)), np.zeros((1, POLES))
        half = 0.5 * self._plant.parameters.integration.internal_step
        self.electrical += half * sum(float(np.sum(applied * side)) for side in currents)
        self.copper += half * sum(float(np.sum(circuit.coil_resistance * side**2)) for side in currents)
        self.eddy += half * sum(float(np.sum(side * (side @ network.eddy_coefficient))) for side in rates)
        self.stored += self._field(trace, -1) - self._field(trace, 0)
        push = np.sum(trace.force * trace.velocity, axis=1)
        self.mechanical += self._integral(push)
        self.work += self._integral(np.abs(push))
        self.contact += self._integral(np.sum(trace.contact_force * trace.velocity, axis=1))

    def _add_disturbance(self, trace: Trace) -> None:
        rotor, model = self._plant.parameters.rotor, self._plant.rotor
        time = (self._steps + np.arange(len(trace.time))) * self._plant.parameters.integration.internal_step
        external = np.array([rotor.external_force_x, rotor.external_force_y])
        wave = np.cos(2.0 * np.pi * rotor.external_force_frequency * time)
        self.disturbance += self._integral(wave * (trace.velocity @ external))
        speed = 2.0 * np.pi * rotor.running_speed
        turning = rotor.unbalance * speed**2 * np.column_stack([np.cos(speed * time), np.sin(speed * time)])
        velocity = trace.velocity if model is None else trace.rates @ model.unbalance.T
        self.disturbance += self._integral(np.sum(turning * velocity, axis=1))

    def _add_point_mass(self, trace: Trace) -> None:
        rotor = self._plant.parameters.rotor
        self.kinetic += 0.5 * rotor.mass * float(np.sum(trace.velocity[-1] ** 2 - trace.velocity[0] ** 2))
        self.potential += rotor.mass * rotor.gravity * float(trace.position[-1, 1] - trace.position[0, 1])

    def _add_rotor(self, trace: Trace) -> None:
        model = self._plant.rotor
        assert model is not None
        self.kinetic += 0.5 * _gained(trace.rates, model.mass)
        self.strain += 0.5 * _gained(trace.coordinates, model.stiffness)
        self.potential -= float(model.weight @ (trace.coordinates[-1] - trace.coordinates[0]))
        self.damping += self._integral(np.sum(trace.rates * (trace.rates @ model.damping), axis=1))

    def _integral(self, power: NDArray[np.float64]) -> float:
        return float(trapezoid(power, dx=self._plant.parameters.integration.internal_step))

    def _field(self, trace: Trace, row: int) -> float:
        (x, y), flux = trace.position[row], trace.flux[row]
        reluctance = self._plant.network.reluctance(x, y, self._plant.parameters.magnetic_circuit.air_gap)
        return 0.5 * float(flux @ reluctance @ flux)


def _gained(rows: NDArray[np.float64], form: NDArray[np.float64]) -> float:
    """Change of a quadratic form from the first to the last row."""
    return float(rows[-1] @ form @ rows[-1] - rows[0] @ form @ rows[0])


def _each(function: Callable[..., NDArray[np.float64]], *traces: Trace) -> Trace:
    """Trace with the results of a function of the arrays of traces of one plant."""
    names = [field.name for field in fields(Trace) if field.name not in ("bearing_b", "axial")]
    arrays = {name: function(*(getattr(trace, name) for trace in traces)) for name in names}
    others = [trace.bearing_b for trace in traces if trace.bearing_b is not None]
    return Trace(**arrays, bearing_b=_each(function, *others) if others else None, axial=None)
