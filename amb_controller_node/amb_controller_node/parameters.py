"""Parameters of the nodes `pd_controller` and `excitation_generator`; no ROS needed to read a file with them."""

from __future__ import annotations

from amb_core.ground.parameters import Parameters, choice, quantity
from amb_core.loop.allowed_changes import AllowedChanges
from amb_core.loop.known_controller import ControllerFileParameters
from amb_core.loop.pd_parameters import ControllerParameters


class CommonParameters(Parameters):
    """Parameters of every controller node."""

    allowed: AllowedChanges = AllowedChanges()
    telemetry_block: int = quantity(100, "-", "steps in a block of telemetry", 1, 10_000)
    signals_rate: float = quantity(
        100.0, "Hz", "messages on signals/<axis> per second of loop time, for plots; 0: none", 0.0, 1000.0
    )


class PdControllerParameters(CommonParameters, ControllerParameters):
    """Parameters of `pd_controller`: those of the control law, and the size of its telemetry blocks."""


class StateSpaceControllerParameters(CommonParameters, ControllerFileParameters):
    """Parameters of `state_space_controller`: those of its law, and the size of its telemetry blocks."""


class GeneratorParameters(Parameters):
    """Parameters of the node."""

    answer_timeout: float = quantity(10.0, "s", "longest wall-clock wait for the controller's answer", 0.1, 60.0)
    simulator: str = choice("simulator", "node whose parameters describe the plant of a preview, relative or full name")
    controller: str = choice(
        "pd_controller", "node whose parameters describe the controller of a preview, relative or full name"
    )
    parameter_timeout: float = quantity(1.0, "s", "longest wait for the parameters of either", 0.05, 10.0)
