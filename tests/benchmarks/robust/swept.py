"""Sensitivity measured by swept sines on the nonlinear simulator, compared with that of the model identified there."""

from __future__ import annotations

import numpy as np

from amb_core.excitation import excitation_from_request, generate
from amb_core.identification import IdentificationData, identify
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant, PlantParameters
from amb_core.robustness import feedback_of, measured_sensitivity
from amb_core.simulation import simulate
from amb_core.simulation.parameters import with_values

RATE = 10_000.0  # Hz
SETTLED = 2_000  # steps
BEARINGS = {
    "paper": {},
    "lighter rotor": {"rotor.mass": 4.0},
    "wider gap": {"magnetic_circuit.air_gap": 0.7e-3},
    "slower derivative": {"controller.derivative_gain": 45.0},
}


def swept(say) -> dict[str, object]:
    """Largest difference in dB up to 1 kHz, by bearing."""
    found = {}
    for name, change in BEARINGS.items():
        found[name] = _worst(change)
        say(f"swept {name}: {found[name]}")
    return {"worst_db": max(one["worst_db"] for one in found.values()), "bearings": found}


def _worst(change: dict[str, float]) -> dict[str, float]:
    plant, controller = with_values(PlantParameters(), ControllerParameters(), change)
    for_model = {"amplitude": 4e-6, "duration": 4.0, "frequency_start": 2.0, "frequency_end": 2_000.0, "seed": 5}
    model = identify(_run(plant, controller, "multisine", for_model), 10, controller=controller).model
    feedback = feedback_of(model, controller)
    sweep = {
        "amplitude": 4e-6,
        "frequency_start": 5.0,
        "frequency_end": 1_200.0,
        "duration": 8.0,
        "spacing": "logarithmic",
    }
    experiments = []
    for axis in ("x", "y"):
        data = _run(plant, controller, "sweep", sweep | {"axes": axis})
        experiments += list(data.experiments)
    both = IdentificationData(tuple(experiments), data.sample_time, *_names(data))
    measured = measured_sensitivity(both, controller, feedback)
    difference = measured.difference_db(feedback)
    return {
        "worst_db": float(np.abs(difference).max()),
        "median_db": float(np.median(np.abs(difference))),
        "frequencies": int(difference.shape[1]),
    }


def _run(plant: PlantParameters, controller: ControllerParameters, kind: str, request: dict) -> IdentificationData:
    excitation = generate(excitation_from_request(kind, request), RATE).samples
    record = simulate(Plant(plant), PdController(controller), len(excitation) + SETTLED, excitation, SETTLED)
    return IdentificationData.from_record(record.window(SETTLED, len(excitation)))


def _names(data: IdentificationData) -> tuple:
    return data.input_names, data.output_names, data.input_units, data.output_units
