"""ROS parameter files without ROS: the nodes that a file addresses, and the parameters of each, as the nodes read them.

Mistakes that ROS ignores silently are errors here: a key that is not a node, a key without the namespace, a key
or a parameter given twice. The meaning of keys and wildcards is that of rcl_yaml_param_parser and rclpy in Jazzy.
"""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import yaml

from amb_core.ground.errors import ParameterError
from amb_core.ground.files.regular_files import read_text, shown

NAMESPACE = "/amb"
NODES = ("simulator", "pd_controller", "excitation_generator", "recorder", "region_monitor", "identifier")
"""The nodes of the graph, relative to their namespace."""
CONTROLLERS = ("pd_controller", "state_space_controller")
"""Nodes of which one controls the machine; by default the first."""
BRIDGE_NODE = "hardware_bridge"
RIG_NODES = (BRIDGE_NODE, *NODES[2:])
"""The nodes of the graph of a rig: the bridge takes the place of simulator and controller."""
KNOWN_NODES = (*NODES, *(name for name in CONTROLLERS if name not in NODES), BRIDGE_NODE, "target_emulator")
"""Nodes that a parameter file may address."""


def nodes_with(controller: str) -> tuple[str, ...]:
    """The nodes of a graph with one of `CONTROLLERS`.

    Raises
    ------
    ParameterError
        If it is none of them.
    """
    if controller not in CONTROLLERS:
        raise ParameterError(f"controller {controller!r} is not allowed; allowed: {', '.join(CONTROLLERS)}")
    return tuple(controller if name == CONTROLLERS[0] else name for name in NODES)


def known_in(namespace: str) -> tuple[str, ...]:
    """Full names of the nodes that a file may address for a graph in this namespace: its own, and those of `/amb`."""
    return tuple(dict.fromkeys(f"{place}/{name}" for place in (namespace, NAMESPACE) for name in KNOWN_NODES))


PARAMETERS = "ros__parameters"
EACH_ENTRY = f"each entry must be a node name with a mapping '{PARAMETERS}'"
DEEPEST = 32  # nesting of a file: far more than needed, far less than the limit of Python's stack
_PART = re.compile(r"\*\*?|\w+")


class ParameterFile:
    """A parameter file that has been read; all its keys are nodes.

    Parameters
    ----------
    path : str or Path
        The file.
    nodes : collection of str, optional
        Full names of the nodes that the file may address; those of the graph by default.

    Raises
    ------
    ParameterError
        One line that names the file, if it cannot be read, is not a parameter file, or has a key that matches no node.
    """

    def __init__(self, path: str | Path, nodes: Collection[str] | None = None) -> None:
        self._where = f"parameter file {shown(path)}"
        self._nodes = tuple(nodes) if nodes is not None else tuple(full_name(name) for name in KNOWN_NODES)
        try:
            content = _parse(read_text(path))
            self._sections = dict(_sections(content))
            for key in self._sections:
                self._check_key(key)
        except OSError as problem:
            raise ParameterError(f"{self._where}: cannot be read: {problem.strerror}") from None
        except ParameterError as problem:
            raise ParameterError(f"{self._where}: {problem}") from None

    def values(self, node: str) -> dict[str, Any]:
        """Parameters of a node by dotted name; a later section of the file overrides an earlier one, as in ROS.

        Parameters
        ----------
        node : str
            Full name, or the name in the namespace of the graph.
        """
        name = full_name(node)
        parameters: dict[str, Any] = {}
        for key, values in self._sections.items():
            if _pattern(key).fullmatch(name):
                parameters.update(values)
        return {name: value for name, value in parameters.items() if not of_rclpy(name)}

    def with_values(self, values: Mapping[str, Mapping[str, Any]]) -> str:
        """The text of a parameter file with other values of some parameters.

        Parameters
        ----------
        values : mapping
            By node, full name or the name in the namespace of the graph, then by dotted name.
        """
        sections = dict(self._sections)
        for node, changed in values.items():
            name = full_name(node)
            given = self.values(name)
            kept = {key: value for key, value in sections.pop(name, {}).items() if of_rclpy(key)}
            present = {**kept, **given, **changed}
            # Last, since a later section counts. An empty list has no type in ROS; every list is empty by default.
            sections[name] = {key: value for key, value in present.items() if value not in ([], ())}
        content = {name: {PARAMETERS: parameters} for name, parameters in sections.items()}
        return str(yaml.safe_dump(content, sort_keys=False, allow_unicode=True))

    def error(self, node: str, problem: ParameterError) -> ParameterError:
        """A problem with the parameters of a node, as a line that names file and node."""
        return ParameterError(f"{self._where}, node {node}: {problem}")

    def _check_key(self, key: str) -> None:
        if not all(_PART.fullmatch(part) for part in key.removeprefix("/").split("/")):
            raise ParameterError(f"'{key}' is not a valid node name; * and ** may only replace whole parts of a name")
        pattern = _pattern(key)
        if any(pattern.fullmatch(node) for node in self._nodes):
            return
        by_name = {node.rsplit("/", 1)[-1]: node for node in reversed(self._nodes)}
        last = key.rsplit("/", 1)[-1]
        if last in by_name:
            raise ParameterError(f"'{key}' names no node, ROS would ignore it; the node is '{by_name[last]}'")
        close = difflib.get_close_matches(last, by_name, n=1)
        hint = f"did you mean '{by_name[close[0]]}'?" if close else f"nodes: {', '.join(self._nodes)}"
        raise ParameterError(f"there is no node '{key}', ROS would ignore it; {hint}")


