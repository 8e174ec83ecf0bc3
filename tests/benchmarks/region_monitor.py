"""The region monitor at 10 kHz in real time: share of a core that its process takes, and how late it reports a region.

Telemetry is published in the blocks and at the pace of a loop in real time: a sweep of 25 um over 15 s with the
derivative on the measurement, which runs up to 5 kHz, with beats and all. The start of the process is left out.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from domain_coordinator import domain_id

from amb_bringup.client import AmbClient
from amb_core.excitation import Sweep, generate
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant
from amb_core.plant.simulation import simulate
from amb_core.recording.messages.loop_samples import fill_loop_samples
from amb_msgs.msg import AxisSamples, LoopSamples, RegionState
from amb_ros.qos import HISTORY

BLOCK = 100  # steps
RUN = 1
DURATION = 15.0  # s
SWEEP: dict[str, Any] = {"amplitude": 25e-6, "frequency_start": 10.0, "frequency_end": 5000.0, "axes": "y"}


def measure(duration: float = DURATION) -> dict[str, float]:
    """Share of one core (-), median and largest time from a block to the region in which it ends (ms)."""
    with domain_id() as domain:
        return _measure(duration, domain)


def _measure(duration: float, domain: int) -> dict[str, float]:
    record = simulate(
        Plant(), PdController(ControllerParameters(derivative_on="measurement")), round(duration * 10_000),
        generate(Sweep(duration=duration, **SWEEP), 10_000.0).samples,
    )  # fmt: skip
    blocks = [_message(record, first) for first in range(0, record.steps - BLOCK + 1, BLOCK)]
    published: dict[int, float] = {}
    lags: list[float] = []

    def on_region(state: RegionState) -> None:
        if (state.step + 1) % BLOCK == 0:
            lags.append(time.perf_counter() - published[state.step + 1 - BLOCK])

    environment = os.environ | {"ROS_DOMAIN_ID": str(domain)}
    # no machine is published: nothing may wait for one
    without_wait = ["--ros-args", "-p", "machine_timeout:=0.0"]
    process = subprocess.Popen([sys.executable, "-m", "amb_ident_node.region_monitor", *without_wait], env=environment)
    try:
        with AmbClient(domain_id=domain) as amb:
            publisher = amb.node.create_publisher(LoopSamples, "telemetry", HISTORY)
            region = amb.node.create_subscription(RegionState, "region", on_region, HISTORY)
            amb.wait_until(lambda: publisher.get_subscription_count() and region.get_publisher_count())
            used, started = _processor_time(process.pid), time.perf_counter()
            for number, block in enumerate(blocks):
                due = started + number * BLOCK * record.sample_time
                while (left := due - time.perf_counter()) > 0.0:
                    amb.spin_once(left)
                published[block.first_step] = time.perf_counter()
                publisher.publish(block)
            used, wall = _processor_time(process.pid) - used, time.perf_counter() - started
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(30.0)
    return {
        "core_share": used / wall,
        "lag_ms": 1e3 * float(np.median(lags)),
        "longest_lag_ms": 1e3 * max(lags),
    }


def _message(record: LoopRecord, first: int) -> LoopSamples:
    part = record.window(first, BLOCK)
    return fill_loop_samples(LoopSamples(), AxisSamples, RUN, part)


def _processor_time(process: int) -> float:
    """What a process has computed so far (s)."""
    fields = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    print(measure())
