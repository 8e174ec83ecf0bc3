"""Checks of a port of the target: the example keeps to the protocol, and what a porter gets wrong is named."""

from __future__ import annotations

import socket

import pytest

from amb_core.ground.errors import TargetError
from amb_core.rig.link.conformance import Exchange, check_target
from tests.served_emulator import ServedEmulator
from tests.soak.conformance import FAULTS, Planted, named


def test_the_example_keeps_to_the_protocol() -> None:
    assert named(None) == []


@pytest.mark.parametrize(
    "name", ["last byte of the tag not checked", "status word in the wrong place", "record from the start of the ring"]
)
def test_a_planted_fault_is_named(name: str) -> None:
    assert FAULTS[name].check in {one.check for one in named(FAULTS[name])}


@pytest.mark.parametrize("length", [3, 30, 33])  # within the header, without a body, with one byte of it
def test_an_answer_that_is_cut_is_no_reply(length: int) -> None:
    cut = Planted(
        "command.c",
        "if (type < AMB_HEARTBEAT || type > AMB_RECORD) return AMB_UNKNOWN;",
        "if (type < AMB_HEARTBEAT || type > AMB_RECORD) {\n"
        "        t->io[5] = AMB_REPLY, t->io[AMB_SEALED] = type;\n"
        f"        board_send(t->board, t->io, {length}, from);\n        return AMB_SILENT;\n    }}",
        "refusals",
    )
    assert "an unknown type that is genuine has no reply" in {one.text for one in named(cut)}


def test_a_target_slower_than_real_time_keeps_to_all_but_the_timing() -> None:
    """A status every 100 ms is one of the target's own time, which an emulator on a loaded machine has less of."""
    with ServedEmulator(block=1) as served:
        target = Exchange(served.address, served.port, b"", 5.0)
        try:
            assert {one.check for one in check_target(target)} == {"timing"}
        finally:
            target.close()


def test_there_are_thirty_planted_faults_at_least() -> None:
    assert len(FAULTS) >= 30


def test_a_target_that_does_not_answer_is_said_to_be_silent() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
        silent.bind(("127.0.0.1", 0))
        target = Exchange("127.0.0.1", silent.getsockname()[1], b"", 0.05)
        assert [one.text for one in check_target(target)] == ["no answer to HELLO"]
        target.close()


def test_an_address_that_is_none_is_refused_in_one_line() -> None:
    with pytest.raises(TargetError, match="cannot be reached"):
        Exchange("no.such.host.invalid", 1, b"")
