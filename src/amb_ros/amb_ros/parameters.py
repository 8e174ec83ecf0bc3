"""ROS parameters from the one declaration in amb_core: descriptors, ranges, and one clear line for a wrong value."""

from __future__ import annotations

import difflib
import reprlib
from array import array
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar, cast

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from amb_core.ground.errors import ParameterError, one_line
from amb_core.ground.files.parameter_files import of_rclpy
from amb_core.ground.parameters import (
    Declaration,
    Parameters,
    flatten,
    own_declarations,
    refuse_those_of_machine,
    validate,
)
from amb_ros.parameter_services import guard_parameter_services, require_type
from amb_ros.rclpy_inside import set_read_only, writable

P = TypeVar("P", bound=Parameters)


def declare(
    node: Node,
    parameters: type[P],
    on_change: Callable[[P], None] | None = None,
    check: Callable[[P], None] | None = None,
) -> P:
    """Declare all parameters of a set on a node and return the set with the values the node was started with.

    The node must be made with `automatically_declare_parameters_from_overrides=True`. Otherwise an unknown name in a
    parameter file or on the command line would go unnoticed.

    Parameters
    ----------
    node : Node
        The node.
    parameters : type[Parameters]
        The set; those not marked `runtime` become read-only.
    on_change : callable, optional
        Called with the new set after a runtime parameter was changed; without it every parameter is read-only.
    check : callable, optional
        Called with a set before it is used, at the start and after a change; raises ParameterError to refuse it.

    Raises
    ------
    ParameterError
        One line naming the node, the parameter, its value and what is allowed.
    """
    # rclpy's annotation names values, what it returns are parameters.
    known = cast(Mapping[str, Parameter], node.get_parameters_by_prefix(""))
    given = {name: parameter.value for name, parameter in known.items() if not of_rclpy(name)}
    try:
        _require_declared(parameters, given)
        values = _checked(parameters, given, check)
    except ParameterError as problem:
        raise ParameterError(f"{node.get_fully_qualified_name()}: {problem}") from None
    for name in given:
        node.undeclare_parameter(name)
    every = flatten(values.model_dump())
    current = {declaration.name: every[declaration.name] for declaration in own_declarations(parameters)}
    for declaration in own_declarations(parameters):
        writable = declaration.runtime and on_change is not None
        _declare(node, declaration, current[declaration.name], read_only=not writable)
    guard_parameter_services(node, own_declarations(parameters))
    if on_change is not None:
        node.add_on_set_parameters_callback(_guard(node, parameters, current, check))
        node.add_post_set_parameters_callback(_notify(parameters, current, on_change))
    return values


def replace(node: Node, values: Parameters) -> None:
    """Give the parameters that `declare` made the values of another set of the same class, including read-only ones.

    For the node itself, when it loads all its parameters again; from outside they stay read-only. One parameter event
    reports all changes.

    Raises
    ------
    ParameterError
        If rclpy or a callback of the node refuses; then no parameter has changed.
    """
    changes = [
        typed_parameter(name, value)
        for name, value in flatten(values.model_dump()).items()
        if typed_parameter(name, value).value != node.get_parameter(name).value
    ]
    if not changes:
        return
    with writable(node, [change.name for change in changes]):
        result = node.set_parameters_atomically(changes)
    if not result.successful:
        raise ParameterError(f"{node.get_fully_qualified_name()}: {result.reason}")


def _require_declared(parameters: type[P], given: Mapping[str, object]) -> None:
    """Refuse what a node is started with as it is refused at run time: unknown names, and values of another type."""
    refuse_those_of_machine(parameters, given)
    declared = {item.name: item for item in own_declarations(parameters)}
    for name, value in given.items():
        if name not in declared:
            close = difflib.get_close_matches(name, declared, n=1)
            hint = f"did you mean '{close[0]}'?" if close else f"known: {', '.join(declared)}"
            raise ParameterError(f"unknown parameter '{name}' = {reprlib.repr(value)}; {hint}")
        require_type(declared[name], value)


def _checked(parameters: type[P], given: Mapping[str, object], check: Callable[[P], None] | None) -> P:
    values = validate(parameters, given)
    if check is not None:
        check(values)
    return values


def typed_parameter(name: str, value: object) -> Parameter:
    """A parameter of rclpy; from an empty list rclpy would not conclude that it is one of numbers."""
    if isinstance(value, tuple):
        return Parameter(name, Parameter.Type.DOUBLE_ARRAY, array("d", value))
    return Parameter(name, value=value)


def _declare(node: Node, declaration: Declaration, value: object, read_only: bool) -> None:
    if value != ():
        node.declare_parameter(declaration.name, value, _descriptor(declaration, read_only), ignore_override=True)
        return
    # rclpy declares no empty list of numbers, but it can be set to one afterwards.
    node.declare_parameter(declaration.name, [0.0], _descriptor(declaration, read_only=False), ignore_override=True)
    node.set_parameters([typed_parameter(declaration.name, ())])
    set_read_only(node, declaration.name, read_only)


def _descriptor(declaration: Declaration, read_only: bool) -> ParameterDescriptor:
    unit = "" if declaration.unit == "-" else f" [{declaration.unit}]"
    source = f"; default {declaration.source}" if declaration.source else ""
    descriptor = ParameterDescriptor(
        description=declaration.description + unit + source,
        additional_constraints=declaration.allowed if declaration.choices else "",
        read_only=read_only,
    )
    if declaration.type is tuple:  # ROS has ranges for single numbers only
        descriptor.additional_constraints = declaration.allowed
    elif declaration.minimum is not None and declaration.maximum is not None:
        if declaration.type is int:
            descriptor.integer_range = [
                IntegerRange(from_value=int(declaration.minimum), to_value=int(declaration.maximum), step=1)
            ]
        else:
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(declaration.minimum), to_value=float(declaration.maximum))
            ]
    return descriptor


def _changed(current: dict[str, object], changes: Sequence[Parameter]) -> dict[str, object]:
    values = {change.name: change.value for change in changes if change.name in current}
    return current | {name: list(value) if isinstance(value, array) else value for name, value in values.items()}


def _guard(
    node: Node, parameters: type[P], current: dict[str, object], check: Callable[[P], None] | None
) -> Callable[[list[Parameter]], SetParametersResult]:
    def answer(changes: list[Parameter]) -> SetParametersResult:
        try:
            _checked(parameters, _changed(current, changes), check)
        except ParameterError as problem:
            return SetParametersResult(
                successful=False, reason=f"{node.get_fully_qualified_name()}: {one_line(problem)}"
            )
        return SetParametersResult(successful=True)

    return answer


def _notify(
    parameters: type[P], current: dict[str, object], on_change: Callable[[P], None]
) -> Callable[[list[Parameter]], None]:
    def take(changes: list[Parameter]) -> None:
        current.update(_changed(current, changes))
        on_change(validate(parameters, current))

    return take
