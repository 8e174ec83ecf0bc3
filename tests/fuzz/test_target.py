"""The short form of the attack on the C target: no finding of the sanitizers, and no forged command is accepted."""

from __future__ import annotations

import pytest

from tests.fuzz.target import run


@pytest.mark.timeout(600)
def test_no_datagram_harms_the_target_and_none_is_accepted_that_is_forged() -> None:
    found = run(frames=200_000, seed=1)
    assert found["findings"] == []
    assert (found["frames"], found["accepted"]) == (200_000, 0)
    assert found["forged"] > 140_000
    assert found["currents"] > 0  # of a host that closes the loop
    assert min(found["states"]) > 0  # it was attacked in every state
