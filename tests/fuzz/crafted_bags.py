"""Crafted bags: MCAP, SQLite and their metadata."""

from __future__ import annotations

import sqlite3
import struct
from pathlib import Path

import lz4.frame
import yaml
import zstandard
from mcap.writer import CompressionType, Writer

from tests.fuzz.crafted import GIB, LOOP, crafted


def _mcap(path: Path, definition: str, data: bytes, count: int, compression: CompressionType) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream, compression=compression, chunk_size=1 << 30)
        writer.start(profile="ros2", library="crafted")
        schema = writer.register_schema(LOOP, "ros2msg", definition.encode())
        channel = writer.register_channel("/amb/telemetry", "cdr", schema)
        for index in range(count):
            writer.add_message(channel, index, data, index, index)
        writer.finish()


TINY = "amb_msgs/Tiny[] s\n" + "=" * 80 + "\nMSG: amb_msgs/Tiny\nuint8 a\n"


@crafted("tiny.mcap")
def _tiny(path: Path) -> None:
    size = 60_000_000
    _mcap(path, TINY, struct.pack("<II", 0x100, size) + bytes(size), 1, CompressionType.ZSTD)


@crafted("empty_fields.mcap")
def _empty_fields(path: Path) -> None:
    definition = "amb_msgs/Tiny[4000000000] s\n" + "=" * 80 + "\nMSG: amb_msgs/Tiny\n"
    _mcap(path, definition, struct.pack("<II", 0x100, 4_000_000_000), 1, CompressionType.NONE)


@crafted("fixed.mcap")
def _fixed(path: Path) -> None:
    _mcap(path, "float64[4000000000] s\n", struct.pack("<II", 0x100, 1), 1, CompressionType.NONE)


@crafted("recursive.mcap")
def _recursive(path: Path) -> None:
    _mcap(path, f"{LOOP.replace('/msg', '')}[] s\n", struct.pack("<II", 0x100, 1) + bytes(64), 3, CompressionType.NONE)


@crafted("deep_types.mcap")
def _deep_types(path: Path) -> None:
    texts = ["amb_msgs/T0 s\n"]
    texts += [f"MSG: amb_msgs/T{index}\namb_msgs/T{index + 1} s\n" for index in range(2_000)]
    texts += ["MSG: amb_msgs/T2000\nuint8 a\n"]
    _mcap(path, ("=" * 80 + "\n").join(texts), bytes(64), 3, CompressionType.NONE)


@crafted("doubling_types.mcap")
def _doubling_types(path: Path) -> None:
    texts = ["amb_msgs/T0[2] s\n"]
    texts += [f"MSG: amb_msgs/T{index}\namb_msgs/T{index + 1}[2] s\n" for index in range(40)]
    texts += ["MSG: amb_msgs/T40\nuint8 a\n"]
    _mcap(path, ("=" * 80 + "\n").join(texts), bytes(4_000_000), 1, CompressionType.ZSTD)


@crafted("chunks.mcap")
def _chunks(path: Path) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD, chunk_size=50_000_000)
        writer.start(profile="ros2", library="crafted")
        schema = writer.register_schema(LOOP, "ros2msg", b"uint8[] s\n")
        channel = writer.register_channel("/amb/telemetry", "cdr", schema)
        for index in range(40):
            writer.add_message(channel, index, bytes(50_000_000), index, index)
        writer.finish()


def _chunk_that_lies(path: Path, compression: str, data: bytes, declared: int) -> None:
    text = compression.encode()
    body = struct.pack("<QQQII", 0, 1, declared, 0, len(text)) + text + struct.pack("<Q", len(data)) + data
    magic = b"\x89MCAP0\r\n"
    head = struct.pack("<BQ", 1, 8) + struct.pack("<II", 0, 0)
    path.write_bytes(magic + head + struct.pack("<BQ", 6, len(body)) + body)


@crafted("lz4.mcap")
def _lz4(path: Path) -> None:
    _chunk_that_lies(path, "lz4", lz4.frame.compress(bytes(2 * GIB - 1)), 1000)


@crafted("zstd.mcap")
def _zstd(path: Path) -> None:
    _chunk_that_lies(path, "zstd", _zeros(3 * GIB), 1000)


def _zeros(size: int) -> bytes:
    packer = zstandard.ZstdCompressor(level=3).compressobj(size=size)
    part = bytes(1 << 24)
    return b"".join(packer.compress(part) for _ in range(size >> 24)) + packer.flush()


def _metadata(path: Path, **values: object) -> None:
    path.mkdir()
    content = {"version": 9, "storage_identifier": "mcap", "relative_file_paths": ["a.mcap"], **values}
    (path / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": content}))


@crafted("compressed_file")
def _compressed_file(path: Path) -> None:
    _metadata(path, relative_file_paths=["a.mcap.zstd"], compression_format="zstd", compression_mode="FILE")
    (path / "a.mcap.zstd").write_bytes(_zeros(6 * GIB))


@crafted("compressed_database")
def _compressed_database(path: Path) -> None:
    _metadata(
        path,
        storage_identifier="sqlite3",
        relative_file_paths=["a.db3.zstd"],
        compression_format="zstd",
        compression_mode="FILE",
    )
    (path / "a.db3.zstd").write_bytes(_zeros(6 * GIB))


@crafted("numbers_as_files")
def _numbers_as_files(path: Path) -> None:
    _metadata(path, relative_file_paths=[1])


@crafted("parents_as_files")
def _parents_as_files(path: Path) -> None:
    _metadata(path, relative_file_paths=["../../secret.bin", "/etc/passwd", ".."])


@crafted("text_as_files")
def _text_as_files(path: Path) -> None:
    _metadata(path, relative_file_paths="secret.bin")


@crafted("aliases")
def _aliases(path: Path) -> None:
    path.mkdir()
    lines = ["a0: &a0 [x, x]"] + [f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]" for i in range(1, 40)]
    lines += ["rosbag2_bagfile_information:", "  version: 9", "  relative_file_paths: *a39", "  compression_mode: *a39"]
    (path / "metadata.yaml").write_text("\n".join(lines))


@crafted("deep_metadata")
def _deep_metadata(path: Path) -> None:
    path.mkdir()
    (path / "metadata.yaml").write_text("[" * 20_000)


def _database(path: Path, script: str) -> None:
    connection = sqlite3.connect(path)
    connection.executescript(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT, "
        f"offered_qos_profiles TEXT); INSERT INTO topics VALUES(1, '/amb/telemetry', '{LOOP}', 'cdr', '');{script}"
    )
    connection.commit()
    connection.close()


NUMBERS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"


@crafted("view.db3")
def _view(path: Path) -> None:
    _database(
        path, f"CREATE VIEW messages AS {NUMBERS} SELECT i AS id, 1 AS topic_id, i AS timestamp, x'00' AS data FROM n;"
    )


@crafted("generated.db3")
def _generated(path: Path) -> None:
    _database(
        path,
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
        "data BLOB GENERATED ALWAYS AS (zeroblob(900000000)));"
        "INSERT INTO messages(topic_id, timestamp) VALUES(1, 1), (1, 2), (1, 3);",
    )


@crafted("journal.db3")
def _journal(path: Path) -> None:
    _database(path, "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);")
    path.with_name(path.name + "-journal").write_bytes(bytes.fromhex("d9d505f920a163d7") + bytes(504))
