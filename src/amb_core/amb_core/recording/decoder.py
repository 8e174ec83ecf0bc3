"""Decodes stored messages with the definitions in their bag."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from amb_core.ground.errors import BagError
from amb_core.recording.storage import Definition


def register(types: Typestore, message_type: str, definition: Definition) -> None:
    """Add a message type, `package/msg/Name`, and those that it uses to a store of types.

    Raises
    ------
    TypesysError
        If the definition cannot be understood.
    """
    if definition.encoding == "ros2idl":
        types.register(get_types_from_idl(definition.text))
    else:
        types.register(get_types_from_msg(definition.text, message_type))


class Decoder:
    """Decodes the messages of one bag.

    Parameters
    ----------
    path : Path
        The bag, for error messages.
    definitions : dict of str to Definition
        By message type; entries may be added until a type is decoded for the first time.
    """

    def __init__(self, path: Path, definitions: dict[str, Definition]) -> None:
        self._path = path
        self._definitions = definitions
        self._types = get_typestore(Stores.EMPTY)

    def decode(self, message_type: str, data: bytes) -> Any:
        """A message from its serialized form (CDR).

        Raises
        ------
        BagError
            If the bag does not define the type, or the data are not such a message.
        """
        try:
            if message_type not in self._types.types:
                self._register(message_type)
            return self._types.deserialize_cdr(data, message_type)
        except KeyError as problem:
            raise BagError(f"bag {self._path}: the definition of {message_type} lacks the type {problem}") from None
        except (TypesysError, SerdeError) as problem:
            raise BagError(f"bag {self._path}: a message of type {message_type} cannot be decoded: {problem}") from None

    def _register(self, message_type: str) -> None:
        if message_type not in self._definitions:
            self._register_standard(message_type)
            return
        register(self._types, message_type, self._definitions[message_type])

    def _register_standard(self, message_type: str) -> None:
        """A standard type of ROS 2, for bags of Humble and before, which hold no definitions."""
        standard = get_typestore(Stores.ROS2_HUMBLE)
        if message_type not in standard.types:
            raise BagError(f"bag {self._path}: lacks the definition of {message_type}; record with Iron or later")
        self._types = standard
