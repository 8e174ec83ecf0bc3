"""The subharmonic test on the simulated loop."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from amb_core.excitation import Tones, generate
from amb_core.ground.errors import ExcitationError
from amb_core.ground.parameters import given_set
from amb_core.loop.control import ControllerParameters, require_one_rate
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.simulation import require_loop, simulate_first_bearing
from amb_core.regions.subharmonics.analysis import analyse, block_periods
from amb_core.regions.subharmonics.results import SubharmonicSpectrum
from amb_core.regions.subharmonics.settings import WHOLE, SubharmonicSettings


def run_subharmonics(
    plant: PlantParameters, controller: ControllerParameters, settings: SubharmonicSettings | None = None
) -> SubharmonicSpectrum:
    """Excite the simulated loop with the tones until its response is steady, the rotor delevitates, or time is up.

    The loop always starts from its reset: a run that is too short is repeated with twice the length. A run ends when
    the rotor touches the backup bearing, even if the plant could continue.

    Parameters
    ----------
    plant, controller : PlantParameters, ControllerParameters
        The loop.
    settings : SubharmonicSettings, optional
        The tones; the paper's by default.

    Returns
    -------
    SubharmonicSpectrum
        Lines, products and slow component of the response.

    Raises
    ------
    ExcitationError
        If the tones exceed the clearance of the backup bearing, or the rotor cannot move along their axis.
    SpectrumError
        If a tone is not below the Nyquist frequency, a block is not a whole number of samples, or plant and controller
        have different sample rates.
    """
    settings = given_set(SubharmonicSettings, "settings", settings)
    check(plant, controller, settings)
    rate = controller.sample_rate
    block, _ = block_periods(settings, 1.0 / rate)
    first = round(settings.rest * rate)
    full = first + round(settings.fade_in * rate)
    longest = int(settings.longest_run / settings.block_duration + WHOLE)
    contact = plant.backup_bearing.model_copy(update={"contact": False})
    simulated = Plant(plant.model_copy(update={"backup_bearing": contact}))
    blocks = settings.agreeing_blocks
    while True:
        steps = full + blocks * block
        samples = excitation(settings, steps - first, rate)
        record = simulate_first_bearing(simulated, controller, steps, samples, first)
        spectrum = analyse(record, settings, full, delevitated=simulated.delevitated)
        if spectrum.state in ("steady", "delevitated") or blocks >= longest:
            return spectrum
        blocks = min(2 * blocks, longest)


def check(plant: PlantParameters, controller: ControllerParameters, settings: SubharmonicSettings) -> None:
    """Reject a test that does not suit the loop, as `run_subharmonics` does."""
    require_loop(plant, controller)
    actuators = plant.magnetic_circuit.actuators
    if actuators != "two_axis" and settings.axis != "y":
        raise ExcitationError(
            f"axis = '{settings.axis}' is not allowed with magnetic_circuit.actuators = '{actuators}', which pull "
            "along y only; allowed: y"
        )
    reach, clearance = sum(settings.amplitudes), plant.rotor.backup_bearing_radius
    if reach >= clearance:
        raise ExcitationError(
            f"the amplitudes of the tones add up to {1e6 * reach:g} um; allowed: below the clearance of the backup "
            f"bearing, {1e6 * clearance:g} um"
        )
    require_one_rate(controller.sample_rate, plant.integration.sample_rate)
    block_periods(settings, 1.0 / controller.sample_rate)


def excitation(settings: SubharmonicSettings, steps: int, rate: float) -> NDArray[np.float64]:
    """Samples of the tones on their axis, fade-in included (m), shape (steps, 2)."""
    count = 3 if settings.inducing_amplitude > 0.0 else 2
    tones = Tones(
        frequencies=settings.frequencies[:count],
        amplitudes=settings.amplitudes[:count],
        phases=(0.0, 0.0, settings.inducing_phase)[:count],
        duration=steps / rate,
        axes=settings.axis,
    )
    samples = generate(tones, rate).samples.copy()
    fade = min(round(settings.fade_in * rate), steps)
    samples[:fade] *= (0.5 - 0.5 * np.cos(np.pi * np.arange(fade) / max(fade, 1)))[:, None]
    return samples
