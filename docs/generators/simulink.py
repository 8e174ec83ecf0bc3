"""Telemetry as the fields of a Byte Unpack block, from the declaration of the frames."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from amb_core.rig.link.layout import CHECKSUM, HEADER, TelemetryOption

TYPES = {"B": "uint8", "s": "uint8", "H": "uint16", "I": "uint32", "Q": "uint64"}
"""Types of Simulink by the letters of `struct`."""

NAMES = ("magic", "version", "type", "length of the payload", "session", "sequence", "step of the first sample")
OPTIONS = TelemetryOption.STATUS
"""Options of the frame that the page shows: float32 and the status word."""


@dataclass(frozen=True)
class Field:
    """A field of a frame: name, type of Simulink, how many of it, and where it begins (bytes)."""

    name: str
    type: str
    count: int
    offset: int


def telemetry_fields(axes: int, coils: int = 0, options: TelemetryOption = OPTIONS) -> list[Field]:
    """Fields of a telemetry frame of one sample.

    Parameters
    ----------
    axes, coils : int
        Axes of the machine, and coil currents that the target measures.
    options : TelemetryOption, optional
        As in STREAM.

    Returns
    -------
    list of Field
        In their order, without gaps.
    """
    wide = bool(options & TelemetryOption.FLOAT64)
    number = "double" if wide else "single"
    rows = [(name, *kind) for name, kind in zip(NAMES, _header(), strict=True)]
    rows += [("options", "uint8", 1), ("axes", "uint8", 1), ("coil currents", "uint8", 1), ("0", "uint8", 1)]
    rows += [("samples", "uint16", 1), ("bytes of a sample", "uint16", 1)]
    rows += [("references (m)", number, axes), ("positions (m)", number, axes), ("control currents (A)", number, axes)]
    if options & TelemetryOption.COILS:
        rows.append(("coil currents (A)", number, coils))
    if options & TelemetryOption.STATUS:
        rows.append(("status word", "uint64" if wide else "uint32", 1))
    rows.append(("checksum", "uint32", CHECKSUM // 4))
    fields, offset = [], 0
    for name, kind, count in rows:
        fields.append(Field(name, kind, count, offset))
        offset += count * SIZES[kind]
    return fields


SIZES = {"uint8": 1, "uint16": 2, "uint32": 4, "uint64": 8, "single": 4, "double": 8}
"""Bytes of the types."""


def telemetry_table(axes: int = 4) -> str:
    """The fields as a table, and as what is typed into the block.

    Parameters
    ----------
    axes : int, optional
        Of the machine.

    Returns
    -------
    str
        In Markdown.
    """
    fields = telemetry_fields(axes)
    lines = ["| offset | type | number | field |", "|---|---|---|---|"]
    lines += [f"| {one.offset} | {one.type} | {one.count} | {one.name} |" for one in fields]
    types = ", ".join(f"'{one.type}'" for one in fields)
    sizes = ", ".join(str(one.count) for one in fields)
    end = fields[-1].offset + CHECKSUM
    typed = f"Output port dimensions:  {{{sizes}}}\nOutput port data types:  {{{types}}}\nByte alignment:          1\n"
    return "\n".join(lines) + f"\n\nA frame has {end} bytes. For the block:\n\n```text\n{typed}```\n"


def _header() -> list[tuple[str, int]]:
    """Type and number of each field of the header, from its format."""
    fields = []
    count = ""
    for letter in HEADER.format.lstrip("<"):
        if letter.isdigit():
            count += letter
        else:
            fields.extend([(TYPES[letter], int(count))] if letter == "s" else [(TYPES[letter], 1)] * int(count or 1))
            count = ""
    if sum(SIZES[kind] * number for kind, number in fields) != HEADER.size:
        raise struct.error(f"the header has {HEADER.size} bytes; its fields {fields} have others")
    return fields
