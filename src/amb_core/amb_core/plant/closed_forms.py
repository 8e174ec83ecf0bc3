"""Closed forms of the bearing with ideal iron: the limit of the plant when the iron has no magnetomotive force drop.

An electromagnet has N turns on two poles of face area A, at 22.5 deg on either side of its axis; g_0 is the air gap of
the centred rotor and i_0 the bias current.

Sources: Schweitzer, Maslen (eds.), "Magnetic Bearings", Springer 2009, ch. 3; the paper's eq. (2).
"""

from __future__ import annotations

import numpy as np
from scipy.constants import mu_0

from amb_core.plant.parameters import MagneticCircuitParameters

AXIS_COSINE = float(np.cos(np.pi / 8))
"""Part of the force of a pole along the axis of its electromagnet."""


def force_constant(circuit: MagneticCircuitParameters) -> float:
    """Factor k of an electromagnet's force k i^2 / x_g^2 at current i and pole gap x_g (N m^2/A^2)."""
    return mu_0 * _turns(circuit) ** 2 * _area(circuit) * AXIS_COSINE / 4.0


def current_gain(circuit: MagneticCircuitParameters, bias_current: float) -> float:
    """Current gain k_i: force of a pair of electromagnets per control current, rotor centred (N/A)."""
    return 4.0 * force_constant(circuit) * bias_current / circuit.air_gap**2


def negative_stiffness(circuit: MagneticCircuitParameters, bias_current: float) -> float:
    """Negative stiffness k_s: force on the rotor per displacement at bias current, away from the centre (N/m).

    If the electromagnets share flux, every pole keeps its full bias when the rotor moves. In separate circuits the
    electromagnets at the sides keep their flux, and only those along the displacement count.
    """
    separate = current_gain(circuit, bias_current) * bias_current * AXIS_COSINE / circuit.air_gap
    return separate / AXIS_COSINE**2 if circuit.coupling else separate


def inductance(circuit: MagneticCircuitParameters) -> float:
    """Inductance L of an electromagnet with its own circuit, two gaps in series, rotor centred (H)."""
    return mu_0 * _turns(circuit) ** 2 * _area(circuit) / (2.0 * circuit.air_gap)


def _turns(circuit: MagneticCircuitParameters) -> int:
    return 2 * circuit.turns_per_pole


def _area(circuit: MagneticCircuitParameters) -> float:
    return circuit.pole_width * circuit.axial_length
