"""Files made to hurt their reader: they refer to other files, expand to gigabytes, nest deeply, or never end."""

from __future__ import annotations

import io
import os
import sqlite3
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import lz4.frame
import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet
import yaml
import zstandard
from mcap.writer import CompressionType, Writer

SECRET = b"SECRET-4711-"
"""What the file beside the crafted ones holds; whoever reads it has read elsewhere."""
GIB = 1 << 30
LOOP = "amb_msgs/msg/LoopSamples"

CRAFTED: dict[str, Callable[[Path], None]] = {}
"""Makers of a file or folder at a path, by its name."""


def crafted(name: str) -> Callable[[Callable[[Path], None]], Callable[[Path], None]]:
    """Add a maker."""

    def add(make: Callable[[Path], None]) -> Callable[[Path], None]:
        CRAFTED[name] = make
        return make

    return add


def make_secret(folder: Path) -> Path:
    """The file that nobody may read: numbers that spell the secret."""
    path = folder / "secret.bin"
    path.write_bytes(SECRET * 400)
    return path


def _hdf5(path: Path) -> h5py.File:
    return h5py.File(path, "w", userblock_size=512)


def _closed(path: Path, file: h5py.File) -> None:
    file.close()
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


@crafted("external.mat")
def _external(path: Path) -> None:
    file = _hdf5(path)
    secret = path.parent / "secret.bin"
    file.create_dataset("u", (4800,), "u1", external=[(str(secret), 0, 4800)])
    _closed(path, file)


@crafted("external_pipe.mat")
def _external_pipe(path: Path) -> None:
    pipe = path.parent / "pipe"
    if not pipe.exists():
        os.mkfifo(pipe)
    file = _hdf5(path)
    file.create_dataset("u", (4800,), "u1", external=[(str(pipe), 0, 4800)])
    _closed(path, file)


@crafted("pipe.mat")
def _pipe(path: Path) -> None:
    os.mkfifo(path)


@crafted("pipe.db3")
def _pipe_db3(path: Path) -> None:
    os.mkfifo(path)


@crafted("virtual.mat")
def _virtual(path: Path) -> None:
    other = path.with_name("virtual_source.h5")
    with h5py.File(other, "w") as source:
        source["u"] = np.frombuffer(SECRET * 100, np.uint8)
    layout = h5py.VirtualLayout((1200,), "u1")
    layout[:] = h5py.VirtualSource(str(other), "u", (1200,))
    file = _hdf5(path)
    file.create_virtual_dataset("u", layout)
    _closed(path, file)


@crafted("links.mat")
def _links(path: Path) -> None:
    file = _hdf5(path)
    file["a"], file["b"] = h5py.SoftLink("/b"), h5py.SoftLink("/a")
    file["c"] = h5py.ExternalLink("virtual_source.h5", "/u")
    group = file.create_group("g")
    group["g"] = group
    _closed(path, file)


@crafted("declared.mat")
def _declared(path: Path) -> None:
    file = _hdf5(path)
    file.create_dataset("u", (450_000_000,), "f8", chunks=(1_000_000,), compression="gzip")
    _closed(path, file)


@crafted("cells.mat")
def _cells(path: Path) -> None:
    file = _hdf5(path)
    kind = h5py.special_dtype(ref=h5py.Reference)
    file["x0"] = np.arange(3.0)
    inner = file["x0"]
    refs = file.create_group("#refs#")
    for level in range(3_000):
        cell = refs.create_dataset(str(level), (1, 1), dtype=kind)
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
        cell[0, 0] = inner.ref
        inner = cell
    top = file.create_dataset("u", (1, 1), dtype=kind)
    top[0, 0] = inner.ref
    _closed(path, file)


@crafted("wide_cells.mat")
def _wide_cells(path: Path) -> None:
    """A cell of 30 levels, each twice as wide: 2^30 items from a small file."""
    file = _hdf5(path)
    kind = h5py.special_dtype(ref=h5py.Reference)
    file["x0"] = np.arange(3.0)
    inner = file["x0"]
    for level in range(30):
        cell = file.create_dataset(f"c{level}", (1, 2), dtype=kind)
        cell[0, 0] = cell[0, 1] = inner.ref
        inner = cell
    _closed(path, file)


def _element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def _mat5(path: Path, element: bytes) -> None:
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + element)


def _matrix(name: bytes, kind: int, dims: tuple[int, ...], content: bytes) -> bytes:
    flags = _element(6, struct.pack("<II", kind, 0))
    shape = _element(5, struct.pack(f"<{len(dims)}i", *dims))
    return _element(14, flags + shape + _element(1, name) + content)


