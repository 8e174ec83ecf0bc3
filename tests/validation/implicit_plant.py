"""The plant written anew for an implicit solver: one ordinary differential equation between switching instants.

It shares with the kernel the reluctances, eddy-current coefficients and windings of the network, the terms fitted to
laminations and a solid journal, the fluxes to start from and the control law of bearing B. Its own are the equations of
network, iron, rotor and sensors, the modulation and current control of the amplifiers, and the integration: Radau's
method, started anew wherever a coil voltage jumps. There are no diodes, so coil currents must stay positive.

The field H in an iron element follows its flux density B by the equations of Jiles and Atherton (J. Magn. Magn. Mater.
61, 1986) with M = B / mu0 - H, H_e = H + alpha M, M = (1 - c) M_irr + c M_an,

    dM_irr/dH_e = (M_an - M_irr) / (delta k), not negative,   delta = sign(dB/dt),   M_an = M_s (coth(H_e/a) - a/H_e).

Where dB/dt changes its sign or the walls begin to move, dH/dt is continuous and has a kink, which the solver's error
control resolves. Without hysteresis M = M_an.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from amb_core.plant import Plant, PlantParameters
from tests.validation.implicit_iron import DIRECTIONS, Iron

RTOL = 1e-9
FIRST_STEP = 2e-7  # s, a tenth of the shortest eddy-current time constant
# Beside a change of the current by 1 mA or of the position by 1 nm: ten times closer changes neither by 1 % of that
FLUX_TOLERANCE, FIELD_TOLERANCE, CHARGE_TOLERANCE = 1e-10, 1e-3, 1e-10  # Wb, A/m, A s
POSITION_TOLERANCE, VELOCITY_TOLERANCE = 1e-12, 1e-9  # m, m/s


class ImplicitPlant:
    """The plant of the same parameters.

    Attributes
    ----------
    time : float
        Since the start (s).
    state : ndarray, shape (n,)
        Blocks of the bearings, then coordinates and rates of the rotor, then sensed positions.
    """

    def __init__(self, plant: Plant) -> None:
        self._parameters = parameters = plant.parameters
        self._bearings = plant.bearings
        self._iron = Iron(plant)
        size = self._iron.size
        self._blocks = [self._iron.block(bearing * size) for bearing in range(self._bearings)]
        self._rotor = _Rotor(parameters)
        axes = 2 * self._bearings
        first = self._bearings * size
        self._coordinates, self._rates, self._sensed = (
            slice(first + n * axes, first + (n + 1) * axes) for n in range(3)
        )
        self._tolerance = np.empty(first + 3 * axes)
        for block in self._blocks:
            self._tolerance[block.flux.start : block.delayed.stop] = FLUX_TOLERANCE
            self._tolerance[block.field] = FIELD_TOLERANCE
            self._tolerance[block.charge] = CHARGE_TOLERANCE
        self._tolerance[self._coordinates] = self._tolerance[self._sensed] = POSITION_TOLERANCE
        self._tolerance[self._rates] = VELOCITY_TOLERANCE
        bandwidth = parameters.sensor.bandwidth
        self._lag = 1.0 / (2.0 * np.pi * bandwidth) if bandwidth > 0.0 else 0.0

        amplifier = parameters.amplifier
        self._means = parameters.iron.laminations == "diffusion"  # then a trace has the means over its steps
        self._period = 1.0 / amplifier.switching_frequency
        interleaved = amplifier.carriers == "interleaved"
        later = 0.25 * self._period * np.arange(4) if interleaved else np.zeros(4)
        self._starts = np.tile(later, self._bearings)  # of the coils' next switching periods
        self._starts_now = self._starts - self._period
        self._duty = np.full(4 * self._bearings, 0.5)
        self._integral = np.zeros(4 * self._bearings)
        self._charge_start = -amplifier.bias_current * (self._period - np.tile(later, self._bearings))
        self._held = np.zeros(axes)
        self.time = 0.0
        self.state = np.zeros(first + 3 * axes)
        for block in self._blocks:
            self._iron.start(plant, self.state, block)

    # -- one controller sample

    def measured(self) -> NDArray[np.float64]:
        """Measured positions (m), shape (2 * bearings,)."""
        sensed = self.state[self._sensed] if self._lag else self._rotor.sensors @ self.state[self._coordinates]
        return _on_grid(sensed, self._parameters.converters.position_resolution)

    def positions(self) -> NDArray[np.float64]:
        """Positions of the journals (m), shape (2 * bearings,)."""
        return self._rotor.journals @ self.state[self._coordinates]

    def advance(self, references: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Hold control current references (A) over a sample; positions (m) and coil currents (A) at period starts."""
        references = _on_grid(references, self._parameters.converters.current_resolution)
        begin, rate = self.time, self._parameters.integration.sample_rate
        delayed = begin + self._parameters.converters.computation_delay / rate
        positions, currents = [], []
        for n in range(self._parameters.steps_per_sample // self._parameters.steps_per_period):
            start = begin + n * self._period
            for number, instant in enumerate(np.unique(np.concatenate([[start], self._starts]))):
                self._solve_to(instant)
                self._update(instant, self._held if instant < delayed - 1e-12 else references)
                if number == 0:
                    positions.append(self.positions())
                    currents.append(self._mean_currents() if self._means else self._currents_now())
        self._solve_to(begin + 1.0 / rate)
        self._held = references
        return np.array(positions), np.array(currents)

    def _update(self, instant: float, references: NDArray[np.float64]) -> None:
        """Current control of the coils whose switching period begins: mean current of the last to the duty of this."""
        amplifier = self._parameters.amplifier
        due = np.abs(self._starts - instant) < 1e-12
        control = np.concatenate([np.concatenate([pair, -pair]) for pair in references.reshape(-1, 2)])
        wanted = np.clip(amplifier.bias_current + control, 0.0, amplifier.current_limit)
        charge = np.concatenate([self.state[block.charge] for block in self._blocks])
        error = wanted - (charge - self._charge_start) / self._period
        following = self._integral + amplifier.integral_gain * error * self._period
        duty = 0.5 + amplifier.proportional_gain * error + following
        limited = np.clip(duty, amplifier.minimum_duty, amplifier.maximum_duty)
        self._integral = np.where(due & (duty == limited), following, self._integral)
        self._duty = np.where(due, limited, self._duty)
        self._charge_start = np.where(due, charge, self._charge_start)
        self._starts_now = np.where(due, self._starts, self._starts_now)
        self._starts = np.where(due, self._starts + self._period, self._starts)

    def _pulses(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """When the voltages become positive and negative again; dead time delays what drives the positive currents."""
        on = self._starts_now + 0.5 * self._period * (1.0 - self._duty) + self._parameters.amplifier.dead_time
        return on, self._starts_now + 0.5 * self._period * (1.0 + self._duty)

    def _currents_now(self) -> NDArray[np.float64]:
        """Coil currents (A); what the voltages drive at once is averaged over an internal step, as in a trace."""
        on, off = self._pulses()
        step = self._parameters.integration.internal_step
        share = np.clip((np.minimum(off, self.time + step) - np.maximum(on, self.time)) / step, 0.0, 1.0)
        voltage = self._parameters.amplifier.supply_voltage * (2.0 * share - 1.0)
        currents = []
        for bearing, block in enumerate(self._blocks):
            applied = voltage[4 * bearing : 4 * bearing + 4]
            currents.append(self._iron.solved(self.state, block, self._position(bearing, self.state), applied)[8:])
        return np.concatenate(currents)

    def _mean_currents(self) -> NDArray[np.float64]:
        """Mean coil currents (A) over the next internal step, over which this goes."""
        step = self._parameters.integration.internal_step
        before = np.concatenate([self.state[block.charge] for block in self._blocks])
        self._solve_to(self.time + step)
        return (np.concatenate([self.state[block.charge] for block in self._blocks]) - before) / step

    def _solve_to(self, end: float) -> None:
        if end <= self.time:  # two starts of a period that differ by rounding, the second in the past already
            return
        supply = self._parameters.amplifier.supply_voltage
        on, off = self._pulses()
        edges = np.concatenate([on, off])
        inside = edges[(edges > self.time + 1e-15) & (edges < end - 1e-15)]
        for start, stop in itertools.pairwise(np.unique(np.concatenate([[self.time, end], inside]))):
            middle = 0.5 * (start + stop)
            voltage = np.where((on < middle) & (middle < off), supply, -supply)
            solution = solve_ivp(
                self._derivative,
                (start, stop),
                self.state,
                method="Radau",
                args=(voltage,),
                jac=self._jacobian,
                rtol=RTOL,
                atol=self._tolerance,
                first_step=min(stop - start, FIRST_STEP),
            )
            if not solution.success:
                raise RuntimeError(f"solve_ivp failed: {solution.message}")
            self.state = solution.y[:, -1]
        self.time = end

    # -- the equations

    def _position(self, bearing: int, state: NDArray[np.float64]) -> NDArray[np.float64]:
        return self._rotor.journals[2 * bearing : 2 * bearing + 2] @ state[self._coordinates]

    def _derivative(self, time: float, state: NDArray[np.float64], voltage: NDArray[np.float64]) -> NDArray[np.float64]:
        rates = np.empty_like(state)
        forces = np.empty(2 * self._bearings)
        for bearing, block in enumerate(self._blocks):
            position = self._position(bearing, state)
            self._iron.derivative(state, block, position, voltage[4 * bearing : 4 * bearing + 4], rates)
            forces[2 * bearing : 2 * bearing + 2] = self._iron.pull * (state[block.flux] ** 2 @ DIRECTIONS)
        rates[self._coordinates] = state[self._rates]
        rates[self._rates] = self._rotor.acceleration(time, forces, state[self._rates])
        rates[self._sensed] = 0.0
        if self._lag:
            seen = self._rotor.sensors @ state[self._coordinates]
            rates[self._sensed] = (seen - state[self._sensed]) / self._lag
        return rates

    def _jacobian(self, _: float, state: NDArray[np.float64], voltage: NDArray[np.float64]) -> NDArray[np.float64]:
        """Derivative of the right-hand side; the slopes dH/dB of the iron are taken as constant."""
        jacobian = np.zeros((len(state), len(state)))
        for bearing, block in enumerate(self._blocks):
            position = self._position(bearing, state)
            journal = self._rotor.journals[2 * bearing : 2 * bearing + 2]
            self._iron.jacobian(
                state, block, position, voltage[4 * bearing : 4 * bearing + 4], journal, self._coordinates, jacobian
            )
            by_flux = 2.0 * self._iron.pull * (state[block.flux, np.newaxis] * DIRECTIONS).T
            jacobian[self._rates, block.flux] = self._rotor.by_force[:, 2 * bearing : 2 * bearing + 2] @ by_flux
        jacobian[self._coordinates, self._rates] = np.eye(2 * self._bearings)
        jacobian[self._rates, self._rates] = self._rotor.by_rate
        if self._lag:
            jacobian[self._sensed, self._coordinates] = self._rotor.sensors / self._lag
            jacobian[self._sensed, self._sensed] = -np.eye(2 * self._bearings) / self._lag
        return jacobian


class _Rotor:
    """Point mass, or rigid body with coordinates x, y of its centre of mass and tilts dx/dz, dy/dz."""

    def __init__(self, parameters: PlantParameters) -> None:
        rotor, body = parameters.rotor, parameters.rigid_rotor
        self._speed = 2.0 * np.pi * rotor.running_speed
        self._turning = rotor.unbalance * self._speed**2
        self._external = np.array([rotor.external_force_x, rotor.external_force_y])
        self._frequency = 2.0 * np.pi * rotor.external_force_frequency
        if rotor.model == "point_mass":
            self.journals = self.sensors = np.eye(2)
            inertia, moment = np.full(2, rotor.mass), 0.0
        else:
            self.journals, self.sensors = (
                np.array([[1.0, 0.0, a, 0.0], [0.0, 1.0, 0.0, a], [1.0, 0.0, b, 0.0], [0.0, 1.0, 0.0, b]])
                for a, b in ((body.bearing_a, body.bearing_b), (body.sensor_a, body.sensor_b))
            )
            inertia = np.array([body.mass, body.mass, body.transverse_inertia, body.transverse_inertia])
            moment = body.polar_inertia * self._speed
        self.by_force = (self.journals / inertia).T
        self.by_rate = np.zeros((len(inertia), len(inertia)))
        if len(inertia) == 4:
            self.by_rate[2, 3], self.by_rate[3, 2] = -moment / inertia[2], moment / inertia[2]
        self._mass, self._gravity = inertia[0], rotor.gravity

    def acceleration(self, time: float, forces: NDArray[np.float64], rates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Accelerations of the coordinates from the magnetic forces at A x, A y, B x, B y (N)."""
        forces = forces.copy()
        forces[:2] += self._external * np.cos(self._frequency * time)
        acceleration = self.by_force @ forces + self.by_rate @ rates
        acceleration[0] += self._turning * np.cos(self._speed * time) / self._mass
        acceleration[1] += self._turning * np.sin(self._speed * time) / self._mass - self._gravity
        return acceleration


def _on_grid(values: NDArray[np.float64], resolution: float) -> NDArray[np.float64]:
    return values if resolution == 0.0 else resolution * np.round(values / resolution)
