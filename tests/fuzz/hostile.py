"""Hostile values for every field of a ROS message, made from its definition and a seeded generator of numbers."""

from __future__ import annotations

import importlib
import math
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

INTEGERS = {f"{sign}int{bits}": bits for sign in ("", "u") for bits in (8, 16, 32, 64)}
WHOLE = (0, 1, 2, 3, 7, 100, 1_000, 2**15, 2**16, 2**31 - 1, 2**31, 2**32 - 1, 2**53 + 1, 2**63 - 1, 2**64 - 1)
REAL = (
    0.0, -0.0, 1.0, -1.0, 0.1, 1e-4, -1e-4, 1e-6, 50.0, math.nan, math.inf, -math.inf, 1e300, -1e300, 1.8e308, 5e-324,
    2.2e-308, 1e-300, 1e9, -1e9, 1e18, 2.0**63, 0.25, 1e-5,
)  # fmt: skip
LENGTHS = (0, 0, 1, 2, 3, 4, 5, 8, 100, 1_000, 100_000)
TEXTS = (
    "", " ", "\n", "a\nb\r\n\tc", "\0", "a\0b", "{}", "[]", "null", "NaN", "[" * 5_000, "x" * 100_000,
    "x" * 300, "é漢", "%s%n{0}", "'; --", "-1", "1e400", "../..", "~", "~nobody/x", "/", ".", "/nowhere/x",
    "/dev/null", "/dev/full", "/dev/zero", "/dev/zero.yaml", "/dev/stdin", "/proc/self/mem", "file:///etc/passwd",
    "9" * 20, "9" * 5_000, "-" + "9" * 5_000, "\u0663", "\u00b2", "1e5000", "\\ud800", "\"\\ud800\"", "\\udcff",
    'units: ["\\ud800"]', '{"\\ud800": 1}', "a/b.yaml", "paper", "x, y",
    "sweep", "pem", "pd_controller", "/amb/simulator", "tcp://127.0.0.1:1", "-r",
)  # fmt: skip
UNREADABLE = (
    b"", b"\0", b"\0\1\0\0", b"\0\1\0\0" + b"\5" * 8, b"\0\0\0\0" + b"\xff" * 20, b"\0\1\0\0" + b"\xff" * 16,
    b"\x09\x09\0\0" + b"\5" * 80, b"\0\0\0\0" + b"\xff" * 80,
)  # fmt: skip
"""Bytes that are no message of a loop: cut, with a header of nothing, with lengths beyond their end."""
DELIVERED = tuple(data for data in UNREADABLE if len(data) >= 4)
"""Those that the middleware delivers."""
MOST_TEXTS, MOST_MESSAGES = 300, 3  # elements of an array

_ARRAY = re.compile(r"(?:sequence<(?P<item>[^,>]+)(?:, \d+)?>|(?P<fixed>.+)\[(?P<length>\d+)\])")


def interface(name: str) -> Any:
    """The class of a message, service or action, such as `std_msgs/msg/Header`."""
    package, folder, kind = name.split("/")
    return getattr(importlib.import_module(f"{package}.{folder}"), kind)


def make_traps(folder: Path) -> tuple[str, ...]:
    """Files, folders and pipes that are not what a reader or writer hopes for; their paths."""
    (folder / "empty.yaml").touch()
    (folder / "binary.json").write_bytes(bytes(range(256)))
    (folder / "wrong.yaml").write_text("/**: {ros__parameters: {colour: [1, {}]}}\n")
    (folder / "folder.yaml").mkdir()
    for name in ("pipe", "pipe.yaml", "pipe.json", "pipe.mcap", "pipe.npz"):
        os.mkfifo(folder / name)
    (folder / "loop.yaml").symlink_to("loop.yaml")
    (folder / "zero.yaml").symlink_to("/dev/zero")
    (folder / "zero.json").symlink_to("/dev/zero")
    (folder / "full.json").symlink_to("/dev/full")
    return tuple(str(path) for path in sorted(folder.iterdir()))


