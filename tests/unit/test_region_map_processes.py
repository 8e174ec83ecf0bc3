"""Region maps on real clusters: whatever is killed, nothing finished is lost and nothing is left behind."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions.region_map import MapSettings, RegionMap, build_map
from tests.semaphores import left_of, semaphores_of

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

SETTINGS = MapSettings(
    amplitude_low=5e-6, amplitude_high=40e-6, frequency_end=1500.0, duration=3.0, initial_sweeps=6, max_sweeps=8
)
# No guard around the main part: the workers must not import it.
PROGRAM = """
import sys
from pathlib import Path
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions.region_map import MapSettings, build_map

settings = MapSettings.model_validate_json(sys.argv[1])
build_map(
    settings, PlantParameters(), ControllerParameters(), cache=Path(sys.argv[2]), workers=2,
    progress=lambda progress: print(progress.done, progress.reused, flush=True),
).save(sys.argv[3])
"""


def start(folder: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, SETTINGS.model_dump_json(), str(folder / "cache"), str(folder / "map.json")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def read_until(process: subprocess.Popen[str], done: int) -> None:
    assert process.stdout is not None
    for line in process.stdout:
        if int(line.split()[0]) >= done:
            return
    raise AssertionError(process.stderr.read() if process.stderr else "")


def cluster_of(process: subprocess.Popen[str]) -> list[psutil.Process]:
    return psutil.Process(process.pid).children(recursive=True)


def wait_for_end(processes: list[psutil.Process]) -> None:
    _, alive = psutil.wait_procs(processes, timeout=120.0)
    assert not alive


def wait_for(file: Path) -> None:
    deadline = time.monotonic() + 120.0
    while not file.exists():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def names(folder: Path) -> set[str]:
    return {path.name for path in (folder / "cache").iterdir()}


def test_a_killed_map_goes_on_where_it_ended(tmp_path):
    process = start(tmp_path)
    read_until(process, 3)
    workers = cluster_of(process)
    opened = semaphores_of(workers)
    assert opened
    process.kill()
    process.communicate()
    wait_for_end(workers)  # which finish the sweeps that they have begun, and keep them
    assert left_of(opened) == []
    kept = names(tmp_path)
    assert 3 <= len(kept) < 8
    written = {name: (tmp_path / "cache" / name).stat().st_mtime_ns for name in kept}

    output, problem = start(tmp_path).communicate(timeout=120)
    assert problem == ""
    assert output.splitlines()[-1] == f"8 {len(kept)}", "a finished sweep was run again"
    assert {name: (tmp_path / "cache" / name).stat().st_mtime_ns for name in kept} == written
    resumed = RegionMap.load(tmp_path / "map.json")
    assert resumed == build_map(
        SETTINGS, PlantParameters(), ControllerParameters(), cache=tmp_path / "fresh", workers=1
    )


def test_the_sweep_of_a_killed_worker_is_run_by_another(tmp_path):
    process = start(tmp_path)
    read_until(process, 1)
    computing = [child for child in cluster_of(process) if "spawn_main" in " ".join(child.cmdline())]
    assert len(computing) == 2
    computing[0].kill()
    output, problem = process.communicate(timeout=120)
    assert process.returncode == 0, problem
    assert output.splitlines()[-1] == "8 0"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_nothing_is_left_behind_by_a_program_that_is_stopped(tmp_path, number):
    process = start(tmp_path)
    read_until(process, 1)
    workers = cluster_of(process)
    opened = semaphores_of(workers)
    process.send_signal(number)
    process.communicate(timeout=120)
    wait_for_end(workers)
    assert left_of(opened) == []
    assert names(tmp_path)


def test_ctrl_c_in_a_terminal_keeps_what_is_done_and_says_how_to_go_on(tmp_path):
    command = [
        "amb", "map", "--duration", "3", "--frequency-end", "1500", "--workers", "2",
        "--cache", str(tmp_path / "cache"), "--out", str(tmp_path / "out"),
    ]  # fmt: skip
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    deadline = time.monotonic() + 120.0
    while not (tmp_path / "cache").exists() or len(names(tmp_path)) < 6:  # the program has heard of one by then
        assert time.monotonic() < deadline
        time.sleep(0.05)
    workers = cluster_of(process)
    os.killpg(process.pid, signal.SIGINT)
    output, problem = process.communicate(timeout=120)
    wait_for_end(workers)
    assert process.returncode == 130, output + problem
    assert problem == "amb: interrupted; finished sweeps are kept: run the same command to resume\n"
    assert 1 <= len(RegionMap.load(tmp_path / "out" / "map.json").sweeps) < 24


def test_a_scheduler_that_goes_away_is_told_in_one_line(tmp_path):
    scheduler_file = tmp_path / "scheduler.json"
    command = [
        sys.executable, "-m", "dask", "scheduler", "--host", "127.0.0.1", "--port", "0",
        "--dashboard-address", "127.0.0.1:0", "--scheduler-file", str(scheduler_file),
    ]  # fmt: skip
    with contextlib.ExitStack() as stack:
        scheduler = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        stack.callback(scheduler.wait)
        stack.callback(scheduler.kill)
        wait_for(scheduler_file)
        address = json.loads(scheduler_file.read_text())["address"]
        options = ["--scheduler", address, "--cache", str(tmp_path / "cache"), "--out", str(tmp_path / "out")]
        process = subprocess.Popen(
            ["amb", "map", *options], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        stack.callback(process.wait)
        stack.callback(process.kill)
        assert process.stderr is not None
        assert any("has no workers yet" in line for line in process.stderr)
        time.sleep(1.0)  # the sweeps are handed in
        scheduler.kill()
        _, problem = process.communicate(timeout=120)
    assert process.returncode == 1
    (told,) = [line for line in problem.splitlines() if line.startswith("amb: ")]
    assert told.endswith(f"the scheduler {address} is gone; finished results are kept")


def test_a_scheduler_that_is_already_there_is_used(tmp_path):
    with contextlib.ExitStack() as stack:
        scheduler_file = tmp_path / "scheduler.json"

        def launch(*arguments: str) -> subprocess.Popen[bytes]:
            process = subprocess.Popen(
                [sys.executable, "-m", "dask", *arguments, "--scheduler-file", str(scheduler_file)],
                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            )  # fmt: skip
            stack.callback(process.wait, 30)
            stack.callback(process.terminate)
            return process

        launch("scheduler", "--host", "127.0.0.1", "--port", "0", "--dashboard-address", "127.0.0.1:0")
        wait_for(scheduler_file)
        worker = launch("worker", "--nthreads", "1", "--dashboard-address", "127.0.0.1:0")
        address = json.loads(scheduler_file.read_text())["address"]
        region_map = build_map(
            SETTINGS, PlantParameters(), ControllerParameters(), cache=tmp_path / "cache", scheduler=address
        )
        assert len(region_map.sweeps) == 8
        assert worker.poll() is None, "the workers are not ours to end"
