"""`make fuzz-files`: what a stranger can reach; adds to results/security.json.

Damaged and hostile files through commands and service, a stranger's node beside a rig, hostile names on pages.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import multiprocessing
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tests.benchmarks.skipped import Skipped
from tests.front_door.results import results_file
from tests.fuzz import pages, peers
from tests.fuzz.crafted_files import CRAFTED, SECRET, make_secret
from tests.written_bags import BLOCK

QUICK = 3  # crafted files and mutants of the smallest size
DATA = Path(__file__).parents[1] / "data" / "own_data"
LARGEST = 1 << 30
"""Memory that a process may have had (B)."""
SECONDS = 20.0
"""Processor time that a file may take (s)."""
EACH_COMMAND = 40
"""One mutant of so many goes through a whole command; the others through the part of it that reads."""


PATIENCE = 600.0
"""Longest wait for an answer on a loaded machine (s)."""
BATCH = 200
"""Files in one process."""


class Job(NamedTuple):
    """A file and what is done with it."""

    name: str
    make: Callable[[], Path]
    action: Callable[[Path], str]


@dataclass
class Found:
    """What was found: counts, and the files that are to blame."""

    mutants: int = 0
    crafted: int = 0
    tracebacks: int = 0
    crashes: int = 0
    over_limits: int = 0
    escaped: int = 0
    blamed: list[str] = field(default_factory=list)

    def add(self, outcome: dict[str, str], name: str, report: Callable[[str], None]) -> None:
        """Count and report the outcome of a file."""
        for kind, text in outcome.items():
            setattr(self, kind, getattr(self, kind) + 1)
            self.blamed.append(f"{kind}: {name}: {text}")
            report(self.blamed[-1])

    @property
    def counts(self) -> dict[str, int]:
        """The counts alone."""
        return {name: value for name, value in vars(self).items() if isinstance(value, int)}


def seeds(folder: Path) -> list[Path]:
    """Whole files of all kinds."""
    from amb_core.data.analysis import read
    from amb_core.data.experiments import write_data
    from tests.unit.conftest import LinearBearing
    from tests.written_bags import write_telemetry

    paths = [path for path in sorted(DATA.iterdir()) if path.suffix not in (".py", "")]
    paths += [path / f"{path.name}.mcap" for path in sorted(DATA.iterdir()) if path.is_dir()]
    telemetry = write_telemetry(folder / "telemetry", [(1, BLOCK * number) for number in range(6)])
    paths += [telemetry / "telemetry_0.mcap", _database(folder / "database")]
    model = LinearBearing().model
    for ending in (".json", ".npz", ".mat"):
        model.save(folder / f"model{ending}")
        paths.append(folder / f"model{ending}")
    data = read(telemetry).data
    for ending in (".csv", ".npz", ".mat"):
        write_data(data, folder / f"written{ending}")
        paths.append(folder / f"written{ending}")
    return [path for path in paths if path.stat().st_size < 1 << 20]


def _database(folder: Path) -> Path:
    """Telemetry as `ros2 bag record` stores it in SQLite."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    from tests.written_bags import LOOP_SAMPLES, TYPES, block

    with Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/amb/telemetry", LOOP_SAMPLES, typestore=TYPES)
        for number in range(6):
            writer.write(connection, number, block(1, BLOCK * number))
    return folder / "database.db3"


def mutated(content: bytes, chance: random.Random) -> bytes:
    """A content with a few changes: bytes, lengths, parts that are cut, doubled or moved."""
    data = bytearray(content)
    for _ in range(chance.choice((1, 1, 2, 4, 16))):
        if not data:
            break
        where = chance.randrange(len(data))
        if chance.random() < 0.3:
            where = min(where, chance.randrange(1, 512)) % len(data)  # headers
        match chance.randrange(7):
            case 0:
                data[where] ^= 1 << chance.randrange(8)
            case 1:
                data[where] = chance.choice((0, 1, 0x7F, 0x80, 0xFF, chance.randrange(256)))
            case 2:
                size = chance.choice((2, 4, 8))
                value = chance.choice((0, 1, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1, 2**64 - 1))
                data[where : where + size] = value.to_bytes(8, "little")[:size]
            case 3:
                del data[where:]
            case 4:
                del data[where : where + chance.randrange(1, 64)]
            case 5:
                data[where:where] = data[where : where + chance.randrange(1, 256)]
            case _:
                stop = min(len(data), where + chance.randrange(1, 64))
                data[where:stop] = bytes(chance.randrange(256) for _ in range(stop - where))
    return bytes(data)