def full_name(node: str) -> str:
    """The full name of a node; one without a slash in front is in the namespace of the graph."""
    return node if node.startswith("/") else f"{NAMESPACE}/{node}"


def of_rclpy(parameter: str) -> bool:
    """Whether rclpy declares a parameter itself, on every node: every section may contain it."""
    return parameter in ("use_sim_time", "start_type_description_service") or parameter.startswith("qos_overrides.")


def _pattern(key: str) -> re.Pattern[str]:
    """What a key matches: /** any number of parts of a name, /* one."""
    parts = {"**": r"(/\w+)*", "*": r"/\w+"}
    return re.compile("".join(parts.get(part, f"/{part}") for part in key.removeprefix("/").split("/")))


def _sections(content: Mapping[str, Any], prefix: str = "") -> list[tuple[str, dict[str, Any]]]:
    """Keys and flat parameters in the order of the file; a namespace may be a mapping around its nodes."""
    sections: list[tuple[str, dict[str, Any]]] = []
    for key, section in content.items():
        name = f"{prefix}{key}"
        if not isinstance(section, Mapping) or not section:
            raise ParameterError(f"{EACH_ENTRY}; '{name}' is not")
        if PARAMETERS not in section:
            sections += _sections(section, f"{name}/")
            continue
        others = [str(other) for other in section if other != PARAMETERS]
        if others:
            raise ParameterError(
                f"'{name}' has '{others[0]}' in addition to '{PARAMETERS}'; no other key is allowed there"
            )
        if not isinstance(section[PARAMETERS], Mapping):
            raise ParameterError(f"{EACH_ENTRY}; '{name}' is not")
        sections.append((name, _flat(name, section[PARAMETERS])))
    for name, number in Counter(name for name, _ in sections).items():
        if number > 1:
            raise ParameterError(f"'{name}' is given twice")
    return sections


def _flat(node: str, values: Mapping[Any, Any], prefix: str = "") -> dict[str, Any]:
    """Nested parameters by dotted name; a parameter given in both ways is an error."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, list):
            _check_list(f"'{node}': the list '{name}'", value)
        entries = _flat(node, value, f"{name}.") if isinstance(value, Mapping) else {name: value}
        for twice in entries.keys() & flat.keys():
            raise ParameterError(f"'{node}': parameter '{twice}' is given twice")
        flat |= entries
    return flat


def _check_list(what: str, values: list[Any]) -> None:
    """Refuse a list at which rcl gives up, and with it every node that is given the file.

    Texts are left to the declaration: rcl reads some as numbers, 1e-6 for one, that YAML 1.1 does not.
    """
    if not values:
        raise ParameterError(f"{what} is empty, which ROS does not read; leave it out")
    kinds = {type(value) for value in values if isinstance(value, bool | int | float)}
    if len(kinds) > 1:
        names = " and ".join(kind.__name__ for kind in (bool, int, float) if kind in kinds)
        advice = "write all with a point, as 0.0" if kinds == {int, float} else "allowed: values of one type"
        raise ParameterError(f"{what} mixes {names}, which ROS does not read; {advice}")


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """A safe loader that rejects a key given twice; YAML would keep the last one silently."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[str] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if key.value in seen:
                    line = key.start_mark.line + 1
                    raise ParameterError(f"cannot be read: '{key.value}' is given twice, again in line {line}")
                seen.add(key.value)
        return super().construct_mapping(node, deep)


def _parse(text: str) -> Mapping[Any, Any]:
    """The mapping in a YAML text."""
    try:
        _check_structure(text)
        content = yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as problem:
        place = f"line {problem.problem_mark.line + 1}: " if problem.problem_mark else ""
        raise ParameterError(f"cannot be read: {place}{problem.problem}") from None
    except (yaml.YAMLError, ValueError) as problem:  # ValueError: for example an invalid date
        raise ParameterError(f"cannot be read: {' '.join(str(problem).split())}") from None
    if content is None:
        raise ParameterError("is empty; it must give parameters to at least one node")
    if not isinstance(content, Mapping):
        raise ParameterError(EACH_ENTRY)
    if not content:
        raise ParameterError("is empty; it must give parameters to at least one node")
    return content


def _check_structure(text: str) -> None:
    """Reject aliases and deep nesting, which could grow without bound, before anything is built."""
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        place = f"line {event.start_mark.line + 1}" if event.start_mark else "it"
        if isinstance(event, yaml.AliasEvent):
            raise ParameterError(f"cannot be read: {place} has an alias (*{event.anchor}), which ROS does not allow")
        if isinstance(event, yaml.MappingStartEvent | yaml.SequenceStartEvent):
            depth += 1
            if depth > DEEPEST:
                raise ParameterError(f"cannot be read: {place} is nested deeper than {DEEPEST} levels")
        elif isinstance(event, yaml.MappingEndEvent | yaml.SequenceEndEvent):
            depth -= 1
