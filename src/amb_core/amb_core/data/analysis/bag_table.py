"""Any bag as a table: every number of every message is a column, named `TOPIC.FIELD` or `TOPIC.FIELD[INDEX]`.

Joint states name their columns by joint. Messages of several topics are joined where their stamps agree: those of their
headers, or without headers the times of recording, to half a sample of the first topic.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments.clock import TOLERANCE
from amb_core.data.tables import Column, Table
from amb_core.data.tables.table import ends_in
from amb_core.ground.errors import BagError, IdentificationError
from amb_core.ground.files.plain_data import fields_of_object
from amb_core.recording import Recording

TIME = "time"
_TIMES = (TIME, "none")  # which any table has
_SKIPPED = ("header", "layout", "name", "stamp")
_MOST_VALUES = 256  # of one message


def table_of_bag(recording: Recording, topics: Sequence[str] = (), columns: Sequence[str] = ()) -> Table:
    """The numbers of some topics, by default of those that have the named columns, else of all.

    Raises
    ------
    BagError
        If a topic does not exist, or none has numbers.
    IdentificationError
        If the messages of the topics do not belong together.
    """
    there = [topic.name for topic in recording.topics if not topic.name.startswith(("/parameter_events", "/rosout"))]
    for topic in topics:
        if topic not in there:
            raise BagError(f"bag {recording.path}: --topics {topic}: holds no such topic; its topics: {_list(there)}")
    chosen = list(topics) or _with_columns(recording, there, columns)
    parts = {name: part for name in chosen or there if (part := _topic(recording, name)) is not None}
    if not parts:
        raise BagError(
            f"bag {recording.path}: no topic has numbers; its topics: {_list(there)}; name some with --topics"
        )
    if len(parts) > 1 and not chosen:
        names = ", ".join(name for _, signals, _ in parts.values() for name in signals)
        raise IdentificationError(
            f"bag {recording.path}: which of its topics belong together is not known; name them with --topics, such as "
            f"--topics {','.join(parts)}, or columns with --inputs and --outputs; there are {names}"
        )
    return _joined(str(recording.path), parts)


def _with_columns(recording: Recording, topics: Sequence[str], columns: Sequence[str]) -> list[str]:
    """The topics whose first message has one of some columns; none if only numbers of columns are given."""
    named = [column for column in columns if column not in _TIMES and not column.replace("-", "").isdigit()]
    there = {topic: _first_names(recording, topic) for topic in topics} if named else {}
    with_column = {
        column: [topic for topic, names in there.items() if any(ends_in(name, column) for name in (topic, *names))]
        for column in named
    }
    for column in (column for column in named if not with_column[column]):
        names = ", ".join(name for names in there.values() for name in names)
        raise IdentificationError(f"bag {recording.path}: no topic has a column {column}; there are {names}")
    return [topic for topic in there if any(topic in chosen for chosen in with_column.values())]


def _first_names(recording: Recording, topic: str) -> list[str]:
    _, message = next(iter(recording.timed_messages_of(topic)), (0, None))
    return [] if message is None else [name for name, _ in _numbers(message, topic)]


_Part = tuple[NDArray[np.int64], dict[str, NDArray[np.float64]], bool]


def _topic(recording: Recording, topic: str) -> _Part | None:
    """Times (ns), signals by name, and whether the times are those of headers; None without numbers."""
    stamps, recorded, rows, names = [], [], [], None
    for log_time, message in recording.timed_messages_of(topic):
        numbers = dict(_numbers(message, topic))
        if not numbers:
            return None
        if names is None:
            names = list(numbers)
        elif list(numbers) != names:
            raise IdentificationError(
                f"bag {recording.path}: {topic}: the number or names of the values change from message to message; "
                "leave the topic out with --topics"
            )
        rows.append(list(numbers.values()))
        recorded.append(log_time)
        stamps.append(_stamp(message))
    if not rows or names is None:
        return None
    with_header = len(set(stamps)) > 1
    times = np.array(stamps if with_header else recorded, dtype=np.int64)
    values = np.array(rows, dtype=np.float64)
    order = np.argsort(times, kind="stable") if with_header else np.arange(len(times))
    signals = {name: values[order, index] for index, name in enumerate(names)}
    return times[order], signals, with_header


def _numbers(value: Any, path: str) -> Iterator[tuple[str, float]]:
    """Every number of a message, with its place."""
    labels = (
        [str(name) for name in getattr(value, "name", ())] if isinstance(getattr(value, "name", None), list) else []
    )
    for field, item in fields_of_object(value).items():
        if field in _SKIPPED:
            continue
        if isinstance(item, bool | int | float | np.number):
            yield f"{path}.{field}", float(item)
        elif isinstance(item, np.ndarray | list) and len(item) <= _MOST_VALUES:
            for index, part in enumerate(item):
                label = labels[index] if len(labels) == len(item) else str(index)
                if isinstance(part, bool | int | float | np.number):
                    yield f"{path}.{field}[{label}]", float(part)
                elif fields_of_object(part):
                    yield from _numbers(part, f"{path}.{field}[{label}]")
        elif fields_of_object(item):
            yield from _numbers(item, f"{path}.{field}")


def _stamp(message: Any) -> int:
    """Time of the header (ns); 0 without one."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return 0 if stamp is None else int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _joined(path: str, parts: dict[str, _Part]) -> Table:
    """One table of all topics, at the times of the first one."""
    (first, (time, signals, stamped)), *others = parts.items()
    kept = np.ones(len(time), dtype=bool)
    signals = dict(signals)
    notes = [f"times of {'headers' if stamped else 'recording, since there are no headers'}"]
    half = 0.5 * float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    for name, (other, values, also) in others:
        if also != stamped:
            raise IdentificationError(
                f"{path}: of {first} and {name} only one has stamps; give one of them to --topics"
            )
        if len(other) < 2:
            raise IdentificationError(f"{path}: {name} has {len(other)} messages; leave it out with --topics")
        nearest = np.clip(np.searchsorted(other, time), 1, len(other) - 1)
        nearest -= (time - other[nearest - 1]) < (other[nearest] - time)  # integers: a double holds no ns of a date
        later = other[nearest] - time
        kept &= np.abs(later) <= half
        if abs(usual := float(np.median(later)) / (2.0 * half or 1.0)) >= TOLERANCE:
            lag = f"{abs(usual):.2g} of a sample {'after' if usual > 0.0 else 'before'} {first}"
            notes.append(f"{name} is usually {lag}; taken as simultaneous, so the model has this lag")
        signals |= {key: value[nearest] for key, value in values.items()}
    if kept.sum() < 0.5 * len(time):
        raise IdentificationError(
            f"{path}: {', '.join(parts)} do not belong together: {kept.sum()} of {len(time)} messages have one "
            "time; name topics of one time with --topics"
        )
    seconds = (time[kept] - time[0]) * 1e-9
    if lost := int((~kept).sum()):
        notes.append(f"{lost} of {len(time)} messages of {first} have no partner in the other topics")
    columns = [Column(key, value[kept]) for key, value in signals.items()]
    return Table(path, (Column(TIME, seconds, "s"), *columns), notes=tuple(notes))


def _list(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"


def is_ours(recording: Recording) -> bool:
    """Whether a bag has telemetry of this workbench, or its topics of positions and currents."""
    types = {topic.type for topic in recording.topics}
    single = {"amb_msgs/msg/RotorPosition", "amb_msgs/msg/CurrentReference"}
    return bool(recording.runs) or single <= types
