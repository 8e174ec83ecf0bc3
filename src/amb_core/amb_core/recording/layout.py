"""Compares the byte layouts of two definitions of a message type."""

from __future__ import annotations

from rosbags.typesys import Stores, TypesysError, get_typestore

from amb_core.ground.errors import BagError
from amb_core.recording.decoder import register
from amb_core.recording.storage import Definition


def layout_hash(message_type: str, definition: Definition) -> str:
    """Hash of the fields of a message type (RIHS01 of ROS 2); comments and constants have no influence.

    Parameters
    ----------
    message_type : str
        As `package/msg/Name`.
    definition : Definition
        Its text, followed by those of the types it uses.

    Raises
    ------
    BagError
        If the definition cannot be understood.
    """
    types = get_typestore(Stores.EMPTY)
    try:
        register(types, message_type, definition)
        return types.hash_rihs01(message_type)
    except TypesysError as problem:
        raise BagError(f"definition of {message_type} is wrong: {problem}") from None
