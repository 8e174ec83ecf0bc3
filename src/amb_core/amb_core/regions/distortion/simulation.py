"""Distortion of the simulated bearing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from amb_core.ground.errors import ParameterError, SpectrumError
from amb_core.ground.given_values import require_kind
from amb_core.ground.progress import Progress
from amb_core.loop.control import ControllerParameters
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.simulation import require_loop, simulate_first_bearing
from amb_core.regions.distortion.measurement import PeriodicResponse, measure_distortion
from amb_core.regions.distortion.result import Distortion
from amb_core.regions.distortion.settings import DistortionSettings
from amb_core.regions.distortion.signals import EXPERIMENTS, Lines, lines_of, reference_of


def simulate_distortion(
    plant: PlantParameters,
    controller: ControllerParameters,
    settings: DistortionSettings,
    progress: Progress | None = None,
    realisations: Sequence[int] | None = None,
) -> Distortion:
    """Simulate the experiments and measure the distortions.

    Parameters
    ----------
    plant, controller : PlantParameters, ControllerParameters
        The loop.
    settings : DistortionSettings
        The multisines.
    progress : callable, optional
        Called before the first and after every experiment, see `amb_core.ground.progress.Progress`. None for no calls.
    realisations : sequence of int, optional
        Numbers of the realisations; by default the first ones, as many as the settings say.

    Returns
    -------
    Distortion
        Linear response, distortions and noise by the robust method.

    Raises
    ------
    SpectrumError
        If the settings do not fit the loop, or the rotor delevitates.
    PlantError, ParameterError
        As `simulate`.
    """
    require_loop(plant, controller)
    require_kind("settings", settings, DistortionSettings, "DistortionSettings", ParameterError)
    lines = lines_of(settings, plant.integration.sample_rate)
    experiments = len(EXPERIMENTS[settings.axes])
    chosen = range(settings.realisations) if realisations is None else realisations
    total = len(chosen) * experiments
    bearing = Plant(plant)
    responses: list[list[PeriodicResponse]] = []
    for place, realisation in enumerate(chosen):
        responses.append([])
        for experiment in range(experiments):
            if progress is not None:
                progress("experiments", place * experiments + experiment, total)
            responses[-1].append(_respond(bearing, controller, settings, lines, realisation, experiment))
    if progress is not None:
        progress("experiments", total, total)
    return measure_distortion(responses, lines, bearing.sample_time)


def _respond(
    plant: Plant,
    controller: ControllerParameters,
    settings: DistortionSettings,
    lines: Lines,
    realisation: int,
    experiment: int,
) -> PeriodicResponse:
    rest = round(settings.rest / plant.sample_time)
    reference = reference_of(settings, lines, realisation, experiment)
    excitation = np.tile(reference, (settings.settling_periods + settings.periods, 1))
    record = simulate_first_bearing(plant, controller, rest + len(excitation), excitation, rest)
    if plant.delevitated:
        raise SpectrumError(
            f"the rotor delevitates at {record.steps * plant.sample_time:.3g} s in experiment {experiment + 1} of "
            f"realisation {realisation + 1} with an rms of {settings.rms:g} m; allowed: a smaller one"
        )
    first = rest + settings.settling_periods * lines.steps
    shape = (settings.periods, lines.steps, 2)
    return PeriodicResponse(reference, record.current[first:].reshape(shape), record.position[first:].reshape(shape))
