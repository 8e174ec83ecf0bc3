"""The plant with averaged amplifiers as an ordinary differential equation: the reference for kernel and linearisation.

State s: for each bearing the pole fluxes phi_0..phi_7 (Wb), with nonlinear iron the fluxes that circulate in back iron
and journal (Wb), with diffusion into laminations or a solid journal the memories m_n of its terms (Wb), and the
integral parts I_c of the current controllers (-) of electromagnets +x, +y, -x, -y; then coordinates q and rates v of
the rotor, which for a point mass are position (m) and velocity (m/s). With coil current references r_c = clip(i_0 +
i_x, 0, i_max) (i_0 - i_x for -x, i_y likewise), supply voltage U and the network of `amb_core.plant.network`,

    e_c = r_c - i_c,    d_c = clip(1/2 + K_P e_c + I_c, d_min, d_max),    V_c = U (2 d_c - 1)
    (dphi/dt, i) = M (h, V),    h = diag(g_j / (mu_0 A)) phi + R phi + drops of nonlinear iron and diffusion
    dI_c/dt = K_I e_c, or 0 while the duty is at a limit
    m dv/dt = sum_j phi_j^2 / (2 mu_0 A) (cos theta_j, sin theta_j) + f - (0, m g),    dq/dt = v

with a constant external force f, which acts at bearing A of a rotor in two.

With eddy currents, part of a coil current follows its voltage at once (M has a block from V to i), so V and i are
solved together. If the current of a unipolar coil would be negative, its voltage is the one that keeps it zero. Dead
time takes a part of the duty from a positive current, and adds as much to that of a negative one.

Iron with hysteresis is represented by its single-valued curve. If the plant has no eddy currents, a thousandth of them
remains, so that all fluxes have rates. Sensors, alternating forces and backup bearings are not part of these equations.

Written for clarity, independently of the compiled kernel. The kernel holds the duty over each switching period (over
each internal step with `switching` off). It approaches these equations to first order as that period goes to zero:
its currents lag their references less by about one period, whose mean current is the one before it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from amb_core.plant.magnetostatics import RINGS
from amb_core.plant.network import COIL_AXES, COILS, POLES, active_coils, flux_constraints
from amb_core.plant.parameters import AmplifierParameters
from amb_core.plant.plant import Plant

_SWEEPS = 200
_VOLTAGE_TOLERANCE = 1e-10  # V; makes 1e-14 A through the eddy currents' conductance
_BEARINGS = ("a", "b")
_COIL_NAMES = ("+x", "+y", "-x", "-y")


class AveragedPlant:
    """Right-hand side, states and outputs of the averaged plant.

    Parameters
    ----------
    plant : Plant
        Gives parameters, network and rotor; its own state is neither used nor changed.

    Attributes
    ----------
    size : int
        Number of states.
    flux, circulating, memory, integral : tuple of slice
        Positions of the states of each bearing.
    coordinates, rates : slice
        Positions of the states of the rotor.
    names : tuple of str
        Names of the states.
    """

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        network = plant.network
        self._solution = network.averaged_solution
        self._circulation = network.circulation
        self._rings = RINGS if plant.magnetostatics.nonlinear else 0
        parts = network.diffusing
        self._weights = np.concatenate([np.zeros(0), *(part.terms.weights for part in parts)])
        self._decay = np.concatenate([np.zeros(0), *(part.terms.rates for part in parts)])
        # Drops of all memories, in the order of the states
        self._by_memory = np.hstack(
            [np.zeros((POLES, 0)), *(np.tile(part.reluctance, len(part.terms.rates)) for part in parts)]
        )
        self._external = np.zeros(2 * plant.bearings)
        self._external[:2] = plant.parameters.rotor.constant_force[:2]
        terms = len(self._weights)
        names: list[str] = []
        flux: list[slice] = []
        circulating: list[slice] = []
        memory: list[slice] = []
        integral: list[slice] = []
        for bearing in range(plant.bearings):
            suffix = "" if plant.bearings == 1 else f"_{_BEARINGS[bearing]}"
            for slices, block in (
                (flux, [f"flux_{pole}{suffix}" for pole in range(POLES)]),
                (circulating, [f"circulating_{ring}{suffix}" for ring in range(self._rings)]),
                (memory, [f"memory_{term}_{pole}{suffix}" for term in range(terms) for pole in range(POLES)]),
                (integral, [f"integral_{coil}{suffix}" for coil in _COIL_NAMES]),
            ):
                slices.append(slice(len(names), len(names) + len(block)))
                names += block
        coordinates = ("x", "y") if plant.rotor is None else plant.rotor.coordinate_names
        self.flux, self.circulating = tuple(flux), tuple(circulating)
        self.memory, self.integral = tuple(memory), tuple(integral)
        self.coordinates = slice(len(names), len(names) + len(coordinates))
        self.rates = slice(self.coordinates.stop, self.coordinates.stop + len(coordinates))
        self.names = (*names, *coordinates, *(f"v_{name}" for name in coordinates))
        self.size = len(self.names)

    def derivative(self, state: NDArray[np.float64], current_reference: NDArray[np.float64]) -> NDArray[np.float64]:
        """Right-hand side ds/dt.

        Parameters
        ----------
        state : ndarray, shape (size,)
            State; see above.
        current_reference : ndarray, shape (2 * bearings,)
            Control current references i_x, i_y of each bearing (A); the amplifiers add the bias current.
        """
        amplifier = self.plant.parameters.amplifier
        derivative = np.zeros(self.size)
        forces = []
        for bearing in range(self.plant.bearings):
            reference = current_reference[2 * bearing : 2 * bearing + 2]
            drops = self.drops(state, bearing)
            voltage, current = self._amplifier_output(state, drops[:POLES], reference, bearing)
            rates = self._solution[:POLES] @ np.concatenate([drops[:POLES], voltage])
            error = coil_references(reference, self.plant) - current
            duty = 0.5 + amplifier.proportional_gain * error + state[self.integral[bearing]]
            low, high = _duty_limits(self.plant)
            derivative[self.flux[bearing]] = rates
            derivative[self.circulating[bearing]] = (-self._circulation * drops[POLES:])[: self._rings]
            memory = state[self.memory[bearing]].reshape(-1, POLES)
            derivative[self.memory[bearing]] = (
                np.outer(self._weights, rates) - self._decay[:, np.newaxis] * memory
            ).ravel()
            derivative[self.integral[bearing]] = np.where(
                (low <= duty) & (duty <= high), amplifier.integral_gain * error, 0.0
            )
            forces.append(self.plant.magnetostatics.force(state[self.flux[bearing]]))
        derivative[self.coordinates] = state[self.rates]
        derivative[self.rates] = self._accelerations(state, np.concatenate(forces))
        return derivative

    def currents(self, state: NDArray[np.float64], current_reference: NDArray[np.float64]) -> NDArray[np.float64]:
        """Coil currents (A), shape (4 * bearings,), arguments as in `derivative`."""
        return np.concatenate(
            [
                self._amplifier_output(
                    state, self.drops(state, bearing)[:POLES], current_reference[2 * bearing : 2 * bearing + 2], bearing
                )[1]
                for bearing in range(self.plant.bearings)
            ]
        )

    def drops(self, state: NDArray[np.float64], bearing: int) -> NDArray[np.float64]:
        """Magnetomotive force drops (A), shape (10,): along each pole, around back iron and journal."""
        x, y = self.journals(state)[2 * bearing : 2 * bearing + 2]
        flux, circulating = state[self.flux[bearing]], np.zeros(RINGS)
        circulating[: self._rings] = state[self.circulating[bearing]]
        drops = self.plant.magnetostatics.drops(flux, circulating, x, y)
        drops[:POLES] += self._by_memory @ state[self.memory[bearing]]
        return drops

    def journals(self, state: NDArray[np.float64]) -> NDArray[np.float64]:
        """Positions of the journals (m), shape (2 * bearings,)."""
        rotor = self.plant.rotor
        return state[self.coordinates] if rotor is None else rotor.bearings @ state[self.coordinates]

    def sensors(self) -> NDArray[np.float64]:
        """Map from the state to the measured positions (m), shape (2 * bearings, size)."""
        sensors = np.zeros((2 * self.plant.bearings, self.size))
        sensors[:, self.coordinates] = np.eye(2) if self.plant.rotor is None else self.plant.rotor.sensors
        return sensors

    def at_rest(self, coordinates: NDArray[np.float64], current_reference: NDArray[np.float64]) -> NDArray[np.float64]:
        """State with amplifiers and fluxes at rest around a rotor that is held in place."""
        amplifier, resistance = self.plant.parameters.amplifier, self.plant.parameters.magnetic_circuit.coil_resistance
        state = np.zeros(self.size)
        state[self.coordinates] = coordinates
        journals = self.journals(state)
        for bearing in range(self.plant.bearings):
            current = coil_references(current_reference[2 * bearing : 2 * bearing + 2], self.plant)
            if amplifier.integral_gain > 0.0:
                lost = np.where(current < 0.0, -1.0, 1.0) * _lost_duty(self.plant)
                state[self.integral[bearing]] = resistance * current / (2.0 * amplifier.supply_voltage) + lost
            else:
                current = currents_without_integral(current, amplifier, resistance)
            self._magnetise(state, bearing, current, journals)
        return state

    def initial_state(self) -> NDArray[np.float64]:
        """State after `Plant.reset`: rotor at rest where it starts, fluxes of the bias currents, no integral parts."""
        rotor = self.plant.parameters.rotor
        x, y = rotor.initial_x, rotor.initial_y
        coordinates = np.array([x, y]) if self.plant.rotor is None else self.plant.rotor.coordinates_at(x, y)
        state = np.zeros(self.size)
        state[self.coordinates] = coordinates
        for bearing in range(self.plant.bearings):
            self._magnetise(state, bearing, self.plant.bias_currents(), self.journals(state))
        return state

    def _magnetise(
        self,
        state: NDArray[np.float64],
        bearing: int,
        coil_currents: NDArray[np.float64],
        journals: NDArray[np.float64],
    ) -> None:
        """Set the fluxes of constant coil currents (A)."""
        magnetised = self.plant.magnetostatics.solve(coil_currents, *journals[2 * bearing : 2 * bearing + 2])
        state[self.flux[bearing]] = magnetised.flux
        state[self.circulating[bearing]] = magnetised.circulating[: self._rings]

    def unbalanced(self, state: NDArray[np.float64]) -> NDArray[np.float64]:
        """Unbalanced generalised force on the rotor: for a point mass along x, y (N)."""
        forces = [self.plant.magnetostatics.force(state[self.flux[bearing]]) for bearing in range(self.plant.bearings)]
        return self._mass() @ self._accelerations(state, np.concatenate(forces))

    def _mass(self) -> NDArray[np.float64]:
        return self.plant.parameters.rotor.mass * np.eye(2) if self.plant.rotor is None else self.plant.rotor.mass

    def _accelerations(self, state: NDArray[np.float64], force: NDArray[np.float64]) -> NDArray[np.float64]:
        rotor, model = self.plant.parameters.rotor, self.plant.rotor
        if model is None:
            free = np.array(["x" in self.plant.axes, True])
            return free * ((force + self._external) / rotor.mass - np.array([0.0, rotor.gravity]))
        generalised = (
            model.bearings.T @ (force + self._external)
            + model.weight
            - model.stiffness @ state[self.coordinates]
            - (model.damping + model.gyroscopic) @ state[self.rates]
        )
        return np.asarray(np.linalg.solve(model.mass, generalised), dtype=np.float64)

    def _amplifier_output(
        self,
        state: NDArray[np.float64],
        drops: NDArray[np.float64],
        current_reference: NDArray[np.float64],
        bearing: int,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Consistent averaged coil voltages (V) and coil currents (A) in a state, each of shape (4,)."""
        amplifier = self.plant.parameters.amplifier
        conductance = self._solution[POLES:, POLES:]
        # The coil currents without the part that their voltages drive at once.
        flux_current = self._solution[POLES:, :POLES] @ drops
        supply = amplifier.supply_voltage
        gain = 2.0 * supply * amplifier.proportional_gain
        offset = state[self.integral[bearing]] - _lost_duty(self.plant)
        demand = gain * coil_references(current_reference, self.plant) + 2.0 * supply * offset
        lowest, highest = (supply * (2.0 * (duty - _lost_duty(self.plant)) - 1.0) for duty in _duty_limits(self.plant))
        # V = demand - gain (flux_current + conductance V) inside the limits. With limits, diodes and dead time V
        # minimises a convex function whose kinks belong to single coils, so solving coil by coil finds it
        # (Gauss-Seidel).
        voltage = np.asarray(
            np.linalg.solve(np.eye(COILS) + gain * conductance, demand - gain * flux_current), dtype=np.float64
        )
        for _ in range(_SWEEPS):
            before = voltage.copy()
            for coil in range(COILS):
                own = conductance[coil, coil]
                others = flux_current[coil] + conductance[coil] @ voltage - own * voltage[coil]
                wanted = (demand[coil] - gain * others) / (1.0 + gain * own)
                voltage[coil] = min(max(wanted, lowest), highest)
                if others + own * voltage[coil] < 0.0:
                    blocked = -others / own
                    # A negative current gains what dead time takes from a positive one, unless that makes it positive.
                    gained = 4.0 * supply * _lost_duty(self.plant)
                    reversed_ = min(max(wanted + gained / (1.0 + gain * own), lowest + gained), highest + gained)
                    voltage[coil] = blocked if amplifier.unipolar else min(reversed_, blocked)
            if np.abs(voltage - before).max() <= _VOLTAGE_TOLERANCE:
                break
        return voltage, flux_current + conductance @ voltage


