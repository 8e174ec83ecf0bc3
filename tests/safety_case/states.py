"""Every state that the compiled target can reach with a small configuration, found by trying everything in each.

`python -m tests.safety_case.states` writes tests/data/target/states.json anew, a minute of processor time: only after a
change of the target or of the search, whose hash stands in that file.
"""

from __future__ import annotations

import functools
import hashlib
import json
import subprocess
import tempfile
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from amb_core.rig.link.reference import SOURCE

HERE = Path(__file__).parent
RECORDED = HERE.parents[1] / "tests" / "data" / "target" / "states.json"
PARTS = ("host", "gains", "faults", "excitation", "matrices", "references")
"""What is tried, the longest first; see `part_of` in tried.h."""

COMPILER = (
    "gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off", "-O2",
    "-DAMB_AXES=1", "-DAMB_ORDER=1", "-DAMB_MATRICES=8", "-DAMB_CHUNKS=1",
)  # fmt: skip


def build(folder: Path, source: Path = SOURCE) -> Path:
    """Compile the search with a target.

    Parameters
    ----------
    folder : Path
        For the program.
    source : Path, optional
        The target in C.

    Returns
    -------
    Path
        The program.
    """
    program = folder / "states"
    files = [HERE / "states.c", *sorted(source.glob("*.c"))]
    subprocess.run([*COMPILER, f"-I{source}", "-o", program, *files, "-lm"], check=True)
    return program


def searched() -> str:
    """What the result of the search depends on.

    Returns
    -------
    str
        SHA-256 of the sources of target and search, and of how they are compiled.
    """
    digest = hashlib.sha256(repr((COMPILER, PARTS)).encode())
    for path in sorted([*HERE.glob("*.[ch]"), *SOURCE.glob("*.[ch]")], key=lambda path: path.name):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()


def search(program: Path, part: str, most: int | None = None) -> dict[str, Any]:
    """What the program finds; the first checks that fail are on standard error.

    Parameters
    ----------
    program : Path
        From `build`.
    part : str
        One of `PARTS`.
    most : int, optional
        States after which it gives up.

    Returns
    -------
    dict
        Counts, and what each command and each step did in each state.
    """
    arguments = [program, part, *([] if most is None else [str(most)])]
    ended = subprocess.run(arguments, check=True, stdout=subprocess.PIPE, text=True)
    result: dict[str, Any] = json.loads(ended.stdout)
    return result


def search_all() -> list[dict[str, Any]]:
    """All parts, two at a time.

    Returns
    -------
    list of dict
        As `search` does, in the order of `PARTS`.
    """
    with tempfile.TemporaryDirectory(prefix="target_states") as folder, ThreadPoolExecutor(2) as pool:
        program = build(Path(folder))
        return list(pool.map(lambda part: search(program, part), PARTS))


def recorded() -> list[dict[str, Any]]:
    """The parts as they were found last; tests compare them, and what was searched, with the code.

    Returns
    -------
    list of dict
        As `search_all`.
    """
    result: list[dict[str, Any]] = _file()["parts"]
    return result


def recorded_of() -> str:
    """What `searched` returned then."""
    return str(_file()["searched"])


@functools.cache
def _file() -> dict[str, Any]:
    content: dict[str, Any] = json.loads(RECORDED.read_text())
    return content


def total(name: str, parts: Iterable[dict[str, Any]] | None = None) -> int:
    """The sum of a count over all parts.

    Parameters
    ----------
    name : str
        Of the count.
    parts : iterable of dict, optional
        By default those recorded.

    Returns
    -------
    int
        The sum.
    """
    return sum(int(part[name]) for part in (recorded() if parts is None else parts))


def main() -> None:
    """Record what is found."""
    rows = ",\n".join(json.dumps(part) for part in search_all())
    RECORDED.write_text(f'{{"searched": "{searched()}", "parts": [\n{rows}]}}\n')


if __name__ == "__main__":
    main()
