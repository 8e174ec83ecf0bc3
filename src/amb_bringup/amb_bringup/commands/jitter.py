"""`amb jitter`: how well the paced nodes of the graph keep their deadlines, from /diagnostics."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.box import SIMPLE
from rich.console import Console
from rich.live import Live
from rich.table import Table

from amb_bringup.commands.interrupt import Interrupt
from amb_bringup.commands.results import make_folder, make_place, write_json
from amb_bringup.commands.terminal import Terminal
from amb_core.loop.pace import HISTOGRAM, MISSED, PACED, QUANTILES, histogram
from amb_ros import topics

if TYPE_CHECKING:
    from diagnostic_msgs.msg import DiagnosticArray

PATIENCE = 10.0  # s until the first report of a paced node; they come twice a second


@dataclass
class PacedNode:
    """What a node has reported of its pace, at the first report of the watch and at the latest one."""

    first: Mapping[str, str]
    latest: Mapping[str, str]

    def summary(self) -> dict[str, Any]:
        """Deadlines and missed ones since the first report; lateness (us) since the start of the node."""
        return {
            "paced": self._unit,
            "deadlines": self._since(f"{self._unit}{PACED}"),
            "missed": self._since(MISSED),
            "missed_in_all": int(self.latest[MISSED]),
            "lateness_us": {name: float(self.latest[f"lateness {name} (us)"]) for name in QUANTILES},
        }

    def has_more_than(self, values: Mapping[str, str]) -> bool:
        """Whether a count of the latest report is above that of another one, of a pace that must have begun later."""
        return any(int(self.latest[key]) > int(values.get(key, 0)) for key in (f"{self._unit}{PACED}", MISSED))

    @property
    def _unit(self) -> str:
        return next(key for key in self.latest if key.endswith(PACED)).removesuffix(PACED)

    def _since(self, key: str) -> int:
        return int(self.latest[key]) - int(self.first[key])


class JitterWatch:
    """Listens to /diagnostics.

    Attributes
    ----------
    nodes : dict of str to PacedNode
        The nodes that run at a pace, by name. A node that was started again counts from its start, and one with another
        pace, such as a simulator with another real_time_factor, from there.
    """

    def __init__(self) -> None:
        self.nodes: dict[str, PacedNode] = {}

    def note(self, array: DiagnosticArray) -> None:
        """Take a message."""
        from amb_ros.diagnostics import INSTANCE

        for status in array.status:
            values = {item.key: item.value for item in status.values}
            if MISSED not in values:
                continue
            known = self.nodes.get(status.name)
            if known is None or known.latest.get(INSTANCE) != values.get(INSTANCE) or known.has_more_than(values):
                self.nodes[status.name] = PacedNode(values, values)
            else:
                known.latest = values

    def histograms(self) -> dict[str, tuple[NDArray[np.float64], NDArray[np.int64]]]:
        """Edges (s) and counts of the lateness of each node since its start."""
        return {name: histogram(node.latest[HISTOGRAM]) for name, node in sorted(self.nodes.items())}

    def table(self) -> Table:
        """What was found, a row for each node."""
        table = Table("node", "paced", "missed", "in all", *QUANTILES, title="lateness in us", box=SIMPLE)
        for name, node in sorted(self.nodes.items()):
            summary = node.summary()
            lateness = (f"{value:.{1 if value < 100.0 else 0}f}" for value in summary["lateness_us"].values())
            counts = (
                f"{summary['deadlines']} {summary['paced']}",
                str(summary["missed"]),
                str(summary["missed_in_all"]),
            )
            table.add_row(name, *counts, *lateness)
        return table


SecondsOption = Annotated[
    float, typer.Option(min=0.0, help="How long to watch from the first report onwards, in s; 0: until Ctrl-C.")
]


def jitter(
    seconds: SecondsOption = 0.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
    out: Annotated[Path | None, typer.Option(help="File for the same as JSON (.json).", show_default=False)] = None,
    figures: Annotated[
        Path | None,
        typer.Option(help="Folder for the histogram, lateness.png and .html.", show_default=False, metavar="DIR"),
    ] = None,
) -> None:
    """Show how late the steps of paced nodes come, and how many deadlines they miss, from /diagnostics.

    Paced nodes are the simulator with a real_time_factor, and the target emulator. Deadlines (`paced`) and missed ones
    are counted from the first report of a node in this watch, missed ones also since the start of the node (`in all`).
    The distribution of the lateness is that since the start of the node.
    """
    from amb_bringup.client.errors import ClientError
    from amb_core.report.figures.lateness import lateness_chart

    if out is not None:
        make_place(out)
    if figures is not None:
        make_folder(figures)
    watch, console = JitterWatch(), Terminal()
    _listen(watch, console, seconds, show=console.is_terminal and not as_json)
    if not watch.nodes:
        raise ClientError(
            "no node reports a pace on /diagnostics; paced are a simulator with real_time_factor above 0, and "
            "target_emulator, in the DDS domain ROS_DOMAIN_ID"
        )
    summaries = {name: node.summary() for name, node in sorted(watch.nodes.items())}
    if as_json:
        typer.echo(json.dumps(summaries, indent=2))
    else:
        console.print(watch.table())
    if out is not None:
        write_json(out, summaries)
    if figures is not None:
        lateness_chart(watch.histograms()).save(figures, "lateness")


def _listen(watch: JitterWatch, console: Console, seconds: float, show: bool) -> None:
    """Watch so long from the first report onwards, or until Ctrl-C; no longer than the patience without any report."""
    from diagnostic_msgs.msg import DiagnosticArray

    from amb_bringup.client.connection import GraphConnection
    from amb_ros.diagnostics import TOPIC

    with Interrupt() as interrupt, GraphConnection(topics.NAMESPACE, PATIENCE, None, ()) as connection:
        connection.node.create_subscription(DiagnosticArray, TOPIC, watch.note, 100)
        with Live(console=console, auto_refresh=False, transient=True) as live:
            end = time.monotonic() + PATIENCE
            while not watch.nodes and time.monotonic() < end and not interrupt.asked():
                connection.spin_once(0.1)
            end = time.monotonic() + (seconds or math.inf)
            while watch.nodes and time.monotonic() < end and not interrupt.asked():
                connection.spin_once(0.1)
                if show:
                    live.update(watch.table(), refresh=True)