def read_as_commands_do(path: Path) -> str:
    """The part of commands that reads a file; what they show of it."""
    from rich.console import Console

    from amb_bringup.commands.bag import _runs, _topics
    from amb_bringup.commands.own_data import DataOptions
    from amb_core.data.tables import ENDINGS
    from amb_core.ground.files.file_errors import reading
    from amb_core.ground.files.matlab import load_variables
    from amb_core.identification import StateSpaceModel
    from amb_core.recording import Recording
    from amb_core.recording.run_overview import read_runs

    console = Console(file=open(os.devnull, "w"), width=200)  # noqa: PTH123, SIM115
    if path.stem.startswith("model") or path.suffix == ".json":
        return str(StateSpaceModel.load(path))
    if path.suffix == ".mat":
        with reading("data", path):
            variables = load_variables(path)
        numbers = {name: np.ravel(value)[:20].tolist() for name, value in variables.items()}
        return f"{numbers} {DataOptions({'controller': 'none'}).read(console, path)}"
    if path.suffix in ENDINGS:
        return str(DataOptions({"controller": "none"}).read(console, path))
    recording = Recording.read(path)
    console.print(_topics(recording.topics))
    console.print(_runs(read_runs(path)[0]))
    return f"{recording.parameters()} {recording.machine()} {recording.regions()} {recording.model()}"


def commands_for(path: Path) -> list[list[str]]:
    """Whole commands for a file, with OUT in the place of a new folder."""
    if path.stem.startswith("model") or path.suffix == ".json":
        return [["model", "export", str(path), "--python", "--out", "OUT/m.py"]]
    calls = [["identify", str(path), "--controller", "none", "--order", "2", "--out", "OUT/model.json"]]
    if path.suffix in ("", ".mcap", ".db3"):
        calls += [["bag", "info", str(path)], ["bag", "recover", str(path), "--out", "OUT/bag"]]
        calls += [["bag", "export", str(path), "--csv", "--out", "OUT/b.csv"]]
    return calls


def run_command(path: Path, words: list[str]) -> str:
    """Run a command; what it shows."""
    from typer.testing import CliRunner

    from amb_bringup.cli import app

    with tempfile.TemporaryDirectory(prefix="out", dir=path.parent) as out:
        result = CliRunner().invoke(app, [word.replace("OUT", out) for word in words], env={"COLUMNS": "200"})
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.output


def actions_for(path: Path, whole: bool) -> dict[str, Callable[[Path], str]]:
    """What is done with a file: the part of commands that reads it, or whole commands."""
    if not whole:
        return {"reading": read_as_commands_do}
    return {" ".join(words[:2]): partial(run_command, words=words) for words in commands_for(path)}


def attempt(jobs: Sequence[Job], spool: Path) -> Iterator[tuple[str, dict[str, str]]]:
    """Names of jobs, and what went wrong with each by kind; in a process that a crash may end."""
    done = 0
    while done < len(jobs):
        receiving, sending = multiprocessing.Pipe(duplex=False)
        child = os.fork()
        if child == 0:
            for job in jobs[done:]:
                sending.send(_attempted(job, spool))
            os._exit(0)
        sending.close()
        try:
            while done < len(jobs):
                if not receiving.poll(PATIENCE):
                    os.kill(child, signal.SIGKILL)
                yield jobs[done].name, receiving.recv()
                done += 1
        except EOFError:
            yield jobs[done].name, {"crashes": "the process ended, or did not answer"}
            done += 1
        os.waitpid(child, 0)


def _attempted(job: Job, spool: Path) -> dict[str, str]:
    from amb_core.ground.errors import AmbError

    faults = {}
    shown = ""
    before, path = _listed(spool), job.make()
    Path("/proc/self/clear_refs").write_text("5")
    began = time.process_time()
    try:
        shown = job.action(path)
    except AmbError as problem:
        shown = str(problem)
    except BaseException:
        faults["tracebacks"] = traceback.format_exc()[-3000:]
    peak = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    if int(peak.split()[1]) << 10 > LARGEST:
        faults["over_limits"] = peak
    if (taken := time.process_time() - began) > SECONDS:
        faults["over_limits"] = f"{taken:.0f} s"
    if SECRET.decode() in shown or ", ".join(str(byte) for byte in SECRET[:6]) in shown:
        faults["escaped"] = shown[:200]
    if left := _listed(spool) - before:
        faults["escaped"] = f"left {left}"
    return faults


