"""What the integrator works on, as records: every quantity by its name and unit.

Compiled code reads the fields of a record at fixed places in memory, as fast as those of a C structure. A plant has one
record of constants, one of what its bearings share, and one per bearing; `amb_core.plant.packing` makes them. Arrays
whose size depends on the rotor, its modes and a trace, stay arrays (`kernel.rotor`, `kernel.trace`).

Matrices that `kernel.products` multiplies lie by columns: row n holds what component n of the vector contributes.
"""

from __future__ import annotations

import numpy as np

from amb_core.plant.memory_terms import MOST_TERMS
from amb_core.plant.network import COILS, POLES

OK, DELEVITATED, NOT_FINITE, GAP_CLOSED = range(4)
"""How a call of the integrator ends."""

LINEAR, CURVE_OF_IRON, HYSTERESIS_OF_IRON = range(3)
"""How flux density and field of the iron belong together: constant permeability, single-valued curve, loops."""

MOST_BEARINGS = 2
RINGS = 2  # back iron and journal, in which fluxes may circulate
ELEMENTS = 3 * POLES  # of the iron of a bearing: poles, segments of the back iron, segments of the journal
FLUXES = POLES + RINGS  # pole fluxes, then circulating fluxes
CURVE_INTERVALS = 4096

AMPLIFIER = np.dtype(
    [
        ("supply", float),  # V
        ("duty_min", float),
        ("duty_max", float),
        ("mean_by_ends", float),  # share of the change of the current over a period that its sum leaves out
        ("proportional_gain", float),  # 1/A
        ("integral_gain", float),  # 1/(A s)
        ("bias", float),  # A
        ("current_min", float),  # of the references (A)
        ("current_max", float),
        ("period", np.int64),  # of the switching (internal steps)
        ("carrier_shift", np.int64),  # from one coil's carrier to the next one's (internal steps)
        ("dead_time", float),  # internal steps
        ("unipolar", np.bool_),
        ("plain_carriers", np.bool_),  # all alike, without dead time, with limits
    ],
    align=True,
)

ROTOR = np.dtype(
    [
        ("mass", float),  # of the point mass (kg)
        ("gravity", float),  # m/s^2
        ("free_x", float),  # 1, or 0 where the rotor cannot move along x
        ("speed", float),  # angular (rad/s)
        ("unbalance", float),  # kg m
        ("external_force", float, (2,)),  # amplitudes (N)
        ("external_frequency", float),  # angular (rad/s)
        ("disturbed", np.bool_),  # by unbalance or external force
        ("backup_radius", float),  # displacement at which the journal touches the backup bearing (m)
        ("contact", np.bool_),  # a contact is simulated; otherwise it ends the run
        ("contact_stiffness", float),  # N/m
        ("contact_damping", float),  # N s/m
        ("friction", float),
        ("journal_radius", float),  # m
    ],
    align=True,
)

MATERIAL = np.dtype(
    [
        ("saturation", float),  # M_s (A/m)
        ("susceptibility", float),  # M_s / a
        ("argument_per_b", float),  # 1 / (mu0 a) (1/T)
        ("argument_per_m", float),  # (1 - alpha) / a (m/A)
        ("uncoupled", float),  # 1 - alpha
        ("pinning", float),  # 1 / k (m/A)
        ("reversibility", float),  # c
        ("damping", float),  # of the pull of M towards M_an (1/T)
    ]
)

CURVE = np.dtype(
    [
        ("scale", float),  # intervals per tesla
        # Of the field in each interval and on the straight line beyond (A/m), lowest power first, in the place within
        # the interval (0 to 1)
        ("coefficients", float, (CURVE_INTERVALS + 1, 4)),
    ]
)

