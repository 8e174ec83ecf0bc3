"""Uploads to the C target, and excitations that start at an exact step."""

from __future__ import annotations

import numpy as np
import pytest

from amb_core.rig.link import Code, CommandWriter, Limits, TelemetryBlock, commands, excitation_upload
from amb_core.rig.link.layout import UploadKind
from amb_core.rig.link.upload import Upload
from tests.target_rig import Rig


def signal(steps: int = 1000, axes: int = 2) -> np.ndarray:
    return np.random.default_rng(steps).normal(0.0, 5e-6, (steps, axes))


def played(rig: Rig, steps: int) -> np.ndarray:
    """Reference of each step, telemetry in float64."""
    rows = []
    for number in range(steps):
        rig.step((1e-9 * (number % 3), 1e-9 * (number % 5)))
        rows += [answer.reference for answer in rig.answers() if isinstance(answer, TelemetryBlock)]
        if number % 100 == 0:
            rig.command(commands.heartbeat())
    return np.concatenate(rows)


def test_it_starts_at_the_armed_step_and_is_bit_for_bit_the_uploaded_one() -> None:
    rig, expected = Rig(), signal()
    rig.levitate()
    assert rig.upload(excitation_upload(5, expected)).code == Code.DONE
    rig.command(commands.stream(1, 1))
    now = rig.status().step
    assert rig.command(commands.arm(5, now + 37)).code == Code.DONE
    currents = played(rig, 1100)
    assert currents[37:1037].tobytes() == expected.tobytes()
    assert not currents[:37].any()
    assert not currents[1037:].any()


def test_chunks_arrive_in_any_order_with_losses_and_repetitions() -> None:
    rig, upload = Rig(), excitation_upload(9, signal(2000))
    rig.levitate()
    rig.command(upload.begin)
    rng = np.random.default_rng(0)
    assert rig.command(upload.bitmap).missing == tuple(range(upload.chunks))
    rounds = 0
    while missing := rig.command(upload.bitmap).missing:
        for chunk in rng.permutation(missing):
            frame = rig.writer.write(upload.chunk(int(chunk)))
            for _ in range(int(rng.integers(0, 3))):
                rig.send(frame)
        rounds += 1
    assert rounds > 1
    codes = [rig.command(upload.commit).code for _ in range(upload.chunks)]  # it checks a chunk at a time
    assert codes[-1] == Code.DONE
    assert set(codes) <= {Code.BUSY, Code.DONE}


@pytest.mark.parametrize(
    ("samples", "limits"),
    [
        (np.full((10, 2), 100.1e-6), Limits()),
        (np.full((10, 2), 50e-6), Limits(excitation_slew=0.4)),  # from zero
        (np.linspace(1e-6, 50e-6, 50)[:, None] * [1.0, 0.0], Limits(excitation_slew=0.4)),  # to zero
        (np.array([[0.0, 30e-6], [0.0, -30e-6]]), Limits(excitation_slew=0.5)),
    ],
)
def test_excitations_beyond_the_limits_are_refused(samples, limits) -> None:
    rig = Rig(2, limits)
    rig.levitate()
    assert rig.upload(excitation_upload(1, samples)).code == Code.BEYOND_LIMIT
    assert rig.command(commands.arm(1, 1000)).code == Code.NO_UPLOAD


def test_a_limit_that_is_lowered_counts_for_what_is_uploaded_already() -> None:
    rig = Rig()
    rig.levitate()
    rig.upload(excitation_upload(1, np.full((1000, 2), 50e-6)))
    rig.command(commands.limits(Limits(excitation_amplitude=40e-6)))
    assert rig.command(commands.arm(1, 100)).code == Code.BEYOND_LIMIT


def test_what_is_incomplete_or_damaged_is_not_played() -> None:
    rig, upload = Rig(), excitation_upload(1, signal())
    rig.levitate()
    rig.command(upload.begin)
    assert rig.command(upload.commit).code == Code.INCOMPLETE
    wrong = Upload(1, UploadKind.EXCITATION, bytes(16_000), 0, 0, 1000)
    for chunk in range(upload.chunks):
        rig.send(rig.writer.write(wrong.chunk(chunk)))
    assert rig.command(upload.commit).code == Code.CHECKSUM
    not_finite = Upload(2, UploadKind.EXCITATION, np.array([1e-6, np.nan]).tobytes(), 0, 0, 1)
    assert rig.upload(not_finite).code == Code.BAD_VALUE
    assert rig.command(commands.arm(2, 1000)).code == Code.NO_UPLOAD


def test_a_chunk_that_has_arrived_does_not_change_any_more() -> None:
    rig, upload = Rig(), excitation_upload(1, signal())
    rig.levitate()
    rig.command(upload.begin)
    for source in (upload, Upload(1, UploadKind.EXCITATION, bytes(16_000), 0, 0, 1000)):
        for chunk in range(upload.chunks):
            rig.send(rig.writer.write(source.chunk(chunk)))
    assert rig.command(upload.commit).code == Code.DONE


@pytest.mark.parametrize("steps", [0, -1, -1000])
def test_a_step_that_has_passed_is_refused(steps: int) -> None:
    rig = Rig()
    rig.levitate()
    rig.noise(1100)
    rig.upload(excitation_upload(1, signal(10)))
    now = rig.status().step
    code = rig.command(commands.arm(1, now + steps)).code
    assert code == (Code.DONE if steps == 0 else Code.TOO_LATE)


def test_nothing_is_uploaded_over_what_is_armed() -> None:
    rig = Rig()
    rig.levitate()
    rig.upload(excitation_upload(1, signal(10)))
    rig.command(commands.arm(1, rig.status().step + 50))
    assert rig.command(excitation_upload(2, signal(10)).begin).code == Code.WRONG_STATE
    rig.command(commands.disarm())
    assert rig.command(excitation_upload(2, signal(10)).begin).code == Code.DONE


def test_an_upload_without_room_is_refused_at_its_begin() -> None:
    rig = Rig()
    assert rig.command(excitation_upload(1, np.zeros((200_001, 2))).begin).code == Code.TOO_LARGE
    wrong_size = Upload(1, UploadKind.EXCITATION, bytes(32), 0, 0, 3)
    assert rig.command(wrong_size.begin).code == Code.BAD_VALUE


def test_only_a_levitated_machine_is_excited() -> None:
    rig = Rig()
    rig.step()
    rig.upload(excitation_upload(1, signal(10)))
    assert rig.command(commands.arm(1, 100)).code == Code.WRONG_STATE


def test_an_upload_is_forgotten_by_a_reboot() -> None:
    rig = Rig()
    rig.upload(excitation_upload(1, signal(10)))
    rig.target.reboot()
    rig.connect()
    assert isinstance(rig.writer, CommandWriter)
    rig.levitate()
    assert rig.command(commands.arm(1, 1000)).code == Code.NO_UPLOAD
