"""Files of others are read in a child process: what ends the child is an error of the file, and nothing else."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from amb_core.data.analysis import read
from amb_core.data.tables import load_content
from amb_core.ground.errors import AmbError, BagError, IdentificationError
from amb_core.ground.files import apart, limits
from amb_core.ground.files.matlab import load_variables
from amb_core.recording import BagWriter, Recording, inspect_bag
from tests.fuzz.crafted_files import CRAFTED, SECRET, make_secret


@pytest.fixture
def made(tmp_path: Path) -> Callable[[str], Path]:
    def make(name: str) -> Path:
        make_secret(tmp_path)
        CRAFTED[name](tmp_path / name)
        return tmp_path / name

    return make


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("external.mat", "its data in other files"),
        ("external_pipe.mat", "its data in other files"),
        ("virtual.mat", "its data in other files|Too many open files|is damaged"),
        ("links.mat", "is a link"),
        ("pipe.mat", "is a pipe"),
        ("declared.mat", "more than"),
        ("cells.mat", "nested deeper than 32"),
        ("wide_cells.mat", "more than 20000 items"),
        ("cells_v5.mat", "nested|process that read it has ended"),
        ("declared.npz", "more than|damaged"),
        ("bytes.npz", "more than 128 MiB of numbers"),
        ("many.npz", "more than 4096 signals"),
        ("wide.csv", "has a line of"),
        ("own.csv", "nested too deeply"),
    ],
)
def test_a_hostile_table_is_refused_in_one_line(made: Callable[[str], Path], name: str, reason: str) -> None:
    with pytest.raises(IdentificationError, match=reason) as refusal:
        read(made(name))
    assert SECRET.decode() not in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_what_several_cells_of_a_matlab_file_refer_to_is_in_each_of_them(tmp_path: Path) -> None:
    path = tmp_path / "shared.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        numbers, other = file.create_dataset("x", data=[[1.0, 2.0, 3.0]]), file.create_dataset("z", data=[[4.0]])
        inner = file.create_dataset("inner", (1, 2), dtype=h5py.ref_dtype)
        inner[0, 0], inner[0, 1] = numbers.ref, other.ref
        outer = file.create_dataset("outer", (1, 3), dtype=h5py.ref_dtype)
        outer[0, 0], outer[0, 1], outer[0, 2] = inner.ref, inner.ref, numbers.ref
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    outer_cell = load_variables(path)["outer"]
    assert outer_cell.shape == (1, 3)
    for cell in outer_cell[0, :2]:
        assert [item.ravel().tolist() for item in cell.ravel()] == [[1.0, 2.0, 3.0], [4.0]]
    assert outer_cell[0, 2].ravel().tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("numbers_as_files", "relative_file_paths in metadata.yaml must be a list of file names"),
        ("text_as_files", "relative_file_paths in metadata.yaml must be a list of file names"),
        ("parents_as_files", "must be a list of file names|which does not exist"),
        ("aliases", "must be a list of file names"),
        ("deep_metadata", "not a bag"),
        ("view.db3", "has no table messages"),
        ("generated.db3", "computed, not stored"),
        ("lz4.mcap", "cannot be read"),
        ("pipe.db3", "not a bag"),
    ],
)
def test_a_hostile_bag_is_refused_in_one_line(made: Callable[[str], Path], name: str, reason: str) -> None:
    path = made(name)
    for reader in (Recording.read, inspect_bag):
        with pytest.raises(BagError) as refusal:
            reader(path).telemetry() if reader is Recording.read else _all_of(reader(path))
        if reader is Recording.read:
            assert re.search(reason, str(refusal.value)), refusal.value


def _all_of(state: object) -> None:
    """A damaged bag may be inspected; nothing of it can be recovered."""
    raise BagError(str(state)[:100])


def test_the_reader_ends_and_the_next_file_is_read(made: Callable[[str], Path], tmp_path: Path) -> None:
    with pytest.raises(AmbError):
        read(made("cells_v5.mat"))
    np.savez(tmp_path / "good.npz", u=np.arange(6.0), Ts=0.1)
    assert len(load_content(tmp_path / "good.npz")["u"]) == 6


def test_a_child_that_waits_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    few = limits.ReadLimits(expanded=1 << 20, values=1 << 20, texts=1 << 20, memory=1 << 28, seconds=0.1)
    monkeypatch.setattr(apart, "limits_for", lambda _: few)
    os.mkfifo(tmp_path / "pipe")
    reader = apart.Apart("pathlib:Path", tmp_path / "pipe")
    with pytest.raises(OSError, match="the process that read it has ended"):
        reader.call("read_bytes")


LIMITED = """
import dataclasses, resource, sys
from pathlib import Path
from amb_core.data.tables import load_content
from amb_core.ground.files import apart, limits
apart.limits_for = lambda path: dataclasses.replace(limits.limits_for(path), memory=1 << 40)
number, limit = getattr(resource, sys.argv[2]), int(sys.argv[3])
resource.setrlimit(number, (limit, limit))
print(load_content(Path(sys.argv[1]))["u"].tolist())
"""


@pytest.mark.parametrize(
    ("resource", "limit"),
    [("RLIMIT_CPU", 3_000), ("RLIMIT_AS", 30 << 30), ("RLIMIT_FSIZE", 0), ("RLIMIT_NOFILE", 200)],
)
def test_files_are_read_under_hard_limits_of_the_user(tmp_path: Path, resource: str, limit: int) -> None:
    np.savez(tmp_path / "good.npz", u=np.arange(3.0), Ts=0.1)
    limited = [sys.executable, "-c", LIMITED, str(tmp_path / "good.npz"), resource, str(limit)]
    process = subprocess.run(limited, capture_output=True, text=True, check=False)
    assert process.stdout == "[0.0, 1.0, 2.0]\n", process.stderr


def test_a_child_writes_no_file(tmp_path: Path) -> None:
    reader = apart.Apart("pathlib:Path", tmp_path / "file")
    with pytest.raises(OSError, match="too large"):
        reader.call("write_text", "data")
    assert (tmp_path / "file").stat().st_size == 0


def test_a_reader_that_is_not_there_is_an_error_of_the_file(tmp_path: Path) -> None:
    with pytest.raises(apart.UnreadableError, match="nowhere"):
        apart.read_apart("nowhere:nothing", tmp_path)


def test_a_server_that_has_ended_is_started_again(tmp_path: Path) -> None:
    np.savez(tmp_path / "good.npz", u=np.arange(6.0), Ts=0.1)
    assert len(load_content(tmp_path / "good.npz")["u"]) == 6
    server = apart._server
    assert server._process is not None
    server._process.kill()
    server._process.wait()
    assert len(load_content(tmp_path / "good.npz")["u"]) == 6


def test_a_damaged_definition_affects_only_its_messages(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/a", "amb_msgs/msg/Made", "uint8 a\n")
        bag.write("/a", b"\x00\x01\x00\x00\x07", 1)
    assert [item.a for item in Recording.read(tmp_path / "bag").messages_of("/a")] == [7]


def test_variables_have_their_shapes(tmp_path: Path) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "a.mat", {"s": {"u": np.ones((3, 2)), "name": "rig"}, "c": np.array([[1 + 2j]])})
    variables = load_variables(tmp_path / "a.mat")
    assert variables["s"]["u"].shape == (3, 2)
    assert str(variables["s"]["name"][0]) == "rig"
    assert variables["c"].item() == 1 + 2j
