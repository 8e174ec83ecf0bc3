"""Who a host takes for its target: forged and repeated descriptions, a lost counter, and answers that are strange."""

from __future__ import annotations

import itertools
import math
import socket
import struct
import threading
import time
from collections.abc import Callable

import pytest

from amb_core.ground.errors import TargetError
from amb_core.loop.control import ControllerParameters
from amb_core.rig.link import (
    AmbUdpLink,
    Command,
    FrameType,
    ReferenceTarget,
    Reply,
    TargetDescription,
    TargetSettings,
    TargetState,
    TelemetryBlock,
)
from amb_core.rig.link.layout import ParameterKind
from tests.served_emulator import ServedEmulator
from tests.soak.on_path import resummed
from tests.soak.recovery import recovery
from tests.target_rig import library, machine
from tests.unit.test_target_link import KEY, PATIENT, Listener, levitated, settled, why_not_connected


def test_a_host_under_attack_commands_again_within_a_second() -> None:
    figures = recovery(rounds=1)["recovery"]
    assert (figures["attacks"], figures["recovered"]) == (18, 18), figures


class Strange:
    """A target whose descriptions are changed on their way."""

    def __init__(self, change: Callable[[bytes], bytes], key: bytes = b"") -> None:
        self._target, self._change = ReferenceTarget(library(), machine(), key=key), change
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.1)
        self.port = self._socket.getsockname()[1]
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Strange:
        self._thread.start()
        return self

    def __exit__(self, *problem: object) -> None:
        self._ended.set()
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                frame, peer = self._socket.recvfrom(2048)
            except TimeoutError:
                continue
            self._target.feed(frame)
            for answer, _ in self._target.take():
                self._socket.sendto(self._change(answer), peer)


def put(offset: int, block: bytes) -> Callable[[bytes], bytes]:
    """Change bytes of the payload, with a right checksum."""
    return lambda frame: resummed(frame[: 24 + offset] + block + frame[24 + offset + len(block) :])


def double(offset: int, value: float) -> Callable[[bytes], bytes]:
    return put(offset, struct.pack("<d", value))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda frame: resummed(frame[:4] + b"\1" + frame[5:]), "version 1 of the protocol; known: 2"),
        (lambda frame: frame[:4] + b"\3" + frame[5:40], "version 3 of the protocol; known: 2"),
        (lambda frame: frame[:4] + b"\3" + frame[5:] + bytes(1000), "version 3 of the protocol; known: 2"),
        (lambda frame: b"X" + frame[1:], "magic"),
        (lambda frame: frame[:-1], "its header gives it"),
        (lambda frame: frame[:12], "12 bytes"),
        (lambda frame: frame[:-1] + bytes([frame[-1] ^ 1]), "wrong checksum"),
        (lambda frame: resummed(frame[:5] + b"\x33" + frame[6:]), "unknown type 0x33"),
        (put(0, b"other challenge."), "answers another HELLO"),
        (put(16, b"nonce"), "with another nonce"),
        (put(32, struct.pack("<Q", 1 << 63)), "counter"),
        (put(40, b"\xff\xfe"), "description"),
        (double(104, math.nan), "sample rate of nan Hz"),
        (put(128, b"\x11"), "of 17"),
        (double(136, math.nan), "limit control_current is nan"),
        (put(132, b"\1"), "it needs a key"),
        (double(136, 1.0), "wrong tag"),
    ],
)
def test_a_strange_description_is_named(change: Callable[[bytes], bytes], reason: str) -> None:
    with Strange(change) as target:
        said = why_not_connected(target.port, b"")
        assert "answers, but cannot be used" in said
        assert reason in said
        assert "is it on" not in said


@pytest.mark.parametrize(
    ("of_target", "of_host", "reason"),
    [(KEY, bytes(32), "is the key right"), (KEY, b"", "it needs a key"), (b"", KEY, "it has no key")],
)
def test_another_key_is_named(of_target: bytes, of_host: bytes, reason: str) -> None:
    with Strange(lambda frame: frame, of_target) as target:
        said = why_not_connected(target.port, of_host)
        assert reason in said
        assert KEY.hex() not in said


