"""The reference of messages, services and actions in Markdown, from the comments of their files."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rosidl_adapter.parser import parse_action_file, parse_message_file, parse_service_file

PACKAGE = Path(__file__).parents[2] / "amb_msgs"


def message_reference() -> str:
    """A section for each message, service and action: purpose, constants and fields with their units."""
    parts = ["## Messages\n"]
    for path in _files("msg"):
        parts.append(_message(f"### {path.stem}", parse_message_file("amb_msgs", str(path))))
    parts.append("## Services\n")
    for path in _files("srv"):
        service = parse_service_file("amb_msgs", str(path))
        parts += [_message(f"### {path.stem}", service.request, "Request"), _fields("Response", service.response)]
    parts.append("## Actions\n")
    for path in _files("action"):
        action = parse_action_file("amb_msgs", str(path))
        parts.append(_message(f"### {path.stem}", action.goal, "Goal"))
        parts += [_fields("Result", action.result), _fields("Feedback", action.feedback)]
    return "\n".join(parts)


def _files(kind: str) -> list[Path]:
    return sorted((PACKAGE / kind).glob(f"*.{kind}"))


def _message(heading: str, message: Any, title: str = "") -> str:
    comment = _plain(message)
    constants = [f"| `{item.name}` | {item.value} | {_cell(item)} |" for item in message.constants]
    table = ["| constant | value | meaning |", "|---|---|---|", *constants, ""] if constants else []
    return "\n".join([heading, "", *comment, *table, _fields(title, message)])


def _fields(title: str, message: Any) -> str:
    rows = [f"| `{item.name}` | `{item.type}` | {_cell(item)} |" for item in message.fields]
    if not rows:
        return f"{title}: no fields.\n" if title else "No fields.\n"
    return "\n".join([f"**{title}**\n" if title else "", "| field | type | meaning |", "|---|---|---|", *rows, ""])


def _plain(message: Any) -> Iterable[str]:
    """The comment at the top: its sentences as a paragraph, what follows an empty line as it stands there."""
    lines = message.annotations.get("comment", [])
    end = lines.index("") if "" in lines else len(lines)
    yield _escaped(" ".join(lines[:end])) + "\n"
    if lines[end + 1 :]:
        yield "\n".join(["```text", *lines[end + 1 :], "```\n"])


def _cell(item: Any) -> str:
    return _escaped(" ".join(item.annotations.get("comment", []))).replace("|", r"\|")


def _escaped(text: str) -> str:
    return text.replace("<", "&lt;").replace("_", r"\_") if "`" not in text else text
