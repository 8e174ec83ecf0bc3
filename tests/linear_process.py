"""Linear processes of any number of inputs and outputs, with known matrices, in open loop, as data for tests."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, solve_discrete_are

from amb_core.identification import IdentificationData, StateSpaceModel

SIZES = ((1, 1), (2, 1), (1, 2), (2, 2), (3, 2), (4, 4))
"""Inputs and outputs."""
FREQUENCIES = np.linspace(0.005, 0.45, 60)  # of the sample rate


@dataclass(frozen=True)
class LinearProcess:
    """A stable process of lightly damped modes, driven by white inputs and by noise on states and outputs.

    Attributes
    ----------
    inputs, outputs, order : int
        Numbers of inputs, outputs and states; the order is even.
    feedthrough : bool
        Whether outputs respond within the sample.
    noise : float
        Of the outputs, relative to what the inputs make of them.
    """

    inputs: int
    outputs: int
    order: int = 6
    feedthrough: bool = False
    noise: float = 0.05
    sample_time: float = 0.5  # s

    @functools.cached_property
    def model(self) -> StateSpaceModel:
        """The process in innovations form."""
        random = np.random.default_rng([self.inputs, self.outputs, self.order])
        n, m, p = self.order, self.inputs, self.outputs
        angles = np.pi * (np.arange(n // 2) + 0.6) / (n // 2 + 0.8)
        radii = random.uniform(0.7, 0.95, n // 2)
        a = block_diag(
            *(
                r * np.array([[np.cos(w), np.sin(w)], [-np.sin(w), np.cos(w)]])
                for r, w in zip(radii, angles, strict=True)
            )
        )
        b, c = random.normal(size=(n, m)), random.normal(size=(p, n))
        d = random.normal(size=(p, m)) * np.sqrt(n) if self.feedthrough else np.zeros((p, m))
        disturbance, error = self.noise**2 * np.eye(n), self.noise**2 * n * np.eye(p)
        variance = solve_discrete_are(a.T, c.T, disturbance, error)
        innovation = c @ variance @ c.T + error
        k = np.linalg.solve(innovation, c @ variance @ a.T).T
        return StateSpaceModel(
            a, b, c, d, k, innovation, np.zeros(m), np.zeros(p), np.zeros(n), self.sample_time,
            tuple(f"u{i + 1}" for i in range(m)), tuple(f"y{i + 1}" for i in range(p)),
            input_units=("V",) * m, output_units=("mm",) * p,
        )  # fmt: skip

    def data(self, steps: int = 4_000, seed: int = 1, period: int = 0) -> IdentificationData:
        """An experiment in open loop, about an operating point that is not zero, with inputs of a period if any."""
        model, random = self.model, np.random.default_rng(seed)
        inputs = random.normal(size=(period or steps, self.inputs))[np.arange(steps) % (period or steps)]
        errors = random.multivariate_normal(np.zeros(self.outputs), model.innovation_covariance, steps)
        outputs, state = np.empty_like(errors), np.zeros(self.order)
        for step in range(steps):
            outputs[step] = model.c @ state + model.d @ inputs[step] + errors[step]
            state = model.a @ state + model.b @ inputs[step] + model.k @ errors[step]
        return IdentificationData.from_arrays(
            inputs + 3.0, outputs - 2.0, self.sample_time,
            input_units=model.input_units, output_units=model.output_units,
        )  # fmt: skip

    def response_error(self, model: StateSpaceModel) -> float:
        """Error of a model's frequency response relative to that of the process, rms over all frequencies."""
        identified, right = response(model), response(self.model)
        return float(np.linalg.norm(identified - right) / np.linalg.norm(right))


def response(model: StateSpaceModel) -> np.ndarray:
    """Frequency response at `FREQUENCIES`, shape (frequencies, p, m)."""
    z = np.exp(2j * np.pi * FREQUENCIES)
    return np.array([model.c @ np.linalg.solve(one * np.eye(model.order) - model.a, model.b) + model.d for one in z])
