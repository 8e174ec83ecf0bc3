"""Reads declarative launch files (`*.launch.yaml`) where the `launch` packages of ROS 2 are not installed.

The subset is what this workbench uses, with the meaning that `ros2 launch` gives it: `arg` (name, default, description)
and `node` (pkg, exec, name, namespace, output, args, param, remap, env, if) with the substitutions `$(var NAME)`,
`$(find-pkg-share PACKAGE)` and `$(env NAME [DEFAULT])`. Anything else is refused by name, never skipped.

Source: design article "ROS 2 Launch Static Descriptions", and the parsers of launch_yaml and launch_ros in Jazzy.
"""

from __future__ import annotations

import json
import os
import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from amb_bringup.graph.packages import LaunchError, find_executable, share_folder
from amb_core.ground.files.regular_files import read_text, shown

NODE_KEYS = ("pkg", "exec", "name", "namespace", "output", "args", "param", "remap", "env", "if")
ARGUMENT_KEYS = ("name", "default", "description")
SUBSTITUTION = re.compile(r"\$\(([^()$]*)\)")


@dataclass(frozen=True)
class NodeProcess:
    """One process to start.

    Attributes
    ----------
    name : str
        Unique label: the name of the node, or of the executable if the launch file does not name the node.
    command : tuple of str
        Executable and arguments.
    env : dict
        Variables in addition to the environment.
    """

    name: str
    command: tuple[str, ...]
    env: dict[str, str] = field(default_factory=dict)


