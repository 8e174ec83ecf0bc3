"""Ends graphs of six nodes at the worst moment, again and again, and measures what each end leaves.

Every node is in a discovery callback while it leaves: callbacks take 20 ms longer, and a node waits up to 0.2 s for one
before it goes (`delayed_discovery.c`). Each graph is started by `amb up`, records a running loop, and ends by Ctrl-C,
alone or beside four busy loops. A call that was interrupted, or is followed by one for more ends, resumes on the same
commit; --anew begins again. `make leaving` writes results/leaving.json: the commit, and for all ends and each kind

    ends                  of graphs; every graph has six nodes
    hung                  nodes that were alive 6 s after Ctrl-C
    slow                  nodes that have shown their stacks, a second before their limit of time
    longest_s             from Ctrl-C to the end of the last node
    longest_up_s          from Ctrl-C to the end of amb up
    exit_codes            of amb up, with their numbers; 0 if every node ended with 0
    bags_whole            bags that can be read to their end
    shm_left              files of the graphs in /dev/shm after their ends, by no process in use
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from domain_coordinator import domain_id

from amb_bringup.client import AmbClient
from amb_bringup.graph.packages import find_executable
from amb_core.recording import inspect_bag
from amb_msgs.srv import RunSteps
from tests.delayed_discovery import build_delayed_discovery, delays
from tests.front_door.figures import Figures, MayBeEmpty
from tests.front_door.results import results_file
from tests.graph.processes import SHARED_MEMORY
from tests.kept_outcomes import KeptOutcomes, checkout
from tests.stress import BUSY_LOOPS, load

NODES = 6
HUNG_AFTER = 6.0  # s
GIVEN_UP_AFTER = 120.0  # s; for the start of a graph, and for its end
STEPS = 2_000  # that are recorded at least
# But for ports below 7400: graphs of all DDS domains share them, and one of another graph may have been killed.
MAPPED = re.compile(r"/dev/shm/(\S*fastrtps_(?!port7[0-3]\d\d\b)\S+)")


class Ends(Figures):
    """What the ends of some graphs have left; the keys are described above."""

    ends: int
    hung: int
    slow: int
    longest_s: float
    longest_up_s: float
    exit_codes: MayBeEmpty[dict[str, int]]
    bags_whole: int
    shm_left: list[str]


class Leaving(Ends):
    """What is written to results/leaving.json."""

    commit: str  # with a + where files were changed
    exit_codes: dict[str, int]
    idle: Ends
    loaded: Ends


class End(Figures):
    """What the end of one graph has left."""

    kind: str
    hung: int
    slow: int
    seconds: float
    up_seconds: float
    exit_code: int
    bag_whole: bool
    left: list[str]


def end_one(kind: str, folder: Path, environment: dict[str, str]) -> End:
    """Start a graph, let it record, end it by Ctrl-C."""
    with domain_id() as domain, (folder / "output.txt").open("w+") as output:
        settings = os.environ | environment | {"ROS_DOMAIN_ID": str(domain), "ROS_LOG_DIR": str(folder / "log")}
        command = [str(find_executable("amb_bringup", "amb")), "up"]
        before = {path.name for path in SHARED_MEMORY.iterdir()}  # such as ports that a killed program has left
        graph = subprocess.Popen(
            command, env=settings, stdout=output, stderr=subprocess.STDOUT, cwd=folder, start_new_session=True
        )
        try:
            with AmbClient(domain_id=domain, timeout=GIVEN_UP_AFTER) as amb:
                amb.wait_for_nodes()
                bag = Path(amb.start_recording(str(folder / "bag")))
                amb.call(RunSteps, "simulator/run", steps=0)
                amb.wait_until(lambda: amb.simulator_state is not None and amb.simulator_state.step > STEPS)
                wait_for(lambda: "amb: ready" in (folder / "output.txt").read_text())
                own = mapped(os.getpid())
            children = Path(f"/proc/{graph.pid}/task/{graph.pid}/children").read_text().split()
            nodes = [int(child) for child in children]
            assert len(nodes) == NODES, f"{len(nodes)} nodes run"
            files = set().union(*map(mapped, nodes)) | (mapped(graph.pid) - own)
            began = time.monotonic()
            graph.send_signal(signal.SIGINT)
            wait_for(lambda: not any(map(alive, nodes)), HUNG_AFTER)
            hung = sum(map(alive, nodes))
            wait_for(lambda: not any(map(alive, nodes)))
            seconds = time.monotonic() - began
            graph.wait(GIVEN_UP_AFTER)
            up_seconds = time.monotonic() - began
        finally:
            if graph.poll() is None:
                graph.send_signal(signal.SIGINT)  # it ends its nodes, in the end by force
                graph.wait(GIVEN_UP_AFTER)
        said = (folder / "output.txt").read_text()
    return End(
        kind=kind,
        hung=hung,
        slow=said.count("Timeout (0:"),
        seconds=seconds,
        up_seconds=up_seconds,
        exit_code=graph.returncode,
        bag_whole=not inspect_bag(bag).damage,
        left=sorted(left(files - before)),
    )


def mapped(process: int) -> set[str]:
    """Files of Fast DDS in shared memory that a process has open."""
    return set(MAPPED.findall(Path(f"/proc/{process}/maps").read_text()))


def left(files: set[str]) -> set[str]:
    """Those that still exist, and are not of a program that runs."""
    there = {name for name in files if (SHARED_MEMORY / name).exists()}
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            there -= mapped(int(process.name))
    return there


def alive(process: int) -> bool:
    """Whether a process exists and has not ended."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_for(condition: Callable[[], bool], limit: float = GIVEN_UP_AFTER) -> None:
    """Wait until a condition holds, at most for a time (s)."""
    deadline = time.monotonic() + limit
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)


