"""Compiles every kernel into numba's cache, so that no node has to: `python -m amb_core.warm_up`.

`python -m amb_core.warm_up plant` compiles those of the plant, `... estimates` all others: two processes need about
half the time, since the kernel of the plant alone takes most of it.
"""

from __future__ import annotations

import contextlib
import sys
from typing import get_args

import numpy as np

from amb_core.designs.excitation.linear_response import LinearLoop
from amb_core.excitation import ExcitationSignal, Square, generate
from amb_core.ground.errors import MissingExtraError
from amb_core.ground.parameters import validate
from amb_core.identification import Focus, IdentificationData, identify
from amb_core.identification import validate as validate_model
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.known_controller import LinearControl
from amb_core.loop.linear_control import LinearController, LinearControllerParameters, pd_as_linear
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.simulation import simulate
from amb_core.regions.rehearsal import rehearse
from amb_core.robustness.error_band import error_band

_RATE = 10_000.0  # Hz; the kernels are the same for all rates
_STIFFNESS, _FORCE = 2.8e5, 40.0  # 1/s^2 and N/(A kg), about those of the paper's bearing


def warm_up() -> None:
    """Compile all kernels."""
    plant()
    estimates()


def plant() -> None:
    """Go once through simulation, tracing and the linear loop."""
    simulated = Plant()
    simulated.trace((0.0, 0.0))
    Plant(validate(PlantParameters, {"rotor.model": "rigid", "rotor.axial": True})).advance([0.0] * 5)
    signal, controller = _signal(), ControllerParameters()
    record = simulate(simulated, PdController(controller), signal.steps, signal.samples, 0)
    with contextlib.suppress(MissingExtraError):  # without the extra `control` nobody needs it
        LinearLoop(simulated, controller).respond(record.reference)


def estimates() -> None:
    """Go once through regions, identification, validation and a certificate, of a loop that is linear."""
    rehearse()
    part = _linear_record()
    model = identify(part, order=4, method="n4sid").model
    error_band(model, [IdentificationData.from_record(part)], 0.1)
    for focus in get_args(Focus):
        identify(part, order=4, method="pem", focus=focus)
    linear = LinearControl(pd_as_linear(ControllerParameters()), LinearControllerParameters())
    LinearController(linear.model, linear.parameters, 2, linear.sample_rate).update((0.0, 0.0), (0.0, 0.0))
    identification = identify(part, order=4, method="pem", focus="simulation", controller=linear)
    validate_model(identification.model, identification.data, linear)


def _signal() -> ExcitationSignal:
    return generate(Square(amplitude=10e-6, duration=0.2, frequency=20.0), _RATE)


def _linear_record() -> LoopRecord:
    """A rotor that its bearings push away, under the PD law."""
    reference, law = _signal().samples, PdController(ControllerParameters())
    position, current = np.zeros_like(reference), np.zeros_like(reference)
    noise = 1e-8 * np.random.default_rng(0).standard_normal(reference.shape)
    state = np.zeros((2, 2))  # position (m) and velocity (m/s) of each axis
    for step, wanted in enumerate(reference):
        position[step] = state[0] + noise[step]
        current[step] = law.update(position[step], wanted)
        state[1] += (_STIFFNESS * state[0] + _FORCE * current[step]) / _RATE
        state[0] += state[1] / _RATE
    return LoopRecord(0, 1.0 / _RATE, reference, position, current)


if __name__ == "__main__":
    for part in sys.argv[1:] or ["plant", "estimates"]:
        {"plant": plant, "estimates": estimates}[part]()