PATHS = np.dtype(
    [
        ("area", float, (3,)),  # of a pole, a segment of the back iron, a segment of the journal (m^2)
        ("length", float, (3,)),  # m
        ("to_segments", float, (POLES, POLES)),  # from pole fluxes to the fluxes of the segments, by columns
        ("to_poles", float, (POLES, POLES)),  # its transpose
        # Rate of the flux density that circulates in a ring per mean field along it, 12 / (sigma d^2) (ohm/m)
        ("circulation", float),
        ("stiff_slope", float),  # dM/dB below which iron is stiff (A/(m T))
        ("stiff_density", float),  # flux density above which it may become so within a step (T)
    ]
)

JOURNAL = np.dtype(
    [
        ("reluctance", float, (POLES, POLES)),  # of a solid journal, by columns (A/Wb)
        ("terms", np.int64),
        ("keep", float, (MOST_TERMS,)),  # a_n
        ("gain", float, (MOST_TERMS,)),  # b_n
        ("weight", float),  # sum of the weights of the terms
    ]
)

PART = np.dtype(
    [
        ("reluctance", float, (POLES, POLES)),  # of iron into which flux diffuses, by columns (A/Wb)
        ("coefficient", float),  # k (s)
        ("terms", np.int64),
        ("keep", float, (MOST_TERMS,)),  # exp(-p_n h)
        ("gain", float, (MOST_TERMS,)),  # c_n alpha_n^2 h (s)
    ]
)

BALANCE = np.dtype(
    [
        ("size", np.int64),  # number n of directions
        ("inductance", float),  # of a coil, rotor centred (H)
        # Directions Q in which fluxes settle, one a column; what they make of the flux densities of the iron's elements
        # (1/m^2); reluctance of the linear iron in them
        ("directions", float, (FLUXES, FLUXES)),
        ("densities", float, (ELEMENTS, FLUXES)),
        ("reluctance", float, (FLUXES, FLUXES)),
    ]
)

CONSTANTS = np.dtype(
    [
        ("step", float),  # internal step h (s)
        ("extended", np.bool_),  # any effect beyond the paper's table is on
        ("iron", np.int64),  # LINEAR, CURVE_OF_IRON or HYSTERESIS_OF_IRON
        ("linear_iron", np.bool_),  # the reluctance matrix is not zero
        ("solid_journal", np.bool_),
        ("quasistatic", np.bool_),  # no eddy currents
        ("diffusion", np.bool_),  # into laminations; the network's solution is that of means over a step
        ("sensor_share", float),  # of the distance to the position that the sensors' low-pass covers in a step
        ("gap", float),  # rotor centred (m)
        ("gap_reluctance", float),  # of one metre of gap (A/(Wb m))
        ("pull", float),  # force per square of the flux, 1 / (2 mu0 A) (N/Wb^2)
        ("cosine", float, (POLES,)),  # directions of the poles
        ("sine", float, (POLES,)),
        ("reluctance", float, (POLES, POLES)),  # of the linear iron, by columns (A/Wb)
        # The network's solution, by columns
        ("rate_by_drop", float, (POLES, POLES)),  # of the flux (Wb/(A s))
        ("current_by_drop", float, (POLES, COILS)),
        ("rate_by_voltage", float, (COILS, POLES)),  # of the flux (Wb/(V s))
        ("current_by_voltage", float, (COILS, COILS)),  # A/V
        ("amplifier", AMPLIFIER),
        ("rotor", ROTOR),
        ("paths", PATHS),
        ("journal", JOURNAL),  # beside thin laminations
        ("laminations", PART),
        ("solid", PART),  # journal, beside laminations with diffusion
        ("balance", BALANCE),
        ("material", MATERIAL),
        ("curve", CURVE),
    ],
    align=True,
)

STATE = np.dtype(
    [
        ("started", np.bool_),  # after the first internal step
        ("steps", np.int64),  # internal steps since the reset
        ("phase", np.int64),  # internal step within the switching period
        ("sensed", float, (2 * MOST_BEARINGS,)),  # positions behind the sensors' low-pass, x, y of each bearing (m)
        ("external_force", float, (2,)),  # at bearing A (N)
        ("unbalance_force", float, (2,)),  # N
        ("force", float, (2 * MOST_BEARINGS + 2,)),  # on the journals, then of the unbalance (N)
    ],
    align=True,
)

