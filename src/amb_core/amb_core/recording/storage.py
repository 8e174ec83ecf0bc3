"""The files of a bag: messages as stored, from possibly incomplete MCAP files and from other formats of rosbag2."""

from __future__ import annotations

import re
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import yaml
from rosbags.interfaces import MessageDefinitionFormat
from rosbags.rosbag2 import Reader, ReaderError

from amb_core.errors import BagError
from amb_core.files.regular_files import MIB, read_text, shown
from amb_core.recording.mcap_scan import McapScan


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
    mode = mode_of(path)
    if stat.S_ISDIR(mode):
        return _storage_of_folder(path)
    if stat.S_ISREG(mode) and path.suffix == ".mcap":
        return McapStorage([path])
    if stat.S_ISREG(mode) and path.suffix == ".db3":
        return RosbagsStorage(path)
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
    if description.get("storage_identifier") == "sqlite3" or description.get("compression_mode"):
        return RosbagsStorage(path)
    listed = description.get("relative_file_paths")
    files = [path / Path(name).name for name in listed] if listed else files_by_number(path.glob("*.mcap"))
    if missing := [file.name for file in files if not file.exists()]:
        raise BagError(f"bag {path}: metadata.yaml lists {', '.join(missing)}, which does not exist")
    if files:
        return McapStorage(files)
    databases = files_by_number(path.glob("*.db3"))
    if len(databases) == 1:
        return RosbagsStorage(databases[0])
    raise BagError(f"bag {path}: not a bag; the folder holds neither metadata.yaml nor an .mcap or .db3 file")


class McapStorage:
    """MCAP files read from the beginning, so their end may be missing."""

    def __init__(self, files: list[Path]) -> None:
        self.definitions: dict[str, Definition] = {}
        self.damage = ""
        self.files = files

    def messages(self) -> Iterator[StoredMessage]:
        """All messages that can be read, file after file."""
        damage = []
        for file in self.files:
            scan = McapScan(file)
            for topic, message in scan.messages():
                if topic.type not in self.definitions:
                    self.definitions[topic.type] = Definition(topic.encoding, topic.definition.decode(errors="replace"))
                yield StoredMessage(topic.name, topic.type, message.log_time, message.data)
            damage += scan.damage
        self.damage = "; ".join(damage)


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
        found = re.search(r"_(\d+)$", file.stem)
        return (int(found[1]) if found else -1, file.name)

    return sorted(files, key=number)
