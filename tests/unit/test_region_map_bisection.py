"""The search for a boundary by trials at single frequencies: it ends at the boundary, or says that there is none."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from amb_core.regions.region_map.bisection import BoundarySearch

LIMITS = (10.0, 5000.0)
RESOLUTION = 0.03
FREQUENCIES = st.floats(*LIMITS)


def run(search: BoundarySearch, boundary: float) -> list[float]:
    """All trials of a search for a property that holds from a frequency onwards."""
    tried: list[float] = []
    while (frequency := search.frequency) is not None:
        tried.append(frequency)
        assert len(tried) < 40
        search.add(frequency, frequency >= boundary)
    return tried


@settings(max_examples=200)
@given(boundary=FREQUENCIES, guess=FREQUENCIES)
def test_the_boundary_lies_in_the_final_bracket_wherever_the_search_began(boundary: float, guess: float) -> None:
    search = BoundarySearch([guess], LIMITS, RESOLUTION)
    tried = run(search, boundary)
    assert search.low < boundary <= search.high or math.isinf(search.high)
    assert all(LIMITS[0] <= frequency <= LIMITS[1] for frequency in tried)
    if search.low > 0.0 and not math.isinf(search.high):
        assert search.high <= (1.0 + RESOLUTION) * search.low * (1.0 + 1e-5)


def test_a_good_guess_costs_few_trials() -> None:
    assert len(run(BoundarySearch([400.0], LIMITS, RESOLUTION), 390.0)) <= 5


def test_a_bracket_that_still_holds_costs_two_trials() -> None:
    """From above the search begins with the bracket that was found from below."""
    assert run(BoundarySearch([400.0, 410.0], LIMITS, RESOLUTION), 405.0) == [400.0, 410.0]


def test_a_bracket_that_no_longer_holds_is_left_in_the_right_direction() -> None:
    above = BoundarySearch([400.0, 410.0], LIMITS, RESOLUTION)
    run(above, 2100.0)
    assert above.low < 2100.0 <= above.high <= 1.031 * above.low
    below = BoundarySearch([400.0, 410.0], LIMITS, RESOLUTION)
    run(below, 150.0)
    assert below.low < 150.0 <= below.high <= 1.031 * below.low


@pytest.mark.parametrize(("boundary", "low", "high"), [(math.inf, 5000.0, math.inf), (1.0, 0.0, 10.0)])
def test_without_a_boundary_within_the_limits_the_bracket_stays_open(boundary: float, low: float, high: float) -> None:
    search = BoundarySearch([300.0], LIMITS, RESOLUTION)
    run(search, boundary)
    assert (search.low, search.high) == (low, high)
