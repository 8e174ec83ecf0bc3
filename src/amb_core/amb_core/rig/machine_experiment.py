"""The experiment that identifies a machine in its loop: order of the model, band and amplitude, from its rotor.

The excitation is an orthogonal multisine of odd lines: distortions of even order, which sag causes, then lie between
the lines. Its band has three reasons to be as wide as it is.

- Bending modes: response on both sides of each is needed. Modes close to the Nyquist frequency are left out.
- Persistent excitation. A model of n states and p outputs needs 2 n / p lags of the inputs that are linearly
  independent. Without noise the lags of a narrow band are nearly collinear however many lines it has: a sampled signal
  up to the frequency f changes little within a few samples. The smallest singular value of the lags falls with each of
  them in proportion to f T. So the band grows with the number of lags and with the sample rate.
- A thrust bearing: eddy currents of its solid iron give a lag of half order, without a highest frequency.

Higher lines cost current, whose square distorts the response to the low ones, and voltage, which grows with frequency
and current. So the amplitude falls as the band grows.

Source: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, section 13.2 (persistent excitation).
"""

from __future__ import annotations

import math

from amb_core.excitation import Multisine
from amb_core.loop.machine import Machine
from amb_core.plant import PlantParameters
from amb_core.plant.machine import machine_of
from amb_core.plant.rotor import rotor_model

LOWEST = 2.0
"""Lower end of the band (Hz)."""
PERIOD = 0.5
"""Of the multisine (s)."""
PERIODS = 2
"""Of each of its experiments."""
AMPLITUDE = 1.5e-6
"""Peak of the reference (m) over a band to `RIGID`."""
RIGID = 600.0
"""Upper end of the band for a rigid rotor (Hz)."""

_OVER_BENDING = 2.25  # upper end over the frequency of the highest bending mode
_ROOM = 1.3  # the same, at least, for a mode to be part of the model
_THRUST = 1000.0  # Hz, with a thrust bearing
_LAG = 0.01  # upper end over the sample rate for each lag
_LIMIT = 0.2  # upper end over the sample rate at most
_HIGHEST_ORDER = 40
_HALF_ORDER_STATES = 2  # that describe the eddy currents of a thrust bearing over the band


def model_order(plant: PlantParameters, band_end: float = 0.0) -> int:
    """Order of the model: two states for each mode of the rotor, one for each axis, more for a thrust bearing.

    Parameters
    ----------
    plant : PlantParameters
        The machine.
    band_end : float
        A mode counts up to this frequency (Hz); 0: where the sample rate leaves room above it.

    Returns
    -------
    int
        Up to 40.
    """
    end = band_end or _LIMIT * plant.integration.sample_rate / _ROOM
    modes = sum(value <= end for value in _frequencies(plant))
    thrust = 2 + _HALF_ORDER_STATES if plant.rotor.axial else 0
    return min(2 * modes + thrust + len(machine_of(plant).axes), _HIGHEST_ORDER)


def band_end(plant: PlantParameters) -> float:
    """Upper end of the band (Hz): above the bending modes of the model, and wide enough for its order."""
    rate = plant.integration.sample_rate
    limit = _LIMIT * rate
    lags = 2 * math.ceil(model_order(plant) / len(machine_of(plant).axes))
    bending = [_OVER_BENDING * value for value in _frequencies(plant) if _ROOM * value <= limit]
    return min(limit, max(RIGID, _LAG * rate * lags, _THRUST if plant.rotor.axial else 0.0, *bending))


def amplitude(band_end: float) -> float:
    """Peak of the reference (m) for the upper end of a band (Hz)."""
    return AMPLITUDE * RIGID / max(RIGID, band_end)


def multisine(
    machine: Machine,
    band_end: float,
    amplitude: float,
    *,
    band_start: float = LOWEST,
    period: float = PERIOD,
    periods: int = PERIODS,
) -> Multisine:
    """One experiment of some periods (s) for each axis of a machine, all axes excited in each."""
    return Multisine(
        amplitude=amplitude,
        axes="orthogonal",
        duration=len(machine.axes) * periods * period,
        periods=periods,
        frequency_start=band_start,
        frequency_end=band_end,
        phasing="optimised",
        odd=True,
    )


def _frequencies(plant: PlantParameters) -> list[float]:
    """Natural frequencies of the free rotor across its axis (Hz): 0 for rigid body modes."""
    if plant.rotor.model == "point_mass":
        return [0.0, 0.0]
    return [float(value) for value in rotor_model(plant).natural_frequencies()]
