"""The port to a Cortex-M7: built for it, run in QEMU beside the host's build, and what it needs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from amb_core.rig.link.reference import SOURCE
from tests.qemu_board import build, missing, size
from tests.soak.board import Beside, Compared, beside

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
    found, _ = ran
    assert (found.frames_equal, found.steps_equal) == (found.frames, found.steps)
    assert found.steps > 250
    assert found.frames > 30


def test_the_rotor_levitates_and_follows_the_excitation(ran: tuple[Compared, Beside]) -> None:
    _, both = ran
    positions = np.array(both.positions)
    excited = positions[-EXCITED - 30 : -30]
    assert np.abs(positions).max() < 125e-6  # the trip share of the clearance
    assert np.ptp(excited[:, 0]) > 2e-6  # of an excitation of 4 um from peak to peak


def test_it_needs_no_more_than_the_guide_says(image: Path, ran: tuple[Compared, Beside]) -> None:
    """By a tenth at most, since compilers differ; a short run takes the same ways through the code."""
    found, needed = ran[0], size(image)
    guide = (SOURCE / "PORTING.md").read_text()
    measured = {
        "code and constants": needed.code,
        "variables, without the buffer of uploads": needed.ram_without_uploads,
        "stack used": found.stack_bytes,
        "control step, worst": found.instructions,
    }
    for name, value in measured.items():
        row = re.search(rf"^\| {name} \| ([\d ]+) ", guide, re.MULTILINE)
        assert row is not None, name
        assert 0 < value <= 1.1 * int(row[1].replace(" ", "")), name
