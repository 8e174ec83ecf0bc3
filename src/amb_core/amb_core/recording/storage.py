"""The files of a bag: messages as stored, from possibly incomplete MCAP files and from other formats of rosbag2."""

from __future__ import annotations

import errno
import itertools
import re
import sqlite3
import stat
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple, Protocol
from urllib.parse import quote

import yaml
import zstandard
from mcap.records import ChunkIndex, Message

from amb_core.ground.errors import BagError
from amb_core.ground.files.limits import Expansion, limits_for, too_much
from amb_core.ground.files.regular_files import MIB, open_regular, read_text, shown
from amb_core.recording.mcap_file import StoredTopic
from amb_core.recording.mcap_scan import McapScan, expand_zstd


class StoredMessage(NamedTuple):
    """A message as stored: serialized data (CDR), time of recording (ns since 1970)."""

    topic: str
    type: str
    log_time: int
    data: bytes


class Definition(NamedTuple):
    """Definition of a message type: its format, `ros2msg` or `ros2idl`, and the text."""

    encoding: str
    text: str


class Stretch(NamedTuple):
    """A part of a bag, see `BagReader.survey`.

    Attributes
    ----------
    telemetry : str
        Message type of which only a part is wanted.
    others : tuple of str
        Message types of which everything is wanted.
    run : int or None
        The run; None for that of the last message.
    first_step, stop : int
        Its first step, and the one after the last.
    place : callable
        Run and step of a serialized message of telemetry.
    """

    telemetry: str
    others: tuple[str, ...]
    run: int | None
    first_step: int
    stop: int
    place: Callable[[bytes], tuple[int, int]]


class Storage(Protocol):
    """Files of one bag."""

    definitions: dict[str, Definition]
    """By message type; complete once `messages` has run through."""
    damage: str
    """Why reading stopped before the end; empty for a complete bag. Known at the end of `messages`."""

    def messages(self) -> Iterator[StoredMessage]:
        """All messages in the order in which they were stored."""
        ...

    def stretch(self, wanted: Stretch) -> Iterator[StoredMessage] | None:
        """The messages of a stretch, found by an index; None where there is none."""
        ...


def open_storage(path: Path) -> Storage:
    """The files of the bag at a path: a folder, an `.mcap` or a `.db3` file.

    Raises
    ------
    BagError
        If nothing is there, or it is not a bag.
    """
    mode = mode_of(path)
    if stat.S_ISDIR(mode):
        return _storage_of_folder(path)
    if stat.S_ISREG(mode) and path.suffix == ".mcap":
        return McapStorage([path], Compressed("", 0))
    if stat.S_ISREG(mode) and path.suffix == ".db3":
        return SqliteStorage([path], Compressed("", 0))
    raise BagError(f"bag {path}: not a bag; a bag is a folder, an .mcap or a .db3 file")


def mode_of(path: Path) -> int:
    """Kind of the file or folder at a path, as `os.stat` returns it.

    Raises
    ------
    BagError
        If there is none.
    """
    try:
        return path.stat().st_mode
    except FileNotFoundError:
        raise BagError(f"bag {shown(path)}: there is no such file or folder") from None
    except OSError as problem:
        raise BagError(f"bag {shown(path)}: cannot be read: {problem.strerror}") from None
    except ValueError as problem:  # a NUL in the path
        raise BagError(f"bag {shown(path)}: the path is not allowed: {problem}") from None


def _storage_of_folder(path: Path) -> Storage:
    description = description_of(path)
    listed = listed_files(path, description)
    files = listed or files_by_number(path.glob("*.mcap"))
    if missing := [file.name for file in files if not file.exists()]:
        raise BagError(f"bag {path}: metadata.yaml lists {', '.join(missing)}, which does not exist")
    compressed = _compression_of(path, description)
    if listed and description.get("storage_identifier") == "sqlite3":
        return SqliteStorage(files, compressed)
    if files:
        return McapStorage(files, compressed)
    databases = files_by_number(path.glob("*.db3"))
    if len(databases) == 1:
        return SqliteStorage(databases, compressed)
    raise BagError(f"bag {path}: not a bag; the folder holds neither metadata.yaml nor an .mcap or .db3 file")


def listed_files(folder: Path, description: Mapping[str, Any]) -> list[Path]:
    """The files that `metadata.yaml` lists, all in the folder of the bag; none without a list.

    Raises
    ------
    BagError
        If the list is none of names.
    """
    listed = description.get("relative_file_paths") or []
    if not isinstance(listed, list) or not all(isinstance(name, str) and Path(name).name for name in listed):
        raise BagError(f"bag {folder}: relative_file_paths in metadata.yaml must be a list of file names")
    return [folder / Path(name).name for name in listed]