def _listed(folder: Path) -> set[str]:
    return {item.name for item in folder.iterdir()}


def jobs_of_mutants(folder: Path, count: int, seed: int) -> Iterator[Job]:
    """Mutants of the seeds, one after the other at a place that the next one takes again."""
    originals = seeds(folder)
    for number in range(count):
        chance = random.Random(seed * 1_000_003 + number)
        original = chance.choice(originals)
        model = original.stem.startswith("model")
        path = folder / f"{'model_' if model else ''}mutant{original.suffix}"

        def make(path: Path = path, original: Path = original, chance: random.Random = chance) -> Path:
            path.write_bytes(mutated(original.read_bytes(), chance))
            return path

        for what, action in actions_for(path, number % EACH_COMMAND == 0).items():
            yield Job(f"mutant {number} of {original.name}, {what}", make, action)


def campaign(
    count: int, seed: int, names: list[str], report: Callable[[str], None], minutes: float = math.inf
) -> Found:
    """Crafted files by name, and so many mutants, or as many as the time allows."""
    import amb_core.recording.recording  # noqa: F401

    tally, stop = Found(), time.monotonic() + 60.0 * minutes
    with tempfile.TemporaryDirectory(prefix="fuzz_files_") as name:
        folder, spool = Path(name) / "files", Path(name) / "spool"
        for part in (folder, spool):
            part.mkdir()
        tempfile.tempdir, os.environ["TMPDIR"] = str(spool), str(spool)
        try:
            make_secret(folder)
            for action in actions_for(DATA / "suffixes.csv", True).values():  # loads what commands load late
                action(DATA / "suffixes.csv")
            for item in names:
                path = folder / item
                CRAFTED[item](path)
                actions = actions_for(path, False) | actions_for(path, True)
                jobs = [Job(f"{item}, {what}", lambda path=path: path, action) for what, action in actions.items()]
                began = time.monotonic()
                for name, outcome in attempt(jobs, spool):
                    tally.add(outcome, name, report)
                report(f"{item}: {time.monotonic() - began:.1f} s")
                tally.crafted += 1
                path.unlink() if not path.is_dir() else shutil.rmtree(path)
            mutants = jobs_of_mutants(folder, count, seed)
            while batch := list(islice(mutants, BATCH)):
                for name, outcome in attempt(batch, spool):
                    tally.add(outcome, name, report)
                tally.mutants = min(count, tally.mutants + BATCH)
                report(f"{tally.mutants} mutants, {tally.counts}")
                if time.monotonic() > stop:
                    break
        finally:
            tempfile.tempdir = None
            del os.environ["TMPDIR"]
    return tally


def write_results(counts: dict[str, Any], path: Path) -> None:
    """Write the counts; other keys of the file stay."""
    kept: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
    path.write_text(json.dumps(kept | counts, indent=1) + "\n")


def main() -> int:
    """Run what the command line asks for; 1 if anything was found."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--mutants", type=int, default=20_000)
    options.add_argument("--minutes", type=float, default=math.inf, help="end after this time")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--only", nargs="*", choices=list(CRAFTED), metavar="NAME", help="crafted files")
    options.add_argument("--quick", action="store_true", help=f"{QUICK} of each, into results/quick")
    chosen = options.parse_args()
    names = list(CRAFTED) if chosen.only is None else chosen.only
    if chosen.quick:
        names, chosen.mutants = names[:QUICK], QUICK
    tally = campaign(chosen.mutants, chosen.seed, names, lambda line: print(line, flush=True), chosen.minutes)
    print(json.dumps(tally.counts))
    if chosen.only is None:
        others: dict[str, Any] = {"peers": peers.attack(chosen.quick)}
        with contextlib.suppress(Skipped):  # without Chromium
            others["pages"] = pages.open_payloads(chosen.quick)
        print(json.dumps(others))
        write_results(tally.counts | others, results_file("security.json", chosen.quick))
        blamed = [name for part in others.values() for name in part["names"]]
        return 1 if tally.blamed or blamed else 0
    return 1 if tally.blamed else 0


if __name__ == "__main__":
    sys.exit(main())
