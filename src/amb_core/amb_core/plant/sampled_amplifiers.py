"""Linear model of the plant from sample to sample with the sampling of its pulse-width modulation.

An amplifier sets its duty cycle once per switching period T_p, from the reference and the mean coil current of the
period before, and holds it (`amb_core.plant.kernel.amplifiers`). For small deviations, with the open plant
dx/dt = A x + B V, i = C x + D V of states x, coil voltages V and coil currents i, at the start of a period

    e = r - (1 / T_p) integral of i over the period before,    I <- I + K_I T_p e,    V = 2 U (K_P e + I)

V is held over the period; where in the period its pulse lies, matters to second order in T_p. A controller sample of
whole switching periods makes a time-invariant map, the product of the maps of its periods. Interleaved carriers divide
a period into four parts, at the start of each of which one electromagnet is updated.

Source: D. M. Van de Sype et al., Small-signal Laplace-domain analysis of uniformly-sampled pulse-width modulators,
IEEE PESC 2004 (held duty cycles as sample and hold).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.linear import LinearSystem
from amb_core.plant.differences import OpenPlant, axis_labels, open_plant, plant_axes, plant_system
from amb_core.plant.network import COIL_AXES, COILS, active_coils
from amb_core.plant.operating_point import OperatingPoint
from amb_core.plant.parameters import PlantParameters
from amb_core.plant.plant import Plant


def modulation_is_regular(parameters: PlantParameters) -> bool:
    """Whether the modulation is resolved and each controller sample holds whole switching periods."""
    return parameters.amplifier.switching and parameters.steps_per_sample % parameters.steps_per_period == 0


def sampled_plant(plant: Plant, point: OperatingPoint) -> LinearSystem:
    """The plant from control currents (A) to measured positions (m) of the radial axes, from sample to sample.

    Parameters
    ----------
    plant : Plant
        Its modulation is regular, see `modulation_is_regular`.
    point : OperatingPoint
        Point of linearisation.
    """
    by_axis = _references(plant.parameters, plant_axes(plant))
    return sample_modulated(open_plant(plant, point), plant.parameters, by_axis, axis_labels(plant))


def sample_modulated(
    opened: OpenPlant, parameters: PlantParameters, by_axis: NDArray[np.float64], labels: list[str]
) -> LinearSystem:
    """A plant with modulated amplifiers from control currents (A) to measured positions (m), from sample to sample.

    Its states are those of the open plant, then for each electromagnet the integral of its current over the switching
    period (`charge`, A s), the integral part, and what interleaving and computation delay hold.

    Parameters
    ----------
    opened : OpenPlant
        The plant without current controllers.
    parameters : PlantParameters
        Its amplifiers, delay and rates are used; the modulation is regular, see `modulation_is_regular`.
    by_axis : ndarray, shape (coils, axes)
        Coil current references by control currents.
    labels : list of str
        Names of the axes.
    """
    a, b, names = _sample(opened, parameters, by_axis)
    axes = len(labels)
    names += [f"held_i_{label}" for label in labels]
    kept = _moving(a, len(opened.a))
    c = np.hstack([opened.sensors, np.zeros((axes, len(a) - len(opened.a)))])[:, kept]
    sample_time = 1.0 / parameters.integration.sample_rate
    return plant_system(a[np.ix_(kept, kept)], b[kept], c, sample_time, labels, [names[n] for n in kept])


def switching_period_matrix(opened: OpenPlant, parameters: PlantParameters) -> NDArray[np.float64]:
    """Matrix A of x[k+1] = A x[k] from switching period to switching period at constant control currents.

    States are those of the open plant, then charge, integral part and voltage of each electromagnet.

    Parameters
    ----------
    opened : OpenPlant
        The plant without current controllers.
    parameters : PlantParameters
        Its amplifiers are used; their modulation is resolved.
    """
    rate = {"sample_rate": parameters.amplifier.switching_frequency}
    period = {"integration": parameters.integration.model_copy(update=rate)}
    a, _, _ = _sample(opened, parameters.model_copy(update=period), np.zeros((len(opened.coils), 0)))
    return a


def _sample(
    opened: OpenPlant, parameters: PlantParameters, by_axis: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], list[str]]:
    """Matrices of x[k+1] = A x[k] + B i[k] and the names of the first states: plant, charge, integral, voltage.

    After these come the held inputs.
    """
    amplifier, (coils, axes) = parameters.amplifier, by_axis.shape
    period = 1.0 / amplifier.switching_frequency
    parts = COILS if amplifier.carriers == "interleaved" else 1
    charge, integral, voltage, held = (len(opened.a) + n * coils for n in range(4))
    a, b = np.eye(held + axes), np.zeros((held + axes, axes))
    flow = _flow(opened, len(a), period / parts)
    late = round(parameters.converters.computation_delay * parameters.steps_per_sample)
    periods = parameters.steps_per_sample // parameters.steps_per_period
    for part in range(periods * parts):
        fresh = part * parameters.steps_per_period >= late * parts
        for coil in _updated(part % parts, parts, parameters, coils):
            error = -a[charge + coil] / period, -b[charge + coil] / period
            now, before = (by_axis[coil], 0.0) if fresh else (0.0, by_axis[coil])
            error[0][held:] += before
            error[1][:] += now
            for matrix, deviation in zip((a, b), error, strict=True):
                matrix[integral + coil] += amplifier.integral_gain * period * deviation
                duty = amplifier.proportional_gain * deviation + matrix[integral + coil]
                matrix[voltage + coil] = 2.0 * amplifier.supply_voltage * duty
                matrix[charge + coil] = 0.0
        a, b = flow @ a, flow @ b
    a[held:], b[held:] = 0.0, np.eye(axes)
    names = [f"{kind}_{coil}" for kind in ("charge", "integral", "voltage") for coil in opened.coils]
    return a, b, [*opened.states, *names]


def _flow(opened: OpenPlant, size: int, duration: float) -> NDArray[np.float64]:
    """Transition of all states between two updates: voltages are held, currents are integrated."""
    order, coils = len(opened.a), len(opened.coils)
    charge, voltage, held = order, order + 2 * coils, order + 3 * coils
    rates = np.zeros((size, size))
    rates[:order, :order], rates[:order, voltage:held] = opened.a, opened.b
    rates[charge : charge + coils, :order], rates[charge : charge + coils, voltage:held] = opened.c, opened.d
    return np.asarray(linalg.expm(rates * duration), dtype=np.float64)


def _references(parameters: PlantParameters, axes: list[int]) -> NDArray[np.float64]:
    """Coil current references by control currents, shape (coils with amplifiers, axes)."""
    bearings = 1 if parameters.rotor.model == "point_mass" else 2
    active = list(active_coils(parameters.magnetic_circuit))
    return np.kron(np.eye(bearings), COIL_AXES[active])[:, axes]


def _updated(part: int, parts: int, parameters: PlantParameters, coils: int) -> list[int]:
    """Coils, numbered as those with amplifiers, that are updated at the start of a part of the switching period."""
    active = active_coils(parameters.magnetic_circuit)
    return [coil for coil in range(coils) if parts == 1 or active[coil % len(active)] == part]


def _moving(a: NDArray[np.float64], plant_states: int) -> list[int]:
    """States of the plant and those others that act on anything and change: not voltages updated in time."""
    idle = np.eye(len(a))
    return [n for n in range(len(a)) if n < plant_states or (a[:, n].any() and (a[n] != idle[n]).any())]
