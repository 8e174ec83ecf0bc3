"""Node `pd_controller`: the decoupled PD controller, the paper's with its default parameters."""

from __future__ import annotations

from amb_controller_node.controller_node import ControllerNode
from amb_controller_node.parameters import PdControllerParameters
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.machine import Machine
from amb_ros.process import run_node


class PdControllerNode(ControllerNode):
    """The controller. Topics and parameters: see the package's README."""

    def __init__(self) -> None:
        PdController(ControllerParameters()).update((0.0, 0.0), (0.0, 0.0))  # compile before the first position
        super().__init__("pd_controller", PdControllerParameters)

    def law_for(self, machine: Machine, parameters: PdControllerParameters) -> PdController:
        """The PD law of all axes at the machine's sample rate."""
        return PdController(parameters.at_rate(machine.sample_rate), len(machine.axes))

    def configure(self, law: PdController, parameters: PdControllerParameters) -> None:
        """Use changed gains, limit or nominal reference."""
        law.configure(parameters.at_rate(law.sample_rate))


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT, SIGTERM or SIGHUP."""
    return run_node(PdControllerNode, args)


if __name__ == "__main__":
    raise SystemExit(main())
