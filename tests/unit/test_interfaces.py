"""Messages, services and actions: every field has its unit, and the built types are those of the files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import amb_msgs.action
import amb_msgs.msg
import amb_msgs.srv

FOLDER = Path(__file__).parents[2] / "amb_msgs"
FILES = [path for kind in ("msg", "srv", "action") for path in sorted((FOLDER / kind).glob(f"*.{kind}"))]
PARTS = {"msg": ("",), "srv": ("Request", "Response"), "action": ("Goal", "Result", "Feedback")}
UNITS = {"-", "A", "A, m", "Hz", "N", "T", "dB", "m", "m/A", "m/s", "m^2", "1/A", "1/m", "percent", "rad", "s", "s, ns"}

of_each_file = pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)


def fields_with_comments(text: str) -> Iterator[tuple[str, str]]:
    """Fields of a part of a file, and their comments with the lines that continue them."""
    field, comment = "", ""
    for line in text.splitlines():
        declaration, _, said = line.partition("#")
        if declaration.strip() and "=" not in declaration:
            if field:
                yield field, comment
            field, comment = declaration.strip(), said
        elif declaration and not declaration.strip():  # indented: goes on with the comment above
            comment += said
        elif field:
            yield field, comment
            field = ""
    if field:
        yield field, comment


def parts_of(path: Path) -> list[str]:
    """Request and response of a service, for example."""
    return re.split(r"^---$", path.read_text(), flags=re.MULTILINE)


@of_each_file
def test_every_field_of_a_message_has_its_unit(path: Path) -> None:
    for field, comment in (item for part in parts_of(path) for item in fields_with_comments(part)):
        assert set(re.findall(r"\(([^()]*)\)", comment)) & UNITS, f"{path.name}: '{field}' lacks a unit in parentheses"


@of_each_file
def test_the_built_type_has_the_fields_of_its_file(path: Path) -> None:
    kind = path.suffix.removeprefix(".")
    built = getattr(getattr(amb_msgs, kind), path.stem)
    types: list[Any] = [getattr(built, part) if part else built for part in PARTS[kind]]
    for one, text in zip(types, parts_of(path), strict=True):
        assert list(one.get_fields_and_field_types()) == [field.split()[1] for field, _ in fields_with_comments(text)]
