"""A host and the reference target in one process, and the exchange between them of which the golden frames are made.

`python -m tests.target_rig` writes tests/data/target/frames.json anew: only after a change of the protocol.
"""

from __future__ import annotations

import functools
import json
import math
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from amb_core.linear.model import StateSpaceModel
from amb_core.loop.control import ControllerParameters
from amb_core.loop.machine import Machine, MachineAxis, MachineBearing
from amb_core.loop.pd_parameters import pack_gains
from amb_core.rig.link import (
    LOOPBACK,
    Answer,
    Command,
    CommandWriter,
    Description,
    Law,
    Limits,
    Peer,
    ReferenceTarget,
    Refusal,
    Reply,
    TargetStatus,
    Upload,
    build_library,
    commands,
    decode,
    excitation_upload,
    hello,
)
from amb_core.rig.link.layout import VERSION, UploadKind
from amb_core.rig.link.reference import VERSION as FIRMWARE

GOLDEN = Path(__file__).parent / "data" / "target" / "frames.json"
KEY, NONCE = bytes(range(32)), bytes(range(0xA0, 0xB0))
HOST = Peer(0xC0A80001, 5000, False)
UNDEFINED = ("-O1", "-fsanitize=undefined", "-fno-sanitize-recover=all")
"""Options under which undefined behaviour ends the process."""


@functools.cache
def library() -> Path:
    """The target as a library, compiled once a test run."""
    return build_library(Path(tempfile.mkdtemp(prefix="target")) / "target.so", UNDEFINED)


