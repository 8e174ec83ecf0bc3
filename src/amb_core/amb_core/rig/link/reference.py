"""The reference target in this process: the C code of `target/`, one call per control step.

For emulators and tests. The code is compiled by gcc; its boards are in `target/hosted`.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import TargetError
from amb_core.loop.machine import Machine
from amb_core.loop.pd_parameters import ControllerParameters, pack_gains
from amb_core.rig.link.frames import require_key
from amb_core.rig.link.layout import LARGEST_FRAME, LONGEST_KEY, MOST_AXES, NONCE, Limits

SOURCE = Path(__file__).resolve().with_name("c")
"""Folder of the C code: in a checkout a link to its folder `target`, of which each build of this package has a copy."""
COMPILER = (
    "gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-pedantic", "-ffp-contract=off",
)  # fmt: skip
VERSION = (1, 0, 0)
LONGEST_LANDING = 30.0
"""Longest time in which the reference may cross a clearance (s), by `amb_init` and the command for settings."""


class _Axis(ctypes.Structure):
    _fields_ = (("name", ctypes.c_char * 16), ("bearing", ctypes.c_char * 16), ("number", ctypes.c_double * 8))


class _Config(ctypes.Structure):
    _fields_ = (
        ("machine", ctypes.c_char * 32),
        ("firmware", ctypes.c_char * 32),
        ("sample_rate", ctypes.c_double),
        ("firmware_version", ctypes.c_uint32),
        ("axes", ctypes.c_uint8),
        ("coils", ctypes.c_uint8),
        ("key_length", ctypes.c_uint8),
        ("key", ctypes.c_uint8 * LONGEST_KEY),
        ("axis", _Axis * MOST_AXES),
        ("limits", ctypes.c_double * (len(Limits().to_bytes()) // 8)),
        ("gains", ctypes.c_double * (5 * MOST_AXES)),
        ("waveform", ctypes.c_void_p),
        ("waveform_size", ctypes.c_uint32),
        ("record", ctypes.c_void_p),
        ("record_words", ctypes.c_uint32),
    )


class Peer(ctypes.Structure):
    """Sender or receiver of a datagram: IPv4 address, port, and whether it is this machine itself."""

    _fields_ = (("address", ctypes.c_uint32), ("port", ctypes.c_uint16), ("loopback", ctypes.c_bool))


LOOPBACK = Peer(0x7F000001, 40_000, True)


def build_library(library: Path, options: Iterable[str] = ("-O2",), source: Path = SOURCE) -> Path:
    """Compile the reference target with the hosted board into a shared library, if it is older than its sources.

    Parameters
    ----------
    library : Path
        File of the shared library to write.
    options : iterable of str, optional
        Options of the compiler.
    source : Path, optional
        Folder of the C code.

    Returns
    -------
    Path
        `library`.

    Raises
    ------
    TargetError
        If the sources or the compiler are missing, or the code does not compile.
    """
    files = sorted([*source.glob("*.c"), *source.glob("hosted/*.c")])
    if not files:
        raise TargetError(f"no C code in {source}; it is the folder `target` of the workbench's checkout")
    newest = max(file.stat().st_mtime for file in [*files, *source.glob("*.h"), *source.glob("hosted/*.h")])
    if library.exists() and library.stat().st_mtime >= newest:
        return library
    library.parent.mkdir(parents=True, exist_ok=True)
    made = library.with_name(f"{library.name}.{os.getpid()}")
    command = [*COMPILER, *options, "-shared", "-fPIC", "-o", str(made), *map(str, files), "-lm"]
    try:
        subprocess.run(command, check=True, capture_output=True, text=True)
    except FileNotFoundError:
        raise TargetError("the reference target needs the compiler gcc (Debian or Ubuntu: apt install gcc)") from None
    except subprocess.CalledProcessError as problem:
        raise TargetError(f"the reference target does not compile: {problem.stderr.strip()}") from None
    made.replace(library)  # two processes may build it at the same time
    return library


class ReferenceTarget:
    """A target in this process.

    Parameters
    ----------
    library : Path
        From `build_library`.
    machine : Machine
        The machine that it controls.
    limits : Limits, optional
        Its limits. The defaults of `Limits` if None.
    controller : ControllerParameters, optional
        Gains until a host sets others. The defaults of `ControllerParameters` if None.
    key : bytes, optional
        Shared secret; empty: it takes commands from loopback only.
    coils : int, optional
        Coil currents that it measures.
    waveform_bytes : int, optional
        Room for uploads.
    nonce : bytes, optional
        Random number of this boot; by default a new one.
    record_steps : int, optional
        Steps before a trip that it keeps; a second if None.

    Attributes
    ----------
    position, coil_current, current : ndarray, shapes (axes,), (coils,), (axes,)
        Measured position (m) and coil currents (A) of the next step, set by the caller; control current references of
        the latest step (A).
    enabled : bool
        Whether the amplifiers are on since the latest step or datagram.
    steps : int
        Steps since the boot.

    Raises
    ------
    TargetError
        If the machine or the key does not fit into a target.
    """

    def __init__(
        self,
        library: Path,
        machine: Machine,
        limits: Limits | None = None,
        controller: ControllerParameters | None = None,
        key: bytes = b"",
        coils: int = 0,
        waveform_bytes: int = 4 * 100_000 * 8,
        nonce: bytes | None = None,
        record_steps: int | None = None,
    ) -> None:
        self._config, self._waveform = _config(machine, limits or Limits(), key, coils, waveform_bytes)
        kept = round(machine.sample_rate) if record_steps is None else record_steps
        self._record = np.zeros(kept * (3 * len(machine.axes) + 1), np.uint32)
        self._config.record, self._config.record_words = self._record.ctypes.data, self._record.size
        self._config.gains[: 5 * len(machine.axes)] = (
            pack_gains((controller or ControllerParameters()).at_rate(machine.sample_rate), len(machine.axes))[:, :5]
            .ravel()
            .tolist()
        )
        self._library = _functions(library)
        # A target is some 64-bit words of the caller's memory.
        self._memory = np.zeros(self._library.hosted_size() // 8 + 1, np.uint64)
        self.position, self.current = np.zeros((2, len(machine.axes)))
        self.coil_current = np.zeros(coils)
        self.enabled = False
        self._period = 1e9 / machine.sample_rate
        self.steps = 0
        self._frame, self._to = ctypes.create_string_buffer(LARGEST_FRAME), Peer()
        self._address = self._memory.ctypes.data
        slowest = max(bearing.clearance for bearing in machine.bearings) / LONGEST_LANDING
        slew = (limits or Limits()).reference_slew
        self._refused = "no room for it, or a number that is not allowed"
        if slew < slowest:
            self._refused = (
                f"limits.reference_slew = {slew:g} m/s is not allowed; allowed: {slowest:.2g} m/s or more, to cross "
                f"its largest clearance within {LONGEST_LANDING:g} s"
            )
        self._arrays = self.position.ctypes.data, self.coil_current.ctypes.data
        self._output = self.current.ctypes.data
        self.reboot(nonce)

    def reboot(self, nonce: bytes | None = None) -> None:
        """Start anew, with a new nonce: everything that a host has set or uploaded is forgotten.

        Parameters
        ----------
        nonce : bytes, optional
            Random number of the new boot; None for a new one.

        Raises
        ------
        TargetError
            If the nonce is not allowed, or the target does not start with its configuration.
        """
        drawn = nonce or os.urandom(NONCE)
        if len(drawn) != NONCE or not any(drawn[:4]):
            raise TargetError(f"nonce {drawn.hex()}; allowed: {NONCE} bytes, not all of the first four 0")
        self.steps = 0
        if not self._library.hosted_init(self._address, ctypes.byref(self._config), drawn):
            raise TargetError(
                f"the target does not start with this configuration of {self._config.axes} axes: {self._refused}"
            )

    def step(self, time: int | None = None, temperature: float = 0.0, amplifier_fault: bool = False) -> bool:
        """One control step with `position` and `coil_current`; sets `current`. Returns whether the amplifiers are on.

        Parameters
        ----------
        time : int, optional
            Time of the step (ns), for the target's watchdog; by default exactly one sample after the last.
        temperature : float, optional
            Of the machine (deg C).
        amplifier_fault : bool, optional
            Whether the amplifiers report one.

        Returns
        -------
        bool
            Whether the amplifiers are on.
        """
        now = round(self.steps * self._period) if time is None else time
        self.steps += 1
        self.enabled = self._library.hosted_step(
            self._address, *self._arrays, temperature, amplifier_fault, now, self._output
        )
        return self.enabled

    def feed(self, datagram: bytes, sender: Peer = LOOPBACK) -> None:
        """Hand a received datagram to the target, which answers it at once; see `take`.

        Parameters
        ----------
        datagram : bytes
            As received.
        sender : Peer, optional
            Address from which it came; loopback by default.
        """
        self.enabled = self._library.hosted_feed(self._address, datagram, len(datagram), ctypes.byref(sender))

    @property
    def hardware_enable(self) -> bool:
        """The output for the enable of the amplifiers in hardware."""
        return bool(self._library.hosted_hardware_enable(self._address))

    @property
    def waits(self) -> bool:
        """Whether the host is to set the currents, and has not yet for the latest step."""
        return bool(self._library.hosted_waits(self._address))

    def take(self) -> list[tuple[bytes, Peer]]:
        """Datagrams that the target has sent since the last call, with their receivers; 64 are kept at most.

        Returns
        -------
        list of (bytes, Peer)
            Each datagram with its receiver, oldest first.
        """
        taken = []
        while length := self._library.hosted_take(self._address, self._frame, ctypes.byref(self._to)):
            taken.append((self._frame.raw[:length], Peer(self._to.address, self._to.port, self._to.loopback)))
        return taken


def _functions(library: Path) -> ctypes.CDLL:
    functions = ctypes.CDLL(str(library))
    functions.hosted_size.argtypes, functions.hosted_size.restype = [], ctypes.c_size_t
    functions.hosted_init.argtypes, functions.hosted_init.restype = (
        [ctypes.c_void_p] * 2 + [ctypes.c_char_p],
        ctypes.c_bool,
    )
    functions.hosted_step.argtypes = [ctypes.c_void_p] * 3 + [
        ctypes.c_double, ctypes.c_bool, ctypes.c_uint64, ctypes.c_void_p,
    ]  # fmt: skip
    functions.hosted_step.restype = ctypes.c_bool
    functions.hosted_feed.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t, ctypes.c_void_p]
    functions.hosted_feed.restype = ctypes.c_bool
    functions.hosted_waits.argtypes, functions.hosted_waits.restype = [ctypes.c_void_p], ctypes.c_bool
    functions.hosted_hardware_enable.argtypes = [ctypes.c_void_p]
    functions.hosted_hardware_enable.restype = ctypes.c_bool
    functions.hosted_take.argtypes, functions.hosted_take.restype = [ctypes.c_void_p] * 3, ctypes.c_size_t
    return functions


def _config(
    machine: Machine, limits: Limits, key: bytes, coils: int, waveform_bytes: int
) -> tuple[_Config, NDArray[np.uint8]]:
    require_key(key)
    if not 0 <= coils <= 2 * MOST_AXES or not 1 <= waveform_bytes < 1 << 32:
        raise TargetError(
            f"{coils} coils and {waveform_bytes} bytes for uploads; allowed: 0 to {2 * MOST_AXES}, 1 to {2**32 - 1}"
        )
    waveform = np.zeros(waveform_bytes, np.uint8)
    clearance = {bearing.name: bearing.clearance for bearing in machine.bearings}
    config = _Config(
        machine=_name(machine.name, 32),
        firmware=b"reference",
        sample_rate=machine.sample_rate,
        firmware_version=VERSION[0] << 16 | VERSION[1] << 8 | VERSION[2],
        axes=len(machine.axes),
        coils=coils,
        key_length=len(key),
        waveform=waveform.ctypes.data,
        waveform_size=waveform_bytes,
    )
    config.key[: len(key)] = list(key)
    config.limits[:] = np.frombuffer(limits.to_bytes()).tolist()
    for row, axis in zip(config.axis, machine.axes, strict=False):
        row.name, row.bearing = _name(axis.name, 16), _name(axis.bearing, 16)
        row.number[:] = (
            axis.sensor_position, axis.actuator_position, *axis.direction, axis.bias_current, axis.current_limit,
            clearance[axis.bearing],
        )  # fmt: skip
    return config, waveform


def _name(text: str, room: int) -> bytes:
    name = text.encode()
    if len(name) >= room or b"\0" in name:
        raise TargetError(f"the name {text!r} has {len(name)} bytes; allowed: {room - 1}")
    return name
