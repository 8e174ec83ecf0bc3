"""Verdicts on the paper's sweeps follow from the regions that the runs went through; doctored runs change them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from amb_core.loop.control import ControllerParameters
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant
from amb_core.regions import AxisState, Classification, Judged, Onset, Region, RegionState
from amb_paper.studies.causes import ALL, CASES, CENTRED, FORCE_LAW, cause_claim, effects_note, rotor_speed
from amb_paper.studies.causes import speed_claim as motion_claim
from amb_paper.studies.sweep_one_axis import (
    NAMES,
    PAPER,
    SLOW,
    TOP,
    OneAxisSweep,
    Pole,
    delevitation_claim,
    frequency_claim,
    linear_claim,
    order_claim,
    region_a_fit,
)
from amb_paper.studies.sweep_two_axes import gravity_claim, regions_claim
from amb_paper.study import Claim, judged, with_another_value
from amb_paper.sweeps import SLOW_NOTE, TOP_COIL, SweptBearing, in_order, sweep_bearing

STEPS, REST = 10_000, 1_000
FREQUENCY = np.concatenate([np.full(REST, np.nan), np.linspace(100.0, 1_000.0, STEPS - REST)])
POLE = Pole(natural=63.0, damped=56.0)
BEGINS = {Region.B: 3_000, Region.C: 6_000, Region.D: STEPS - 1}


@pytest.fixture(scope="module")
def plant() -> Plant:
    return Plant()


@pytest.fixture
def swept(plant: Plant):
    """Makes a bearing in which regions begin at given steps, whose rotor oscillates at 55 Hz in region C."""

    def make(begins: dict[Region, int], slow: float = 55.0, response: float = 1e-6) -> SweptBearing:
        onsets = {region: Onset(step, 1e-4 * step, float(FREQUENCY[step]), False) for region, step in begins.items()}
        states = []
        for step in range(REST + 99, STEPS, 100):
            region = max((one for one, begin in begins.items() if begin <= step), default=Region.A)
            since = onsets.get(region, Onset(0, 0.0, math.nan, False))
            axis = AxisState(region, since, 0.0, 0.0, 0.0, 1e-6, slow, FREQUENCY[step], 1e-6, response, False)
            states.append(RegionState(step, (axis, replace(axis, name="y")), (), region, since, 0.0, True))
        samples = np.zeros((STEPS, 2))
        record = LoopRecord(0, 1e-4, samples, samples, samples)
        classification = Classification(states, onsets, {"x": {}, "y": onsets}, Judged({}, {}, 0.7))
        return SweptBearing(plant, ControllerParameters(), record, FREQUENCY, classification)

    return make


def bearings(paper: SweptBearing, top: SweptBearing, slow: SweptBearing) -> dict[str, SweptBearing]:
    return {PAPER: paper, TOP: top, SLOW: slow}


@pytest.mark.parametrize(
    ("as_stated", "changed", "verdict"),
    [
        ([True, True], [False], "agrees"),
        ([True, False], [], "agrees in part"),
        ([False], [True], "agrees in part"),
        ([], [True], "agrees in part"),
        ([False], [False], "does not agree"),
    ],
)
def test_a_claim_agrees_only_with_the_values_that_the_paper_states(as_stated, changed, verdict) -> None:
    assert judged(as_stated, changed) == verdict


def test_a_claim_on_a_bearing_against_the_paper_agrees_in_part_at_most() -> None:
    claim = Claim("x", "Fig. 0", "It falls.", "It fell.", "agrees")
    assert with_another_value(claim, "a supply of 30 V").verdict == "agrees in part"
    assert "30 V, against the paper" in with_another_value(claim, "a supply of 30 V").reason
    assert with_another_value(replace(claim, verdict="does not agree"), "x").verdict == "does not agree"


def test_all_regions_in_order_agree_with_the_paper(swept) -> None:
    everything = swept(BEGINS)
    assert in_order(everything)
    assert order_claim(bearings(everything, everything, swept({}))).verdict == "agrees"
    assert regions_claim(everything, everything).verdict == "agrees"


def test_a_region_that_only_the_slow_amplifier_shows_agrees_in_part(swept) -> None:
    without_c = swept({Region.B: 3_000, Region.D: STEPS - 1})
    claim = order_claim(bearings(without_c, without_c, swept(BEGINS)))
    assert claim.verdict == "agrees in part"
    assert "supply voltage" in claim.reason
    assert regions_claim(without_c, without_c).verdict == "does not agree"


def test_one_of_two_bearings_with_the_stated_values_agrees_in_part(swept) -> None:
    without_c = swept({Region.B: 3_000, Region.D: STEPS - 1})
    claim = order_claim(bearings(without_c, swept(BEGINS), without_c))
    assert claim.verdict == "agrees in part"
    assert "does not state which" in claim.reason


def test_the_missing_region_is_not_blamed_on_the_scaling_of_the_amplifiers() -> None:
    assert "does not replace it" in SLOW_NOTE


@pytest.mark.parametrize(
    "begins", [{Region.B: 6_000, Region.C: 3_000}, {Region.C: 3_000}, {Region.B: REST - 1, Region.C: 3_000}]
)
def test_regions_out_of_order_do_not_pass(swept, begins) -> None:
    assert not in_order(swept(begins))


@pytest.mark.parametrize(
    ("slow", "verdict"),
    [(55.0, "agrees"), (45.0, "agrees in part"), (20.0, "does not agree"), (110.0, "does not agree")],
)
def test_the_slow_oscillation_is_held_against_the_dominant_pole(swept, slow, verdict) -> None:
    compared = bearings(swept(BEGINS, slow), swept(BEGINS, slow), swept({}))
    claim = frequency_claim(compared, dict.fromkeys(compared, POLE))
    assert claim.verdict == verdict
    assert bool(claim.reason) == (verdict != "agrees")


def test_one_of_two_bearings_without_a_slow_oscillation_agrees_in_part(swept) -> None:
    without_c = swept({Region.B: 3_000, Region.D: STEPS - 1})
    compared = bearings(without_c, swept(BEGINS), swept(BEGINS))
    claim = frequency_claim(compared, dict.fromkeys(compared, POLE))
    assert claim.verdict == order_claim(compared).verdict == "agrees in part"
    assert f"{NAMES[PAPER]}: no slow oscillation" in claim.finding
    assert "does not oscillate slowly" in claim.reason


def test_a_slow_oscillation_with_the_slow_amplifier_alone_agrees_in_part(swept) -> None:
    compared = bearings(swept({}), swept({}), swept(BEGINS))
    claim = frequency_claim(compared, dict.fromkeys(compared, POLE))
    assert claim.verdict == "agrees in part"
    assert "against table 1" in claim.reason


def test_without_a_slow_oscillation_its_frequency_cannot_agree(swept) -> None:
    compared = dict.fromkeys((PAPER, TOP, SLOW), swept({Region.B: 3_000}))
    claim = frequency_claim(compared, dict.fromkeys(compared, POLE))
    assert claim.verdict == "does not agree"
    assert "nan" not in claim.finding


def test_a_bearing_that_stays_up_takes_part_of_the_claim_of_delevitation(swept) -> None:
    falls, stays = swept(BEGINS), swept({Region.B: 3_000})
    assert delevitation_claim(bearings(falls, falls, stays)).verdict == "agrees"
    assert delevitation_claim(bearings(falls, stays, falls)).verdict == "agrees in part"
    assert delevitation_claim(bearings(stays, stays, falls)).verdict == "agrees in part"
    assert delevitation_claim(bearings(stays, stays, stays)).verdict == "does not agree"


def test_a_model_must_follow_in_region_a_and_depart_beyond() -> None:
    assert linear_claim({PAPER: (90.0, 10.0)}, {SLOW: (30.0, 25.0)}).verdict == "agrees"
    assert linear_claim({PAPER: (90.0, 85.0)}, {}).verdict == "agrees in part"
    assert linear_claim({PAPER: (30.0, 25.0)}, {SLOW: (90.0, 10.0)}).verdict == "agrees in part"
    assert linear_claim({PAPER: (30.0, 25.0)}, {}).verdict == "does not agree"


def test_the_fit_is_taken_apart_where_region_a_ends(swept) -> None:
    wave = 1e-6 * np.sin(0.3 * np.arange(STEPS))
    position = np.column_stack([np.zeros(STEPS), wave])
    position[BEGINS[Region.B] :, 1] *= -1.0
    bearing = swept(BEGINS)
    bearing = replace(bearing, record=replace(bearing.record, position=position))
    model = LoopRecord(REST, 1e-4, *[np.column_stack([wave, wave])[REST:]] * 3)
    assert region_a_fit(bearing, model) == pytest.approx((100.0, -100.0), abs=0.1)


def test_gravity_is_told_by_the_end_of_region_a_on_both_axes(swept) -> None:
    early, late = swept({Region.B: 3_000}), swept({Region.B: 6_000})
    assert gravity_claim({"a": (early, late)}, {"b": (late, early)}).verdict == "agrees"
    assert gravity_claim({"a": (early, swept({}))}, {}).verdict == "agrees"
    assert gravity_claim({"a": (late, early)}, {"b": (early, late)}).verdict == "agrees in part"
    assert gravity_claim({"a": (late, early)}, {}).verdict == "does not agree"


@pytest.mark.parametrize(
    ("with_force_law", "verdict"),
    [(BEGINS, "agrees"), ({Region.B: 2_000}, "agrees in part"), ({}, "does not agree")],
)
def test_the_force_law_is_the_cause_of_what_remains_without_limits(swept, with_force_law, verdict) -> None:
    runs = {ALL: swept(BEGINS), FORCE_LAW: swept(with_force_law), CENTRED: swept({})}
    claim = cause_claim("causes", runs)
    assert claim.verdict == verdict
    assert bool(claim.reason) == (verdict != "agrees")


def test_the_rotor_is_slower_where_region_a_ends_if_it_responds_less(swept) -> None:
    run = swept(BEGINS)
    axes = [state.axis("y") for state in run.classification.states]
    axes = [replace(axis, response_amplitude=1e-3 / axis.input_frequency**2) for axis in axes]
    states = [replace(state, axes=(axis,)) for state, axis in zip(run.classification.states, axes, strict=True)]
    slowing = replace(run, classification=replace(run.classification, states=states))
    assert motion_claim("causes", rotor_speed(slowing), slowing).verdict == "does not agree"
    assert motion_claim("causes", rotor_speed(run), run).verdict == "agrees"  # as far at every frequency: ever faster


def test_effects_are_told_region_by_region(swept) -> None:
    runs = {name: swept({Region.B: 3_000, Region.D: 9_000}) for name in CASES}
    moved = runs[CENTRED].record.position + 1e-6
    runs[CENTRED] = replace(swept({Region.C: 4_000}), record=replace(runs[CENTRED].record, position=moved))
    note = effects_note(runs)
    assert f"{FORCE_LAW}: the same samples, bit for bit" in note
    assert f"{CENTRED}: B gone, C from {FREQUENCY[4_000]:.0f} Hz, new, D gone." in note


@pytest.mark.slow
def test_the_study_of_one_axis_agrees_in_part() -> None:
    verdicts = {claim.id: claim.verdict for claim in OneAxisSweep().run().claims}
    assert verdicts["one-axis-linear-model"] == "agrees in part"  # its iron is against the paper
    assert verdicts["one-axis-regions"] == "agrees in part"
    assert verdicts["slow-oscillation-frequency"] == "agrees in part"


@pytest.mark.slow
@pytest.mark.parametrize("amplitude", [15e-6, 20e-6, 25e-6])
def test_the_top_coil_alone_goes_through_all_regions_with_table_1(amplitude: float) -> None:
    assert in_order(sweep_bearing(amplitude, TOP_COIL))


@pytest.mark.slow
@pytest.mark.parametrize("gain", [0.1, 0.03])
def test_a_lower_gain_of_the_amplifiers_alone_brings_no_region_c(gain: float) -> None:
    scaled = {"magnetic_circuit.actuators": "differential", "amplifier.proportional_gain": gain}
    assert Region.C not in sweep_bearing(15e-6, scaled).onsets


@pytest.mark.slow
def test_the_slow_oscillation_needs_the_slew_limit() -> None:
    slow = {"magnetic_circuit.actuators": "differential", "amplifier.supply_voltage": 30.0}
    assert Region.C in sweep_bearing(15e-6, slow).onsets
    unlimited = {"amplifier.switching": False, "amplifier.limits": False}
    assert Region.C not in sweep_bearing(15e-6, slow | unlimited).onsets
