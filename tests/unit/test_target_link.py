"""The host's end of AMB-UDP on a socket and on a pseudo-terminal, with the emulated target beyond a bad network."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest

from amb_core.ground.errors import TargetError
from amb_core.loop.control import ControllerParameters
from amb_core.rig.emulation import LOCALHOST
from amb_core.rig.emulation.listening import PSEUDO_TERMINAL
from amb_core.rig.link import (
    AmbUdpLink,
    ExcitationPhase,
    Limits,
    TargetDescription,
    TargetLink,
    TargetSettings,
    TargetState,
    TargetStatus,
    TelemetryBlock,
    TooLateError,
)
from amb_core.rig.link.session import STREAM_TIMEOUT
from tests.served_emulator import ServedEmulator
from tests.soak.tap import Tap

KEY = bytes(range(32))
TIMEOUT = 60.0
PATIENT = {"timeout": TIMEOUT, "silence": TIMEOUT}
"""A link (s) that takes no thread of a loaded machine, which waits for its turn, for a target that has gone."""
BAD = {"loss": 0.05, "duplication": 0.02, "reordering": 0.02, "corruption": 0.02}


class Listener:
    """Keeps what a link delivers."""

    def __init__(self) -> None:
        self.blocks: list[TelemetryBlock] = []
        self.events: list[str] = []
        self.changed = threading.Condition()

    def on_samples(self, block: TelemetryBlock) -> None:
        with self.changed:
            self.blocks.append(block)
            self.changed.notify_all()

    def on_status(self, status: TargetStatus) -> None:
        pass

    def on_silence(self) -> None:
        self._note("silence")

    def on_return(self, description: TargetDescription, rebooted: bool) -> None:
        self._note("reboot" if rebooted else "return")

    def _note(self, event: str) -> None:
        with self.changed:
            self.events.append(event)
            self.changed.notify_all()

    def wait_for(self, condition: Callable[[], bool]) -> None:
        with self.changed:
            assert self.changed.wait_for(condition, TIMEOUT), self.events

    def wait_for_step(self, step: int) -> None:
        self.wait_for(lambda: bool(self.blocks) and self.blocks[-1].first_step + self.blocks[-1].steps > step)

    def at(self, first: int, steps: int, name: str) -> np.ndarray:
        """A signal over some steps of the target, NaN where samples are missing."""
        values = np.full((steps, 2), np.nan)
        for block in self.blocks:
            for row, step in enumerate(range(block.first_step, block.first_step + block.steps)):
                if first <= step < first + steps:
                    values[step - first] = getattr(block, name)[row]
        return values


@pytest.fixture(params=[LOCALHOST, PSEUDO_TERMINAL])
def served(request: pytest.FixtureRequest):
    with ServedEmulator(key=KEY, host=request.param) as emulator:
        yield emulator


@pytest.fixture
def listener() -> Listener:
    return Listener()


@pytest.fixture
def link(served: ServedEmulator):
    link = AmbUdpLink(served.address, served.port, KEY, float64=True, **PATIENT)
    yield link
    link.close()


def why_not_connected(port: int, key: bytes, address: str = LOCALHOST) -> str:
    """Why a target that answers is refused; a busy machine, on which no answer comes in a short time, gets longer."""
    said = ""
    for timeout in (0.3, 3.0, TIMEOUT):
        with pytest.raises(TargetError) as refused:
            AmbUdpLink(address, port, key, timeout=timeout).connect(Listener())
        said = str(refused.value)
        if "no answer" not in said:
            break
    return said


def settled(link: TargetLink, state: TargetState) -> TargetStatus:
    """The status of the target once it is in a state."""
    until = time.monotonic() + TIMEOUT
    while (status := link.status()).state is not state:
        assert time.monotonic() < until, status
    return status


def levitated(link: AmbUdpLink, listener: Listener) -> TargetDescription:
    description = link.connect(listener)
    link.configure(TargetSettings(ControllerParameters(), description.limits, ()))
    link.levitate(0.01)
    settled(link, TargetState.LEVITATED)
    return description


def noise(steps: int) -> np.ndarray:
    return np.random.default_rng(steps).uniform(-1e-8, 1e-8, (steps, 2))


def test_an_excitation_arrives_bit_for_bit_over_a_bad_network_and_begins_at_its_step(
    served: ServedEmulator, link: AmbUdpLink, listener: Listener
) -> None:
    description = levitated(link, listener)
    served.fail(to_host=BAD, from_host=BAD)
    samples = noise(40_000)
    arm = link.upload(samples)
    served.fail()
    first = link.status().step + 2_000
    arm(first)
    listener.wait_for_step(first + 1_500)
    reference = listener.at(first - 10, 1_500, "reference")
    expected = np.vstack([np.zeros((10, 2)), samples[:1_490]])
    there = ~np.isnan(reference[:, 0])
    assert there.all()
    assert np.array_equal(reference, expected)
    assert link.count.resent > 0
    assert description.machine.axis_names == ("x", "y")


def test_the_second_before_a_trip_is_read_over_a_bad_network_although_its_telemetry_was_lost(
    served: ServedEmulator, link: AmbUdpLink, listener: Listener
) -> None:
    levitated(link, listener)
    listener.wait_for_step(listener.blocks[-1].first_step + 2_000)
    served.fail(to_host=BAD | {"loss": 1.0})
    began = served.do(lambda emulator: emulator.steps)
    until = time.monotonic() + TIMEOUT
    while served.do(lambda emulator: emulator.steps) < began + 12_000:
        assert time.monotonic() < until
        time.sleep(0.01)
    served.fail(to_host=BAD, from_host=BAD, amplifier=True)
    (trip,) = settled(link, TargetState.TRIPPED).trips
    blocks = link.trip_record()
    assert (blocks[0].first_step, sum(block.steps for block in blocks)) == (trip.step - 10_000, 10_000)
    assert all(later.first_step == one.first_step + one.steps for one, later in itertools.pairwise(blocks))
    known = listener.at(blocks[0].first_step, 10_000, "position").astype(np.float32)
    read = np.concatenate([block.position for block in blocks])
    there = ~np.isnan(known[:, 0])
    assert np.array_equal(read[there], known[there])
    assert not there.all()
    link.forget_trip_record()
    with pytest.raises(TargetError, match="keeps nothing: no trip since its start or reset"):
        link.trip_record()


def test_gaps_are_those_that_the_network_made_to_the_sample(
    served: ServedEmulator, link: AmbUdpLink, listener: Listener
) -> None:
    link.connect(listener)
    listener.wait_for(lambda: bool(listener.blocks))
    served.fail(to_host=BAD)
    listener.wait_for(lambda: link.count.samples.lost > 500)
    served.fail()
    end = served.do(lambda emulator: emulator.steps)
    listener.wait_for_step(end + 1_000)
    link.close()
    reached = listener.blocks[-1].first_step + listener.blocks[-1].steps  # a pseudo-terminal that is full holds it up
    injected = served.do(lambda emulator: list(emulator.to_host.count.gaps))
    gaps = link.count.samples
    assert gaps.late == 0
    lost = {step for gap in injected for step in range(gap.first, gap.stop) if step < reached}
    assert {step for first, stop in gaps.gaps for step in range(first, stop)} == lost
    assert gaps.lost == len(lost)
    assert gaps.doubled > 0
    assert gaps.reordered > 0
    steps = np.concatenate([np.arange(block.first_step, block.first_step + block.steps) for block in listener.blocks])
    assert (np.diff(steps) > 0).all()  # each once, in order


def test_a_step_that_has_passed_is_refused_with_the_next_one(link: AmbUdpLink, listener: Listener) -> None:
    levitated(link, listener)
    arm = link.upload(noise(100))
    with pytest.raises(TooLateError) as refused:
        arm(1)
    assert refused.value.next_step > 1


def test_a_refusal_names_command_and_reason(link: AmbUdpLink, listener: Listener) -> None:
    description = link.connect(listener)
    with pytest.raises(TargetError, match="refuses LEVITATE: a value is not allowed"):
        link.levitate(1e3)
    with pytest.raises(TargetError, match="refuses DELEVITATE: it is off"):
        link.land(1.0)
    link.land(0.0)  # off is what it is
    with pytest.raises(TargetError, match="beyond the target's limits"):
        link.upload(np.full((10, 2), 2.0 * description.limits.excitation_amplitude))
    higher = Limits(**{**vars(description.limits), "excitation_slew": 1e9})
    with pytest.raises(TargetError, match="refuses PARAMETERS"):
        link.configure(TargetSettings(ControllerParameters(), higher, ()))


def test_a_wrong_key_is_named_as_a_possible_reason(served: ServedEmulator) -> None:
    assert "is the key right" in why_not_connected(served.port, bytes(32), served.address)


def test_nobody_at_the_port_is_an_error_of_one_line(listener: Listener) -> None:
    with pytest.raises(TargetError, match=r"no answer from the target at 127\.0\.0\.1 port 9 .* is it on\?"):
        AmbUdpLink(port=9, timeout=0.2).connect(listener)


def test_a_target_that_comes_back_is_found_and_streams_on(served: ServedEmulator, listener: Listener) -> None:
    link = AmbUdpLink(served.address, served.port, KEY, float64=True, timeout=TIMEOUT, silence=2.0)
    try:
        levitated(link, listener)
        served.pause(True)
        listener.wait_for(lambda: "silence" in listener.events)
        with pytest.raises(TargetError, match="no reply"):
            link.status()
        served.pause(False)
        listener.wait_for(lambda: "return" in listener.events)
        listener.wait_for_step(served.do(lambda emulator: emulator.steps))
        assert settled(link, TargetState.LEVITATED).trips == ()
        assert link.count.samples.lost == 0  # a target that stood still has lost nothing
    finally:
        link.close()


def test_a_target_that_answers_but_makes_no_steps_loses_no_telemetry(
    served: ServedEmulator, link: AmbUdpLink, listener: Listener
) -> None:
    levitated(link, listener)
    served.do(lambda emulator: emulator.run(5))  # amid a frame
    served.stop_steps(True)
    time.sleep(4.0 * STREAM_TIMEOUT)  # heartbeats are answered, samples do not come
    served.stop_steps(False)
    listener.wait_for_step(served.do(lambda emulator: emulator.steps) + 500)
    assert link.count.samples.lost == 0


def test_a_reboot_is_noticed_and_the_new_boot_takes_commands(
    served: ServedEmulator, link: AmbUdpLink, listener: Listener
) -> None:
    levitated(link, listener)
    served.do(lambda emulator: emulator.reboot())
    listener.wait_for(lambda: "reboot" in listener.events)
    link.levitate(0.01)
    settled(link, TargetState.LEVITATED)
    listener.wait_for_step(served.do(lambda emulator: emulator.steps) + 100)


def test_a_landing_passes_an_upload(served: ServedEmulator, link: AmbUdpLink, listener: Listener) -> None:
    levitated(link, listener)
    served.fail(from_host={"loss": 0.5})
    ended = threading.Event()

    def upload() -> None:
        with pytest.raises(TargetError, match="called off"):
            link.upload(noise(90_000), ended.is_set)

    uploading = threading.Thread(target=upload)
    uploading.start()
    link.land(0.0)
    assert uploading.is_alive()
    settled(link, TargetState.OFF)
    ended.set()
    uploading.join(TIMEOUT)


def test_a_host_that_is_there_keeps_an_excitation_alive(listener: Listener) -> None:
    with ServedEmulator(limits={"host_time": 0.5}) as served:
        link = AmbUdpLink(port=served.port, float64=True, **PATIENT)
        try:
            levitated(link, listener)
            arm = link.upload(noise(90_000))
            first = link.status().step + 1_000
            arm(first)
            listener.wait_for_step(first + 20_000)
            assert link.status().excitation is ExcitationPhase.PLAYING
        finally:
            link.close()
        listener.blocks.clear()
        served.do(lambda emulator: emulator.run(20_000))
        status = served.do(lambda emulator: emulator.status())
        assert status is not None


@pytest.mark.parametrize("served", [LOCALHOST], indirect=True)  # whoever attacks stands between two sockets
def test_hostile_frames_end_neither_the_link_nor_its_telemetry(served: ServedEmulator, listener: Listener) -> None:
    with Tap(served.port) as tap:
        link = AmbUdpLink(port=tap.port, key=KEY, float64=True, **PATIENT)
        try:
            link.connect(listener)
            tap.attack(True)
            listener.wait_for(lambda: tap.hostile > 5_000 and link.count.refused > 1_000)
            assert link.status().state is TargetState.OFF  # sealed replies get through
            tap.attack(False)
            listener.wait_for_step(served.do(lambda emulator: emulator.steps) + 1_000)
            assert "reboot" not in listener.events
        finally:
            link.close()
