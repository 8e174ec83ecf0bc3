"""Loops of linear rotors and LQG controllers, without ROS: data that no PD controller could have made."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_discrete_are
from scipy.signal import cont2discrete

from amb_core.identification import StateSpaceModel
from amb_core.linear import LinearSystem
from amb_core.loop.controller_files import controller_from
from amb_core.loop.law import ControlLaw
from amb_core.loop.linear_control import LinearController, LinearControllerParameters
from amb_core.loop.records import LoopRecord, axis_names

SAMPLE_TIME = 1e-4  # s
MASS, TRANSVERSE, POLAR = 12.5, 0.30, 0.06  # kg, kg m^2
SPEED = 2.0 * np.pi * 200.0  # rad/s
GAIN, STIFFNESS = 66.0, 3.30e5  # N/A, N/m
SENSOR_NOISE, FORCE_NOISE = 0.02e-6, 0.1  # m, N


@dataclass(frozen=True, eq=False)
class Rotor:
    """A rotor in magnetic bearings in discrete time: currents (A) and forces (N) to positions (m)."""

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    force: np.ndarray

    @property
    def axes(self) -> int:
        """Number of axes."""
        return len(self.c)

    @property
    def model(self) -> StateSpaceModel:
        """The rotor itself, with the gain of its stationary Kalman filter."""
        variance, innovation, _ = self._kalman()
        k = self.a @ variance @ self.c.T @ np.linalg.inv(innovation)
        names = axis_names(self.axes)
        return StateSpaceModel(
            self.a, self.b, self.c, np.zeros((self.axes, self.axes)), k, innovation, np.zeros(self.axes),
            np.zeros(self.axes), np.zeros(len(self.a)), SAMPLE_TIME, tuple(f"i_{name}" for name in names), names,
        )  # fmt: skip

    def _kalman(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Variance of the predicted state and of the innovation, and the gain of the measurement update."""
        error = np.eye(self.axes) * SENSOR_NOISE**2
        variance = solve_discrete_are(self.a.T, self.c.T, self.force @ self.force.T * FORCE_NOISE**2, error)
        innovation = self.c @ variance @ self.c.T + error
        return variance, innovation, variance @ self.c.T @ np.linalg.inv(innovation)

    def lqg(self, of_errors: bool = True) -> StateSpaceModel:
        """LQG controller: from the errors without feedthrough, or from references and positions with feedthrough."""
        largest = np.eye(self.axes) * 2.0**-2  # A
        cost = self.c.T @ self.c * 20e-6**-2  # m
        p = solve_discrete_are(self.a, self.b, cost, largest)
        feedback = np.linalg.solve(largest + self.b.T @ p @ self.b, self.b.T @ p @ self.a)
        update = self._kalman()[2]
        if of_errors:
            # The filter takes the position relative to its reference for the output: w[k+1] = ... + A M (y - r).
            b, d = -self.a @ update, np.zeros((self.axes, self.axes))
            a, c = self.a - self.b @ feedback - self.a @ update @ self.c, -feedback
        else:
            # Filtered state w + M (y - C w), and the reference through the inverse of the static gain.
            closed = self.c @ np.linalg.solve(np.eye(len(self.a)) - self.a + self.b @ feedback, self.b)
            static, filtered = np.linalg.inv(closed), np.eye(len(self.a)) - update @ self.c
            c, d = -feedback @ filtered, np.hstack([static, -feedback @ update])
            a = self.a @ filtered + self.b @ c
            b = np.hstack([self.b @ static, self.a @ update + self.b @ d[:, self.axes :]])
        inputs = self.axes * (1 if of_errors else 2)
        return StateSpaceModel(
            a, b, c, d, np.zeros((len(a), self.axes)), np.eye(self.axes), np.zeros(inputs), np.zeros(self.axes),
            np.zeros(len(a)), SAMPLE_TIME, tuple(f"u_{number}" for number in range(inputs)),
            tuple(f"i_{number}" for number in range(self.axes)),
            input_units=("m",) * inputs, output_units=("A",) * self.axes,
        )  # fmt: skip

    def record(
        self, law: ControlLaw, steps: int = 6_000, seed: int = 1, amplitude: float = 5e-6, noise: float = 1.0
    ) -> LoopRecord:
        """The loop from rest under independent random steps of all references (m)."""
        random = np.random.default_rng(seed)
        reference = amplitude * np.sign(random.normal(size=(-(-steps // 7), self.axes))).repeat(7, axis=0)[:steps]
        reference[:20] = 0.0
        errors = random.normal(scale=noise * SENSOR_NOISE, size=reference.shape)
        forces = random.normal(scale=noise * FORCE_NOISE, size=(steps, self.force.shape[1]))
        position, current = np.empty_like(reference), np.empty_like(reference)
        state = np.zeros(len(self.a))
        law.reset()
        for step, target in enumerate(reference):
            position[step] = self.c @ state + errors[step]
            current[step] = law.update(position[step], target)
            state = self.a @ state + self.b @ current[step] + self.force @ forces[step]
        return LoopRecord(0, SAMPLE_TIME, reference, position, current)


def linear_law(model: StateSpaceModel, axes: int, limit: float = 3.0) -> LinearController:
    """The running law."""
    return LinearController(model, LinearControllerParameters(current_limit=limit), axes, 1.0 / SAMPLE_TIME)


def rotor(axes: int) -> Rotor:
    """The turning rigid rotor in two bearings (4 axes, 12 states), or the half of it in one (2 axes, or 1 of them)."""
    rates = 2.0 * np.pi * np.array([1_500.0, 2_000.0, 1_700.0, 1_900.0][:axes])
    if axes <= 2:
        inverse, at_magnets = np.eye(axes) / (MASS / 2.0), np.eye(axes)
        at_sensors = np.array([[1.0, 0.02], [-0.03, 1.0]])[:axes, :axes]
        gyroscopic = np.zeros((axes, axes))
    else:
        inverse = np.diag([1.0 / MASS, 1.0 / MASS, 1.0 / TRANSVERSE, 1.0 / TRANSVERSE])
        at_magnets, at_sensors = (
            np.vstack([np.hstack([np.eye(2), place * np.eye(2)]) for place in places])
            for places in ((0.12, -0.15), (0.14, -0.17))
        )
        gyroscopic = np.zeros((4, 4))
        gyroscopic[2, 3], gyroscopic[3, 2] = -SPEED * POLAR, SPEED * POLAR
    by_force = inverse @ at_magnets.T
    zero, one = np.zeros((axes, axes)), np.eye(axes)
    a = np.block(
        [
            [zero, one, zero],
            [by_force @ (STIFFNESS * at_magnets), inverse @ gyroscopic, by_force * GAIN],
            [zero, zero, -np.diag(rates)],
        ]
    )
    b = np.vstack([np.zeros((2 * axes, 2 * axes)), np.hstack([np.diag(rates), zero])])
    b[axes : 2 * axes, axes:] = by_force
    c = np.hstack([at_sensors, zero, zero])
    a, b, *_ = cont2discrete((a, b, c, np.zeros((axes, 2 * axes))), SAMPLE_TIME)
    return Rotor(a, b[:, :axes], c, b[:, axes:])


def with_integrators(controller: StateSpaceModel, gain: float = 20.0) -> StateSpaceModel:
    """A controller of errors with slow integrators beside it; its anti-windup gain is left to be found."""
    axes, none = len(controller.c), np.zeros
    return replace(
        controller,
        a=np.block([[controller.a, none((controller.order, axes))], [none((axes, controller.order)), np.eye(axes)]]),
        b=np.vstack([controller.b, np.eye(axes)]),
        c=np.hstack([controller.c, gain * np.eye(axes)]),
        k=none((controller.order + axes, axes)),
        initial_state=none(controller.order + axes),
    )


def pid(axes: int) -> StateSpaceModel:
    """A PID controller of the errors with a filtered derivative, each axis by itself."""
    gain, integral, derivative, keep = 13e3, 0.2, 2.5e-3, 0.5  # A/m, s, s, -
    rate = (1.0 - keep) * derivative / SAMPLE_TIME
    a = np.array([[1.0, 0.0, 0.0], [0.0, keep, -rate], [0.0, 0.0, 0.0]])
    b = np.array([[SAMPLE_TIME / integral], [rate], [1.0]])
    c, d = np.array([[1.0, keep, -rate]]), np.array([[1.0 + SAMPLE_TIME / integral + rate]])
    each = np.eye(axes)
    matrices = (np.kron(each, part) for part in (a, b, gain * c, gain * d))
    return controller_from(LinearSystem(*matrices, SAMPLE_TIME))
