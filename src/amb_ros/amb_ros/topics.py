"""Names of the workbench's topics, relative to the namespace of the nodes (/amb unless remapped)."""

MACHINE = "machine"
CONTROLLER = "controller"
POSITION = "position"
CURRENT_REFERENCE = "current_reference"
EXCITATION = "excitation"
EXCITATION_STATUS = "excitation_status"
TELEMETRY = "telemetry"
SIGNALS = "signals/<axis>"
MODEL = "model"
REGION = "region"
REGION_MAP = "region_map"
PLANT_STATE = "plant_state"
SIMULATOR_STATE = "simulator/state"
BRIDGE_STATE = "hardware_bridge/state"
TRIP = "trip"
CLOCK = "clock"

NAMESPACE = "amb"


def signals(axis: str) -> str:
    """Topic with samples of an axis for plots."""
    return SIGNALS.replace("<axis>", axis)


def clock(namespace: str) -> str:
    """Topic of the simulation time: `/clock`, which nodes with use_sim_time read, in the workbench's own namespace.

    In any other namespace it is the graph's own, so that the clocks of two graphs do not mix.
    """
    return f"/{CLOCK}" if namespace == f"/{NAMESPACE}" else CLOCK
