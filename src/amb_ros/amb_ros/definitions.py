"""The definition text of a message type with everything it includes, as bags carry it."""

from __future__ import annotations

import re
from pathlib import Path

from ament_index_python.packages import get_package_share_directory

_FIELD = re.compile(r"^\s*(?P<type>[A-Za-z]\w*(?:/[A-Za-z]\w*)?)(?:<=\d+)?(?:\[[<=\d]*\])?\s+[a-z]\w*\s*(?:[^=]|$)")
_PRIMITIVE = re.compile(r"^(bool|byte|char|w?string|u?int(8|16|32|64)|float(32|64))$")
_SEPARATOR = "=" * 80


def message_definition(message_type: str) -> str:
    """Text of the `.msg` file of a type, then those of all types it includes, each under a line `MSG: package/Name`.

    Parameters
    ----------
    message_type : str
        As `package/msg/Name`; its package must be installed.
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
    return (Path(get_package_share_directory(package)) / "msg" / f"{message}.msg").read_text()


def _included(name: str, text: str) -> list[str]:
    """Types of the fields of a message that are messages themselves, as `package/Name`."""
    package = name.split("/")[0]
    found = []
    for line in text.splitlines():
        match = _FIELD.match(line.split("#")[0])
        if match and not _PRIMITIVE.match(match["type"]):
            found.append(match["type"] if "/" in match["type"] else f"{package}/{match['type']}")
    return found
