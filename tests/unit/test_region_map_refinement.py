"""The choice of amplitudes: resolved boundaries from few sweeps, whatever the order in which results arrive."""

from __future__ import annotations

import random

import numpy as np
import pytest

from amb_core.regions import Region
from amb_core.regions.region_map import Boundary, MapSettings, MapSweep, RegionMap
from amb_core.regions.region_map.refinement import Refinement

AMPLITUDES = np.geomspace(5e-6, 100e-6, 1000)


def power_law(amplitude):
    return {Region.D: 400.0 * (50e-6 / amplitude) ** 1.3}


def curved(amplitude):
    """Slope of the logarithms from -0.9 to -2.1 over the amplitudes, some bending as simulated boundaries have."""
    ratio = np.log(amplitude / 20e-6)
    return {Region.B: 400.0 * np.exp(-1.4 * ratio - 0.2 * ratio**2), Region.D: 900.0 * np.exp(-1.4 * ratio)}


def jumping(amplitude):
    """The rotor delevitates at its resonance from 72 um on."""
    return {Region.D: 60.0 if amplitude > 72e-6 else 16e-3 / amplitude}


def ending(amplitude):
    """No drift above 40 um."""
    return {} if amplitude > 40e-6 else {Region.B: 4e-3 / amplitude}


def run(function, settings, shuffle=None):
    """All sweeps of a map in the order in which they were asked for; results arrive in any order."""
    refinement = Refinement(settings)
    waiting = list(refinement.amplitudes)
    while waiting:
        amplitude = waiting.pop(0 if shuffle is None else shuffle.randrange(len(waiting)))
        boundaries = {region: Boundary(f, False) for region, f in function(amplitude).items()}
        waiting += refinement.add(MapSweep(amplitude, boundaries, (), 5000.0, 1))
    assert refinement.finished
    return refinement


def error(refinement, function, region):
    """Largest relative error of the boundary over all amplitudes."""
    boundary = RegionMap(MapSettings(), refinement.sweeps).boundary(region, AMPLITUDES)
    true = np.array([function(amplitude)[region] for amplitude in AMPLITUDES])
    return np.max(np.abs(boundary / true - 1.0))


def test_a_straight_boundary_needs_no_refinement():
    refinement = run(power_law, MapSettings())
    assert len(refinement.sweeps) == 8
    assert refinement.resolved
    assert [s.amplitude for s in refinement.sweeps][::7] == [5e-6, 100e-6]


@pytest.mark.parametrize("initial", [3, 4, 5, 8])
def test_curved_boundaries_are_resolved_to_three_percent(initial):
    refinement = run(curved, MapSettings(initial_sweeps=initial))
    assert refinement.resolved
    assert len(refinement.sweeps) <= 15
    assert error(refinement, curved, Region.B) < 0.03
    assert error(refinement, curved, Region.D) < 1e-6


def test_a_finer_resolution_takes_more_sweeps():
    coarse, fine = (run(curved, MapSettings(resolution=r, max_sweeps=100)) for r in (0.03, 0.003))
    assert len(fine.sweeps) > len(coarse.sweeps)
    assert error(fine, curved, Region.B) < 0.003


@pytest.mark.parametrize(("function", "edge"), [(jumping, 72e-6), (ending, 40e-6)])
def test_where_a_boundary_jumps_or_ends_the_amplitude_is_bisected(function, edge):
    refinement = run(function, MapSettings())
    assert refinement.resolved
    amplitudes = np.array([s.amplitude for s in refinement.sweeps])
    right = np.searchsorted(amplitudes, edge)
    assert amplitudes[right] / amplitudes[right - 1] < 1.03
    assert len(amplitudes) <= 8 + 4, "sweeps were spent elsewhere than at the edge"


@pytest.mark.parametrize("function", [curved, jumping, ending])
def test_the_sweeps_of_a_map_do_not_depend_on_the_order_in_which_they_finish(function):
    settings = MapSettings(initial_sweeps=4)
    orders = {tuple(run(function, settings, random.Random(seed)).amplitudes) for seed in range(20)}
    assert orders == {tuple(run(function, settings).amplitudes)}


def test_no_more_than_max_sweeps_and_then_the_map_is_not_resolved():
    refinement = run(jumping, MapSettings(max_sweeps=10))
    assert len(refinement.sweeps) == 10
    assert not refinement.resolved


def test_as_many_sweeps_are_under_way_at_once_as_there_are_initial_ones():
    refinement = Refinement(MapSettings(resolution=0.001))
    for amplitude in refinement.amplitudes:
        asked = refinement.add(MapSweep(amplitude, {}, (), 5000.0, 1) if amplitude > 30e-6 else at(amplitude))
    assert 1 <= len(asked) <= 8
    assert len(set(refinement.amplitudes)) == len(refinement.amplitudes)


def at(amplitude):
    boundaries = {region: Boundary(f, False) for region, f in curved(amplitude).items()}
    return MapSweep(amplitude, boundaries, (), 5000.0, 1)
