"""PD gains for a bearing: pole placement on the linearised plant, adjusted until the sampled loop has its margins.

`amb_core.designs.tuning.pd_gains` places the poles of the rigid rotor and takes the gains with the least derivative
action. If their peak sensitivity is above the limit, or the grid has none, the gains are searched: a wide grid of
stiffness and damping, then a simplex search from the best point. What no gains of this search stabilise is explained
(`amb_core.designs.tuning.reasons`).

Sources: Schweitzer, Maslen (eds.), "Magnetic Bearings", Springer 2009, ch. 2 and 8; ISO 14839-3.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.designs.tuning.dynamic_stiffness import stiffness_and_damping
from amb_core.designs.tuning.loop_family import LoopFamily, gain_margins
from amb_core.designs.tuning.pd_gains import choose_gains, held_at_centre, placed_gains, require_carrying, three_digits
from amb_core.ground.errors import ParameterError, PlantError
from amb_core.ground.parameters import flatten, validate
from amb_core.loop.control import ControllerParameters, pack_gains
from amb_core.plant import Plant, PlantParameters, linearize
from amb_core.plant.linearise import Linearization

HIGHEST_PEAK = 3.0
"""Peak sensitivity (-) up to which ISO 14839-3 puts a machine in its zone A, as cited; to be checked against it."""
RATIOS = np.geomspace(1.05, 40.0, 28)
"""Stiffness k_i K_P over negative stiffness k_s, of the wide grid."""
ZETAS = np.geomspace(0.02, 20.0, 28)
"""Damping ratio of the rigid rotor, of the wide grid."""


@dataclass(frozen=True)
class Tuned:
    """Gains with what they make of the loop.

    Attributes
    ----------
    controller : ControllerParameters
        Gains, nominal reference and limit.
    model : Linearization
        The loop with these gains, linearised about where it holds the rotor: the centre of the bearing.
    peak_sensitivity : float
        Exact (-).
    stiffness : float
        Least of the radial axes at low frequency (N/m), see `amb_core.designs.tuning.dynamic_stiffness`.
    damping : float
        Least of the radial axes at low frequency (N s/m): less than k_i K_D by the lag of the loop.
    gain_margins : tuple of float
        Factors on both gains at which the loop becomes unstable, below and above one (-).
    holding_current : float
        Control current that carries the weight in the centre (A).
    """

    controller: ControllerParameters
    model: Linearization
    peak_sensitivity: float
    stiffness: float
    damping: float
    gain_margins: tuple[float, float]
    holding_current: float

    @property
    def least_phase_margin(self) -> float:
        """Phase margin that the peak sensitivity M guarantees on every axis at once, 2 asin(1 / 2 M) (deg)."""
        return float(2.0 * np.degrees(np.arcsin(0.5 / max(self.peak_sensitivity, 0.5))))


def tune(
    parameters: PlantParameters, controller: ControllerParameters | None = None, highest_peak: float = HIGHEST_PEAK
) -> Tuned | None:
    """Gains of a machine with the least derivative action that keep the peak sensitivity; otherwise the lowest peak.

    Parameters
    ----------
    parameters : PlantParameters
        The machine.
    controller : ControllerParameters, optional
        Gives everything but gains and nominal reference. The defaults if None.
    highest_peak : float, optional
        Peak sensitivity that is low enough (-).

    Returns
    -------
    Tuned or None
        None if no gains of the search make the loop stable.

    Raises
    ------
    PlantError
        If the currents cannot carry the rotor in the centre.
    """
    plant = Plant(parameters)
    given = centred(parameters, controller)
    family = LoopFamily(linearize(plant, given, np.zeros(2)))
    try:
        chosen = choose_gains(plant, given).controller
        gains: tuple[float, float] | None = _first_gains(chosen)
    except (PlantError, ParameterError):  # none stable, or beyond what a controller takes
        require_carrying(family.model, given)
        gains = None
    if gains is None or family.exact_peak(*gains) > highest_peak:
        gains = _searched(plant, family, gains)
    return None if gains is None else result_of(plant, family, gains)


def result_of(plant: Plant, family: LoopFamily, gains: tuple[float, float]) -> Tuned:
    """What gains K_P (A/m) and K_D (A s/m) make of a stable loop, with the reference that holds the centre."""
    controller = held_at_centre(plant, family.model, family.controller(*gains))
    model = linearize(plant, controller)
    return Tuned(
        controller,
        model,
        model.peak_sensitivity,
        *stiffness_and_damping(plant, model),
        gain_margins(family, *gains),
        float(np.abs(model.point.current_reference).max()),
    )


def candidates(plant: Plant, family: LoopFamily, highest_peak: float = HIGHEST_PEAK) -> list[tuple[float, float]]:
    """Gains of the wide grid with a peak sensitivity that is low enough, the softest derivative first."""
    pairs = [pair for pair in wide_grid(plant) if family.peak(*pair) <= highest_peak]
    return sorted(pairs, key=lambda pair: pair[1])


def wide_grid(plant: Plant) -> Iterator[tuple[float, float]]:
    """K_P (A/m) and K_D (A s/m) over `RATIOS` and `ZETAS`."""
    for ratio in RATIOS:
        for zeta in ZETAS:
            yield placed_gains(plant, ratio, zeta)


def centred(parameters: PlantParameters, controller: ControllerParameters | None) -> ControllerParameters:
    """The given controller at the plant's sample rate, without references and gains of its own for single axes."""
    rate = parameters.integration.sample_rate
    given = (controller or ControllerParameters(sample_rate=rate)).at_rate(rate)
    values = {name: value for name, value in flatten(given.model_dump()).items() if name in _OWN}
    return validate(ControllerParameters, values | {"nominal_reference": ()})


_OWN = frozenset(ControllerParameters.model_fields)


def _first_gains(controller: ControllerParameters) -> tuple[float, float]:
    packed = pack_gains(controller, max(len(controller.proportional_gains), 1))
    return float(packed[0, 0]), float(packed[0, 1])


def _searched(plant: Plant, family: LoopFamily, start: tuple[float, float] | None) -> tuple[float, float] | None:
    """The gains with the lowest peak sensitivity: of the wide grid, then by simplex search in their logarithms."""
    from scipy.optimize import minimize

    pairs = [*([start] if start else []), *wide_grid(plant)]
    peaks = np.array([family.peak(*pair) for pair in pairs])
    if not np.isfinite(peaks).any():
        return None

    def cost(logarithms: NDArray[np.float64]) -> float:
        return min(family.peak(*np.exp(logarithms)), 1e9)

    best = pairs[int(np.argmin(peaks))]
    optimum = np.exp(minimize(cost, np.log(best), method="Nelder-Mead", options={"xatol": 1e-2, "fatol": 1e-2}).x)
    rounded = three_digits(optimum[0]), three_digits(optimum[1])
    return rounded if family.peak(*rounded) < family.peak(*best) else best
