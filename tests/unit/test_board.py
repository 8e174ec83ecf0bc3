"""The port to a Cortex-M7: built for it, run in QEMU beside the host's build, and what it needs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from amb_core.rig.link import Code, FrameType, Reply, Session, decode
from amb_core.rig.link.reference import SOURCE
from tests.qemu_board import build, missing, size
from tests.soak.board import Beside, Compared, beside
from tests.soak.board_model import identified
from tests.target_rig import KEY, NONCE, golden

REASON = missing()
pytestmark = [pytest.mark.skipif(bool(REASON), reason=REASON), pytest.mark.timeout(600)]
EXCITED = 120  # steps


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("board"))


@pytest.fixture(scope="module")
def ran(image: Path) -> tuple[Compared, Beside]:
    return beside(image, EXCITED)


def test_every_frame_and_current_equals_the_host_build_bit_for_bit(ran: tuple[Compared, Beside]) -> None:
    comparison, _ = ran
    assert (comparison.frames_equal, comparison.steps_equal) == (comparison.frames, comparison.steps)
    assert comparison.steps > 250
    assert comparison.frames > 30


def test_the_rotor_levitates_and_follows_the_excitation(ran: tuple[Compared, Beside]) -> None:
    _, both = ran
    positions = np.array(both.positions)
    excited = positions[-EXCITED - 30 : -30]
    assert np.abs(positions).max() < 125e-6  # the trip share of the clearance
    assert np.ptp(excited[:, 0]) > 2e-6  # of an excitation of 4 um from peak to peak


def test_it_answers_the_recorded_exchange_as_it_was_recorded(ran: tuple[Compared, Beside]) -> None:
    """But for the limits, which are above those of its configuration."""
    recorded = [decode(item.frame, Session(NONCE, 2, 4, KEY)) for item in golden() if not item.from_host]
    expected = [(reply.command, reply.code) for reply in recorded if isinstance(reply, Reply)]
    limits = expected.index((FrameType.PARAMETERS, Code.DONE)) + 3  # after gains and two references
    expected[limits] = FrameType.PARAMETERS, Code.BAD_VALUE
    assert [(reply.command, reply.code) for reply in ran[1].replies] == expected


@pytest.mark.slow
def test_the_model_from_its_telemetry_is_that_of_the_host_build(image: Path) -> None:
    model = identified(image)
    assert (model["samples"], model["samples_equal"], model["models_equal"]) == (8_000, 8_000, True)
    assert model["fit_percent"] > 90.0  # of a plant without noise; the rest is its nonlinearity


def test_it_needs_no_more_than_the_guide_says(image: Path, ran: tuple[Compared, Beside]) -> None:
    """By a tenth at most, since compilers differ; a short run takes the same ways through the code."""
    comparison, needed = ran[0], size(image)
    guide = (SOURCE / "PORTING.md").read_text()
    measured = {
        "code and constants": needed.code,
        "variables, without the two buffers": needed.ram_without_buffers,
        "buffer of the second before a trip": needed.record,
        "stack used": comparison.stack_bytes,
        "control step, worst": comparison.instructions,
        "control step of a state-space law of order 23, worst": comparison.instructions_state_space,
    }
    for name, value in measured.items():
        row = re.search(rf"^\| {name} \| ([\d ]+) ", guide, re.MULTILINE)
        assert row is not None, name
        assert 0 < value <= 1.1 * int(row[1].replace(" ", "")), name
