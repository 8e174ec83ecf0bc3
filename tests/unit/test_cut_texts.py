"""Texts that ROS would cut off are refused before they are sent."""

from __future__ import annotations

import pytest

from amb_bringup.client.connection import ClientError, refuse_cut_texts


def test_a_text_with_a_nul_character_is_refused_with_its_field() -> None:
    refuse_cut_texts("/amb/recorder/start", {"uri": "bag", "steps": 3})
    with pytest.raises(ClientError, match=r"/amb/recorder/start: uri = 'bag\\x00s' has a NUL character"):
        refuse_cut_texts("/amb/recorder/start", {"uri": "bag\0s"})


def test_a_long_text_is_not_repeated_whole() -> None:
    with pytest.raises(ClientError) as problem:
        refuse_cut_texts("/amb/recorder/start", {"uri": "x" * 100_000 + "\0"})
    assert len(str(problem.value)) < 300
