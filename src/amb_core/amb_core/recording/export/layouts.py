"""Layouts of PlotJuggler and Foxglove for exported runs: orbit, time, spectrum and status.

What they show are the topics and fields of `plotjuggler` and `foxglove` in this folder.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree

from amb_core.recording.content import REGION_STATE
from amb_core.recording.export import plotjuggler
from amb_core.recording.export.axis_messages import field_names
from amb_core.recording.export.foxglove import SPECTRUM_TOPIC, STATES, TELEMETRY_TOPIC

COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#ff7f0e", "#9467bd", "#8c564b", "#17becf", "#bcbd22")
MICROMETRES = ".@mul(1000000)"
"""Function of a Foxglove path that shows metres as micrometres."""


def radial_pairs(axes: Sequence[str]) -> list[tuple[str, str]]:
    """Pairs of axes that make an orbit: x with y, x_a with y_a."""
    return [(axis, f"y{axis[1:]}") for axis in axes if axis.startswith("x") and f"y{axis[1:]}" in axes]


def plotjuggler_layout(axes: Sequence[str]) -> str:
    """The layout of PlotJuggler (XML) for a machine with these axes."""
    root = ElementTree.Element("root")
    tabs = ElementTree.SubElement(root, "tabbed_widget", {"name": "Main Window", "parent": "main_window"})
    position = {axis: f"{plotjuggler.LOOP}/{axis}/position" for axis in axes}
    orbits = [[(position[x], position[y])] for x, y in radial_pairs(axes)]
    if orbits:
        _tab(tabs, "Orbit (m)", "|", [_xy(curves) for curves in orbits])
    reference = [f"{plotjuggler.REFERENCE}/{axis}/position" for axis in axes]
    current = [f"{plotjuggler.LOOP}/{axis}/effort" for axis in axes]
    _tab(tabs, "Time (m, m, A)", "-", [_time(list(position.values())), _time(reference), _time(current)])
    lines = [(plotjuggler.FREQUENCY, f"{plotjuggler.SPECTRUM}/{axis}") for axis in axes]
    _tab(tabs, "Spectrum (m over Hz)", "-", [_xy([(f"{x}/data", f"{y}/data") for x, y in lines])])
    regions = [f"{plotjuggler.REGION}/{axis}/data" for axis in axes]
    inputs = [f"{plotjuggler.EVIDENCE_TOPIC}/{axis}/input_frequency/data" for axis in axes]
    status = [f"{plotjuggler.MISSING}/data", f"{plotjuggler.MODE}/data"]
    _tab(tabs, "Status", "-", [_time(regions), _time(inputs), _time(status)])
    ElementTree.SubElement(tabs, "currentTabIndex", index="0")
    ElementTree.SubElement(root, "use_relative_time_offset", enabled="0")
    ElementTree.indent(root, " ")
    return "<?xml version='1.0' encoding='UTF-8'?>\n" + ElementTree.tostring(root, encoding="unicode") + "\n"


def foxglove_layout(axes: Sequence[str]) -> str:
    """The layout of Foxglove (JSON) for a machine with these axes."""
    field = dict(zip(axes, field_names(axes), strict=True))
    position = {axis: f"{TELEMETRY_TOPIC}.{field[axis]}.position{MICROMETRES}" for axis in axes}
    panels: dict[str, dict[str, Any]] = {}
    orbits = []
    for x, y in radial_pairs(axes):
        orbits.append(f"Plot!orbit_{field[x]}")
        panels[orbits[-1]] = _panel(f"Orbit {x}, {y} (um)", {y: position[y]}, "custom", position[x])
    panels["Plot!position"] = _panel("Position (um)", position)
    panels["Plot!current"] = _panel(
        "Control current (A)", {axis: f"{TELEMETRY_TOPIC}.{field[axis]}.current" for axis in axes}
    )
    panels["Plot!reference"] = _panel(
        "Reference (um)", {axis: f"{TELEMETRY_TOPIC}.{field[axis]}.reference{MICROMETRES}" for axis in axes}
    )
    panels["Plot!spectrum"] = _panel(
        "Spectrum of the position (um over Hz)",
        {axis: f"{SPECTRUM_TOPIC}.{field[axis]}[:]{MICROMETRES}" for axis in axes},
        "currentCustom",
        f"{SPECTRUM_TOPIC}.frequency[:]",
    )
    panels["Plot!region"] = _panel(
        "Region (0 A, 1 B, 2 C, 3 D)",
        {axis: f'{STATES[REGION_STATE]}.axes[:]{{name=="{axis}"}}.region' for axis in axes},
    )
    panels["RawMessages!status"] = {"topicPath": STATES[REGION_STATE], "diffEnabled": False}
    left = _stacked([*orbits, "Plot!spectrum"], "column")
    right = _stacked(["Plot!position", "Plot!reference", "Plot!current"], "column")
    status = _stacked(["Plot!region", "RawMessages!status"], "row")
    layout = {
        "direction": "column",
        "first": {"direction": "row", "first": left, "second": right, "splitPercentage": 40},
        "second": status,
        "splitPercentage": 75,
    }
    content = {"configById": panels, "globalVariables": {}, "userNodes": {}, "playbackConfig": {"speed": 1}}
    return json.dumps(content | {"layout": layout}, indent=1) + "\n"


def _tab(tabs: ElementTree.Element, name: str, orientation: str, plots: Sequence[ElementTree.Element]) -> None:
    """Add a tab with plots beside (|) or below (-) each other."""
    tab = ElementTree.SubElement(tabs, "Tab", containers="1", tab_name=name)
    container = ElementTree.SubElement(tab, "Container")
    sizes = ";".join([f"{1.0 / len(plots):g}"] * len(plots))
    splitter = ElementTree.SubElement(
        container, "DockSplitter", sizes=sizes, count=str(len(plots)), orientation=orientation
    )
    for plot in plots:
        ElementTree.SubElement(splitter, "DockArea", name="...").append(plot)


def _time(names: Sequence[str]) -> ElementTree.Element:
    """A plot of series over time."""
    plot = _plot("TimeSeries")
    for name, colour in zip(names, itertools.cycle(COLOURS), strict=False):
        ElementTree.SubElement(plot, "curve", name=name, color=colour)
    return plot


def _xy(pairs: Sequence[tuple[str, str]]) -> ElementTree.Element:
    """A plot of series over each other."""
    plot = _plot("XYPlot")
    for (x, y), colour in zip(pairs, itertools.cycle(COLOURS), strict=False):
        ElementTree.SubElement(plot, "curve", name=f"{x} over {y}", color=colour, curve_x=x, curve_y=y)
    return plot


def _plot(mode: str) -> ElementTree.Element:
    plot = ElementTree.Element("plot", mode=mode, style="Lines", flip_x="false", flip_y="false")
    ElementTree.SubElement(plot, "limitY")
    return plot


def _panel(title: str, paths: dict[str, str], x: str = "timestamp", x_path: str = "") -> dict[str, Any]:
    """A plot panel of Foxglove."""
    series = [
        {
            "value": path,
            "label": label,
            "enabled": True,
            "timestampMethod": "headerStamp" if x == "timestamp" else "receiveTime",
        }
        for label, path in paths.items()
    ]
    panel: dict[str, Any] = {
        "foxglovePanelTitle": title,
        "title": title,
        "paths": series,
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "isSynced": x == "timestamp",
        "xAxisVal": x,
        "sidebarDimension": 240,
    }
    if x_path:
        panel["xAxisPath"] = {"value": x_path, "enabled": True, "timestampMethod": "receiveTime"}
    return panel


def _stacked(panels: Sequence[str], direction: str) -> Any:
    """Panels of equal size in a row or column."""
    if len(panels) == 1:
        return panels[0]
    return {
        "direction": direction,
        "first": panels[0],
        "second": _stacked(panels[1:], direction),
        "splitPercentage": round(100 / len(panels)),
    }