def read_launch_file(path: str | Path, arguments: Mapping[str, str] | None = None) -> list[NodeProcess]:
    """Processes that a launch file describes, in its order.

    Parameters
    ----------
    path : str or Path
        The `*.launch.yaml` file.
    arguments : mapping, optional
        Values of launch arguments, as `name:=value` does for `ros2 launch`.

    Raises
    ------
    LaunchError
        If the file cannot be read or holds anything outside the subset, if a package, executable or parameter file is
        missing, or if an argument is unknown or lacks a value. The message names the file and the place in it.
    """
    try:
        content = yaml.safe_load(read_text(path))
    except OSError as problem:
        raise LaunchError(f"launch file {shown(path)}: cannot be read: {problem.strerror}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as problem:
        raise LaunchError(f"launch file {path}: cannot be read: {' '.join(str(problem).split())}") from None
    try:
        return _Reader(arguments or {}).read(content)
    except LaunchError as problem:
        raise LaunchError(f"launch file {path}: {problem}") from None


class _Reader:
    def __init__(self, arguments: Mapping[str, str]) -> None:
        self._given = dict(arguments)
        self._values: dict[str, str] = {}

    def read(self, content: Any) -> list[NodeProcess]:
        if not isinstance(content, Mapping) or list(content) != ["launch"] or not isinstance(content["launch"], list):
            raise LaunchError("must be a mapping with the single key 'launch' and a list below it")
        nodes: list[NodeProcess] = []
        for number, entity in enumerate(content["launch"], start=1):
            if not isinstance(entity, Mapping) or len(entity) != 1:
                raise LaunchError(f"entry {number} must be a mapping with one key, 'arg' or 'node'")
            kind, body = next(iter(entity.items()))
            place = f"entry {number} ({kind})"
            if kind not in ("arg", "node"):
                raise LaunchError(f"{place} is not supported here; supported: arg, node")
            _check_keys(place, body, ARGUMENT_KEYS if kind == "arg" else NODE_KEYS)
            if kind == "arg":
                self._declare(place, body)
            elif self._wanted(place, body):
                nodes.append(self._node(place, body))
        unknown = sorted(set(self._given) - set(self._values))
        if unknown:
            known = ", ".join(self._values) or "none"
            raise LaunchError(f"unknown argument '{unknown[0]}'; known: {known}")
        names = [node.name for node in nodes]
        for name in names:
            if names.count(name) > 1:
                raise LaunchError(f"two nodes are named '{name}'")
        return nodes

    def _declare(self, place: str, body: Mapping[str, Any]) -> None:
        name = self._text(place, body, "name")
        if name in self._given:
            self._values[name] = str(self._given[name])
        elif "default" in body:
            self._values[name] = self._text(place, body, "default")
        else:
            raise LaunchError(f"argument '{name}' needs a value")

    def _wanted(self, place: str, body: Mapping[str, Any]) -> bool:
        """Whether the condition of a node holds, if it has one."""
        if "if" not in body:
            return True
        word = self._text(place, body, "if").lower()
        if word not in ("true", "1", "false", "0"):
            raise LaunchError(f"{place}: 'if' = {word!r} must be true or false")
        return word in ("true", "1")

    def _node(self, place: str, body: Mapping[str, Any]) -> NodeProcess:
        package, executable = self._text(place, body, "pkg"), self._text(place, body, "exec")
        place = f"{place[:-1]} {package}/{executable})"
        if body.get("output", "screen") != "screen":
            raise LaunchError(f"{place}: output '{body['output']}' is not supported here; supported: screen")
        command = [str(find_executable(package, executable))]
        if "args" in body:
            command += shlex.split(self._text(place, body, "args"))
        command.append("--ros-args")
        if "name" in body:
            command += ["-r", f"__node:={self._text(place, body, 'name')}"]
        if "namespace" in body:
            command += ["-r", f"__ns:=/{self._text(place, body, 'namespace').lstrip('/')}"]
        for item in _entries(place, body, "param"):
            command += self._parameter(place, item)
        for item in _entries(place, body, "remap"):
            _check_keys(f"{place}: remap", item, ("from", "to"))
            command += ["-r", f"{self._text(place, item, 'from')}:={self._text(place, item, 'to')}"]
        env = {}
        for item in _entries(place, body, "env"):
            _check_keys(f"{place}: env", item, ("name", "value"))
            env[self._text(place, item, "name")] = self._text(place, item, "value")
        name = self._text(place, body, "name") if "name" in body else executable
        return NodeProcess(name, tuple(command), env)

    def _parameter(self, place: str, item: Mapping[str, Any]) -> list[str]:
        _check_keys(f"{place}: param", item, ("from", "name", "value"))
        if set(item) == {"from"}:
            file = self._text(place, item, "from")
            if not Path(file).is_file():
                raise LaunchError(f"{place}: parameter file '{file}' does not exist")
            return ["--params-file", file]
        if set(item) != {"name", "value"}:
            raise LaunchError(f"{place}: a param needs either 'from', or 'name' and 'value'; it has {', '.join(item)}")
        value = item["value"]
        text = self._text(place, item, "value") if isinstance(value, str) else json.dumps(value)
        return ["-p", f"{self._text(place, item, 'name')}:={text}"]

    def _text(self, place: str, body: Mapping[str, Any], key: str) -> str:
        value = body.get(key)
        if not isinstance(value, str) or not value:
            raise LaunchError(f"{place}: '{key}' = {value!r} must be a text")
        if "$(" in SUBSTITUTION.sub("", value):
            raise LaunchError(f"{place}: '{key}' = '{value}': nested or open substitutions are not supported here")
        return SUBSTITUTION.sub(lambda match: self._substitute(place, match[1]), value)

    def _substitute(self, place: str, expression: str) -> str:
        kind, *words = expression.split()
        if kind == "var" and len(words) == 1:
            if words[0] not in self._values:
                raise LaunchError(f"{place}: '$({expression})': no argument of this name is declared before")
            return self._values[words[0]]
        if kind == "find-pkg-share" and len(words) == 1:
            return str(share_folder(words[0]))
        if kind == "env" and len(words) in (1, 2):
            value = os.environ.get(words[0], words[1] if len(words) == 2 else None)
            if value is None:
                raise LaunchError(f"{place}: '$({expression})': the environment variable is not set")
            return value
        raise LaunchError(
            f"{place}: '$({expression})' is not supported here; supported: $(var NAME), $(find-pkg-share PACKAGE), "
            "$(env NAME [DEFAULT])"
        )


def _check_keys(place: str, body: Any, allowed: tuple[str, ...]) -> None:
    if not isinstance(body, Mapping):
        raise LaunchError(f"{place} must be a mapping with the keys {', '.join(allowed)}")
    for key in body:
        if key not in allowed:
            raise LaunchError(f"{place}: '{key}' is not supported here; supported: {', '.join(allowed)}")


def _entries(place: str, body: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    entries = body.get(key, [])
    if not isinstance(entries, list) or not all(isinstance(entry, Mapping) for entry in entries):
        raise LaunchError(f"{place}: '{key}' must be a list of mappings")
    return entries
