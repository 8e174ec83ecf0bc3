"""What `amb jitter` makes of the reports of paced nodes."""

from __future__ import annotations

from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rich.console import Console

from amb_bringup.commands.jitter import JitterWatch
from amb_core.loop.pace import Pace, pace_values
from amb_core.report.figures.lateness import lateness_chart
from amb_ros.diagnostics import INSTANCE


def report(pace: Pace, instance: str = "1", name: str = "amb/simulator") -> DiagnosticArray:
    values = pace_values(pace) | {INSTANCE: instance}
    status = DiagnosticStatus(name=name, values=[KeyValue(key=key, value=str(value)) for key, value in values.items()])
    other = DiagnosticStatus(name="amb/recorder", values=[KeyValue(key="messages", value="7")])
    return DiagnosticArray(status=[status, other])


def paced(steps: int, missed: int, late: float = 200e-6) -> Pace:
    """A pace of 1 ms whose first steps missed their deadlines by so much (s)."""
    pace, now = Pace(1e-3), 0.0
    pace.start(now)
    for step in range(steps):
        now += 1e-3 + (late if step < missed else 0.0)
        if pace.wait(now - 1e-9 * (step >= missed)) > 0.0:
            pace.published(now)
    return pace


def test_deadlines_are_counted_from_the_first_report_and_nodes_without_a_pace_are_left_out() -> None:
    watch = JitterWatch()
    watch.note(report(paced(100, 10)))
    watch.note(report(paced(150, 13)))
    assert set(watch.nodes) == {"amb/simulator"}
    summary = watch.nodes["amb/simulator"].summary()
    assert (summary["paced"], summary["deadlines"], summary["missed"], summary["missed_in_all"]) == ("steps", 50, 3, 13)
    assert summary["lateness_us"]["p50"] < 1.0 < 199.0 < summary["lateness_us"]["max"] < 201.0


def test_a_node_that_was_started_again_counts_anew() -> None:
    watch = JitterWatch()
    watch.note(report(paced(100, 10)))
    watch.note(report(paced(20, 2), instance="2"))
    watch.note(report(paced(50, 5), instance="2"))
    summary = watch.nodes["amb/simulator"].summary()
    assert (summary["deadlines"], summary["missed"], summary["missed_in_all"]) == (30, 3, 5)


def test_a_pace_that_began_anew_in_the_same_node_counts_anew() -> None:
    """As the simulator's after a run at another real_time_factor."""
    watch = JitterWatch()
    watch.note(report(paced(1000, 999)))
    watch.note(report(paced(20, 2)))
    watch.note(report(paced(50, 5)))
    summary = watch.nodes["amb/simulator"].summary()
    assert (summary["deadlines"], summary["missed"], summary["missed_in_all"]) == (30, 3, 5)


def test_the_table_has_a_row_for_each_node() -> None:
    watch = JitterWatch()
    watch.note(report(paced(100, 10)))
    watch.note(report(paced(100, 10), name="amb/target_emulator"))
    console = Console(width=100)
    with console.capture() as output:
        console.print(watch.table())
    assert "amb/simulator" in output.get()
    assert "amb/target_emulator" in output.get()


def test_the_histogram_holds_every_deadline_and_draws_itself(tmp_path: Path) -> None:
    watch = JitterWatch()
    pace = paced(100, 10)
    watch.note(report(pace))
    edges, counts = watch.histograms()["amb/simulator"]
    assert (len(edges), counts.sum(), counts[-1]) == (len(counts) + 1, 100, 10)
    assert edges[-2] < 200e-6 < edges[-1] * 1.0001
    assert [file.name for file in lateness_chart(watch.histograms()).save(tmp_path, "lateness")] == [
        "lateness.png",
        "lateness.html",
    ]
