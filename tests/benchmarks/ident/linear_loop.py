"""A linear plant under decentralised PD control, for the sets of the benchmark with other than two axes.

    v[k] = keep v[k-1] + (1 - keep) / T (y[k] - y[k-1]),    u[k] = K_P (r[k] - y[k]) - K_D v[k]

on each axis, without limits: the loop is linear.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from amb_core.identification import StateSpaceModel

SAMPLE_TIME = 1e-4  # s

Arrays = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LinearLoop:
    """Plant, controller and noise of a loop with as many inputs as outputs.

    Attributes
    ----------
    a, b, c, force : ndarray, shapes (n, n), (n, p), (p, n), (n, f)
        The plant, exact for held inputs: control currents (A) and forces (N) to positions (m).
    proportional, derivative : ndarray, shape (p,)
        Gains K_P (A/m) and K_D (A s/m).
    keep : float
        Share of the derivative that its filter keeps over a sample.
    sensor_noise, force_noise : float
        White noise on the sensors (m) and forces (N, held over a sample), rms.
    """

    a: Arrays
    b: Arrays
    c: Arrays
    force: Arrays
    proportional: Arrays
    derivative: Arrays
    keep: float = 0.3
    sensor_noise: float = 0.05e-6
    force_noise: float = 0.3

    @property
    def axes(self) -> int:
        """Number of inputs, and of outputs."""
        return len(self.c)

    @functools.cached_property
    def true_model(self) -> StateSpaceModel:
        """The plant in innovations form, with the gain of its stationary Kalman filter."""
        disturbance = self.force @ self.force.T * self.force_noise**2
        error = np.eye(self.axes) * self.sensor_noise**2
        variance = solve_discrete_are(self.a.T, self.c.T, disturbance, error)
        innovation = self.c @ variance @ self.c.T + error
        k = np.linalg.solve(innovation, self.c @ variance @ self.a.T).T
        return model_of(self.a, self.b, self.c, k, innovation)

    def run(self, reference: Arrays, random: np.random.Generator | None = None) -> tuple[Arrays, Arrays]:
        """Control currents (A) and measured positions (m) from rest; without noise if there is no `random`."""
        steps = len(reference)
        errors, pushes = np.zeros((steps, self.axes)), np.zeros((steps, self.force.shape[1]))
        if random is not None:
            errors = random.normal(scale=self.sensor_noise, size=errors.shape)
            pushes = random.normal(scale=self.force_noise, size=pushes.shape)
        return self.respond(reference, errors, pushes)

    def respond(self, reference: Arrays, errors: Arrays, pushes: Arrays) -> tuple[Arrays, Arrays]:
        """The same with given errors of the sensors (m) and forces (N)."""
        return self._simulate(self.a, self.b, self.c, reference, errors, pushes @ self.force.T)

    def simulate(self, a: Arrays, b: Arrays, c: Arrays, reference: Arrays) -> Arrays:
        """Positions (m) of a model in the place of the plant, without noise."""
        still = np.zeros((len(reference), len(a)))
        return self._simulate(a, b, c, reference, np.zeros_like(reference), still)[1]

    def poles(self, a: Arrays, b: Arrays, c: Arrays) -> NDArray[np.complex128]:
        """Poles in the z plane of a model under this controller."""
        return np.linalg.eigvals(self._closed(a, b, c)[0]).astype(np.complex128)

    def _closed(self, a: Arrays, b: Arrays, c: Arrays) -> tuple[Arrays, Arrays, Arrays, Arrays]:
        """Matrices of the state (x, v, y[k-1]) and its drive by r and y's noise; those of u by both."""
        n, p, weight = len(a), self.axes, (1.0 - self.keep) / SAMPLE_TIME
        by_output = -np.diag(self.proportional + self.derivative * weight)
        law = np.hstack([by_output @ c, -self.keep * np.diag(self.derivative), weight * np.diag(self.derivative)])
        law_drive = np.hstack([np.diag(self.proportional), by_output])
        state = np.zeros((n + 2 * p, n + 2 * p))
        state[:n, :n], state[n : n + p, :n], state[n + p :, :n] = a, weight * c, c
        state[n : n + p, n : n + p], state[n : n + p, n + p :] = self.keep * np.eye(p), -weight * np.eye(p)
        drive = np.zeros((n + 2 * p, 2 * p))
        drive[n : n + p, p:], drive[n + p :, p:] = weight * np.eye(p), np.eye(p)
        state[:n] += b @ law
        drive[:n] += b @ law_drive
        return state, drive, law, law_drive

    def _simulate(
        self, a: Arrays, b: Arrays, c: Arrays, reference: Arrays, errors: Arrays, pushed: Arrays
    ) -> tuple[Arrays, Arrays]:
        state_matrix, drive, law, law_drive = self._closed(a, b, c)
        known = np.hstack([reference, errors])
        forcing = known @ drive.T
        forcing[:, : len(a)] += pushed
        states = np.empty((len(reference), len(state_matrix)))
        state = np.zeros(len(state_matrix))
        for step, push in enumerate(forcing):
            states[step] = state
            state = state_matrix @ state + push
        return states @ law.T + known @ law_drive.T, states[:, : len(a)] @ c.T + errors


def model_of(a: Arrays, b: Arrays, c: Arrays, k: Arrays | None = None, noise: Arrays | None = None) -> StateSpaceModel:
    """A model without offsets and feedthrough; without a gain K of 0 and unit noise."""
    (p, n), m = c.shape, b.shape[1]
    return StateSpaceModel(
        a,
        b,
        c,
        np.zeros((p, m)),
        np.zeros((n, p)) if k is None else k,
        np.eye(p) if noise is None else noise,
        np.zeros(m),
        np.zeros(p),
        np.zeros(n),
        SAMPLE_TIME,
        tuple(f"i_{axis + 1}" for axis in range(m)),
        tuple(f"x_{axis + 1}" for axis in range(p)),
    )


def multisine(axes: int, steps: int, random: np.random.Generator) -> Arrays:
    """Independent multisines of random phase on all axes (m), 1 to 2000 Hz, 5 um rms each; the period is the whole."""
    lines = np.zeros((steps // 2 + 1, axes), dtype=np.complex128)
    frequency = np.fft.rfftfreq(steps, SAMPLE_TIME)
    excited = (frequency >= 1.0) & (frequency <= 2_000.0)
    lines[excited] = np.exp(2j * np.pi * random.uniform(size=(int(excited.sum()), axes)))
    samples = np.fft.irfft(lines, steps, axis=0)
    return np.asarray(samples * (5e-6 / samples.std(axis=0)))


def squares(axes: int, steps: int) -> Arrays:
    """Square waves of 50 um and 5 Hz (m), on one axis after the other."""
    wave = 50e-6 * np.where(np.arange(steps) * SAMPLE_TIME * 5.0 % 1.0 < 0.5, 1.0, -1.0)
    turn = np.arange(steps) * axes // steps
    return np.asarray(wave[:, np.newaxis] * (turn[:, np.newaxis] == np.arange(axes)))