@crafted("cells_v5.mat")
def _cells_v5(path: Path) -> None:
    inner = _matrix(b"", 6, (1, 1), _element(9, struct.pack("<d", 1.0)))
    head = len(_matrix(b"", 1, (1, 1), b""))
    levels = 20_000
    parts = []
    length = len(inner)
    for _ in range(levels):
        parts.append(struct.pack("<II", 14, head - 8 + length) + _matrix(b"", 1, (1, 1), b"")[8:])
        length += head
    _mat5(path, _matrix(b"u", 1, (1, 1), b"".join(reversed(parts)) + inner))


@crafted("bomb_v5.mat")
def _bomb_v5(path: Path) -> None:
    packer = zlib.compressobj(9)
    size = 2 * GIB - 4096
    count = (size - 200) // 8
    head = _matrix(b"u", 6, (count, 1), b"")[8:]
    data = packer.compress(struct.pack("<II", 14, len(head) + 8 + 8 * count) + head + struct.pack("<II", 9, 8 * count))
    zeros = bytes(1 << 20)
    data += b"".join(packer.compress(zeros) for _ in range(8 * count >> 20)) + packer.compress(
        bytes(8 * count % (1 << 20))
    )
    data += packer.flush()
    _mat5(path, struct.pack("<II", 15, len(data)) + data)


@crafted("dims_v5.mat")
def _dims_v5(path: Path) -> None:
    _mat5(path, _matrix(b"u", 6, (2_000_000_000, 2), _element(9, struct.pack("<d", 1.0))))


def _npy_head(shape: tuple[int, ...], kind: str = "<f8") -> bytes:
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": kind, "fortran_order": False, "shape": shape})
    return head.getvalue()


@crafted("bomb.npz")
def _bomb_npz(path: Path) -> None:
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("u.npy", "w", force_zip64=True) as file,
    ):
        file.write(_npy_head((2 * GIB // 8,)))
        for _ in range(2048):
            file.write(bytes(1 << 20))


@crafted("declared.npz")
def _declared_npz(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("u.npy", _npy_head((1 << 40,)) + bytes(80))


@crafted("declared.npy")
def _declared_npy(path: Path) -> None:
    path.write_bytes(_npy_head((1 << 34,)) + bytes(80))


@crafted("bytes.npz")
def _bytes_npz(path: Path) -> None:
    """A hundred million numbers of one byte, which take eight as a double."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("u.npy", _npy_head((100_000_000,), "|u1") + bytes(100_000_000))


@crafted("many.npz")
def _many_npz(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        for index in range(30_000):
            archive.writestr(f"{index}.npy", _npy_head((3,)) + bytes(24))


@crafted("pickle.npy")
def _pickle(path: Path) -> None:
    np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)


@crafted("bomb.parquet")
def _bomb_parquet(path: Path) -> None:
    schema = pa.schema([(f"c{index}", pa.float64()) for index in range(4)])
    zeros = pa.table([np.zeros(4_000_000)] * 4, schema=schema)
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        for _ in range(30):
            writer.write_table(zeros)


@crafted("lists.parquet")
def _lists_parquet(path: Path) -> None:
    kind = pa.float64()
    for _ in range(90):
        kind = pa.list_(kind)
    parquet.write_table(pa.table({"u": pa.nulls(5, kind), "x": np.zeros(5)}), path)


@crafted("wide.csv")
def _wide_csv(path: Path) -> None:
    path.write_text(",".join(["1"] * 4_000_000) + "\n" + ",".join(["2"] * 4_000_000) + "\n")


@crafted("digits.csv")
def _digits_csv(path: Path) -> None:
    path.write_text("t,u,y\n" + "".join(f"{'9' * 900_000},1,2\n" for _ in range(20)))


@crafted("quotes.csv")
def _quotes_csv(path: Path) -> None:
    path.write_text('t,u,y\n"' + "1,2,3\n" * 1_000_000)


@crafted("own.csv")
def _own_csv(path: Path) -> None:
    path.write_text('# amb_core {"input_names": ' + "[" * 100_000 + "\nexperiment,time [s]\n0,0\n")


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


@crafted("deep.json")
def _deep_json(path: Path) -> None:
    path.write_text('{"a": ' + "[" * 200_000)


@crafted("digits.json")
def _digits_json(path: Path) -> None:
    path.write_text('{"samples": ' + "9" * 1_000_000 + "}")


@crafted("bomb_model.npz")
def _bomb_model(path: Path) -> None:
    _bomb_npz(path)
