"""Services that set parameters and answer every request: a wrong value is refused with a message of one line.

Those of rclpy do not convert (an integer for a float is refused), do not report the allowed values if the type is
wrong, and end the node if a value has a type that does not exist.
"""

from __future__ import annotations

import reprlib
from array import array
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter

from amb_core.ground.errors import AmbError, ParameterError, one_line
from amb_core.ground.parameters import Declaration
from amb_core.recording.messages.parameters import parameters_from_messages
from amb_ros.rclpy_inside import replace_handling


def guard_parameter_services(node: Node, declared: Iterable[Declaration]) -> None:
    """Let the parameter services of a node accept the same values as at start-up, and refuse all others.

    Parameters
    ----------
    node : Node
        The node, with the parameter services of rclpy.
    declared : iterable of Declaration
        Its parameters.
    """
    by_name = {item.name: item for item in declared}

    def set_together(messages: Sequence[ParameterMessage]) -> SetParametersResult:
        try:
            return node.set_parameters_atomically([_parameter(node, message, by_name) for message in messages])
        except AmbError as problem:  # also of a node that cannot do what a change asks
            reason = f"{node.get_fully_qualified_name()}: {one_line(problem)}"
            return SetParametersResult(successful=False, reason=reason)

    def set_each(request: SetParameters.Request, response: SetParameters.Response) -> SetParameters.Response:
        response.results = [set_together([message]) for message in request.parameters]
        return response

    def set_all(
        request: SetParametersAtomically.Request, response: SetParametersAtomically.Response
    ) -> SetParametersAtomically.Response:
        response.result = set_together(request.parameters)
        return response

    callbacks: dict[Any, Any] = {SetParameters: set_each, SetParametersAtomically: set_all}
    for service in node.services:
        if service.srv_type in callbacks:
            replace_handling(service, callbacks[service.srv_type])


def _parameter(node: Node, message: ParameterMessage, declared: Mapping[str, Declaration]) -> Parameter:
    """The parameter of a message, of the type that was declared.

    Raises
    ------
    ParameterError
        If the node has no such parameter, or the value is of another type.
    """
    if not node.has_parameter(message.name):
        raise ParameterError(f"unknown parameter '{message.name}'; known: {', '.join(declared)}")
    value = parameters_from_messages([message])[message.name]
    if message.name not in declared or node.describe_parameter(message.name).read_only:
        if value is None:
            raise ParameterError(f"parameter '{message.name}' is given without a value")
        return Parameter.from_parameter_msg(message)  # rclpy has the message
    declaration = declared[message.name]
    require_type(declaration, value)
    if isinstance(value, list):
        return Parameter(message.name, Parameter.Type.DOUBLE_ARRAY, array("d", value))
    return Parameter(message.name, value=declaration.type(value))


def require_type(declaration: Declaration, value: object) -> None:
    """Raise ParameterError if a value is of another type than declared; a whole number may stand for any number."""
    wanted = declaration.type
    if wanted is tuple and isinstance(value, list | array):
        fits = all(type(item) in (int, float) for item in value)
    else:
        fits = type(value) is wanted or (wanted is float and type(value) is int)
    if not fits:
        value = value.tolist() if isinstance(value, array) else value
        allowed = f"whole numbers, {declaration.allowed}" if wanted is int else declaration.allowed
        raise ParameterError(
            f"parameter '{declaration.name}' = {reprlib.repr(value)} is not allowed; allowed: {allowed}"
        )