def coil_references(current_reference: NDArray[np.float64], plant: Plant) -> NDArray[np.float64]:
    """Coil current references (A), shape (4,), from i_x, i_y (A) of a bearing; zero for coils without amplifier."""
    amplifier = plant.parameters.amplifier
    references = plant.bias_currents() + COIL_AXES @ current_reference
    lowest = 0.0 if amplifier.limits or amplifier.unipolar else -np.inf
    references = np.clip(references, lowest, amplifier.current_limit if amplifier.limits else np.inf)
    active = np.zeros(COILS)
    active[list(active_coils(plant.parameters.magnetic_circuit))] = 1.0
    return active * references


def currents_without_integral(
    references: NDArray[np.float64], amplifier: AmplifierParameters, resistance: float
) -> NDArray[np.float64]:
    """Constant coil currents of amplifiers without integral part (A): a control error remains.

    It makes the voltage across the resistance, and that which dead time takes in the direction of the current.

    Parameters
    ----------
    references : ndarray, shape (n,)
        Coil current references (A), none negative for unipolar amplifiers.
    amplifier : AmplifierParameters
        The amplifiers.
    resistance : float
        Of a coil (ohm).

    Returns
    -------
    ndarray, shape (n,)
        Coil currents (A).
    """
    gain = 2.0 * amplifier.supply_voltage * amplifier.proportional_gain
    if gain == 0.0:
        return 0.0 * references
    lost = 2.0 * amplifier.supply_voltage * amplifier.dead_time * amplifier.switching_frequency
    sizes = np.maximum(np.abs(references) * gain - lost, 0.0) / (gain + resistance)
    return np.copysign(sizes, references)


def flux_embedding(plant: Plant) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Independent pole fluxes, and the map from these to all pole fluxes.

    Returns
    -------
    kept : ndarray, shape (n,)
        Poles with independent fluxes: all but the last of each circuit.
    embedding : ndarray, shape (8, n)
        Maps their fluxes to all pole fluxes. An omitted flux is minus the sum of the others of its circuit.
    """
    circuits = flux_constraints(plant.parameters.magnetic_circuit.coupling)
    left_out = POLES - 1 - np.argmax(circuits[::-1], axis=0)
    kept = np.setdiff1d(np.arange(POLES), left_out)
    embedding = np.eye(POLES)[:, kept]
    embedding[left_out] = -circuits[kept].T
    return kept, embedding


def _duty_limits(plant: Plant) -> tuple[float, float]:
    amplifier = plant.parameters.amplifier
    return (amplifier.minimum_duty, amplifier.maximum_duty) if amplifier.limits else (-np.inf, np.inf)


def _lost_duty(plant: Plant) -> float:
    """Duty that dead time takes from a positive current."""
    return plant.parameters.amplifier.dead_time * plant.parameters.amplifier.switching_frequency
