"""The plant of the identification benchmark: a known unstable bearing of order 10, and its closed-loop data.

Linearised bearing of the paper's table 1 (current gain, negative stiffness, mass), seen by the sensors as rigid motion
plus a bending mode of the rotor. States, per axis: position and velocity of the rigid rotor, displacement and velocity
of the bending mode, coil current behind a first-order actuator; 2 x 5 = 10. The axes are coupled by 3 and 4 % in the
force of the currents and by 2 % in the stiffness. White forces act on rotor and mode as the magnets do, and white noise
on the sensors.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are
from scipy.signal import cont2discrete

from amb_core.excitation import excitation_from_request, generate
from amb_core.identification import StateSpaceModel
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord

ORDER = 10
SAMPLE_TIME = 1e-4  # s
STEPS = 40_000
CONTROLLER = ControllerParameters(current_limit=100.0)  # never reached: the loop is linear, as the plant is
SENSOR_NOISE = 0.05e-6  # m, rms
FORCE_NOISE = 0.3  # N, rms, held over a sample

_CURRENT_GAIN = 66.0  # N/A
_STIFFNESS = 3.30e5  # N/m, magnitude of the negative stiffness
_MASS = 6.25  # kg
_FORCE_COUPLING = np.array([[1.0, 0.04], [-0.03, 1.0]])  # of the coil currents
_STIFFNESS_COUPLING = np.array([[1.0, 0.02], [0.02, 1.0]])
_MODE_FREQUENCY = 900.0  # Hz
_MODE_DAMPING = 0.005
# Of the mode's acceleration by a force, relative to the rigid rotor's. Unequal, as where the sensors of x and y lie at
# different distances from a node: equal gains would let the whole response vanish at one antiresonance.
_MODE_GAINS = (0.2, 0.1)
_ACTUATOR_BANDWIDTHS = (1_500.0, 2_000.0)  # Hz


@dataclass(frozen=True)
class Experiment:
    """What is done to the loop.

    Attributes
    ----------
    excitation : str
        `squares` (50 um, 5 Hz, x then y) or `multisine` (1 to 2000 Hz, 5 um rms, both axes at once).
    noise : float
        Factor on the noise of sensors and forces.
    steps : int
        Samples.
    """

    excitation: str
    noise: float = 1.0
    steps: int = STEPS


DATA_SETS = {
    "squares": Experiment("squares"),
    "multisine": Experiment("multisine"),
    "squares_noise10": Experiment("squares", 10.0),
}


@functools.cache
def matrices() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """A, B (control currents), C and the input matrix of the forces on the rotor, exact for held inputs."""
    a, b, force, c = np.zeros((10, 10)), np.zeros((10, 2)), np.zeros((10, 2)), np.zeros((2, 10))
    frequency = 2.0 * np.pi * _MODE_FREQUENCY
    for axis, bandwidth in enumerate(_ACTUATOR_BANDWIDTHS):
        rigid, mode, coil = 2 * axis, 4 + 2 * axis, 8 + axis
        by_current = _CURRENT_GAIN * _FORCE_COUPLING[axis] / _MASS
        a[rigid, rigid + 1] = a[mode, mode + 1] = 1.0
        a[rigid + 1, [0, 2]] = _STIFFNESS * _STIFFNESS_COUPLING[axis] / _MASS
        a[rigid + 1, 8:] = by_current
        a[mode + 1, [mode, mode + 1]] = -(frequency**2), -2.0 * _MODE_DAMPING * frequency
        a[mode + 1, 8:] = _MODE_GAINS[axis] * by_current
        force[[rigid + 1, mode + 1], axis] = 1.0 / _MASS, _MODE_GAINS[axis] / _MASS
        a[coil, coil], b[coil, axis] = -2.0 * np.pi * bandwidth, 2.0 * np.pi * bandwidth
        c[axis, [rigid, mode]] = 1.0
    a, inputs, *_ = cont2discrete((a, np.hstack([b, force]), c, np.zeros((2, 4))), SAMPLE_TIME)
    return a, inputs[:, :2], c, inputs[:, 2:]


@functools.cache
def true_model(noise: float = 1.0) -> StateSpaceModel:
    """The plant in innovations form, with the gain of its stationary Kalman filter."""
    a, b, c, force = matrices()
    disturbance = force @ force.T * (FORCE_NOISE * noise) ** 2
    error = np.eye(2) * (SENSOR_NOISE * noise) ** 2
    variance = solve_discrete_are(a.T, c.T, disturbance, error)
    innovation = c @ variance @ c.T + error
    k = np.linalg.solve(innovation, c @ variance @ a.T).T
    zero = np.zeros(2)
    return StateSpaceModel(a, b, c, np.zeros((2, 2)), k, innovation, zero, zero, np.zeros(len(a)), SAMPLE_TIME)


def reference(excitation: str, steps: int, seed: int) -> NDArray[np.float64]:
    """Reference positions (m), shape (steps, 2); the seed chooses the phases of a multisine."""
    duration = steps * SAMPLE_TIME
    if excitation == "squares":
        request = {"amplitude": 50e-6, "frequency": 5.0, "duration": duration}
        return generate(excitation_from_request("square", request), 1.0 / SAMPLE_TIME).samples
    request = {"amplitude": 20e-6, "duration": duration, "frequency_start": 1.0, "frequency_end": 2_000.0, "seed": seed}
    samples = generate(excitation_from_request("multisine", request), 1.0 / SAMPLE_TIME).samples
    return samples * (5e-6 / samples.std(axis=0))


@functools.lru_cache(maxsize=8)
def record(experiment: Experiment, seed: int) -> LoopRecord:
    """The closed loop from rest; noise 0 gives the loop that a perfect model reproduces."""
    a, b, c, force = matrices()
    target = reference(experiment.excitation, experiment.steps, seed)
    random = np.random.default_rng([seed, 1])
    errors = random.normal(scale=SENSOR_NOISE, size=target.shape) * experiment.noise
    pushes = random.normal(scale=FORCE_NOISE, size=target.shape) * experiment.noise
    law, state = PdController(CONTROLLER), np.zeros(len(a))
    position, current = np.empty_like(target), np.empty_like(target)
    for step, wanted in enumerate(target):
        position[step] = c @ state + errors[step]
        current[step] = law.update(position[step], wanted)
        state = a @ state + b @ current[step] + force @ pushes[step]
    return LoopRecord(0, SAMPLE_TIME, target, position, current)
