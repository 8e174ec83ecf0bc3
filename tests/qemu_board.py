"""The port of the target to a Cortex-M7, built for its processor and run in QEMU, with the bench on its second UART.

Debian's packages: gcc-arm-none-eabi, libnewlib-arm-none-eabi, qemu-system-arm; `scripts/board.sh` installs them.
"""

from __future__ import annotations

import os
import re
import select
import shutil
import socket
import struct
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from amb_core.rig.link.byte_stream import StreamReader, to_stream
from amb_core.rig.link.reference import SOURCE

PORT = SOURCE / "ports" / "mps2_an500"
PROCESSOR = ("-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-d16", "-mfloat-abi=hard")
COMPILER = (
    "arm-none-eabi-gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-ffp-contract=off", "-O2",
    *PROCESSOR, "-ffunction-sections", "-fdata-sections",
)  # fmt: skip
TICKS = 1024 / 40  # of the processor's clock at 25 MHz, an instruction: QEMU counts 2^10 ns for it
PATIENCE = 60.0  # s


def missing() -> str:
    """Why the port cannot be run here; empty if it can."""
    absent = [program for program in ("arm-none-eabi-gcc", "qemu-system-arm") if shutil.which(program) is None]
    return f"{' and '.join(absent)} not there; scripts/board.sh installs them" if absent else ""


@dataclass(frozen=True)
class Size:
    """Memory of the image: code and constants, variables, its two buffers, and variables without them (bytes)."""

    code: int
    ram: int
    waveform: int
    record: int

    @property
    def ram_without_buffers(self) -> int:
        """Variables without the buffers of uploads and of the second before a trip (bytes)."""
        return self.ram - self.waveform - self.record


def build(folder: Path) -> Path:
    """Compile and link the port."""
    image = folder / "target.elf"
    files = [*sorted(SOURCE.glob("*.c")), SOURCE / "ports" / "stream.c", *sorted(PORT.glob("*.c"))]
    link = ("-Wl,--gc-sections", "-nostartfiles", "--specs=nano.specs", "-T", str(PORT / "memory.ld"))
    subprocess.run([*COMPILER, *link, "-o", image, *files, "-lm"], check=True)
    return image


def size(image: Path) -> Size:
    """Memory that an image needs; its stack, of which `Answer.stack` is used, apart."""
    sections = subprocess.run(["arm-none-eabi-size", "-A", image], check=True, capture_output=True, text=True).stdout
    bytes_of = {name: int(count) for name, count in re.findall(r"^(\.\S+)\s+(\d+)", sections, re.MULTILINE)}
    symbols = subprocess.run(["arm-none-eabi-nm", "-S", image], check=True, capture_output=True, text=True).stdout
    buffers = {name: int(count, 16) for count, name in re.findall(r"^\w+ (\w+) \w (\w+)$", symbols, re.MULTILINE)}
    ram = bytes_of[".data"] + bytes_of[".bss"]
    return Size(bytes_of[".text"] + bytes_of[".data"], ram, buffers["waveform"], buffers["record"])


@dataclass(frozen=True)
class Answer:
    """What a step has done: currents (A), enables, instructions of the step, stack (bytes)."""

    current: tuple[float, ...]
    enabled: bool
    hardware_enable: bool
    instructions: int
    stack: int


class Line:
    """One UART of the board."""

    def __init__(self, listening: socket.socket) -> None:
        listening.settimeout(PATIENCE)
        self._socket, _ = listening.accept()
        listening.close()
        self._reader, self.frames = StreamReader(), list[bytes]()

    def send(self, frame: bytes) -> None:
        """Send a frame."""
        self._socket.sendall(to_stream(frame))

    def fileno(self) -> int:
        """File descriptor, to wait for bytes."""
        return self._socket.fileno()

    def read(self) -> None:
        """Take the bytes that are there."""
        received = self._socket.recv(1 << 16)
        assert received, "QEMU has ended"
        self.frames += self._reader.take(received)

    def close(self) -> None:
        """Close it."""
        self._socket.close()


class Board:
    """A board that has started: `send` and `receive` are its link, `step` its converters."""

    def __init__(self, image: Path, nonce: bytes) -> None:
        paths = [image.with_name(name) for name in ("link", "bench")]
        listening = []
        for path in paths:
            path.unlink(missing_ok=True)
            listening.append(socket.socket(socket.AF_UNIX))
            listening[-1].bind(os.fspath(path))
            listening[-1].listen(1)
        serial = [argument for path in paths for argument in ("-serial", f"unix:{path}")]
        self._process = subprocess.Popen(
            ["qemu-system-arm", "-M", "mps2-an500", "-icount", "shift=10,sleep=off", "-display", "none", "-monitor",
             "none", *serial, "-kernel", os.fspath(image)],
        )  # fmt: skip
        self._link, self._bench = (Line(one) for one in listening)
        self._bench.send(nonce)
        self.send = self._link.send

    def step(self, time: int, position: list[float], coil: list[float], temperature: float, fault: bool) -> Answer:
        """One control step; time in ns, positions in m, coil currents in A, temperature in deg C."""
        self._bench.send(struct.pack(f"<Qd{len(position) + len(coil)}d?", time, temperature, *position, *coil, fault))
        *current, enabled, hardware, control, stack = struct.unpack(
            f"<{len(position)}d2?2I", self._received(self._bench)
        )
        return Answer(
            tuple(current), enabled, hardware, round(control / TICKS), stack
        )  # fmt: skip

    def receive(self) -> bytes:
        """Wait for the next frame on the link."""
        return self._received(self._link)

    def _received(self, line: Line) -> bytes:
        """The next frame of a line. Both are read: a socket that is full stops the board."""
        while not line.frames:
            there = select.select([self._link, self._bench], [], [], PATIENCE)[0]
            assert there, "the board does not answer"
            for one in there:
                one.read()
        return line.frames.pop(0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *problem: object) -> None:
        self._process.kill()
        self._process.wait()
        self._link.close()
        self._bench.close()