def is_clean(end: End) -> bool:
    """Whether an end was as it is to be; a limit of time is no fault."""
    return not end.hung and end.exit_code == 0 and end.bag_whole and not end.left


def summary(ends: Sequence[End]) -> dict[str, object]:
    """The figures of some ends."""
    left = sorted(name for end in ends for name in end.left)
    return {
        "ends": len(ends),
        "hung": sum(end.hung for end in ends),
        "slow": sum(end.slow for end in ends),
        "longest_s": round(max((end.seconds for end in ends), default=0.0), 2),
        "longest_up_s": round(max((end.up_seconds for end in ends), default=0.0), 2),
        "exit_codes": {str(code): count for code, count in sorted(Counter(end.exit_code for end in ends).items())},
        "bags_whole": sum(end.bag_whole for end in ends),
        "shm_left": left,
    }


def write(file: Path, commit: str, ends: Sequence[End]) -> None:
    """Write the results: the figures of all ends, and of each kind."""
    kinds = {kind: summary([end for end in ends if end.kind == kind]) for kind in ("idle", "loaded")}
    file.write_text(json.dumps(summary(ends) | {"commit": commit} | kinds, indent=2) + "\n")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ends", type=int, default=1, help="ends of graphs alone on the machine")
    parser.add_argument("--loaded", type=int, default=0, help=f"ends of graphs beside {BUSY_LOOPS} busy loops")
    parser.add_argument("--out", type=Path, help="file of the results; by default results/leaving.json")
    parser.add_argument("--anew", action="store_true", help="also the ends that are there of this commit")
    parser.add_argument("--quick", action="store_true", help="one end, into results/quick")
    settings = parser.parse_args()
    if settings.quick:
        settings.ends, settings.loaded = 1, 0
    out = settings.out or results_file("leaving.json", settings.quick)
    commit = checkout()
    file = out.with_suffix(".jsonl") if commit and not settings.quick else None
    kept = KeptOutcomes(file, commit, End.model_dump, End.model_validate)
    if settings.anew:
        kept.forget()
    ends = kept.load()
    have = Counter(end.kind for end in ends)
    wanted = {"idle": settings.ends, "loaded": settings.loaded}
    plan = [kind for kind, count in wanted.items() for _ in range(count - have[kind])]
    if ends:
        print(f"{len(ends)} ends of this commit are there; {len(plan)} are left")
    write(out, commit, ends)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # through the ends of the processes that run beside
    with tempfile.TemporaryDirectory() as name:
        library = Path(name, "delayed_discovery.so")
        build_delayed_discovery(library)
        environment = delays(library, each=0.02, held=0.02, wait=0.2)
        for number, kind in enumerate(plan, len(ends) + 1):
            if checkout() != commit:
                sys.exit(f"the checkout is no longer at {commit}; {number - 1} ends are in {out}")
            folder = Path(name, str(number))
            folder.mkdir()
            with load(BUSY_LOOPS if kind == "loaded" else 0):
                end = end_one(kind, folder, environment)
            print(f"end {number}: {end}", flush=True)
            if not is_clean(end):
                print((folder / "output.txt").read_text(), flush=True)
            ends.append(end)
            kept.add(end)
            write(out, commit, ends)
    return 0 if all(map(is_clean, ends)) else 1


if __name__ == "__main__":
    raise SystemExit(main())
