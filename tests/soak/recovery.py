"""Hosts under attack, who lost the counter, or whose target started anew: each must command again within a second."""

from __future__ import annotations

import time
from typing import Any

from amb_core.ground.errors import TargetError
from amb_core.rig.link import AmbUdpLink, TargetDescription, TargetStatus, TelemetryBlock
from tests.served_emulator import ServedEmulator
from tests.soak.on_path import ATTACKS, OnPath, leave_alone

KEY = bytes(range(32))
AHEAD = 1_000  # commands of another host
LONGEST = 1.0  # s


class _Listener:
    def on_samples(self, block: TelemetryBlock) -> None:
        pass

    def on_status(self, status: TargetStatus) -> None:
        pass

    def on_silence(self) -> None:
        pass

    def on_return(self, description: TargetDescription, rebooted: bool) -> None:
        pass


def recovery(rounds: int = 10) -> dict[str, Any]:
    """Each attack with each loss, so many times; the longest time is by the clock of the target.

    Parameters
    ----------
    rounds : int, optional
        Of all combinations.
    """
    attacks = recovered = 0
    longest = 0.0
    with ServedEmulator(key=KEY) as served, OnPath(served.port) as path:
        for _ in range(rounds):
            for attack in ATTACKS:
                for lose in (_nothing, _the_counter, _the_boot):
                    seconds = _once(served, path, attack, lose)
                    attacks += 1
                    recovered += seconds <= LONGEST
                    longest = max(longest, seconds)
                    if seconds > LONGEST:
                        print(f"{attack}, {lose.__name__}: {seconds:g} s", flush=True)
    return {"recovery": {"attacks": attacks, "recovered": recovered, "longest_s": longest}}


def _once(served: ServedEmulator, path: OnPath, attack: str, lose: Any) -> float:
    """Seconds of the target from the loss, under attack, until a command of a connected host is done."""
    path.attack = leave_alone
    link = _connected(path)
    try:
        path.attack = ATTACKS[attack]
        time.sleep(0.05)  # it has begun
        lose(served)
        began = served.do(lambda emulator: emulator.steps)
        while True:
            try:
                link.land(0.0)
                break
            except TargetError:  # silent for the moment
                if _seconds(served, began) > 20.0:
                    break
        return _seconds(served, began)
    finally:
        path.attack = leave_alone
        link.close()


def _connected(path: OnPath) -> AmbUdpLink:
    """A link as users have it; made anew where a loaded machine keeps the target silent while it connects."""
    for _ in range(10):
        path.first.clear()
        link = AmbUdpLink(port=path.port, key=KEY, timeout=20.0)
        try:
            link.connect(_Listener())
        except TargetError as problem:
            silent = problem
        else:
            return link
    raise silent


def _seconds(served: ServedEmulator, began: int) -> float:
    return served.do(lambda emulator: (emulator.steps - began) / emulator.plant.machine.sample_rate)


def _nothing(served: ServedEmulator) -> None:
    pass


def _the_counter(served: ServedEmulator) -> None:
    """Another host with the key commands the same target."""
    other = AmbUdpLink(port=served.port, key=KEY, timeout=20.0, silence=20.0)
    try:
        other.connect(_Listener())
        other._writer.counter += AHEAD
        other.status()
    finally:
        other.close()


def _the_boot(served: ServedEmulator) -> None:
    served.do(lambda emulator: emulator.reboot())
