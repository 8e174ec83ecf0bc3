"""Parameters of the node `simulator`; no ROS needed to read a parameter file with them."""

from __future__ import annotations

from amb_core.parameters import quantity, switch
from amb_core.plant import PlantParameters


class SimulatorParameters(PlantParameters):
    """Parameters of the node: those of the plant, and of its interface to the graph."""

    autostart: bool = switch(False, "run from the start instead of waiting, paused, for a run request")
    clock_period: float = quantity(0.01, "s", "simulation time between messages on /clock", 1e-4, 10.0)
    answer_timeout: float = quantity(
        0.25, "s", "wall-clock time after which the answer of the controller counts as overdue", 0.05, 10.0
    )
    plant_state_steps: int = quantity(
        0, "-", "controller steps between messages on plant_state; 0 for none", 0, 1_000_000
    )
