"""Crafted tables and models: MATLAB, NumPy, Parquet, text, JSON."""

from __future__ import annotations

import io
import os
import struct
import zipfile
import zlib
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet

from tests.fuzz.crafted import GIB, SECRET, crafted


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


@crafted("deep.json")
def _deep_json(path: Path) -> None:
    path.write_text('{"a": ' + "[" * 200_000)


@crafted("digits.json")
def _digits_json(path: Path) -> None:
    path.write_text('{"samples": ' + "9" * 1_000_000 + "}")


@crafted("bomb_model.npz")
def _bomb_model(path: Path) -> None:
    _bomb_npz(path)
