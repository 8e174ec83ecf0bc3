"""Compiles every kernel into numba's cache, so that no node has to when it starts: `python -m amb_core.warm_up`."""

from __future__ import annotations

from amb_core.excitation import Square, generate
from amb_core.identification import identify
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.parameters import validate
from amb_core.plant import Plant, PlantParameters
from amb_core.regions import classify
from amb_core.simulation import simulate


def warm_up() -> None:
    """Go once through simulation, tracing, classification of regions and identification."""
    plant = Plant()
    plant.trace(0.0, 0.0)
    Plant(validate(PlantParameters, {"rotor.model": "rigid"}))
    signal = generate(Square(amplitude=10e-6, duration=0.2, frequency=20.0), 10_000.0)
    record = simulate(plant, PdController(ControllerParameters()), 500 + signal.steps, signal.samples, 500)
    classify(record)
    for method in ("n4sid", "pem"):
        identify(record.window(500, signal.steps), order=4, method=method)


if __name__ == "__main__":
    warm_up()
