"""The definition text of a message type with everything it includes, as bags carry it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_msg

from amb_core.ground.errors import BagError

_SEPARATOR = "=" * 80


def message_definition(message_type: str) -> str:
    """Text of the `.msg` file of a type, then those of all types it includes, each under a line `MSG: package/Name`.

    Parameters
    ----------
    message_type : str
        As `package/msg/Name`; its package must be installed.

    Raises
    ------
    BagError
        If a package with one of the types is not known to the environment.
    """
    package, _, name = message_type.split("/")
    root = f"{package}/{name}"
    texts = {root: _text(root)}
    waiting = [root]
    while waiting:
        current = waiting.pop(0)
        for included in _included(current, texts[current]):
            if included not in texts:
                texts[included] = _text(included)
                waiting.append(included)
    sections = [texts.pop(root)]
    sections += [f"{_SEPARATOR}\nMSG: {name}\n{text}" for name, text in texts.items()]
    return "\n".join(sections)


def _text(name: str) -> str:
    package, message = name.split("/")
    try:
        return (Path(get_package_share_directory(package)) / "msg" / f"{message}.msg").read_text()
    except PackageNotFoundError:
        raise BagError(
            f"the message {name} cannot be recorded: its package is not in AMENT_PREFIX_PATH; source ROS 2 before the "
            "workspace, as scripts/env.sh does"
        ) from None


def _included(name: str, text: str) -> list[str]:
    """Message types among the fields of a message, as `package/Name`."""
    package, message = name.split("/")
    ((_, fields),) = get_types_from_msg(text, f"{package}/msg/{message}").values()
    types = [_element(description) for _, description in fields]
    return [str(detail).replace("/msg/", "/") for kind, detail in types if kind == Nodetype.NAME]


def _element(description: Any) -> Any:
    """A type as rosbags describes it, kind and detail; for an array the type of its elements."""
    kind, detail = description
    return _element(detail[0]) if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE) else (kind, detail)