IRON = np.dtype(
    [
        ("target", float, (ELEMENTS,)),  # flux density to go to (T), written by the caller
        ("flux_density", float, (ELEMENTS,)),  # T
        ("magnetisation", float, (ELEMENTS,)),  # A/m
        ("slope", float, (ELEMENTS,)),  # dM/dB of the last step (A/(m T))
        ("field", float, (ELEMENTS,)),  # A/m
        ("work", float, (ELEMENTS,)),  # integral of H dB since the start (J/m^3), trapezoidal
        # Scratch of the hysteresis
        ("midpoint", float, (ELEMENTS,)),
        ("argument", float, (ELEMENTS,)),
        ("numerator", float, (ELEMENTS,)),
        ("denominator", float, (ELEMENTS,)),
    ]
)

RING_FLUX = np.dtype(
    [
        ("flux", float, (RINGS,)),  # that circulates in back iron and journal (Wb)
        ("rate", float, (RINGS,)),  # over this step (Wb/s)
        ("drive", float, (RINGS,)),  # rate at the start of this step (Wb/s)
        ("loss", float),  # of its eddy currents since the reset (J)
    ]
)

DIFFUSION = np.dtype(
    [
        ("memory", float, (MOST_TERMS, POLES)),  # m_n (Wb)
        ("flux", float, (POLES,)),  # at the previous step (Wb)
        ("drop", float, (POLES,)),  # then (A)
        ("energy", float),  # taken up since the reset (J)
    ]
)

MEMORY = np.dtype(
    [
        ("mean", float, (MOST_TERMS, POLES)),  # alpha_n m_n (Wb)
        ("total", float, (POLES,)),  # their sum at the start of this step (Wb)
    ]
)

BEARING = np.dtype(
    [
        ("flux", float, (POLES,)),  # of the poles, positive from stator to journal (Wb)
        ("previous_drop", float, (POLES,)),  # along each pole at the start of the previous step (A)
        ("drop", float, (POLES,)),  # at the start of this step (A)
        ("middle_drop", float, (POLES,)),  # extrapolated to the middle of this step (A)
        ("rate", float, (POLES,)),  # of the fluxes over this step (Wb/s)
        ("current", float, (COILS,)),  # A
        ("voltage", float, (COILS,)),  # mean over this step (V)
        ("applied_voltage", float, (COILS,)),  # before the diodes (V)
        ("reference", float, (COILS,)),  # of the coil currents (A)
        ("integral", float, (COILS,)),  # parts of the PI controllers (duty)
        ("current_sum", float, (COILS,)),  # over the switching period (A)
        ("current_start", float, (COILS,)),  # without the voltages' direct part, at the start of the period (A)
        ("duty", float, (COILS,)),
        ("position", float, (2,)),  # of the journal (m)
        ("velocity", float, (2,)),  # m/s
        ("acceleration", float, (2,)),  # of the point mass at the previous step (m/s^2)
        ("pull", float, (2,)),  # magnetic force (N)
        ("contact_force", float, (2,)),  # of the backup bearing (N)
        ("iron", IRON),
        ("ring", RING_FLUX),
        ("diffusion", DIFFUSION),
        ("laminations", MEMORY),
        ("solid", MEMORY),
        ("unbalanced", float, (POLES,)),  # drops that nonlinear iron adds by the rates of this step (A)
        ("displaced", float, (POLES,)),  # reluctance of the gaps beyond those of the centred rotor (A/Wb)
        # Scratch
        ("segment", float, (POLES,)),
        ("predicted_field", float, (ELEMENTS,)),
        ("previous_rate", float, (FLUXES,)),
        ("stiffness", float, (FLUXES, FLUXES)),
        ("system", float, (FLUXES, FLUXES)),
        ("unknown", float, (FLUXES,)),
    ],
    align=True,
)
