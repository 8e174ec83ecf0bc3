"""Which messages a recorder takes: those that readers of its bag understand.

One that they do not, of a publisher with other definitions or of anybody, would spoil all messages of its topic.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from amb_core.ground.errors import BagError
from amb_core.recording.content import KEPT
from amb_core.recording.decoder import Decoder
from amb_core.recording.messages.loop_samples import block_from_message
from amb_core.recording.messages.machine import machine_from_message
from amb_core.recording.storage import Definition
from amb_ident_node.recorded_topics import RecordedTopic
from amb_msgs.msg import LoopSamples, Machine
from amb_ros.serialized import deserialized, unreadable

CHECKS: Mapping[Any, Callable[[Any], object]] = {LoopSamples: block_from_message, Machine: machine_from_message}
"""What readers make of each message of a type."""


class MessageReader:
    """Reads messages as ROS does and, where the library reads them from bags, as it does then.

    Parameters
    ----------
    definitions : mapping of str to str
        Definitions of all types in the bag, by type.
    """

    def __init__(self, definitions: Mapping[str, str]) -> None:
        known = {message_type: Definition("ros2msg", text) for message_type, text in definitions.items()}
        self._decoder = Decoder(Path(), known)

    def read(self, topic: RecordedTopic, data: bytes) -> Any:
        """The message in serialized form.

        Raises
        ------
        AmbError
            If it cannot be read, or its content is not what the type allows.
        """
        message = deserialized(data, topic.type)
        if topic.type_name in KEPT:
            try:
                self._decoder.decode(topic.type_name, data)  # stricter with texts and lengths
            except BagError:
                raise unreadable(data, topic.type) from None
        if check := CHECKS.get(topic.type):
            check(message)
        return message
