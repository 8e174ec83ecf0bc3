"""The live page: how late, how often, at what cost, and what a hostile client gets done. See `run`."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from amb_core.excitation import Square, generate
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant
from amb_core.plant.simulation import simulate
from tests.benchmarks.skipped import Skipped
from tests.graph.bearing import Bearing
from tests.graph.conftest import Graph, opened_graph
from tests.graph.live_page import CHROMIUM, LivePage, Visit, attack, open_browser, publish_markup

SECONDS = 20.0  # of measurement
WARM_UP = 5.0  # s
STEPS, FIRST_STEP = 20_000, 200
SQUARE = Square(amplitude=20e-6, duration=1.0, frequency=50.0, axes="in_turn")
SCREEN = {"viewport": {"width": 1280, "height": 900}}


def measure(seconds: float = SECONDS, warm_up: float = WARM_UP, steps: int = STEPS) -> dict[str, Any]:
    """The figures of the key `view`."""
    if CHROMIUM is None:
        raise Skipped("there is no Chromium")
    with open_browser() as browser:
        with tempfile.TemporaryDirectory() as folder, opened_graph(Path(folder)) as graph:
            figures = _pace(graph, browser, seconds, warm_up)
        with tempfile.TemporaryDirectory() as folder, opened_graph(Path(folder)) as graph:
            figures["bit_identical"] = _is_bit_identical(graph, browser, steps)
    return figures


def _pace(graph: Graph, browser: Any, seconds: float, warm_up: float) -> dict[str, Any]:
    """Latency, frame rate and cost with telemetry in real time; then the hostile client."""
    graph.start_command([sys.executable, str(Path(__file__).with_name("player.py"))])
    server = LivePage(graph)
    visit = Visit(browser, server.address, **SCREEN)
    visit.wait("ambView.measured.drawn > 10 && ambView.samples.spectrum")
    visit.page.wait_for_timeout(1e3 * warm_up)
    process = psutil.Process(server.process.pid)
    before, first = process.cpu_times(), visit.value("[ambView.measured.drawn, performance.now()]")
    visit.value("ambView.measured.ages.length = 0")
    visit.page.wait_for_timeout(1e3 * seconds)
    after, last = process.cpu_times(), visit.value("[ambView.measured.drawn, performance.now()]")
    ages = np.array(visit.value("ambView.measured.ages"))
    span = 1e-3 * (last[1] - first[1])
    return {
        "latency_ms": round(float(np.percentile(ages, 95)), 1),
        "latency_median_ms": round(float(np.median(ages)), 1),
        "frames_per_s": round((last[0] - first[0]) / span, 1),
        "core_share": round((after.user + after.system - before.user - before.system) / span, 3),
        "lost": visit.value("ambView.state.sections.graph.lost"),
        "load_average": [round(os.getloadavg()[0], 1), os.cpu_count()],
        "hostile_executed": _executed(graph, server, visit),
    }


def _executed(graph: Graph, server: LivePage, visit: Visit) -> int:
    """What a hostile client got done; the page must still be drawn afterwards."""
    ours, host = server.address.rstrip("/"), f"{server.host}:{server.port}"
    opened = sum(
        server.upgrade_status(**headers) == 101
        for headers in (
            {"Host": host},
            {"Host": host, "Origin": "http://evil.example"},
            {"Host": "evil.example", "Origin": "http://evil.example"},
            {"Host": "evil.example", "Origin": ours},
        )
    )
    publisher = publish_markup(graph)
    visit.page.locator("#log-list li", has_text="globalThis.executed").first.wait_for()
    graph.node.destroy_publisher(publisher)
    carried_out = attack(visit, server.address)
    drawn = visit.value("ambView.measured.drawn")
    visit.wait(f"ambView.measured.drawn > {drawn + 10}")
    return opened + carried_out + int(visit.value("globalThis.executed !== undefined"))


def _is_bit_identical(graph: Graph, browser: Any, steps: int) -> bool:
    """Whether the loop over topics with the page open has the samples of the loop without ROS."""
    expected = simulate(
        Plant(), PdController(ControllerParameters()), steps, generate(SQUARE, 10_000.0).samples, FIRST_STEP
    )
    for module in ("amb_bringup.graph.composed_loop", "amb_controller_node.excitation_generator"):
        graph.start(module)
    bearing = Bearing(graph)
    visit = Visit(browser, LivePage(graph).address, **SCREEN)
    while not visit.value("ambView.samples.step > 0"):  # the page may hear of the machine before it hears the telemetry
        bearing.run(FIRST_STEP)
        visit.page.wait_for_timeout(100)
    run = bearing.reset()
    bearing.excite(SQUARE, run, FIRST_STEP)
    bearing.run(steps)
    record = bearing.record(run, steps)
    visit.wait(f"ambView.samples.layout.run === {run} && ambView.samples.step > 0")
    return record.identical_to(expected)
