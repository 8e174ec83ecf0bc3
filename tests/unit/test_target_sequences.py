"""The random sequences against the C target: nothing is found, and what is planted is."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from amb_core.rig.link import TripReason
from amb_core.rig.link.reference import SOURCE
from tests.soak.safety import build, run

SEQUENCES = 2_000


def test_no_sequence_makes_the_reference_jump_or_breaks_a_limit(tmp_path: Path) -> None:
    counts = run(build(tmp_path), 2 * SEQUENCES)
    assert (counts["sequences"], counts["jumps"], counts["limits_broken"]) == (2 * SEQUENCES, 0, 0)
    assert min(counts["accepted"], counts["refused"], counts["excited"], counts["offs"]) > 500
    assert counts["levitated"] > 0.5 * counts["steps"]
    common = set(TripReason) - {TripReason.LAW}
    assert min(counts["reasons"][reason] for reason in common) > 0


@pytest.mark.parametrize(
    ("file", "was", "planted", "counted"),
    [
        ("command.c", "amb_move(t, value, 0.0);", "t->ramp_left = 0;", "jumps"),
        (
            "command.c",
            "    if (!amb_levitating(t)) {\n        memcpy(t->gains",
            "    {\n        memcpy(t->gains",
            "jumps",
        ),
        ("command.c", "!within(value[i], 0.5 * now, 2.0 * now)", "false", "limits_broken"),
        ("command.c", "if (amb_levitating(t)) t->state = AMB_OFF;", "amb_ramp(t, AMB_LANDING, 1.0);", "limits_broken"),
        ("command.c", "if (t->lock_left) return AMB_LOCKED;", "", "limits_broken"),
        ("target.c", "        t->excitation = AMB_NONE;\n", "", "limits_broken"),
        ("target.c", "    board_enable(t->board, amb_levitating(t));\n", "", "limits_broken"),
        (
            "protect.c",
            "limit = t->limits[settled ?",
            "limit = (settled ? 1.0 : 1e9) * t->limits[settled ?",
            "limits_broken",
        ),
        ("protect.c", "if (full && t->saturated", "if (false && t->saturated", "limits_broken"),
        ("excitation.c", " || !amb_keeps_distance(t, t->nominal, t->limits, true)", "", "limits_broken"),
        ("excitation.c", "<= fastest", "<= 1e9 * fastest", "jumps"),
    ],
)
def test_what_is_planted_is_found(tmp_path: Path, file: str, was: str, planted: str, counted: str) -> None:
    source = tmp_path / "target"
    shutil.copytree(SOURCE, source)
    text = (source / file).read_text()
    assert text.count(was) == 1
    (source / file).write_text(text.replace(was, planted))
    assert run(build(tmp_path, source), SEQUENCES)[counted] > 0
