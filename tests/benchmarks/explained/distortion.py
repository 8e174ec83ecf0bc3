"""Nonlinear distortion of the paper's bearing over the rms of the reference, and without gravity: `amb distortion`."""

from __future__ import annotations

from typing import Any

from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.plant.simulation import with_values
from amb_core.regions.distortion import DistortionSettings, simulate_distortion
from tests.front_door.figures import Figures

RMS = (0.5e-6, 1e-6, 2e-6, 4e-6, 8e-6)  # m
WITHOUT_GRAVITY = 2e-6  # m, rms
SMALLEST: dict[str, Any] = {"amplitudes": 1, "period": 0.1, "realisations": 2}


class Parts(Figures):
    """Distortion of an axis over its linear response (percent): all of it, and the parts of even and odd order."""

    all: float
    even: float
    odd: float


class Case(Figures):
    """Distortion of both axes with one rms of the reference (um)."""

    rms_um: float
    x: Parts
    y: Parts


class Distortion(Figures):
    """The bearing with gravity, a case for each rms, and without."""

    realisations: int
    frequency_start: float
    frequency_end: float
    cases: list[Case]
    without_gravity: Case


def measure(amplitudes: int = len(RMS), period: float = 1.0, realisations: int = 4) -> dict[str, object]:
    """Distortions, with multisines of one period length (s) and as many realisations."""
    settings = [
        DistortionSettings(rms=rms, period=period, realisations=realisations)
        for rms in (*RMS[:amplitudes], WITHOUT_GRAVITY)
    ]
    *cases, last = settings
    return {
        "realisations": realisations,
        "frequency_start": last.frequency_start,
        "frequency_end": last.frequency_end,
        "cases": [_case(one, {}) for one in cases],
        "without_gravity": _case(last, {"rotor.gravity": 0.0}),
    }


def _case(settings: DistortionSettings, changed: dict[str, float]) -> dict[str, object]:
    plant, controller = with_values(PlantParameters(), ControllerParameters(), changed)
    percent = simulate_distortion(plant, controller, settings).as_dict()
    names = {"all": "distortion_percent", "even": "even_percent", "odd": "odd_percent"}
    axes = {axis: {name: values[key] for name, key in names.items()} for axis, values in percent.items()}
    return {"rms_um": round(1e6 * settings.rms, 3), **axes}