# -- a rotor that is levitated already


@pytest.fixture
def served():
    with ServedEmulator(key=KEY) as emulator:
        yield emulator


def connected(served: ServedEmulator, settings: Callable[[], ControllerParameters]) -> tuple[AmbUdpLink, Listener]:
    link, listener = AmbUdpLink(port=served.port, key=KEY, float64=True, **PATIENT), Listener()
    description = link.connect(listener)
    link.configure(TargetSettings(settings(), description.limits, ()))
    return link, listener


def test_a_host_that_connects_to_a_levitated_rotor_does_not_move_it(served: ServedEmulator) -> None:
    first = AmbUdpLink(port=served.port, key=KEY, **PATIENT)
    levitated(first, Listener())
    first.close()
    link, listener = connected(
        served, lambda: ControllerParameters(nominal_reference=(90e-6, 40e-6), proportional_gain=0.0)
    )
    try:
        step = link.status().step
        listener.wait_for_step(step + 2_000)
        assert link.status().state is TargetState.LEVITATED
        assert not any(block.reference.any() for block in listener.blocks)
    finally:
        link.close()


def test_a_host_is_heard_although_another_one_commands_while_it_connects(
    served: ServedEmulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, link = (AmbUdpLink(port=served.port, key=KEY, **PATIENT) for _ in range(2))
    levitated(first, Listener())
    begin = link._begin_session

    def after_a_command_of_the_other() -> TargetDescription:
        known = begin()
        first.status()
        return known

    monkeypatch.setattr(link, "_begin_session", after_a_command_of_the_other)
    link.connect(Listener())
    assert link.status().state is TargetState.LEVITATED
    link.close()
    first.close()


def test_a_command_whose_counter_another_host_has_used_is_sent_with_a_later_one(served: ServedEmulator) -> None:
    first, link = (AmbUdpLink(port=served.port, key=KEY, **PATIENT) for _ in range(2))
    first.connect(Listener())
    link.connect(Listener())
    first._writer.catch_up(link._writer.counter)
    first.status()
    assert link.status().state is TargetState.OFF
    link.close()
    first.close()


def test_a_host_that_is_refused_does_not_take_the_samples_from_the_one_that_closes_the_loop(
    served: ServedEmulator,
) -> None:
    first, listener = AmbUdpLink(port=served.port, key=KEY, **PATIENT), Listener()
    limits = first.connect(listener).limits
    first.configure(TargetSettings(ControllerParameters(), limits, (), "off"))
    served.stop_steps(True)  # no current is due meanwhile
    first.levitate(0.0)
    with pytest.raises(TargetError, match="in the other mode of the loop; land it first"):
        connected(served, ControllerParameters)
    step = first.status().step
    served.stop_steps(False)
    listener.wait_for_step(step + 500)
    assert first.count.samples.lost == 0
    first.close()


def test_what_it_changes_meanwhile_waits_with_the_rest_until_the_rotor_has_landed(served: ServedEmulator) -> None:
    first = AmbUdpLink(port=served.port, key=KEY, **PATIENT)
    description = levitated(first, Listener())
    first.close()
    link, listener = connected(served, lambda: ControllerParameters(nominal_reference=(0.0, 30e-6)))
    try:
        link.configure(TargetSettings(ControllerParameters(nominal_reference=(0.0, 20e-6)), description.limits, ()))
        assert link.settings_wait
        listener.wait_for_step(link.status().step + 2_000)
        assert not any(block.reference.any() for block in listener.blocks)
        link.land(0.0)
        link.reset_faults()
        link.levitate(0.01)
        listener.wait_for(lambda: bool(listener.blocks) and listener.blocks[-1].reference[-1, 1] == 20e-6)
        assert not link.settings_wait
        assert link.status().state in (TargetState.LEVITATING, TargetState.LEVITATED)
    finally:
        link.close()


def test_what_it_changes_on_a_rotor_of_its_own_is_sent_and_moves_slowly(served: ServedEmulator) -> None:
    link, listener = AmbUdpLink(port=served.port, key=KEY, float64=True, **PATIENT), Listener()
    try:
        description = levitated(link, listener)
        link.configure(TargetSettings(ControllerParameters(nominal_reference=(0.0, 40e-6)), description.limits, ()))
        listener.wait_for(lambda: listener.blocks[-1].reference[-1, 1] == 40e-6)
        reference = [row for block in listener.blocks for row in block.reference[:, 1].tolist()]
        assert max(abs(after - before) for before, after in itertools.pairwise(reference)) < 1.01e-6
    finally:
        link.close()


def test_what_was_taken_before_a_refusal_is_sent_again_when_the_host_goes_back(
    served: ServedEmulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The gains are taken; the nominal reference, beyond the alarm, is not."""
    link = AmbUdpLink(port=served.port, key=KEY, float64=True, **PATIENT)
    limits, sent, send = levitated(link, Listener()).limits, [], link._command

    def noted(command: Command) -> Reply:
        if command.type is FrameType.PARAMETERS:
            sent.append(ParameterKind(command.body[0]))
        return send(command)

    monkeypatch.setattr(link, "_command", noted)
    far = ControllerParameters(proportional_gain=26_000.0, nominal_reference=(0.0, 120e-6))
    try:
        with pytest.raises(TargetError, match="a value is not allowed"):
            link.configure(TargetSettings(far, limits, ()))
        assert sent == [ParameterKind.GAINS, ParameterKind.NOMINAL_REFERENCE]
        link.configure(TargetSettings(ControllerParameters(), limits, ()))
        assert sent[2:] == [ParameterKind.GAINS, ParameterKind.NOMINAL_REFERENCE]
        link.configure(TargetSettings(ControllerParameters(), limits, ()))
        assert not sent[4:], "the target has them"
    finally:
        link.close()


# -- a target that has tripped


def test_a_host_connects_to_a_target_that_has_tripped_and_sets_it(served: ServedEmulator) -> None:
    first = AmbUdpLink(port=served.port, key=KEY, **PATIENT)
    levitated(first, Listener())
    served.fail(temperature=500.0)
    settled(first, TargetState.TRIPPED)
    first.close()
    served.fail()
    link, listener = connected(served, lambda: ControllerParameters(nominal_reference=(0.0, 30e-6)))
    try:
        link.reset_faults()
        link.levitate(0.01)
        listener.wait_for(lambda: bool(listener.blocks) and listener.blocks[-1].reference[-1, 1] == 30e-6)
    finally:
        link.close()


# -- a listener that fails


def test_an_error_of_the_listener_is_shown_and_the_target_keeps_its_host(
    served: ServedEmulator, caplog: pytest.LogCaptureFixture
) -> None:
    class Failing(Listener):
        def on_samples(self, block: TelemetryBlock) -> None:
            raise RuntimeError("no room")

    link = AmbUdpLink(port=served.port, key=KEY, **PATIENT)
    levitated(link, Failing())
    try:
        assert link.error == "internal error of the link's listener: RuntimeError('no room')"
        assert [record.message for record in caplog.records] == [link.error]
        link.land(0.0)
        assert link.status().state is TargetState.OFF
    finally:
        link.close()


# -- a reboot into a description that is no machine


def test_a_reboot_is_one_although_the_target_is_no_machine_at_first(served: ServedEmulator) -> None:
    def name_second_axis(name: bytes) -> None:
        served.do(lambda emulator: setattr(emulator._target._config.axis[1], "name", name))

    link, listener = AmbUdpLink(port=served.port, key=KEY, **PATIENT), Listener()
    try:
        levitated(link, listener)
        name_second_axis(b"x")  # as the first
        served.do(lambda emulator: emulator.reboot())
        refused = link.count.refused
        while link.count.refused == refused:
            time.sleep(0.01)
        name_second_axis(b"y")
        listener.wait_for(lambda: "reboot" in listener.events)
    finally:
        link.close()