def _compression_of(path: Path, description: Mapping[str, Any]) -> Compressed:
    mode = description.get("compression_mode") or ""
    mode = mode.lower() if isinstance(mode, str) else ""
    if mode in ("file", "message") and description.get("compression_format") != "zstd":
        raise BagError(f"bag {path}: its compression format is not supported; allowed: zstd")
    return Compressed(mode, limits_for(path).expanded)


class McapStorage:
    """MCAP files read from the beginning, so their end may be missing."""

    def __init__(self, files: list[Path], compressed: Compressed) -> None:
        self.definitions: dict[str, Definition] = {}
        self.damage = ""
        self.files = files
        self._compressed = compressed

    def messages(self) -> Iterator[StoredMessage]:
        """All messages that can be read, file after file."""
        try:
            yield from self._messages()
        except OSError as problem:
            raise BagError(f"bag {self.files[0].parent}: cannot be read: {problem.strerror}") from None

    def _messages(self) -> Iterator[StoredMessage]:
        damage = []
        for file in self.files:
            scan = McapScan(file, self._compressed.content_of(file))
            yield from self._stored(scan.messages())
            damage += scan.damage
        self.damage = "; ".join(damage)

    def stretch(self, wanted: Stretch) -> Iterator[StoredMessage] | None:
        """The messages of a stretch, by the index of every file; None where one has none."""
        scans = [McapScan(file, self._compressed.content_of(file)) for file in self.files]
        chunks = [[(scan, *chunk) for chunk in scan.indexed()] for scan in scans]
        return self._of_chunks(wanted, list(itertools.chain(*chunks))) if chunks and all(chunks) else None

    def _of_chunks(self, wanted: Stretch, chunks: list[_Chunk]) -> Iterator[StoredMessage]:
        """Those of the chunks that hold other types, and of telemetry around the stretch and the end of its run."""
        types = [{kind for _, kind in keys} for *_, keys in chunks]
        holding = [index for index, kinds in enumerate(types) if wanted.telemetry in kinds]
        if not holding:
            return

        def places(index: int) -> list[tuple[int, int]]:
            stored = self._at(chunks[index])
            return [wanted.place(item.data) for item in stored if item.type == wanted.telemetry] or [(0, 0)]  # damaged

        def begins(index: int) -> tuple[int, int]:
            return places(index)[0]

        run = places(holding[-1])[-1][0] if wanted.run is None and holding else wanted.run or 0
        before = max(
            bisect_right(holding, (run, wanted.first_step), key=begins) - 2, 0
        )  # two, for messages out of order
        after = bisect_left(holding, (run, wanted.stop), key=begins) + 1
        following = bisect_left(holding, (run + 1, 0), key=begins)
        near = {*holding[before:after], *holding[max(following - 2, 0) : following + 1]}  # also where the run ends
        for index, chunk in enumerate(chunks):
            if index in near or types[index] & set(wanted.others):
                yield from self._at(chunk)
        self.damage = "; ".join(dict.fromkeys(text for scan, *_ in chunks for text in scan.damage))

    def _at(self, chunk: _Chunk) -> list[StoredMessage]:
        scan, index, _ = chunk
        return list(self._stored(scan.messages_at(index)))

    def _stored(self, messages: Iterable[tuple[StoredTopic, Message]]) -> Iterator[StoredMessage]:
        for topic, message in messages:
            if topic.type not in self.definitions:
                self.definitions[topic.type] = Definition(topic.encoding, topic.definition.decode(errors="replace"))
            yield StoredMessage(topic.name, topic.type, message.log_time, self._compressed.message(message.data))


_Chunk = tuple[McapScan, ChunkIndex, set[tuple[str, str]]]


