"""A small linear bearing with known poles, in closed loop with the paper's controller, as data for identification."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from scipy.signal import cont2discrete

from amb_core.excitation import excitation_from_request, generate
from amb_core.identification import StateSpaceModel
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord


class LinearBearing:
    """Two rotor axes with first-order actuators of 1.5 and 2 kHz, some coupling, gravity along -y."""

    sample_time = 1e-4  # s
    mass = 6.25  # kg
    current_gain = 66.0  # N/A
    stiffness_x, stiffness_y = 3.30e5, 3.15e5  # N/m, magnitudes of the negative stiffnesses
    gravity_current = mass * 9.81 / current_gain  # A

    @functools.cached_property
    def model(self) -> StateSpaceModel:
        """The bearing itself as a model, about the operating point that carries the weight, at rest at the start."""
        a, b, c = self._matrices
        return StateSpaceModel(
            a=a,
            b=b[:, :2],
            c=c,
            d=np.zeros((2, 2)),
            k=np.zeros((6, 2)),
            innovation_covariance=np.eye(2) * 1e-18,
            input_offset=np.array([0.0, self.gravity_current]),
            output_offset=np.zeros(2),
            initial_state=np.zeros(6),
            sample_time=self.sample_time,
        )

    @functools.cached_property
    def _matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A, B and C in discrete time, for the inputs i_x, i_y and the forces on the rotor along x and y."""
        a, b, c = np.zeros((6, 6)), np.zeros((6, 4)), np.zeros((2, 6))
        stiffness, gain = self.stiffness_x / self.mass, self.current_gain / self.mass
        a[0, 1] = a[2, 3] = 1.0
        a[1, [0, 2, 4, 5]] = stiffness, 0.01 * stiffness, gain, 0.03 * gain
        a[3, [2, 4, 5]] = self.stiffness_y / self.mass, -0.02 * gain, gain
        for state, axis, bandwidth in ((4, 0, 1_500.0), (5, 1, 2_000.0)):
            a[state, state] = -2.0 * np.pi * bandwidth
            b[state, axis] = 2.0 * np.pi * bandwidth
        c[0, 0] = c[1, 2] = 1.0
        b[1, 2] = b[3, 3] = 1.0 / self.mass
        a, b, *_ = cont2discrete((a, b, c, np.zeros((2, 4))), self.sample_time)
        return a, b, c

    def innovation_covariance(self, noise: float, force: float) -> np.ndarray:
        """Covariance of the innovations of the Kalman filter for an experiment's noise (m^2)."""
        a, b, c = self._matrices
        disturbance, error = b[:, 2:] @ b[:, 2:].T * force**2, np.eye(2) * noise**2
        return c @ solve_discrete_are(a.T, c.T, disturbance, error) @ c.T + error

    def kalman_gain(self, noise: float, force: float) -> np.ndarray:
        """Gain K of the Kalman filter for an experiment's noise."""
        a, b, c = self._matrices
        disturbance, error = b[:, 2:] @ b[:, 2:].T * force**2, np.eye(2) * noise**2
        state = solve_discrete_are(a.T, c.T, disturbance, error)
        return np.linalg.solve(c @ state @ c.T + error, c @ state @ a.T).T

    def response_error(self, model: StateSpaceModel) -> float:
        """Largest error of a model's frequency response from 5 to 1000 Hz, relative to the bearing's at each."""
        z = np.exp(2j * np.pi * np.geomspace(5.0, 1_000.0, 60) * self.sample_time)
        identified, right = (
            np.array([part.c @ np.linalg.solve(point * np.eye(part.order) - part.a, part.b) for point in z])
            for part in (model, self.model)
        )
        return float(np.max(np.linalg.norm(identified - right, axis=(1, 2)) / np.linalg.norm(right, axis=(1, 2))))

    @functools.cache  # noqa: B019  (one bearing for the whole session)
    def experiment(
        self,
        noise: float = 1e-9,
        kind: str = "square",
        lead: int = 0,
        controller: ControllerParameters | None = None,
        force: float = 0.0,
        drift: str = "",
        **settings: Any,
    ) -> LoopRecord:
        """The loop from rest under an excitation of 50 um and 2 s after `lead` steps.

        `noise` is the rms of the white noise of the sensors (m), `force` that of the white force on the rotor (N).
        `drift` is the shape of a drift of both sensors by some um, see `sensor_drift`.
        """
        request = {"amplitude": 50e-6, "duration": 2.0, **settings}
        signal = generate(excitation_from_request(kind, request), 1.0 / self.sample_time).samples
        reference = np.vstack([np.zeros((lead, 2)), signal])
        random = np.random.default_rng(1)
        errors = random.normal(scale=noise, size=reference.shape) + sensor_drift(drift, len(reference))
        forces = random.normal(scale=force, size=reference.shape)
        law = PdController(controller or ControllerParameters())
        model, disturbed = self.model, self._matrices[1][:, 2:]
        state = np.zeros(6)
        position, current = np.empty_like(reference), np.empty_like(reference)
        for step, target in enumerate(reference):
            position[step] = model.c @ state + errors[step]
            current[step] = law.update(position[step], target)
            state = model.a @ state + model.b @ (current[step] - model.input_offset) + disturbed @ forces[step]
        return LoopRecord(0, self.sample_time, reference, position, current)


def sensor_drift(shape: str, steps: int) -> np.ndarray:
    """Drift of the sensors of x and y by 4 and -2.5 um (m), shape (steps, 2); none for an empty shape."""
    time = np.linspace(0.0, 1.0, steps)
    walk = np.cumsum(np.random.default_rng(2).normal(size=steps))
    relative = {
        "": np.zeros(steps),
        "ramp": time,
        "sine": 0.5 * np.sin(2.0 * np.pi * (time + 0.1)),
        "half sine": np.sin(np.pi * time),
        "warm-up": 1.0 - np.exp(-4.0 * time),
        "random walk": walk / np.ptp(walk),
        "step": (time > 0.6).astype(float),
        "runout": 0.5 * np.sin(2.0 * np.pi * 194.6 * time),
    }[shape]
    return np.outer(relative, [4e-6, -2.5e-6])


@pytest.fixture(scope="session")
def bearing() -> LinearBearing:
    """The linear bearing."""
    return LinearBearing()
