"""Verdicts on the subharmonic test follow from its spectra and surface: other sizes, other verdicts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from amb_core.regions.subharmonics import (
    Line,
    Product,
    SlowComponent,
    State,
    SubharmonicSettings,
    SubharmonicSpectrum,
    SubharmonicSurface,
)
from amb_paper.studies.subharmonics import (
    SURFACE,
    judge_cause,
    judge_influence,
    judge_product,
    judge_slow,
)

NONE = np.empty(0)


def spectrum(product: float = 1.0, slow: float = 0.0, state: State = "steady") -> SubharmonicSpectrum:
    """Tones of 3 and 2 um, their difference and a slow component with given sizes (um)."""
    sizes = {(1, 0, 0): 3.0, (0, 1, 0): 2.0, (-1, 1, 0): product}
    lines = tuple(
        Line(100.0 * place, 1e-6 * size + 0j, (Product(*orders, 0),))
        for place, (orders, size) in enumerate(sizes.items(), start=1)
    )
    return SubharmonicSpectrum(
        settings=SubharmonicSettings(), state=state, reason="", sample_time=1e-4, first_step=0, steps=0, frequency=NONE,
        amplitude=NONE, bias=0.0, lines=lines, slow=SlowComponent(2.0, 1e-6 * slow, 0.0, True, None), off_lines=0.0,
        own=0.0, line_change=0.0, bias_change=0.0, block_time=NONE, block_bias=NONE, block_change=NONE,
    )  # fmt: skip


def surface(slow: np.ndarray, state: str = "steady") -> SubharmonicSurface:
    rows, columns = slow.shape
    same = np.full(slow.shape, 0.0)
    return SubharmonicSurface(
        settings=SubharmonicSettings(), surface=SURFACE, inducing_amplitude=np.linspace(5e-6, 40e-6, rows),
        inducing_frequency=np.linspace(500.0, 4500.0, columns), difference=same, slow_amplitude=1e-6 * slow,
        slow_frequency=same, slow_rms=same, slow_origin=np.full(slow.shape, "own"), bias=same,
        state=np.full(slow.shape, state),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("product", "state", "verdict"),
    [
        (1.0, "steady", "agrees"),
        (0.1, "steady", "agrees in part"),
        (1.0, "delevitated", "agrees in part"),
        (0.0, "steady", "does not agree"),
        (1e-15, "steady", "does not agree"),  # rounding
        (0.04, "steady", "does not agree"),  # less than lines differ from block to block
    ],
)
def test_the_product_must_be_significant_in_a_steady_state(product: float, state: State, verdict: str) -> None:
    claim = judge_product(spectrum(product, state=state))
    assert claim.verdict == verdict
    assert bool(claim.reason) == (verdict != "agrees")


def test_a_run_without_lines_has_no_product() -> None:
    claim = judge_product(replace(spectrum(state="delevitated"), lines=()))
    assert claim.verdict == "does not agree"


@pytest.mark.parametrize(("alone", "with_third"), [(0.0, 0.0), (1e-15, 1e-13), (0.01, 0.04)])
def test_the_third_tone_does_not_induce_what_is_not_there_with_it(alone: float, with_third: float) -> None:
    claim = judge_cause(spectrum(alone), spectrum(with_third))
    assert claim.verdict == "does not agree"
    assert "is not 10 times that" in claim.reason


@pytest.mark.parametrize(("alone", "verdict"), [(0.01, "agrees"), (0.5, "agrees in part"), (1.0, "does not agree")])
def test_the_third_tone_induces_what_is_not_there_without_it(alone: float, verdict: str) -> None:
    assert judge_cause(spectrum(alone), spectrum(1.0)).verdict == verdict


@pytest.mark.parametrize(
    ("as_asked", "shifted", "verdict"),
    [(0.3, 0.0, "agrees"), (0.001, 0.3, "agrees in part"), (0.001, 0.001, "does not agree")],
)
def test_a_slow_component_must_be_more_than_drift(as_asked: float, shifted: float, verdict: str) -> None:
    assert judge_slow(spectrum(slow=as_asked), spectrum(slow=shifted)).verdict == verdict


def test_the_inducing_tone_decides_by_amplitude_and_by_frequency() -> None:
    growing = np.array([1.0, 4.0, 20.0])
    assert judge_influence(surface(np.outer(growing, growing))).verdict == "agrees"
    assert judge_influence(surface(np.outer(growing, np.ones(3)))).verdict == "agrees in part"
    assert judge_influence(surface(np.ones((3, 3)))).verdict == "does not agree"


def test_slow_components_as_small_as_rounding_show_no_influence() -> None:
    growing = np.array([1e-15, 1e-9, 1e-3])
    assert judge_influence(surface(np.outer(growing, growing))).verdict == "does not agree"


def test_no_steady_state_at_all_shows_no_influence() -> None:
    claim = judge_influence(surface(np.ones((3, 3)), "delevitated"))
    assert claim.verdict == "does not agree"
    assert "9 of 9 tones delevitate" in claim.finding
