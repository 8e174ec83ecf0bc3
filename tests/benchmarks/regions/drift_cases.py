"""Closed loops of two known bearings whose position sensors drift, as data for identification.

Bearing `flexible` is that of the benchmark of identification: order 10, a bending mode of 900 Hz. Bearing `rigid` is
lighter and stiffer: order 6, unequal axes. White noise of 0.05 um acts on the sensors, white forces of 0.3 N on the
rotor.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete

from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord
from tests.benchmarks.ident import plant

SAMPLE_TIME = plant.SAMPLE_TIME
STEPS = 20_000
DRIFTS = ("ramp", "sine", "half_sine", "warm_up", "random_walk", "step")
EXCITATIONS = ("squares", "multisine")
_LEAST, _LARGEST = 2e-6, 5e-6  # m, size of a drift
_WALK_PERIOD = 0.1  # s, between the independent increments of the random walk
_FREQUENCIES = np.arange(5.0, 1_001.0)  # Hz, at which responses are compared

Matrices = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


@dataclass(frozen=True)
class Case:
    """One run: bearing, excitation, shape of the drift (empty for none), seed of all random numbers; whether cured."""

    bearing: str
    excitation: str
    drift: str
    seed: int
    steps: int = STEPS
    cure: bool = True


@dataclass(frozen=True)
class Bearing:
    """Matrices A, B (control currents), C and those of the forces on the rotor, and the controller of the loop."""

    matrices: Matrices
    controller: ControllerParameters

    @property
    def order(self) -> int:
        """Number of states."""
        return len(self.matrices[0])

    @functools.cached_property
    def response(self) -> NDArray[np.complex128]:
        """Frequency response from currents to positions, shape (frequencies, 2, 2)."""
        return response_of(*self.matrices[:3])


def response_of(a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Frequency response of a model without feedthrough, shape (frequencies, 2, 2)."""
    z = np.exp(2j * np.pi * _FREQUENCIES * SAMPLE_TIME)
    resolvent = z[:, np.newaxis, np.newaxis] * np.eye(len(a)) - a
    return np.asarray(c @ np.linalg.solve(resolvent, np.broadcast_to(b, (len(z), *b.shape))))


@functools.cache
def bearing(name: str) -> Bearing:
    """The bearing of that name."""
    if name == "flexible":
        return Bearing(plant.matrices(), plant.CONTROLLER)
    return Bearing(
        _rigid(), ControllerParameters(proportional_gain=13_000.0, derivative_gain=16.0, current_limit=100.0)
    )


def _rigid() -> Matrices:
    """A rigid rotor of 3 kg, 120 N/A, 7.5e5 and 8.5e5 N/m, actuators of 1.2 and 1.5 kHz."""
    mass, gain = 3.0, 120.0
    a, b, force, c = np.zeros((6, 6)), np.zeros((6, 2)), np.zeros((6, 2)), np.zeros((2, 6))
    for axis, (stiffness, bandwidth) in enumerate(((7.5e5, 1_200.0), (8.5e5, 1_500.0))):
        position, coil = 2 * axis, 4 + axis
        a[position, position + 1] = 1.0
        a[position + 1, position] = stiffness / mass
        a[position + 1, [4, 5]] = gain / mass * np.array([[1.0, 0.03], [-0.02, 1.0]])[axis]
        a[coil, coil], b[coil, axis] = -2.0 * np.pi * bandwidth, 2.0 * np.pi * bandwidth
        force[position + 1, axis] = 1.0 / mass
        c[axis, position] = 1.0
    a, inputs, *_ = cont2discrete((a, np.hstack([b, force]), c, np.zeros((2, 4))), SAMPLE_TIME)
    return a, inputs[:, :2], c, inputs[:, 2:]


def drift(shape: str, steps: int, random: np.random.Generator) -> NDArray[np.float64]:
    """Drift of both sensors (m), shape (steps, 2): each of its own size, sign and place in time."""
    time = np.linspace(0.0, 1.0, steps)
    columns = []
    for _ in range(2):
        size, sign = random.uniform(_LEAST, _LARGEST), random.choice([-1.0, 1.0])
        columns.append(sign * size * _shape(shape, time, steps * SAMPLE_TIME, random))
    return np.column_stack(columns)


def _shape(shape: str, time: NDArray[np.float64], duration: float, random: np.random.Generator) -> NDArray[np.float64]:
    """A drift of size 1 over the relative time: amplitude of the sine, otherwise the range."""
    if shape == "ramp":
        return time
    if shape == "sine":
        return np.sin(2.0 * np.pi * (random.uniform(0.1, 0.5) * duration * time + random.uniform()))
    if shape == "half_sine":
        return np.sin(np.pi * time)
    if shape == "warm_up":
        return 1.0 - np.exp(-time / random.uniform(0.1, 0.5))
    if shape == "random_walk":
        # Slow as the other drifts: a walk that moves with every sample is noise, stronger than the forces up to 30 Hz.
        knots = np.linspace(0.0, 1.0, round(duration / _WALK_PERIOD) + 1)
        walk = np.interp(time, knots, np.cumsum(random.normal(size=len(knots))))
        return np.asarray(walk / np.ptp(walk))
    return (time >= random.uniform(0.2, 0.8)).astype(float)


def record(case: Case) -> LoopRecord:
    """The closed loop from rest; with and without drift the noise is the same."""
    known = bearing(case.bearing)
    a, b, c, force = known.matrices
    target = plant.reference(case.excitation, case.steps, case.seed)
    random = np.random.default_rng([case.seed, 1])
    errors = random.normal(scale=plant.SENSOR_NOISE, size=target.shape)
    if case.drift:
        errors = errors + drift(case.drift, case.steps, np.random.default_rng([case.seed, 2, DRIFTS.index(case.drift)]))
    pushes = random.normal(scale=plant.FORCE_NOISE, size=target.shape)
    law, state = PdController(known.controller), np.zeros(len(a))
    position, current = np.empty_like(target), np.empty_like(target)
    for step, wanted in enumerate(target):
        position[step] = c @ state + errors[step]
        current[step] = law.update(position[step], wanted)
        state = a @ state + b @ current[step] + force @ pushes[step]
    return LoopRecord(0, SAMPLE_TIME, target, position, current)
