"""The short form of `make fuzz`: a fixed set of hostile messages, which no node may die of or fail inside."""

from __future__ import annotations

import pytest

from tests.fuzz.run import attack

CASES = 150
SEED = 1


@pytest.mark.timeout(600)
@pytest.mark.parametrize("check_fields", [False, True], ids=["as users run it", "with field checks"])
def test_no_hostile_message_ends_a_node_or_an_answer(check_fields: bool) -> None:
    outcome = attack(check_fields, SEED, lambda sent: sent / CASES)
    assert not outcome.findings
    assert sum(outcome.sent.values()) == CASES
