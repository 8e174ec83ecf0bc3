"""What a user names as a file is opened only if it is one, and every other case is one line."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from amb_core.data.analysis import read
from amb_core.ground.errors import AmbError, ParameterError
from amb_core.ground.files.regular_files import read_text
from amb_core.ground.parameters import load_parameters
from amb_core.identification import StateSpaceModel
from amb_core.plant import ModalData, PlantParameters
from amb_core.plant.bh_table import read_bh_table
from amb_core.recording import Recording
from amb_core.regions.region_map import RegionMap

READERS: dict[str, Callable[[Path], object]] = {
    ".yaml": lambda path: load_parameters(PlantParameters, path, "simulator"),
    ".json": StateSpaceModel.load,
    ".npz": read,
    ".csv": read,
    ".mat": read,
    ".mcap": Recording.read,
}


@pytest.fixture
def odd(tmp_path: Path) -> Callable[[str, str], Path]:
    """Makes what is no regular file, with the ending that its reader wants."""

    def make(kind: str, ending: str) -> Path:
        path = tmp_path / f"odd{ending}"
        if kind == "pipe":
            os.mkfifo(path)
        elif kind == "folder":
            path.mkdir()
        elif kind == "socket":
            listener = socket.socket(socket.AF_UNIX)
            listener.bind(str(path))
            listener.close()
        elif kind == "device":
            path.symlink_to("/dev/full")
        elif kind == "loop":
            path.symlink_to(path)
        elif kind == "long":
            return tmp_path / ("x" * 5000 + ending)
        elif kind == "nul":
            return tmp_path / f"a\0b{ending}"
        return path

    return make


@pytest.mark.timeout(20)  # opening a pipe without a writer would wait for ever
@pytest.mark.parametrize("kind", ["pipe", "folder", "socket", "device", "loop", "long", "nul", "missing"])
@pytest.mark.parametrize("ending", READERS)
def test_what_is_no_regular_file_is_one_line(odd: Callable[[str, str], Path], kind: str, ending: str) -> None:
    with pytest.raises(AmbError) as caught:
        READERS[ending](odd(kind, ending))
    message = str(caught.value)
    assert message.isprintable()
    assert len(message) < 1000


@pytest.mark.timeout(20)
@pytest.mark.parametrize("kind", ["pipe", "folder", "device", "long", "nul"])
@pytest.mark.parametrize("reader", [RegionMap.load, ModalData.load, read_bh_table])
def test_other_readers_too(odd: Callable[[str, str], Path], kind: str, reader: Callable[[Path], object]) -> None:
    with pytest.raises(AmbError) as caught:
        reader(odd(kind, ".npz"))
    assert str(caught.value).isprintable()


def test_the_reason_is_named(odd: Callable[[str, str], Path]) -> None:
    with pytest.raises(ParameterError, match=r"odd\.yaml: cannot be read: is a pipe; a regular file is needed"):
        READERS[".yaml"](odd("pipe", ".yaml"))


def test_a_file_above_the_limit_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "large"
    with path.open("wb") as file:
        file.truncate(1 << 40)  # sparse
    with pytest.raises(OSError, match="too large; allowed: at most 1 MiB"):
        read_text(path)


def test_a_file_that_claims_no_size_is_bounded_too() -> None:
    with pytest.raises(OSError, match="too large; allowed: at most 10 bytes"):
        read_text("/proc/self/status", 10)


def test_a_text_in_another_encoding_is_refused_with_the_place(tmp_path: Path) -> None:
    path = tmp_path / "latin"
    path.write_bytes(b"ab\xe9")
    with pytest.raises(OSError, match=r"not a text in UTF-8: .* at byte 2"):
        read_text(path)


def test_a_byte_order_mark_is_no_content(tmp_path: Path) -> None:
    path = tmp_path / "windows"
    path.write_text("a: 1", encoding="utf-8-sig")
    assert read_text(path) == "a: 1"


@pytest.mark.parametrize("load", [RegionMap.load, StateSpaceModel.load])
def test_deep_nesting_in_json_is_one_line(tmp_path: Path, load: Callable[[Path], object]) -> None:
    path = tmp_path / "deep.json"
    path.write_text("[" * 200_000)
    with pytest.raises(AmbError) as caught:
        load(path)
    assert str(caught.value).isprintable()
