"""Random sequences of commands, faults and times against the C target: it makes no jump and keeps its limits."""

from __future__ import annotations

import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from amb_core.rig.link.reference import SOURCE

COMPILER = (
    "gcc", "-std=c99", "-D_XOPEN_SOURCE=600", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off", "-O2",
    "-fsanitize=undefined", "-fno-sanitize-recover=all",
)  # fmt: skip


def safety(sequences: int = 100_000) -> dict[str, Any]:
    """So many sequences; jumps of reference or gains, and limits broken.

    Parameters
    ----------
    sequences : int, optional
        Each of up to two dozen commands after a levitation, most of them with faults.
    """
    with tempfile.TemporaryDirectory(prefix="target_safety") as folder:
        found = run(build(Path(folder)), sequences)
    print(f"safety: {json.dumps(found)}", flush=True)
    return {"safety": {name: found[name] for name in ("sequences", "jumps", "limits_broken")}}


def build(folder: Path, source: Path = SOURCE) -> Path:
    """Compile the sequences with a target."""
    program = folder / "target_safety"
    files = [Path(__file__).with_name("target_safety.c"), *source.glob("*.c"), source / "hosted" / "hosted.c"]
    subprocess.run([*COMPILER, f"-I{source}", "-o", program, *files, "-lm"], check=True)
    return program


def run(program: Path, sequences: int, seed: int = 1) -> dict[str, Any]:
    """What the program counts; the first findings are on standard error."""
    ended = subprocess.run([program, str(sequences), str(seed)], check=True, stdout=subprocess.PIPE, text=True)
    found: dict[str, Any] = json.loads(ended.stdout)
    return found
