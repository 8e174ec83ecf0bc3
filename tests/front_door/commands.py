"""Every command of `amb` at its smallest, one after the other, in one process where it ends by itself.

`python -m tests.front_door.commands` writes results/quick/commands.json: seconds by command. See `entries.COMMANDS`.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path
from typing import Annotated

from domain_coordinator import domain_id
from pydantic import RootModel
from typer.main import get_command

from amb_bringup.cli import app
from amb_bringup.graph.packages import find_executable, share_folder
from docs.generators.commands import commands
from tests.benchmarks.robust.emulator import slow_rig
from tests.front_door import entries
from tests.front_door.figures import rows_of
from tests.front_door.results import ROOT, results_file
from tests.graph.rig import free_port

PATIENCE = 120.0  # s, for the sign of life of a command behind the others


class Failed(Exception):  # noqa: N818  # no error of this program
    """What a command showed that did not succeed."""


class CommandSeconds(RootModel[Annotated[dict[str, float], rows_of(lambda: names())]]):
    """Seconds by command, of all in `entries.COMMANDS`."""


def steps(port: int) -> Iterator[tuple[str, bool, list[str]]]:
    """The lines of the list: text after the bar, whether it runs behind the others, and the words after `amb`.

    A rig has a port of its own, as other programs run beside this one.
    """
    places = {
        "config": share_folder("amb_bringup") / "config",
        "rotor": ROOT / "tests/unit/data/overhung.py",
        "port": port,
    }
    for line in entries.COMMANDS.strip().splitlines():
        if line == "^C":
            yield line, False, []
            continue
        behind = line.startswith("& ")
        call, _, sign = line.removeprefix("& ").partition(" | ")
        yield sign, behind, shlex.split(call.format(**places))[1:]


def name_of(words: list[str]) -> str:
    """Full name of the command that these words call."""
    known = dict(commands())
    return next(name for count in (2, 1) if (name := " ".join(["amb", *words[:count]])) in known)


def names() -> list[str]:
    """Full names of all commands of the list."""
    return list(dict.fromkeys(name_of(words) for _, _, words in steps(0) if words))


def main() -> int:
    """Run the commands; 1 if one fails."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="the only size there is")
    parser.add_argument(
        "--only", nargs="*", choices=names(), metavar="NAME", help=f"only these, of {', '.join(names())}"
    )
    chosen = parser.parse_args()
    file = results_file("commands.json", quick=True)
    folder = file.with_suffix("")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    port = free_port()
    (folder / "slow.yaml").write_text(slow_rig(port))
    seconds: dict[str, float] = {}
    failed: list[str] = []
    behind: list[subprocess.Popen[bytes]] = []
    with domain_id() as domain, chdir(folder):
        os.environ |= {"ROS_DOMAIN_ID": str(domain), "PYTHONUNBUFFERED": "1", "COLUMNS": "120"}
        try:
            for sign, is_behind, words in steps(port):
                if sign == "^C":
                    end(behind)
                elif not chosen.only or name_of(words) in chosen.only:
                    began = time.monotonic()
                    try:
                        if is_behind:
                            behind.append(start(words, sign))
                        else:
                            call(words, int(sign or 0))
                    except Failed as problem:
                        failed.append(str(problem))
                        print(problem, flush=True)
                        continue
                    seconds[name_of(words)] = round(time.monotonic() - began, 2)
                    print(f"{seconds[name_of(words)]:6.1f} s  amb {' '.join(words)}", flush=True)
        finally:
            end(behind)
    file.write_text(json.dumps(seconds, indent=1) + "\n")
    return 1 if failed else 0


def call(words: list[str], wanted: int) -> None:
    """Run a command in this process; Failed unless it ends with the wanted exit code."""
    try:
        code = get_command(app).main(words, prog_name="amb", standalone_mode=False)
    except Exception as problem:
        raise Failed(f"amb {' '.join(words)} failed:\n{traceback.format_exc()}") from problem
    if (code or 0) != wanted:
        raise Failed(f"amb {' '.join(words)} ended with {code or 0}; wanted: {wanted}")


def start(words: list[str], sign: str) -> subprocess.Popen[bytes]:
    """Start a command, and wait until it shows a text; Failed if it ends before or does not."""
    log = Path(f"{'_'.join(words[:2])}.log")
    with log.open("w") as output:
        command = [str(find_executable("amb_bringup", "amb")), *words]
        process = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT, start_new_session=True)
    deadline = time.monotonic() + PATIENCE
    while sign not in log.read_text():
        if process.poll() is not None or time.monotonic() > deadline:
            end([process])
            raise Failed(f"amb {' '.join(words)} does not show {sign!r}:\n{log.read_text()[-3000:]}")
        time.sleep(0.1)
    return process


def end(behind: list[subprocess.Popen[bytes]]) -> None:
    """Ctrl-C for the commands behind, last first."""
    while behind:
        process = behind.pop()
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.wait(60.0)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            raise


if __name__ == "__main__":
    sys.exit(main())
