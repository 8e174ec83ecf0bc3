"""One or two axes of a bearing under a state-space controller, as its sensors show it: with noise, and with drift.

The plant is known, so that true models of it, and wrong ones, can be judged by the data.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.signal import cont2discrete

from amb_core.identification import IdentificationData, StateSpaceModel
from amb_core.identification.estimate.predictor import kalman_gain
from amb_core.linear import LinearSystem
from amb_core.loop.controller_files import controller_from
from amb_core.loop.known_controller import LinearControl
from amb_core.loop.linear_control import LinearControllerParameters
from amb_core.loop.records import LoopRecord, axis_names

MASSES, STIFFNESSES, GAINS = (4.0, 5.0), (2.5e5, 3.2e5), (70.0, 80.0)  # kg, N/m, N/A
BANDWIDTH = 2.0 * np.pi * 800.0  # rad/s, of the amplifiers
PROPORTIONAL, DERIVATIVE, FILTER = 12e3, 30.0, 2e-4  # A/m, A s/m, s
NOISE, FORCE = 30e-9, 0.02  # m, N: rms, white

Arrays = NDArray[np.float64]


@dataclass(frozen=True)
class SensorLoop:
    """A bearing and its controller.

    Attributes
    ----------
    axes : int
        1 or 2.
    rate : float
        Samples a second (Hz).
    stiffer : float
        Factor of the stiffness of the plant.
    """

    axes: int = 1
    rate: float = 1e4
    stiffer: float = 1.0

    @cached_property
    def model(self) -> StateSpaceModel:
        """The plant with the Kalman filter of its noise: the truth of the data."""
        a, b, c = self._plant
        p, force = self.axes, b[:, self.axes :]
        k = kalman_gain(a, c, force @ force.T * FORCE**2, np.eye(p) * NOISE**2, np.zeros((len(a), p)))
        names = axis_names(p)
        return StateSpaceModel(
            a, b[:, :p], c, np.zeros((p, p)), k, np.eye(p) * NOISE**2, np.zeros(p), np.zeros(p), np.zeros(len(a)),
            1.0 / self.rate, tuple(f"i_{name}" for name in names), names, method="truth",
        )  # fmt: skip

    @cached_property
    def controller(self) -> LinearControl:
        """A PD law with a filtered derivative, by the rule of Tustin."""
        numerator, denominator = [DERIVATIVE + PROPORTIONAL * FILTER, PROPORTIONAL], [FILTER, 1.0]
        (top,), bottom, step = cont2discrete((numerator, denominator), 1.0 / self.rate, "bilinear")
        pole, gain = -bottom[1], top[0]
        one = np.eye(self.axes)
        law = LinearSystem(pole * one, one, (top[1] + pole * top[0]) * one, gain * one, step)
        return LinearControl(controller_from(law), LinearControllerParameters())

    def record(
        self, seconds: float = 4.0, seed: int = 1, drift: Arrays | float = 0.0, limit: float = 3.0
    ) -> LoopRecord:
        """The loop under a multisine of 5 um on each axis; `drift` of the sensors (m) has a row for each sample."""
        random, law = np.random.default_rng(seed), self.controller.model
        reference = self._multisine(round(seconds * self.rate), random)
        seen = random.normal(scale=NOISE, size=reference.shape) + drift
        forces = random.normal(scale=FORCE, size=reference.shape)
        a, b, c, of_a, of_b, of_c, of_d = map(np.ascontiguousarray, (*self._plant, law.a, law.b, law.c, law.d))
        current, position = _run(a, b, c, of_a, of_b, of_c, of_d, reference, seen, forces, limit)
        return LoopRecord(0, 1.0 / self.rate, reference, position, current, axis_names(self.axes))

    def data(self, seconds: float = 4.0, seed: int = 1, drift: Arrays | float = 0.0) -> IdentificationData:
        """A record as data."""
        return IdentificationData.from_record(self.record(seconds, seed, drift))

    @cached_property
    def _plant(self) -> tuple[Arrays, Arrays, Arrays]:
        """A, B and C for currents (A) and forces (N)."""
        blocks = []
        for mass, stiffness, gain in zip(MASSES, STIFFNESSES, GAINS, strict=True):
            a = np.array([[0.0, 1.0, 0.0], [self.stiffer * stiffness / mass, 0.0, gain / mass], [0.0, 0.0, -BANDWIDTH]])
            blocks.append((a, np.array([[0.0, 0.0], [0.0, 1.0 / mass], [BANDWIDTH, 0.0]]), np.array([[1.0, 0.0, 0.0]])))
        blocks = blocks[: self.axes]
        a, c = block_diag(*(block[0] for block in blocks)), block_diag(*(block[2] for block in blocks))
        b = np.hstack([block_diag(*(block[1][:, [place]] for block in blocks)) for place in (0, 1)])
        a, b, *_ = cont2discrete((a, b, c, np.zeros((self.axes, 2 * self.axes))), 1.0 / self.rate)
        return a, b, c

    def _multisine(self, steps: int, random: np.random.Generator) -> Arrays:
        """Periods of a second, of lines up to a fifth of the rate, every other one on each of two axes."""
        period, lines = round(self.rate), np.arange(2, round(0.2 * self.rate))
        reference = np.empty((steps, self.axes))
        for axis in range(self.axes):
            spectrum = np.zeros(period // 2 + 1, dtype=complex)
            own = lines[axis :: self.axes]
            spectrum[own] = np.exp(2j * np.pi * random.random(len(own)))
            one = np.fft.irfft(spectrum, period)
            reference[:, axis] = np.resize(5e-6 * one / np.abs(one).max(), steps)
        return reference


def with_wrong_gain(model: StateSpaceModel, factor: float) -> StateSpaceModel:
    """A model whose gain from currents to positions is off by a factor."""
    return replace(model, b=factor * model.b)


@numba.njit(cache=True)
def _run(
    a: Arrays, b: Arrays, c: Arrays, of_a: Arrays, of_b: Arrays, of_c: Arrays, of_d: Arrays,
    reference: Arrays, seen: Arrays, forces: Arrays, limit: float,
) -> tuple[Arrays, Arrays]:  # fmt: skip
    steps, axes = reference.shape
    current, position = np.empty((steps, axes)), np.empty((steps, axes))
    x, law, held = np.zeros(len(a)), np.zeros(len(of_a)), np.empty(2 * axes)
    for k in range(steps):
        position[k] = c @ x + seen[k]
        error = reference[k] - position[k]
        current[k] = np.clip(of_c @ law + of_d @ error, -limit, limit)
        law = of_a @ law + of_b @ error
        held[:axes], held[axes:] = current[k], forces[k]
        x = a @ x + b @ held
    return current, position
