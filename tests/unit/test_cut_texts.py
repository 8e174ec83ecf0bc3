"""Texts that ROS would cut off are refused before they are sent."""

from __future__ import annotations

import pytest

from amb_bringup.client.errors import ClientError
from amb_bringup.client.messages import refuse_cut_texts


def test_a_text_with_a_nul_character_is_refused_with_its_field() -> None:
    refuse_cut_texts("/amb/recorder/start", {"uri": "bag", "steps": 3})
    with pytest.raises(ClientError, match=r"/amb/recorder/start: uri = 'bag\\x00s' has a NUL character"):
        refuse_cut_texts("/amb/recorder/start", {"uri": "bag\0s"})


@pytest.mark.parametrize("text", ["\ud800", "/bags/rig \udcff.mcap"])
def test_a_text_that_is_no_unicode_is_refused_with_its_field(text: str) -> None:
    with pytest.raises(ClientError, match=r"identify: bag = .* has a NUL character or is no Unicode; allowed: Unicode"):
        refuse_cut_texts("identify", {"bag": text})
    with pytest.raises(ClientError, match=r"identify: axes = .* is no Unicode"):
        refuse_cut_texts("identify", {"axes": ["x", text]})


def test_a_long_text_is_not_repeated_whole() -> None:
    with pytest.raises(ClientError) as problem:
        refuse_cut_texts("/amb/recorder/start", {"uri": "x" * 100_000 + "\0"})
    assert len(str(problem.value)) < 300
