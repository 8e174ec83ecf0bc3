"""Loss by eddy currents that the pulses of the amplifiers cause, in closed form.

With harmonic k of the switching frequency, s = j k omega, coil voltages V_k and the matrices of
`amb_core.plant.network`,

    sum over gaps and iron R_m f_m(s) phi + E psi - N_p S i = 0,   E^T phi = 0,   s N_p S^T phi + R_c i = V_k

where f = 1 in the gaps, 1 + s tau / 3 in thin laminations, u coth(u) with u = sqrt(s tau) where flux diffuses into
iron. The loss in iron m is Re (s phi)^H R_m f_m(s) phi / 2. The pulses are those of bias current at rest: a square wave
whose mean voltage is the drop of the coil resistance.

Sources: as in `amb_core.plant.eddy`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.plant.eddy import diffusion, lamination_time_constant
from amb_core.plant.network import COILS, POLES, active_coils, build_network, flux_constraints
from amb_core.plant.parameters import PlantParameters

_HARMONICS = 1000
"""Loss in thin laminations falls with the square of the harmonic: what is left out is less than 0.1 %."""


def switching_loss(parameters: PlantParameters) -> float:
    """Eddy-current loss in the iron of a bearing by the switching of its amplifiers (W).

    The rotor is centred, all currents are at the bias, the iron has its constant relative permeability. Dead time is
    left out. Zero without switching or without eddy currents.

    Parameters
    ----------
    parameters : PlantParameters
        The plant; `iron.laminations` decides how its laminations are modelled.
    """
    circuit, amplifier, iron = parameters.magnetic_circuit, parameters.amplifier, parameters.iron
    if not (amplifier.switching and iron.eddy_currents):
        return 0.0
    frequency: NDArray[np.float64] = amplifier.switching_frequency * np.arange(1.0, _HARMONICS + 1.0)
    s, tau = 2j * np.pi * frequency, lamination_time_constant(parameters)
    laminated = diffusion(frequency, tau) if iron.laminations == "diffusion" else 1.0 + s * tau / 3.0
    linear = parameters.model_copy(update={"iron": iron.model_copy(update={"saturation": False, "hysteresis": False})})
    network = build_network(linear)
    in_journal = network.journal_reluctance if iron.solid_journal else np.zeros((POLES, POLES))
    parts = [(network.iron_reluctance - in_journal, laminated)]
    if iron.solid_journal:
        parts.append((in_journal, diffusion(frequency, network.diffusing[-1].terms.time_constant)))
    in_iron = sum(factor[:, None, None] * reluctance for reluctance, factor in parts)
    gap = circuit.air_gap * network.gap_reluctance * np.eye(POLES)
    flux = _flux(gap + in_iron, s, network.winding, parameters)
    return float(0.5 * np.einsum("ki,kij,kj->k", np.conj(s[:, None] * flux), in_iron, flux).real.sum())


def _flux(
    impedance: NDArray[np.complexfloating[Any, Any]],
    s: NDArray[np.complexfloating[Any, Any]],
    winding: NDArray[np.float64],
    parameters: PlantParameters,
) -> NDArray[np.complex128]:
    """Harmonics of the pole fluxes (Wb), shape (k, 8)."""
    circuit, active = parameters.magnetic_circuit, list(active_coils(parameters.magnetic_circuit))
    constraints = flux_constraints(circuit.coupling)
    circuits, coils = constraints.shape[1], len(active)
    size = POLES + circuits + coils
    system = np.zeros((len(s), size, size), dtype=np.complex128)
    system[:, :POLES, :POLES] = impedance
    system[:, :POLES, POLES:] = np.hstack([constraints, -winding[:, active]])
    system[:, POLES:, :POLES] = np.hstack([constraints, winding[:, active]]).T
    system[:, POLES + circuits :, :POLES] *= s[:, None, None]
    system[:, POLES + circuits :, POLES + circuits :] = circuit.coil_resistance * np.eye(coils)
    drive = np.zeros((len(s), size, 1), dtype=np.complex128)
    drive[:, POLES + circuits :, 0] = _voltages(len(s), parameters)[:, active]
    return np.asarray(np.linalg.solve(system, drive)[:, :POLES, 0])


def _voltages(harmonics: int, parameters: PlantParameters) -> NDArray[np.complex128]:
    """Harmonics of the coil voltages (V), shape (k, 4), with pulses in the middle of the switching period."""
    amplifier = parameters.amplifier
    k = np.arange(1, harmonics + 1)
    supply = amplifier.supply_voltage
    duty = 0.5 + 0.5 * parameters.magnetic_circuit.coil_resistance * amplifier.bias_current / supply
    pulse = (-1.0) ** k * 4.0 * supply * np.sin(np.pi * k * duty) / (np.pi * k)
    later = 0.25 * np.arange(COILS) if amplifier.carriers == "interleaved" else np.zeros(COILS)
    return np.asarray(pulse[:, None] * np.exp(-2j * np.pi * np.outer(k, later)))
