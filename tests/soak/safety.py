"""Random sequences of commands, faults and times against the C target: it makes no jump and keeps its limits."""

from __future__ import annotations

import atexit
import functools
import json
import shutil
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
        counts = run(build(Path(folder)), sequences)
    print(f"safety: {json.dumps(counts)}", flush=True)
    return {"safety": {name: counts[name] for name in ("sequences", "jumps", "limits_broken")}}


def build(folder: Path, source: Path = SOURCE) -> Path:
    """Compile the sequences with a target."""
    program = folder / "target_safety"
    headers, files = (
        tuple((str(file.relative_to(source)), file.read_text()) for file in sorted(source_file))
        for source_file in (source.rglob("*.h"), [*source.glob("*.c"), source / "hosted" / "hosted.c"])
    )
    sequences = Path(__file__).with_name("target_safety.c")
    objects = [_compiled(*file, headers) for file in ((sequences.name, sequences.read_text()), *files)]
    subprocess.run([*COMPILER, "-o", program, *objects, "-lm"], check=True)
    return program


@functools.cache
def _objects() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="target_objects"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


@functools.cache
def _compiled(name: str, text: str, headers: tuple[tuple[str, str], ...]) -> Path:
    """The object file of a source: targets that differ in one file share the others."""
    folder = Path(tempfile.mkdtemp(dir=_objects()))
    for header, content in headers:
        (folder / header).parent.mkdir(parents=True, exist_ok=True)
        (folder / header).write_text(content)
    (folder / name).write_text(text)
    subprocess.run([*COMPILER, f"-I{folder}", "-c", "-o", folder / "object.o", folder / name], check=True)
    return folder / "object.o"


def run(program: Path, sequences: int, seed: int = 1) -> dict[str, Any]:
    """What the program counts; the first findings are on standard error."""
    ended = subprocess.run([program, str(sequences), str(seed)], check=True, stdout=subprocess.PIPE, text=True)
    result: dict[str, Any] = json.loads(ended.stdout)
    return result