class SqliteStorage:
    """A bag of `ros2 bag record` in SQLite; its file is never written, and nothing beside it is read."""

    def __init__(self, files: list[Path], compressed: Compressed) -> None:
        self.definitions: dict[str, Definition] = {}
        self.damage = ""
        self.files = files
        self._compressed = compressed

    def messages(self) -> Iterator[StoredMessage]:
        """All messages, file after file, each in order of time."""
        for file in self.files:
            try:
                yield from self._messages_of(file)
            except (sqlite3.Error, UnicodeDecodeError, TypeError, ValueError) as problem:
                raise BagError(f"bag {file}: cannot be read: {problem}") from None
            except OSError as problem:
                raise BagError(f"bag {file}: cannot be read: {problem.strerror}") from None

    def stretch(self, wanted: Stretch) -> None:
        """There is no index by step."""

    def _messages_of(self, file: Path) -> Iterator[StoredMessage]:
        content = self._compressed.content_of(file)
        with closing(_connected(file, content)) as database:
            columns = {row[1] for row in database.execute("PRAGMA table_info(message_definitions)")}
            if columns:
                _check_table(database, file, "message_definitions")
                definitions = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
                for kind, encoding, text in database.execute(definitions):
                    self.definitions[str(kind)] = Definition(str(encoding), str(text))
            for name in ("topics", "messages"):
                _check_table(database, file, name)
            query = (
                "SELECT topics.name, topics.type, messages.timestamp, messages.data FROM messages "
                "JOIN topics ON messages.topic_id = topics.id ORDER BY messages.timestamp"
            )
            for topic, kind, time, data in database.execute(query):
                yield StoredMessage(str(topic), str(kind), int(time), self._compressed.message(bytes(data)))


class Compressed:
    """Compression of whole files or of messages by `ros2 bag record`; the expanded bytes are limited.

    Parameters
    ----------
    mode : str
        `file`, `message`, or anything else for none.
    limit : int
        Most bytes allowed.
    """

    def __init__(self, mode: str, limit: int) -> None:
        self._mode = mode
        self._limit = limit
        self._expansion = Expansion(limit)

    def content_of(self, file: Path) -> bytes | None:
        """The expanded content of a file; None if it is not compressed."""
        if self._mode != "file":
            return None
        with open_regular(file) as stream:
            return self._expanded(stream.read())

    def message(self, data: bytes) -> bytes:
        """The expanded data of a message."""
        return self._expanded(data) if self._mode == "message" else data

    def _expanded(self, data: bytes) -> bytes:
        try:
            expanded = expand_zstd(data, self._expansion.left)
        except ValueError:
            raise too_much(f"expands to more than {self._limit // MIB} MiB; decompress it with zstd -d") from None
        except zstandard.ZstdError as problem:
            raise OSError(errno.EIO, f"is not compressed by Zstandard, or damaged: {problem}") from None
        self._expansion.take(len(expanded))
        return expanded


def _connected(file: Path, content: bytes | None) -> sqlite3.Connection:
    """A database to be read only: no journal beside it is played back, no function of its views is trusted."""
    if content is None:
        open_regular(file).close()  # refuses pipes and devices
        database = sqlite3.connect(f"file:{quote(str(file.absolute()))}?immutable=1&mode=ro", uri=True)
    else:
        database = sqlite3.connect(":memory:")
        database.deserialize(content)
    database.execute("PRAGMA trusted_schema = OFF")
    database.execute("PRAGMA temp_store = MEMORY")
    return database


def _check_table(database: sqlite3.Connection, file: Path, name: str) -> None:
    """Refuse a view, a virtual table or a generated column in the place of a table: it computes its rows."""
    statement = database.execute("SELECT sql FROM sqlite_master WHERE type = 'table' AND name = ?", (name,)).fetchone()
    if statement is None or not re.match(r"\s*CREATE\s+TABLE\b", str(statement[0]), re.IGNORECASE):
        raise BagError(f"bag {file}: cannot be read: it has no table {name}, or is incomplete")
    if any(hidden for *_, hidden in database.execute(f"PRAGMA table_xinfo({name})")):
        raise BagError(f"bag {file}: cannot be read: columns of its table {name} are computed, not stored")


def description_of(folder: Path) -> dict[str, Any]:
    """Content of `metadata.yaml`; empty if it is missing or broken, as after a crash of the recorder."""
    try:
        content = yaml.safe_load(read_text(folder / "metadata.yaml", 16 * MIB))
        description = content["rosbag2_bagfile_information"]
    except (OSError, ValueError, yaml.YAMLError, KeyError, TypeError, RecursionError):
        return {}
    return description if isinstance(description, dict) else {}


def files_by_number(files: Iterator[Path]) -> list[Path]:
    """Files of a split bag, name_0, name_1 ... name_10, in that order."""

    def number(file: Path) -> tuple[int, str]:
        ending = re.search(r"_(\d+)$", file.stem)
        return (int(ending[1]) if ending else -1, file.name)

    return sorted(files, key=number)