def machine(axes: int = 2, clearance: float = 250e-6) -> Machine:
    """A machine with bearings of two axes each."""
    names = [f"{'xy'[axis % 2]}_{axis // 2}" for axis in range(axes)]
    directions = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    return Machine(
        "rig",
        "bridge",
        10_000.0,
        tuple(
            MachineAxis(name, f"bearing_{name[2:]}", 0.1 * axis, 0.125, directions[axis % 2], 2.5, 3.0)
            for axis, name in enumerate(names)
        ),
        tuple(MachineBearing(f"bearing_{number}", clearance) for number in range((axes + 1) // 2)),
    )


class Rig:
    """A target with a host that knows its key. `answers` of the target are kept until asked for."""

    def __init__(self, axes: int = 2, limits: Limits | None = None, coils: int = 0, key: bytes = KEY) -> None:
        self.target = ReferenceTarget(library(), machine(axes), limits, key=key, coils=coils, nonce=NONCE)
        self.key, self.peer = key, HOST if key else LOOPBACK
        self.connect()

    def connect(self) -> None:
        self.target.feed(hello(), self.peer)
        ((frame, _),) = self.target.take()
        self.take_description(frame)

    def take_description(self, frame: bytes) -> None:
        answer = decode(frame)
        assert isinstance(answer, Description)
        self.session = answer.session(self.key)
        self.writer = CommandWriter(self.session, answer.counter)

    def send(self, frame: bytes) -> list[Answer | Refusal]:
        """What the target answers to a frame."""
        self.target.feed(frame, self.peer)
        return self.answers()

    def answers(self) -> list[Answer | Refusal]:
        return [decode(frame, self.session) for frame, _ in self.target.take()]

    def command(self, command: Command) -> Reply:
        """The reply to a command."""
        (reply,) = (answer for answer in self.send(self.writer.write(command)) if isinstance(answer, Reply))
        assert reply.command == command.type
        return reply

    def step(self, position: Iterable[float] = (0.0, 0.0)) -> None:
        self.target.position[:] = position
        self.target.step()

    def noise(self, steps: int, amplitude: float = 1e-6, alive: bool = True) -> None:
        """So many steps with a rotor that moves a little, and a host that shows itself."""
        rng = np.random.default_rng(steps)
        for number in range(steps):
            self.step(rng.normal(0.0, amplitude, self.session.axes))
            if alive and number % 50 == 0:
                self.command(commands.heartbeat())

    def levitate(self) -> None:
        self.step(np.full(self.session.axes, 1e-6))
        assert self.command(commands.levitate()).code == 0
        self.noise(2)

    def upload(self, upload: Upload) -> Reply:
        assert self.command(upload.begin).code == 0
        for chunk in range(upload.chunks):
            self.send(self.writer.write(upload.chunk(chunk)))
        return self.command(upload.commit)

    def status(self) -> TargetStatus:
        return self.command(commands.heartbeat()).status


def small_controller(axes: int = 2) -> StateSpaceModel:
    """A stable controller of order 3 with offsets, errors as inputs."""
    rng = np.random.default_rng(3)
    none = np.zeros((axes, axes))
    return StateSpaceModel(
        a=np.diag([0.9, 0.5, -0.3]), b=rng.normal(size=(3, axes)), c=1e3 * rng.normal(size=(axes, 3)),
        d=1e4 * np.eye(axes), k=1e-4 * rng.normal(size=(3, axes)), innovation_covariance=none,
        input_offset=np.full(axes, 1e-6), output_offset=np.full(axes, 0.1), initial_state=np.zeros(3),
        sample_time=1e-4, input_names=tuple(f"e_{axis}" for axis in range(axes)),
        output_names=tuple(f"i_{axis}" for axis in range(axes)), input_units=("m",) * axes, output_units=("A",) * axes,
    )  # fmt: skip


@dataclass(frozen=True)
class Exchanged:
    """A frame of the exchange: its name, whether the host sent it, its bytes."""

    name: str
    from_host: bool
    frame: bytes


@dataclass(frozen=True)
class Stepped:
    """A control step between the frames: positions (m; NaN: a failed sensor) and coil currents (A) that it measures."""

    position: tuple[float, ...]
    coil_current: tuple[float, ...]


def exchange() -> list[Exchanged]:
    """The frames of an exchange with every type of command and answer, the same bytes every time."""
    return [row for row in rows_of_exchange() if isinstance(row, Exchanged)]


def rows_of_exchange() -> list[Exchanged | Stepped]:
    """The exchange, with the control steps between its frames."""
    rig = Rig(axes=2, coils=4)
    frames: list[Any] = []  # Exchanged, or Stepped

    def send(name: str, frame: bytes) -> None:
        frames.append(Exchanged(name, True, frame))
        rig.target.feed(frame, rig.peer)
        take(name)

    def take(name: str) -> None:
        frames.extend(Exchanged(f"{name}: answer", False, frame) for frame, _ in rig.target.take())

    def steps(name: str, count: int) -> None:
        for number in range(count):
            rig.target.coil_current[:] = [2.5 + number / 8, 2.25, 2.5 - number / 8, 2.75]
            step((number * 2.0**-20, -number * 2.0**-21))
        take(name)

    def step(position: tuple[float, ...]) -> None:
        frames.append(Stepped(position, tuple(rig.target.coil_current.tolist())))
        rig.step(position)

    rig.target.reboot(NONCE)
    send("hello", hello())
    rig.take_description(frames[-1].frame)
    steps("first steps", 2)
    signal = 1e-6 * np.arange(300).reshape(150, 2) % 5e-6
    matrices = (
        np.arange(9 + 6 + 6 + 4 + 6 + 6 + 2 + 2) / 64.0
    )  # no matrices of a library, whose last bits depend on the processor
    excitation, controller = (
        excitation_upload(1, signal),
        Upload(2, UploadKind.STATE_SPACE, matrices.tobytes(), 3, 2, 0),
    )
    parameters = ControllerParameters(derivative_filter=1e-4)
    plain = (
        ("heartbeat", commands.heartbeat()), ("clock", commands.clock(123_456_789)),
        ("gains", commands.gains(parameters, 2)), ("nominal reference", commands.nominal_reference((1e-6, -2e-6))),
        ("landing reference", commands.landing_reference((0.0, -200e-6))),
        ("limits", commands.limits(Limits(control_current=2.5, land_time=60.0))),
        ("stream float64 with coils and status", commands.stream(4, 7)), ("levitate", commands.levitate(0.0005)),
    )  # fmt: skip
    for name, command in plain:
        send(name, rig.writer.write(command))
    steps("float64", 12)
    send("stream float32", rig.writer.write(commands.stream(5)))
    for upload, name in ((controller, "controller"), (excitation, "excitation")):
        send(f"begin {name}", rig.writer.write(upload.begin))
        for chunk in range(upload.chunks):
            send(f"{name} chunk {chunk}", rig.writer.write(upload.chunk(chunk)))
            send(f"{name} bitmap {chunk}", rig.writer.write(upload.bitmap))
        send(f"commit {name}", rig.writer.write(upload.commit))
    send("arm", rig.writer.write(commands.arm(1, 20)))
    steps("float32", 10)
    for name, command in (
        ("disarm", commands.disarm()), ("controller refused while levitated", commands.controller(Law.STATE_SPACE)),
        ("delevitate", commands.delevitate(0.0002)),
    ):  # fmt: skip
        send(name, rig.writer.write(command))
    steps("landing", 10)
    send("controller", rig.writer.write(commands.controller(Law.STATE_SPACE)))
    step((math.nan, 0.0))
    take("sensor failed")
    steps("sensor repaired", 1)  # a reset keeps what the latest measurement still shows
    send("fault reset", rig.writer.write(commands.fault_reset()))
    _by_host(rig, send, steps)
    step((0.0, math.nan))
    take("sensor failed while levitated by the host")
    _second_before_the_trip(rig, send)
    return frames


def _by_host(rig: Rig, send: Callable[[str, bytes], None], steps: Callable[[str, int], None]) -> None:
    """The part of the exchange in which the host closes the loop."""
    for name, command in (
        ("loop by the host", commands.controller(Law.HOST_OR_LAND)), ("stream by sample", commands.stream(1, 5)),
        ("levitate by the host", commands.levitate()),
    ):  # fmt: skip
        send(name, rig.writer.write(command))
    for number in range(3):
        steps(f"sample {number}", 1)
        step = rig.target.steps - 1
        send(f"current {number}", commands.current(rig.session, step, (0.125 * number, -0.25)))


def _second_before_the_trip(rig: Rig, send: Callable[[str, bytes], None]) -> None:
    for name, command in (
        ("record", commands.record(0)), ("record from its second row", commands.record(1)),
        ("record beyond its end", commands.record(1000)), ("forget record", commands.forget_record()),
        ("record that is forgotten", commands.record(0)),
    ):  # fmt: skip
        send(name, rig.writer.write(command))


def golden() -> list[Exchanged]:
    """The exchange as it was recorded."""
    recorded = json.loads(GOLDEN.read_text())
    return [
        Exchanged(row["name"], row["from_host"], bytes.fromhex(row["frame"]))
        for row in recorded["frames"]
        if "frame" in row
    ]


def replayed() -> list[bytes]:
    """What a target sends that is made of the recorded file alone: configuration, steps and frames of the host."""
    recorded = json.loads(GOLDEN.read_text())
    configuration = recorded["configuration"]
    limits = Limits(**{name: math.inf if value is None else value for name, value in configuration["limits"].items()})
    bearings = {axis["bearing"]: axis["clearance"] for axis in configuration["axes"]}
    described = Machine(
        configuration["machine"], "bridge", configuration["sample_rate"],
        tuple(MachineAxis(**{name: tuple(value) if name == "direction" else value for name, value in axis.items()
                             if name != "clearance"}) for axis in configuration["axes"]),
        tuple(MachineBearing(name, clearance) for name, clearance in bearings.items()),
    )  # fmt: skip
    target = ReferenceTarget(
        library(), described, limits, key=bytes.fromhex(recorded["key"]), coils=configuration["coils"],
        nonce=bytes.fromhex(recorded["nonce"]), record_steps=configuration["record_steps"],
    )  # fmt: skip
    sent: list[bytes] = []
    for row in recorded["frames"]:
        if "position" in row:
            target.position[:] = [math.nan if value is None else value for value in row["position"]]
            target.coil_current[:] = row["coil_current"]
            target.step()
        elif row["from_host"]:
            target.feed(bytes.fromhex(row["frame"]), HOST)
        sent += [frame for frame, _ in target.take()]
    return sent


def main() -> None:
    """Record the exchange."""
    rows = [
        {"name": row.name, "from_host": row.from_host, "frame": row.frame.hex()}
        if isinstance(row, Exchanged)
        else {"position": _numbers(row.position), "coil_current": row.coil_current}
        for row in rows_of_exchange()
    ]
    GOLDEN.parent.mkdir(parents=True, exist_ok=True)
    record = {
        "protocol": VERSION, "key": KEY.hex(), "nonce": NONCE.hex(), "configuration": _configuration(), "frames": rows,
    }  # fmt: skip
    GOLDEN.write_text(json.dumps(record, indent=1, allow_nan=False) + "\n")


def _numbers(values: Iterable[float]) -> list[float | None]:
    """Numbers for a JSON file; null for those that are not finite."""
    return [value if math.isfinite(value) else None for value in values]


def _configuration() -> dict[str, object]:
    """What the target of the exchange is configured with; gains are those at boot, K_P in A/m and K_D in A s/m."""
    described, limits = machine(2), Limits()
    clearance = {bearing.name: bearing.clearance for bearing in described.bearings}
    gains = pack_gains(ControllerParameters().at_rate(described.sample_rate), 2)[:, :5]
    return {
        "machine": described.name, "firmware": "reference", "firmware_version": list(FIRMWARE),
        "sample_rate": described.sample_rate, "coils": 4, "waveform_bytes": 4 * 100_000 * 8,
        "record_steps": round(described.sample_rate),
        "axes": [asdict(axis) | {"clearance": clearance[axis.bearing]} for axis in described.axes],
        "limits": dict(zip(asdict(limits), _numbers(asdict(limits).values()), strict=True)), "gains": gains.tolist(),
    }  # fmt: skip


if __name__ == "__main__":
    main()
