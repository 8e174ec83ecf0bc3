"""Where what lies in the flat arrays of the integrator."""

from __future__ import annotations

# State vector: what concerns all bearings, then a block per bearing, then coordinates, rates and previous
# accelerations of the rotor's modes if it has any.
PHASE = 0  # internal step within the switching period (-)
STARTED = 1  # 0 before the first internal step
STEPS = 2  # internal steps since the reset (-)
POSITION = 3  # of the journals: x, y in bearing A, x, y in bearing B (m)
VELOCITY = 7  # (m/s)
ACCELERATION = 11  # of the point mass at the previous internal step, x, y (m/s^2)
SENSED = 13  # position behind the sensors' low-pass, as POSITION (m)
HEAD_SIZE = 24  # a multiple of 8, as the other sizes: fluxes and currents stand on cache lines

# Block of a bearing
FLUX = 0  # pole fluxes (Wb)
MMF = 8  # magnetomotive force drops along the poles at the previous internal step (A)
INTEGRAL = 16  # integral parts of the amplifiers' PI (duty)
CURRENT_SUM = 20  # sums of the coil currents over the switching period (A)
DUTY = 24  # duty cycles (-)
CURRENT_START = 28  # coil currents without the voltages' direct part at the start of the switching period (A)
BLOCK_SIZE = 32

# Constants vector
STEP, GAP, GAP_RELUCTANCE, FORCE, RADIUS = range(5)
SUPPLY, DUTY_MIN, DUTY_MAX, KP, KI, BIAS, CURRENT_MIN, CURRENT_MAX = range(5, 13)
PERIOD, CARRIER_SHIFT, DEAD_TIME, UNIPOLAR = range(13, 17)
MASS, GRAVITY, FREE_X = range(17, 20)
NONLINEAR_IRON, SOLID_JOURNAL, DISTURBED, CONTACT, SENSOR_LAG = range(20, 25)  # switches, and a share per step
FORCE_X, FORCE_Y, FORCE_FREQUENCY, UNBALANCE, SPEED = range(25, 30)  # angular frequency and speed (rad/s)
CONTACT_STIFFNESS, CONTACT_DAMPING, FRICTION, JOURNAL_RADIUS = range(30, 34)
PLAIN_CARRIERS, QUASISTATIC = range(34, 36)  # switches
INDUCTANCE = 36  # of a coil, rotor centred (H)
STIFF_SLOPE = 37  # dM/dB below which iron is stiff (A/(m T))
DIFFUSING_WEIGHT = 38  # sum of the weights of a solid journal's terms (-)
LINEAR_IRON = 39  # switch: the reluctance matrix is not zero
EXTENDED = 40  # switch: whether any effect beyond the paper's table is on
CONSTANTS_SIZE = 41

# Rows of the matrices array, shape (22, 12)
RELUCTANCE = 0  # columns of the reluctance matrix of linear iron (8)
SOLUTION = 8  # columns of the network's solution (12): each maps one of (h, V) to (dphi/dt, i)
COSINE, SINE = 20, 21  # directions of the poles
MATRICES_SIZE = 22

# Work array: a block per bearing. Starts with the drops h (8).
EXTRAPOLATED = 8  # drops extrapolated to the middle of the step
RATES = 16  # flux rates (8), directly before the coil currents: the network's solution gives both
CURRENT = 24
VOLTAGE = 28
REFERENCE = 32
APPLIED = 36  # voltages before the diodes
PULL = 40  # magnetic force x, y
CONTACT_FORCE = 42  # x, y
WORK_SIZE = 48

# Columns of a trace row, one row per internal step. A block per bearing: flux, flux rate, current, voltage, position,
# velocity, magnetic force, contact force; after these, energy taken up by nonlinear iron and by the diffusion in the
# solid journals, then coordinates and rates of the rotor's modes.
TRACE_FLUX, TRACE_RATE, TRACE_CURRENT, TRACE_VOLTAGE = 0, 8, 16, 20
TRACE_POSITION, TRACE_VELOCITY, TRACE_FORCE, TRACE_CONTACT = 24, 26, 28, 30
TRACE_BLOCK_SIZE = 32
TRACE_IRON_ENERGY, TRACE_DIFFUSION_ENERGY = 0, 1
TRACE_TAIL_SIZE = 2

# Rows of the array of the rotor's modes, n columns, for n coordinates
MODE_INPUTS = 0  # acceleration per force in bearing A x, y and B x, y (4)
MODE_UNBALANCE = 4  # acceleration per force of the unbalance x, y (2)
MODE_WEIGHT = 6  # acceleration by gravity
MODE_POSITIONS = 7  # displacement of the journals, as POSITION (4)
MODE_SENSORS = 11  # displacement at the sensors (4)
MODE_STIFFNESS = 15  # columns of the acceleration per coordinate (n), then those per rate (n)

# Status
OK, DELEVITATED, NOT_FINITE, GAP_CLOSED = range(4)
