"""The short form of the attack on the C target: no finding of the sanitizers, and no forged command is accepted."""

from __future__ import annotations

import pytest

from tests.fuzz.target import run


@pytest.mark.timeout(600)
def test_no_datagram_harms_the_target_and_none_is_accepted_that_is_forged() -> None:
    figures = run(frames=200_000, seed=1)
    assert figures["findings"] == []
    assert (figures["frames"], figures["accepted"]) == (200_000, 0)
    assert figures["forged"] > 140_000
    assert figures["currents"] > 0  # of a host that closes the loop
    assert min(figures["states"]) > 0  # it was attacked in every state
