"""What the live page shows besides samples: sections of plain values, made from the messages of the graph."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from amb_bringup.client.rig import MODES
from amb_bringup.view.samples import SampleDisplay
from amb_core.ground.errors import AmbError, one_line
from amb_core.ground.files.parameter_files import BRIDGE_NODE
from amb_core.ground.results import plain
from amb_core.recording.messages.loop_samples import block_from_message
from amb_core.recording.messages.machine import machine_from_message
from amb_core.recording.messages.region_map import region_map_from_message
from amb_core.recording.messages.region_state import region_state_from_message
from amb_core.recording.messages.state_space_model import model_from_message
from amb_core.regions.region_map import BOUNDARIES, RegionMap
from amb_core.regions.state import AxisState, RegionState
from amb_msgs.msg import BridgeState, ExcitationStatus
from amb_ros import topics
from amb_ros.diagnostics import TOPIC as DIAGNOSTICS
from amb_ros.simulator_modes import MODE_NAMES

KEPT_LINES = 300  # of the log
KEPT_TRIPS = 50
KEPT_NODES = 64
LONGEST_TEXT = 500  # characters of a text of a message
SILENCE = 2.5  # s without diagnostics after which a node counts as away; nodes report twice a second
PUBLISHERS = {"region": "region_monitor", "excitation": "excitation_generator"}
"""Sections that one node of the graph reports, besides the plant."""
PLANTS = {"simulator": "simulator", "rig": BRIDGE_NODE}
LOG_LEVELS = {10: "debug", 20: "info", 30: "warn", 40: "error", 50: "fatal"}
HEALTH = ("ok", "warn", "error", "stale")


class Picture:
    """The state of the graph, as sections by name; a section is replaced when it changes.

    Parameters
    ----------
    clock : callable, optional
        Returns the time (s).
    namespace : str, optional
        Namespace of the nodes of the graph. Others are listed with them, and say nothing of the graph.

    Attributes
    ----------
    samples : SampleDisplay
        The display of telemetry.
    sections : dict
        Values that JSON can express, by name of the section.
    log : deque of dict
        The last lines, oldest first, numbered in `number`.
    source : str
        `simulator` or `bridge`, as topic `machine` gives it; empty before.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic, namespace: str = topics.NAMESPACE) -> None:
        self.samples = SampleDisplay()
        self.sections: dict[str, Any] = {"trips": [], "nodes": {}}
        self.log: deque[dict[str, Any]] = deque(maxlen=KEPT_LINES)
        self.source = ""
        self._clock = clock
        self._namespace = namespace.strip("/")
        self._lines = 0
        self._layout_of = -1
        self._heard: dict[str, tuple[float, dict[str, str]]] = {}  # by node: when, and its report
        self._refused: dict[str, str] = {}  # the last refusal, by topic
        self._takers: dict[str, Callable[[Any], None]] = {
            topics.MACHINE: self._on_machine,
            topics.SIMULATOR_STATE: self._on_simulator,
            topics.BRIDGE_STATE: self._on_bridge,
            topics.REGION: self._on_region,
            topics.REGION_MAP: lambda message: self.use_map(region_map_from_message(message)),
            topics.EXCITATION_STATUS: self._on_excitation,
            topics.MODEL: self._on_model,
            topics.TRIP: self._on_trip,
            DIAGNOSTICS: self._on_diagnostics,
            "/rosout": self._on_log,
        }

    def take(self, topic: str, message: Any, published: int) -> None:
        """Take in a message; one that is not in order is refused with a line in the log."""
        try:
            if topic == topics.TELEMETRY:
                self.samples.add(int(message.run), block_from_message(message), 1e-9 * published)
            elif topic in self._takers:
                self._takers[topic](message)
        except (AmbError, ValueError, OverflowError) as problem:
            self._refuse(topic, one_line(problem) if isinstance(problem, AmbError) else str(problem))

    def use_map(self, region_map: RegionMap) -> None:
        """Show a region map."""
        boundaries = {region.name: [plain(value) for value in region_map.frequencies(region)] for region in BOUNDARIES}
        self.sections["map"] = {
            "amplitude": region_map.amplitudes.tolist(),
            "boundaries": boundaries,
            "highest": [plain(sweep.highest_frequency) for sweep in region_map.sweeps],
            "frequencies": [region_map.settings.frequency_start, region_map.settings.frequency_end],
        }

    def update(self) -> None:
        """Bring what depends on time up to date: which nodes are away, and the speed of the run."""
        now = self._clock()
        nodes = {
            name: {**report, "away": now - heard > SILENCE} for name, (heard, report) in sorted(self._heard.items())
        }
        samples = self.samples
        own = {
            name: bool(report["away"]) for name, report in nodes.items() if name.rpartition("/")[0] == self._namespace
        }
        self.sections["nodes"] = nodes
        self.sections["away"] = self._sections_away(own)
        self.sections["graph"] = {
            "alive": not all(own.values()),
            "known": bool(own),
            "rate": round(samples.rate, 1),
            "sampleRate": round(1.0 / samples.sample_time, 6) if samples.sample_time else None,
            "lost": samples.lost,
        }
        if self._layout_of != samples.epoch:
            self._layout_of = samples.epoch
            self.sections["layout"] = samples.layout()

    def _sections_away(self, away: Mapping[str, bool]) -> list[str]:
        """The sections whose node is away: what they hold is the last of it. A node that never reported is not."""
        publishers = dict(PUBLISHERS)
        if "plant" in self.sections:
            publishers["plant"] = PLANTS[self.sections["plant"]["what"]]
        return [
            section for section, node in publishers.items() if away.get(f"{self._namespace}/{node}".lstrip("/"), False)
        ]

    def _refuse(self, topic: str, problem: str) -> None:
        if self._refused.get(topic) != problem:  # not the same line a hundred times a second
            self._refused[topic] = problem
            self._add_line("warn", "view", f"a message on {topic} is not shown: {problem}")

    def _add_line(self, level: str, name: str, text: str) -> None:
        self._lines += 1
        line = {"number": self._lines, "at": time.time(), "level": level, "name": _text(name), "text": _text(text)}
        self.log.append(line)

    def _on_machine(self, message: Any) -> None:
        machine = machine_from_message(message)
        self.source = machine.source
        self.samples.use(machine)
        self.sections["machine"] = {
            "name": _text(machine.name),
            "source": _text(machine.source),
            "sampleRate": machine.sample_rate,
            "axes": [{"name": _text(axis.name), "bearing": _text(axis.bearing)} for axis in machine.axes],
            "bearings": [{"name": _text(part.name), "clearance": plain(part.clearance)} for part in machine.bearings],
        }

    def _on_simulator(self, message: Any) -> None:
        mode = MODE_NAMES.get(message.mode, "unknown")
        self.sections["plant"] = {"what": "simulator", "mode": mode, "run": message.run, "problem": ""}

    def _on_bridge(self, message: Any) -> None:
        self.sections["plant"] = {
            "what": "rig",
            "mode": MODES.get(message.mode, "unknown"),
            "run": message.run,
            "problem": _text(message.problem),
            "alarm": bool(message.alarm),
            "tripped": message.mode == BridgeState.TRIPPED,
            "lost": message.lost,
            "missed": message.missed,
        }

    def _on_region(self, message: Any) -> None:
        state: RegionState = region_state_from_message(message)
        self.sections["region"] = {
            "run": int(message.run),
            "region": state.region.name,
            "settled": state.settled,
            "radius": plain(state.radius),
            "axes": [_axis(axis) for axis in state.axes],
        }

    def _on_excitation(self, message: ExcitationStatus) -> None:
        self.sections["excitation"] = {
            "run": message.run,
            "kind": _text(message.kind),
            "accepted": bool(message.accepted),
            "message": _text(message.message),
            "first": message.first_step,
            "steps": message.steps,
        }

    def _on_model(self, message: Any) -> None:
        model = model_from_message(message)
        self.sections["model"] = {
            "order": model.order,
            "method": _text(model.method),
            "source": _text(model.source),
            "samples": model.samples,
            "outputs": [_text(name) for name in message.output_names],
            "fit": [plain(value) for value in message.fit],
            "unstable": len(model.unstable_poles()),
        }

    def _on_trip(self, message: Any) -> None:
        trip = {
            "at": message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec,
            "run": message.run,
            "step": message.step,
            "text": _text(message.text),
        }
        self.sections["trips"] = [*self.sections["trips"], trip][-KEPT_TRIPS:]

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            name = _text(status.name)
            level = int.from_bytes(status.level, "little")
            report = {"level": HEALTH[min(level, len(HEALTH) - 1)], "message": _text(status.message)}
            self._heard[name] = (self._clock(), report)
        while len(self._heard) > KEPT_NODES:
            self._heard.pop(min(self._heard, key=lambda name: self._heard[name][0]))

    def _on_log(self, message: Any) -> None:
        self._add_line(LOG_LEVELS.get(message.level, "info"), message.name, message.msg)


def _axis(axis: AxisState) -> dict[str, Any]:
    """Region of an axis with its evidence."""
    return {
        "name": _text(axis.name),
        "region": axis.region.name,
        "since": plain(axis.since.time),
        "bias": plain(axis.bias),
        "trend": plain(axis.trend),
        "significance": plain(axis.trend_significance),
        "oscillation": [plain(axis.oscillation_amplitude), plain(axis.oscillation_frequency)],
        "input": [plain(axis.input_amplitude), plain(axis.input_frequency)],
        "response": plain(axis.response_amplitude),
        "resonance": axis.since.resonance,
        "beat": axis.sampling_beat,
        "drifting": axis.drift is not None,
        "oscillating": axis.oscillation is not None,
        "steady": [plain(axis.steady_amplitude), plain(axis.steady_frequency)],
        "even": plain(axis.even_distortion),
        "odd": plain(axis.odd_distortion),
        "frozen": axis.frozen,
        "not_judged": _text(axis.not_judged),
    }


def _text(text: str) -> str:
    """A text of a message, at most LONGEST_TEXT characters of it."""
    return text if len(text) <= LONGEST_TEXT else f"{text[:LONGEST_TEXT]}…"
