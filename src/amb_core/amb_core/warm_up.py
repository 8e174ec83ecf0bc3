"""Compiles every kernel into numba's cache, so that no node has to: `python -m amb_core.warm_up`."""

from __future__ import annotations

import contextlib
from typing import get_args

from amb_core.designs.excitation.linear_response import LinearLoop
from amb_core.excitation import Square, generate
from amb_core.ground.errors import MissingExtraError
from amb_core.ground.parameters import validate
from amb_core.identification import Focus, IdentificationData, identify
from amb_core.identification import validate as validate_model
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.known_controller import LinearControl
from amb_core.loop.linear_control import LinearController, LinearControllerParameters, pd_as_linear
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.simulation import simulate
from amb_core.regions.rehearsal import rehearse
from amb_core.robustness.error_band import error_band


def warm_up() -> None:
    """Go once through simulation, tracing, excitations, regions, identification, validation and a certificate."""
    plant = Plant()
    plant.trace((0.0, 0.0))
    Plant(validate(PlantParameters, {"rotor.model": "rigid", "rotor.axial": True})).advance([0.0] * 5)
    signal = generate(Square(amplitude=10e-6, duration=0.2, frequency=20.0), 10_000.0)
    controller = ControllerParameters()
    record = simulate(plant, PdController(controller), 500 + signal.steps, signal.samples, 500)
    with contextlib.suppress(MissingExtraError):  # without the extra `control` nobody needs it
        LinearLoop(plant, controller).respond(record.reference)
    rehearse()
    part = record.window(500, signal.steps)
    model = identify(part, order=4, method="n4sid").model
    error_band(model, [IdentificationData.from_record(part)], 0.1)
    for focus in get_args(Focus):
        identify(part, order=4, method="pem", focus=focus)
    linear = LinearControl(pd_as_linear(controller), LinearControllerParameters())
    LinearController(linear.model, linear.parameters, 2, linear.sample_rate).update((0.0, 0.0), (0.0, 0.0))
    identification = identify(part, order=4, method="pem", focus="simulation", controller=linear)
    validate_model(identification.model, identification.data, linear)


if __name__ == "__main__":
    warm_up()
