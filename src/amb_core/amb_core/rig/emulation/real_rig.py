"""A plant as a rig has it, where the parameters of a simulation leave it ideal."""

from __future__ import annotations

from typing import Any

from amb_core.ground.parameters import flatten, validate
from amb_core.plant import PlantParameters

LIES = 0.98  # of the radius of the backup bearing, downwards: where the rotor lies before and after a levitation
NOISE, RESOLUTION = 20e-9, 10e-9  # m, of sensors and converters of good rigs; assumed


def as_on_a_rig(plant: PlantParameters) -> PlantParameters:
    """The same plant, whose rotor lies on its backup bearing and bounces on it, with noise and quantisation.

    Noise and resolution that are given stay.

    Parameters
    ----------
    plant : PlantParameters
        Parameters of a machine.

    Returns
    -------
    PlantParameters
        The changed parameters.

    Raises
    ------
    ParameterError
        If they contradict each other.
    """
    values: dict[str, Any] = flatten(plant.model_dump())
    changed = {
        "rotor.initial_x": 0.0,
        "rotor.initial_y": -LIES * plant.rotor.backup_bearing_radius,
        "backup_bearing.contact": True,
        "sensor.noise": plant.sensor.noise or NOISE,
        "converters.position_resolution": plant.converters.position_resolution or RESOLUTION,
    }
    return validate(PlantParameters, values | changed)
