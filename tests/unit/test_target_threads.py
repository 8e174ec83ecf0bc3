"""What sample interrupt and background of the C target share, and how long the background keeps the interrupt out."""

from __future__ import annotations

import json
import struct
import subprocess
from pathlib import Path

import pytest

from amb_core.rig.link import FrameType
from amb_core.rig.link.reference import SOURCE
from tests.target_rig import KEY, golden

FUZZ = Path(__file__).parents[1] / "fuzz"
LONGEST = 8_000  # instructions of x86-64, -O2; also in PORTING.md


def exchange(folder: Path) -> Path:
    path = folder / "exchange"
    frames = b"".join(struct.pack("<H", len(item.frame)) + item.frame for item in golden() if item.from_host)
    path.write_bytes(KEY + frames)
    return path


def build(folder: Path, name: str, *options: str) -> Path:
    program = folder / name
    sources = [FUZZ / f"{name}.c", *SOURCE.glob("*.c")]
    command = ["gcc", "-std=gnu99", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off", "-O2", *options]
    subprocess.run([*command, f"-I{SOURCE}", "-o", program, *sources, "-lm"], check=True)
    return program


def test_nothing_is_shared_without_the_lock(tmp_path: Path) -> None:
    program = build(tmp_path, "target_threads", "-g", "-fsanitize=thread", "-pthread")
    ended = subprocess.run([program, exchange(tmp_path), "40000"], capture_output=True, text=True, timeout=240)
    assert "data race" not in ended.stderr, ended.stderr[:2_000]
    assert ended.returncode == 0, ended.stderr[:2_000]
    assert json.loads(ended.stdout)["counter"] > 100


def test_the_background_keeps_the_interrupt_out_for_a_bounded_number_of_instructions(tmp_path: Path) -> None:
    """Of the longest commands: 16 axes, an upload of 4096 chunks, every trip latched."""
    ended = subprocess.run([build(tmp_path, "target_sections")], capture_output=True, text=True, timeout=240)
    if ended.returncode == 3:
        pytest.skip("the system does not let a process trace its child")
    result = json.loads(ended.stdout)
    assert result.pop("ended") == 0, ended.stderr
    seen = {FrameType(int(kind)) for kind in result}
    assert {FrameType.COMMIT, FrameType.DATA, FrameType.PARAMETERS, FrameType.LEVITATE, FrameType.RECORD} <= seen
    assert max(result.values()) <= LONGEST, result
