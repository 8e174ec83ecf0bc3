"""Plain data between processes: numbers, texts, lists, dictionaries and arrays, as JSON and the bytes of the arrays.

Nothing in a message names code to run, so the receiver need not trust the sender.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import is_dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from amb_core.ground.files.limits import ReadLimits, too_much
from amb_core.ground.files.regular_files import MIB

HEAD = struct.Struct("<QQ")
"""Lengths of the JSON and of the arrays (B)."""
_ARRAY, _CELL, _BYTES = "\0array", "\0cell", "\0bytes"
_KINDS = "fiubcUS"


class PlainObject(SimpleNamespace):
    """A message of a bag: its fields are attributes, in their order."""


class Encoder:
    """Encodes answers to one question, together within limits."""

    def __init__(self, limits: ReadLimits) -> None:
        self._limits = limits
        self._values = self._texts = 0

    def encode(self, value: Any) -> list[bytes | memoryview]:
        """A message as parts to be sent one after the other; OSError if it is too large."""
        arrays: list[bytes | memoryview] = []
        length = 0

        def place(part: bytes | memoryview) -> int:
            nonlocal length
            arrays.append(part)
            length += len(part)
            return length - len(part)

        def plain(item: Any) -> Any:
            if isinstance(item, np.ndarray):
                return self._array(item, place)
            if isinstance(item, bytes):
                self._count(len(item))
                return {_BYTES: [len(item), place(item)]}
            if isinstance(item, np.generic):
                return item.item()
            if is_dataclass(item):
                return {name: part for name, part in vars(item).items() if not name.startswith("__")}
            raise TypeError(f"{type(item).__name__} is not plain data")

        text = json.dumps(value, default=plain).encode()
        self._texts += len(text)
        if self._texts > self._limits.texts:
            raise too_much(f"holds more than {self._limits.texts // MIB} MiB beside its arrays")
        return [HEAD.pack(len(text), length), text, *arrays]

    def _array(self, item: np.ndarray[Any, Any], place: Callable[[memoryview], int]) -> dict[str, Any]:
        if item.dtype.kind == "O":
            return {_CELL: [list(item.shape), item.ravel().tolist()]}
        if item.dtype.kind not in _KINDS:
            raise TypeError(f"an array of {item.dtype} is not plain data")
        self._count(max(8, item.itemsize) * item.size)
        content = np.ascontiguousarray(item)
        return {_ARRAY: [item.dtype.str, list(item.shape), place(memoryview(content.tobytes()))]}

    def _count(self, size: int) -> None:
        self._values += size
        if self._values > self._limits.values:
            raise too_much(f"holds more than {self._limits.values // MIB} MiB of numbers")


def decode(text: bytes, arrays: bytearray, as_objects: bool = False) -> Any:
    """The value of a message; ValueError if it is not one.

    Parameters
    ----------
    text : bytes
        Its JSON.
    arrays : bytearray
        The bytes of its arrays, which share this memory.
    as_objects : bool, optional
        Whether dictionaries become `PlainObject`.
    """

    def restored(item: dict[str, Any]) -> Any:
        if _ARRAY in item:
            kind, shape, start = item[_ARRAY]
            dtype = np.dtype(str(kind))
            if dtype.kind not in _KINDS:
                raise ValueError(f"array of {dtype}")
            count = math.prod(shape)
            if not dtype.itemsize or not count:
                return np.empty(shape, dtype)
            return np.frombuffer(arrays, dtype, count, start).reshape(shape)
        if _CELL in item:
            shape, content = item[_CELL]
            cell = np.empty(len(content), dtype=object)
            for index, part in enumerate(content):
                cell[index] = part
            return cell.reshape(shape)
        if _BYTES in item:
            length, start = item[_BYTES]
            return bytes(arrays[start : start + length])
        return PlainObject(**item) if as_objects else item

    return json.loads(text, object_hook=restored)


def fields_of_object(item: Any) -> Mapping[str, Any]:
    """The fields of a message by name; none for anything else."""
    return vars(item) if isinstance(item, PlainObject) else {}
