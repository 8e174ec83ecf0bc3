"""Where requests of the identifier find their data and controllers: bags, files, the telemetry, running nodes."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any, TypeVar

from rclpy.node import Node

from amb_core.data.analysis import RecordedLoop, read
from amb_core.data.analysis.recorded_clearance import MONITOR_NODE, known_clearance
from amb_core.data.controller_choice import (
    ALLOWED,
    NO_CONTROLLER,
    is_named_set,
    named_controller,
    needs_controller,
    with_shown_limit,
)
from amb_core.data.experiments import DataDescription, IdentificationData
from amb_core.ground.errors import AmbError, BagError, IdentificationError, ParameterError, one_line
from amb_core.ground.files.parameter_files import BRIDGE_NODE, CONTROLLERS
from amb_core.ground.parameters import Parameters, part_of
from amb_core.loop.experiments import controller_of_bridge, linear_controller_of
from amb_core.loop.known_controller import KnownController
from amb_core.loop.pd_parameters import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.recording.messages.parameters import ParameterValue
from amb_core.recording.messages.state_space_model import model_from_message
from amb_ident_node.listening import LiveExperiment
from amb_msgs import msg
from amb_ros import topics
from amb_ros.machine import MachineInput
from amb_ros.qos import LATCHED
from amb_ros.remote_parameters import RemoteParameters
from amb_ros.subscriptions import create_subscription

NAME_A_CONTROLLER = (
    f"name it in `controller`: {ALLOWED}, a running node, or {NO_CONTROLLER} to leave the closed loop out"
)

P = TypeVar("P", bound=Parameters)


class LoopSources:
    """Data and controllers for requests.

    Parameters
    ----------
    node : Node
        The identifier.
    live : LiveExperiment
        What it has heard of the current run.
    controller, simulator : str
        Nodes whose parameters describe controller and plant.
    timeout : float
        Longest wait for the parameters of either (s).
    """

    def __init__(self, node: Node, live: LiveExperiment, controller: str, simulator: str, timeout: float) -> None:
        self._live = live
        self._controller, self._simulator, self._timeout = controller, simulator, timeout
        self._log = node.get_logger()
        self._remote_parameters = RemoteParameters(node)
        self._machine_input = MachineInput(node)
        self._published: msg.StateSpaceModel | None = None  # the last linear controller
        self._subscription = create_subscription(
            node, msg.StateSpaceModel, topics.CONTROLLER, self._on_controller, LATCHED
        )

    def check(self, request: Any) -> None:
        """Refuse impossible steps, a bag that does not exist, an invalid description, and an invalid controller."""
        if request.first_step < -1:
            raise IdentificationError(f"first_step = {request.first_step} is not allowed; allowed: -1 or more")
        if request.bag and not os.path.exists(request.bag):  # noqa: PTH110  # Path.exists raises on long names
            raise BagError(f"bag {request.bag}: there is no such file or folder")
        known = DataDescription.given(request.description)
        if request.description and not request.bag:
            raise IdentificationError("description is for a bag or data file; name one in `bag`, or leave it empty")
        if is_named_set(name := request.controller or known.controller):
            self.named_controller(name, None)

    def loop(self, request: Any, with_plant: bool = False) -> tuple[RecordedLoop, str]:
        """The requested data, from a bag or from the current run, and a remark on them.

        Raises
        ------
        BagError, IdentificationError
            If there are no such data, or their controller is not known.
        ParameterError
            If the parameters of the requested controller are not available.
        """
        known = DataDescription.given(request.description)
        name = request.controller or known.controller
        if request.bag:
            of_file = name if is_named_set(name) or name == NO_CONTROLLER else ""
            known = known.model_copy(update={"controller": of_file})
            loop = read(request.bag, known, first_step=request.first_step, steps=request.steps)
        else:
            data = self._live.data(request.first_step, request.steps)
            # As a file whose controller is `none`: without a controller of their own they would get the paper's.
            data = replace(data, clearance=self._clearance(data.output_names), foreign=name == NO_CONTROLLER)
            running = None if name else self._running_controller(data.sample_rate)
            loop = RecordedLoop(data, running, self._read(PlantParameters, self._simulator) if with_plant else None)
        remark = f"; bag is truncated: {loop.damage}" if loop.damage else ""
        if name:
            if name != NO_CONTROLLER and not (request.bag and is_named_set(name)):
                loop = replace(loop, controller=self.named_controller(name, loop.data))
            remark += f"; controller: {name}, as requested"
        elif loop.controller is None and needs_controller(loop.data):
            source = f"bag {request.bag} lacks" if request.bag else f"node {self._controller} does not give"
            raise IdentificationError(f"{source} the parameters of the controller; {NAME_A_CONTROLLER}")
        return loop, remark

    def named_controller(self, name: str, data: IdentificationData | None) -> KnownController:
        """The controller named in a request, with the sample rate of its data and the limit that they show."""
        sample_rate = None if data is None else data.sample_rate
        if is_named_set(name):
            named = named_controller(name, self._controller.rsplit("/", 1)[-1], sample_rate)
            return named if data is None else with_shown_limit(named, data)
        controller = self._controller_of(name)
        return controller if sample_rate is None else controller.at_rate(sample_rate)

    def _clearance(self, axes: tuple[str, ...]) -> dict[str, float]:
        """The clearances (m) of the running machine by axis, as `recorded_clearance` finds them in a bag of its run."""
        running = {name.rsplit("/", 1)[-1] for name in self._remote_parameters.nodes()}
        machine, simulator = self._machine_input.machine, self._simulator.rsplit("/", 1)[-1]
        needed = machine is None or machine.axis_names != axes  # as in version 0.1
        simulated = self._values(self._simulator) if needed and simulator in running else None
        monitored = self._values(MONITOR_NODE) if MONITOR_NODE in running else None
        return known_clearance(axes, machine, simulated, monitored)

    def _running_controller(self, sample_rate: float) -> KnownController | None:
        """The controller of the running loop; None if there is none that reports its parameters.

        That of the node in the parameter `controller` or, if it does not run, that of another node that closes a loop.
        """
        names = [self._controller]
        running = {name.rsplit("/", 1)[-1] for name in self._remote_parameters.nodes()}
        others = [name for name in (*CONTROLLERS, BRIDGE_NODE) if name in running]
        if names[0] in CONTROLLERS and names[0] not in running and others:
            names = others[:1]
        try:
            return self._controller_of(names[0]).at_rate(sample_rate)
        except AmbError as problem:
            self._log.warning(one_line(problem))
            return None

    def _controller_of(self, node: str) -> KnownController:
        """The controller of a running node: the PD law, or the linear one that it has taken.

        Raises
        ------
        AmbError
            If the node does not report its parameters, or has no controller.
        """
        values = self._remote_parameters.read_all(node, self._timeout)
        if "controller_file" not in values:
            return part_of(ControllerParameters, values)
        if node.rsplit("/", 1)[-1] == BRIDGE_NODE:
            return controller_of_bridge(values, None)
        published = None if self._published is None else model_from_message(self._published)
        controller = linear_controller_of(values, published)
        if controller is None:
            raise ParameterError(f"node {node} has no controller yet")
        return controller

    def _on_controller(self, message: msg.StateSpaceModel) -> None:
        self._published = message

    def _values(self, node: str) -> dict[str, ParameterValue] | None:
        """All parameters of a running node; None if it does not report them."""
        try:
            return self._remote_parameters.read_all(node, self._timeout)
        except ParameterError as problem:
            self._log.warning(one_line(problem))
            return None

    def _read(self, parameters: type[P], node: str) -> P | None:
        """Parameters of a running node; None if it does not report them."""
        try:
            return self._remote_parameters.read_set(parameters, node, self._timeout)
        except ParameterError as problem:
            self._log.warning(one_line(problem))
            return None
