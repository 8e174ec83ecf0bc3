"""Partial results that survive an interruption: a line of JSON for each loop or experiment.

They lie in a folder named by the code that made them, so a run resumes what the same code has measured, and nothing
else.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[3]
_SAID = 10  # times a part reports its progress


@dataclass(frozen=True)
class Size:
    """How much is measured, and the folder in which partial results are kept."""

    folder: Path
    runs: int = 200  # loops, and experiments on each plant
    steps: int = 10_000  # of an experiment
    sampled: int = 400  # models of the sampled bound
    repetitions: int = 3  # of what is timed
    frequencies: int = 500
    identification: float = 12.0  # s, on the nonlinear simulator
    sweep: float = 20.0  # s, there


def say(text: str) -> None:
    """Progress, to the terminal."""
    print(text, file=sys.stderr, flush=True)


def code_version() -> str:
    """Hash of everything that a result depends on: amb_core, this benchmark, and the plants of the other."""
    digest = hashlib.sha256()
    folders = ("src/amb_core/amb_core", "tests/benchmarks/robust", "tests/benchmarks/ident")
    for path in sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py")):
        digest.update(str(path.relative_to(ROOT)).encode() + path.read_bytes())
    return digest.hexdigest()[:12]


def records(part: str, size: Size, count: int, measure: Callable[[int], dict[str, Any]]) -> list[dict[str, Any]]:
    """What `measure` returns for 0 to count - 1; what is kept already is not measured again."""
    path = size.folder / code_version() / f"{part.replace(' ', '_')}.jsonl"
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = path.read_text().splitlines() if path.exists() else []
    kept = {item["seed"]: item for item in (json.loads(line) for line in lines if line.endswith("}"))}
    if kept:
        say(f"{part}: {len(kept)} of {count} are kept from an earlier run")
    for seed in range(count):
        if seed not in kept:
            kept[seed] = {"seed": seed, **measure(seed)}
            with path.open("a") as file:
                file.write(json.dumps(kept[seed]) + "\n")
            if (seed + 1) % max(1, count // _SAID) == 0:
                say(f"{part}: {seed + 1} of {count}")
    return [kept[seed] for seed in range(count)]
