"""The files of a bag: messages as stored, from possibly incomplete MCAP files and from other formats of rosbag2."""

from __future__ import annotations

import re
import stat
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import yaml
import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC
from rosbags.interfaces import MessageDefinitionFormat
from rosbags.rosbag2 import Reader, ReaderError

from amb_core.errors import BagError
from amb_core.files.regular_files import MIB, open_regular, read_text, shown


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


class Storage(Protocol):
    """Files of one bag."""

    definitions: dict[str, Definition]
    """By message type; complete once `messages` has run through."""
    damage: str
    """Why reading stopped before the end; empty for a complete bag. Known at the end of `messages`."""

    def messages(self) -> Iterator[StoredMessage]:
        """All messages in the order in which they were stored."""
        ...


def open_storage(path: Path) -> Storage:
    """The files of the bag at a path: a folder, an `.mcap` or a `.db3` file.

    Raises
    ------
    BagError
        If nothing is there, or it is not a bag.
    """
    mode = _mode_of(path)
    if stat.S_ISDIR(mode):
        return _storage_of_folder(path)
    if stat.S_ISREG(mode) and path.suffix == ".mcap":
        return McapStorage([path])
    if stat.S_ISREG(mode) and path.suffix == ".db3":
        return RosbagsStorage(path)
    raise BagError(f"bag {path}: not a bag; a bag is a folder, an .mcap or a .db3 file")


def _mode_of(path: Path) -> int:
    try:
        return path.stat().st_mode
    except FileNotFoundError:
        raise BagError(f"bag {shown(path)}: there is no such file or folder") from None
    except OSError as problem:
        raise BagError(f"bag {shown(path)}: cannot be read: {problem.strerror}") from None
    except ValueError as problem:  # a NUL in the path
        raise BagError(f"bag {shown(path)}: the path is not allowed: {problem}") from None


def _storage_of_folder(path: Path) -> Storage:
    description = _description(path)
    if description.get("storage_identifier") == "sqlite3" or description.get("compression_mode"):
        return RosbagsStorage(path)
    listed = description.get("relative_file_paths")
    files = [path / Path(name).name for name in listed] if listed else _by_number(path.glob("*.mcap"))
    if missing := [file.name for file in files if not file.exists()]:
        raise BagError(f"bag {path}: metadata.yaml lists {', '.join(missing)}, which does not exist")
    if files:
        return McapStorage(files)
    databases = _by_number(path.glob("*.db3"))
    if len(databases) == 1:
        return RosbagsStorage(databases[0])
    raise BagError(f"bag {path}: not a bag; the folder holds neither metadata.yaml nor an .mcap or .db3 file")


class McapStorage:
    """MCAP files read from the beginning, so their end may be missing."""

    def __init__(self, files: list[Path]) -> None:
        self.definitions: dict[str, Definition] = {}
        self.damage = ""
        self._files = files

    def messages(self) -> Iterator[StoredMessage]:
        """All messages up to the end of each file, or up to the damage."""
        for file in self._files:
            yield from self._messages_of(file)

    def _messages_of(self, file: Path) -> Iterator[StoredMessage]:
        try:
            with open_regular(file) as stream:
                magic = stream.read(len(MCAP0_MAGIC))
                if not MCAP0_MAGIC.startswith(magic):
                    raise BagError(f"bag {file}: not an MCAP file")
                stream.seek(0)
                # A corrupt length must not make the reader allocate more memory than the size of the file.
                reader = StreamReader(stream, validate_crcs=True, record_size_limit=file.stat().st_size)
                yield from self._decoded(reader)
        except OSError as problem:
            raise BagError(f"bag {file}: cannot be read: {problem.strerror}") from None
        except (McapError, ValueError, LookupError, struct.error, zstandard.ZstdError, RuntimeError) as problem:
            # Raised by reader, checksums and decompressors (lz4: RuntimeError) for incomplete data.
            self.damage = f"{file.name} is incomplete or damaged ({type(problem).__name__})"

    def _decoded(self, reader: StreamReader) -> Iterator[StoredMessage]:
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        for record in reader.records:
            if isinstance(record, Schema):
                schemas[record.id] = record
                self.definitions[record.name] = Definition(record.encoding, record.data.decode())
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message):
                channel = channels[record.channel_id]
                yield StoredMessage(channel.topic, schemas[channel.schema_id].name, record.log_time, record.data)


class RosbagsStorage:
    """Bags of `ros2 bag record` in SQLite or compressed form, read by the package rosbags."""

    def __init__(self, path: Path) -> None:
        self.definitions: dict[str, Definition] = {}
        self.damage = ""
        self._path = path

    def messages(self) -> Iterator[StoredMessage]:
        """All messages in order of time."""
        encodings = {MessageDefinitionFormat.MSG: "ros2msg", MessageDefinitionFormat.IDL: "ros2idl"}
        try:
            with Reader(self._path) as reader:
                for connection in reader.connections:
                    encoding = encodings.get(connection.msgdef.format)
                    if encoding:
                        self.definitions[connection.msgtype] = Definition(encoding, connection.msgdef.data)
                for connection, log_time, data in reader.messages():
                    yield StoredMessage(connection.topic, connection.msgtype, log_time, bytes(data))
        except (ReaderError, OSError) as problem:
            raise BagError(f"bag {self._path}: cannot be read: {problem}") from None


def _description(folder: Path) -> dict[str, Any]:
    """Content of `metadata.yaml`; empty if it is missing or broken, as after a crash of the recorder."""
    try:
        content = yaml.safe_load(read_text(folder / "metadata.yaml", 16 * MIB))
        description = content["rosbag2_bagfile_information"]
    except (OSError, ValueError, yaml.YAMLError, KeyError, TypeError, RecursionError):
        return {}
    return description if isinstance(description, dict) else {}


def _by_number(files: Iterator[Path]) -> list[Path]:
    """Files of a split bag, name_0, name_1 ... name_10, in that order."""

    def number(file: Path) -> tuple[int, str]:
        found = re.search(r"_(\d+)$", file.stem)
        return (int(found[1]) if found else -1, file.name)

    return sorted(files, key=number)