class Hostile:
    """Makes messages; the same generator state and traps give the same ones.

    Parameters
    ----------
    rng : numpy.random.Generator
        Where chance comes from.
    texts : sequence of str
        Texts beside `TEXTS`, such as names of parameters and paths of traps.
    """

    def __init__(self, rng: np.random.Generator, texts: Sequence[str] = ()) -> None:
        self._rng = rng
        self._texts = (*TEXTS, *texts)

    def chance(self, probability: float) -> bool:
        """Whether something of this probability happens."""
        return bool(self._rng.random() < probability)

    def choose(self, items: Sequence[Any], weights: Sequence[float] | None = None) -> Any:
        """One of the items, by default all with the same probability."""
        if weights is None:
            return items[int(self._rng.integers(len(items)))]
        bounds = np.cumsum(weights)
        return items[int(np.searchsorted(bounds, bounds[-1] * self._rng.random(), side="right"))]

    def cut(self, data: bytes) -> bytes:
        """A serialized message that ends early, is longer than it should be, has other bytes, or is none."""
        place = int(self._rng.integers(len(data) + 1))
        other = self._rng.bytes(min(8, len(data) - place))
        ways = (data[:place], data + b"\5" * 40, data[:place] + other + data[place + len(other) :])
        return self.choose((*ways, self.choose(UNREADABLE)))

    def message(self, message_type: Any) -> Any:
        """A message most of whose fields are hostile."""
        message = message_type()
        for name, kind in message_type.get_fields_and_field_types().items():
            if self.chance(0.7):
                setattr(message, name, self.value(kind, getattr(message, name)))
        return message

    def near(self, message_type: Any, valid: Mapping[str, Any]) -> Any:
        """A valid message with one field broken, two now and then; fields that the type lacks are left out."""
        fields = message_type.get_fields_and_field_types()
        message = message_type(**{name: value for name, value in valid.items() if name in fields})
        for _ in range(1 + self.chance(0.2)):
            if fields:
                name = self.choose(list(fields))
                setattr(message, name, self.value(fields[name], getattr(message, name)))
        return message

    def value(self, kind: str, present: Any = None) -> Any:
        """A value of a type of field as `get_fields_and_field_types` names it; `present` is what stood there."""
        if (array := _ARRAY.fullmatch(kind)) is not None:
            return self._array(array, present)
        if kind in INTEGERS:
            return self._integer(kind)
        if kind in ("double", "float"):
            value = self.choose(REAL)
            return value if kind == "double" or not math.isfinite(value) else max(-3e38, min(3e38, value))
        if kind == "boolean":
            return self.chance(0.5)
        if kind == "octet":
            return bytes([int(self._rng.integers(256))])
        if kind.startswith("string"):
            return self.choose(self._texts)
        nested = hasattr(present, "get_fields_and_field_types")  # elements of arrays are not there yet
        return self.message(type(present) if nested else interface(kind.replace("/", "/msg/", 1)))

    def _integer(self, kind: str) -> int:
        bits = INTEGERS[kind]
        low, high = (0, 2**bits - 1) if kind.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        extremes = [low, low + 1, high - 1, high, -1, *WHOLE]
        return self.choose([value for value in extremes if low <= value <= high])

    def _array(self, array: re.Match[str], present: Any) -> list[Any]:
        if array["fixed"]:
            return [self.value(array["fixed"]) for _ in range(int(array["length"]))]
        item = array["item"]
        known = [] if present is None else list(present)
        if known and self.chance(0.5):  # right but for one element, or for its length
            place = int(self._rng.integers(len(known)))
            changed = [*known[:place], self.value(item), *known[place + 1 :]]
            return self.choose([changed, known[:-1], known + known[:1], [*known, self.value(item)]])
        most = LENGTHS[-1] if item in INTEGERS or item in ("double", "float", "boolean", "octet") else MOST_MESSAGES
        most = MOST_TEXTS if item.startswith("string") else most
        length = min(self.choose(LENGTHS), most)
        few = [self.value(item) for _ in range(min(length, 4))]
        return [few[number] for number in self._rng.integers(len(few), size=length)] if few else []
