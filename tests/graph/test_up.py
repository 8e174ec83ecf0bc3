"""`amb up` as a user types it: it reports when the graph is ready, and the call that it proposes works as it stands."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from amb_bringup.graph.packages import find_executable


@pytest.mark.timeout(180)
@pytest.mark.parametrize(
    "arguments",
    [pytest.param([], id="separate", marks=pytest.mark.slow), pytest.param(["--composed"], id="composed")],
)
def test_up_says_when_it_is_ready_and_what_to_call_next(domain: int, arguments: list[str]) -> None:
    command = [str(find_executable("amb_bringup", "amb")), "up", *arguments]
    environment = os.environ | {"ROS_DOMAIN_ID": str(domain), "PYTHONUNBUFFERED": "1"}
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment, start_new_session=True
    )
    try:
        assert process.stdout is not None
        ready = next(line for line in process.stdout if line.startswith("amb: ready"))
        assert "6 nodes; the simulator is paused" in ready
        hint = process.stdout.readline().strip()
        answer = subprocess.run(hint, shell=True, capture_output=True, text=True, timeout=90.0)
        assert answer.returncode == 0, answer.stderr
        assert "step=10000, delevitated=False" in answer.stdout
    finally:
        process.send_signal(signal.SIGINT)
        rest, _ = process.communicate(timeout=60.0)
    assert rest.strip().endswith("amb: stopped")
    assert "Traceback" not in rest
    assert process.returncode == 0


@pytest.mark.timeout(120)
@pytest.mark.parametrize("nodes", [1, 6])
def test_ctrl_c_while_the_graph_starts_ends_it_cleanly(domain: int, nodes: int) -> None:
    command = [str(find_executable("amb_bringup", "amb")), "up"]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        env=os.environ | {"ROS_DOMAIN_ID": str(domain)}, start_new_session=True,
    )  # fmt: skip
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    while process.poll() is None and len(children.read_text().split()) < nodes:
        time.sleep(0.001)
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=60.0)
    assert said.strip().endswith("amb: stopped")
    assert "Traceback" not in said
    assert process.returncode == 0
