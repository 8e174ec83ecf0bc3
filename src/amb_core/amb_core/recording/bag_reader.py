"""What a child process reads of a bag: its messages counted and checked in one pass, and decoded on request."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from amb_core.ground.errors import BagError
from amb_core.ground.files.apart import Apart, UnreadableError
from amb_core.ground.files.apart_server import yields
from amb_core.recording.decoder import Decoder
from amb_core.recording.layout import layout_hash
from amb_core.recording.storage import Definition, StoredMessage, Stretch, open_storage

CONTROLLER = "controller"
"""Last part of the name of the topic with linear controllers, whose message type is that of identified models."""
MODEL = "amb_msgs/msg/StateSpaceModel"


class ReadMessage(NamedTuple):
    """A message of a bag: time of recording (ns since 1970), as stored and decoded, each None if not asked for."""

    topic: str
    type: str
    log_time: int
    data: bytes | None
    content: Any


class BagReader:
    """A bag; in a child process, see `BagApart`. Every method has plain data as result."""

    def __init__(self, path: str) -> None:
        self._path = Path(path)
        self._storage = open_storage(self._path)
        self._decoder = Decoder(self._path, self._storage.definitions)
        self._kept: dict[str, list[tuple[str, int, bytes]]] = {}

    def survey(self, kept: list[str], stretch: list[Any] | None = None) -> dict[str, Any] | None:
        """Read the bag once, and keep the messages of some types for `kept`.

        With `stretch`, which is a type with the fields run and first_step, the run, the first step and the one after
        the last, only of that part of this type, by the index of the files; None without an index.
        """
        messages: Iterator[StoredMessage] | None = self._storage.messages()
        if stretch is not None:
            kind, run, first_step, stop = stretch

            def place(data: bytes) -> tuple[int, int]:
                message = self._decoder.decode(kind, data)
                return int(message.run), int(message.first_step)

            others = tuple(other for other in kept if other != kind)
            messages = self._storage.stretch(Stretch(kind, others, run, first_step, stop, place))
        if messages is None:
            return None
        counts: dict[tuple[str, str], int] = {}
        start, end = 2**63 - 1, 0
        for message in messages:
            key = (message.topic, message.type)
            counts[key] = counts.get(key, 0) + 1
            start, end = min(start, message.log_time), max(end, message.log_time)
            if message.type in kept:
                self._kept.setdefault(kind_of(*key), []).append((message.type, message.log_time, message.data))
        return {
            "counts": [[*key, count] for key, count in sorted(counts.items())],
            "start": start if counts else 0,
            "duration": (end - start) / 1e9 if counts else 0.0,
            "damage": self._storage.damage,
        }

    @yields
    def kept(self, kind: str) -> Iterator[Any]:
        """Times of recording and messages of a kind that `survey` has kept, decoded; their stored form is dropped."""
        for message_type, log_time, data in self._kept.pop(kind, []):
            yield [log_time, self._decoder.decode(message_type, data)]

    @yields
    def messages(
        self, topics: list[str] | None, types: list[str] | None, stored: bool, decoded: bool, lenient: bool
    ) -> Iterator[list[Any]]:
        """Messages of some topics or types as lists in the order of `ReadMessage`; reads the files again.

        `lenient` leaves out those that cannot be decoded.
        """
        for message in self._storage.messages():
            if (topics is None or message.topic in topics) and (types is None or message.type in types):
                content = None
                if decoded:
                    try:
                        content = self._decoder.decode(message.type, message.data)
                    except BagError:
                        if lenient:
                            continue
                        raise
                data = bytes(message.data) if stored else None
                yield [message.topic, message.type, message.log_time, data, content]

    def definition(self, message_type: str) -> list[str]:
        """Format and text of the definition of a type that the bag has; known after all messages were read.

        Raises
        ------
        BagError
            If it has none.
        """
        if message_type not in self._storage.definitions:
            raise BagError(f"bag {self._path}: lacks the definition of {message_type}; record with Iron or later")
        return list(self._storage.definitions[message_type])

    def layout(self, message_type: str) -> str:
        """Hash of the fields of a type, see `layout_hash`; errors as for `definition`."""
        return layout_hash(message_type, Definition(*self.definition(message_type)))


class BagApart:
    """A bag that is read in a child process.

    Parameters
    ----------
    path : Path
        Folder or file.

    Raises
    ------
    BagError
        If there is no bag; every method raises it for what cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._apart: Apart = self._with_bag_errors(lambda: Apart(f"{__name__}:BagReader", path))

    def call(self, method: str, *arguments: Any) -> Any:
        """What a method of `BagReader` returns."""
        return self._with_bag_errors(lambda: self._apart.call(method, *arguments))

    def iterate(self, method: str, *arguments: Any) -> Iterator[Any]:
        """The items that a method of `BagReader` yields; messages are objects with their fields as attributes."""
        items = self._apart.iterate(method, *arguments, as_objects=True)
        while (item := self._with_bag_errors(lambda: next(items, None))) is not None:
            yield item

    def messages(
        self,
        topics: list[str] | None = None,
        types: list[str] | None = None,
        *,
        stored: bool = False,
        decoded: bool = True,
        lenient: bool = False,
    ) -> Iterator[ReadMessage]:
        """Messages of some topics or types, by default of all; arguments as for `BagReader.messages`."""
        for item in self.iterate("messages", topics, types, stored, decoded, lenient):
            yield ReadMessage(*item)

    def _with_bag_errors(self, action: Any) -> Any:
        try:
            return action()
        except UnreadableError as problem:
            raise BagError(f"bag {self._path}: cannot be read: {problem}") from None
        except OSError as problem:
            raise BagError(f"bag {self._path}: cannot be read: {problem.strerror}") from None


def kind_of(topic: str, message_type: str) -> str:
    """What the messages of a topic are: their type, or `CONTROLLER`."""
    return CONTROLLER if message_type == MODEL and topic.rsplit("/", 1)[-1] == CONTROLLER else message_type
