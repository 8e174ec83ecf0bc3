"""The pace of a loop in real time: deadlines, those that were missed, and how late steps came."""

from __future__ import annotations

import numpy as np
import pytest

from amb_core.ground.errors import ParameterError
from amb_core.ground.parameters import validate
from amb_core.loop.pace import Lateness, Pace
from amb_sim_node.parameters import SimulatorParameters

PERIOD = 1e-3


def test_steps_that_are_ready_early_are_held_back_until_they_are_due():
    pace = Pace(PERIOD)
    pace.start(10.0)
    for step in range(1, 6):
        due = 10.0 + step * PERIOD
        assert pace.wait(due - 0.4e-3) == pytest.approx(0.4e-3)
        pace.published(due)
    assert pace.missed == 0
    assert pace.lateness.count == 5
    assert pace.lateness.largest == pytest.approx(0.0, abs=1e-12)


def test_every_late_step_is_counted_and_shifts_the_grid_by_its_lateness():
    pace, generator = Pace(PERIOD), np.random.default_rng(1)
    now, injected = 0.0, 0
    pace.start(now)
    for _ in range(10_000):
        late = bool(generator.random() < 0.01)
        injected += late
        ready = now + PERIOD + (generator.uniform(1e-6, 5e-3) if late else -generator.uniform(1e-6, 0.9e-3))
        hold = pace.wait(ready)
        assert (hold == 0.0) is late
        now = ready + hold
        if not late:
            pace.published(now)
    assert pace.missed == injected > 50
    assert pace.lateness.count == 10_000


def test_a_late_wake_up_is_lateness_and_a_missed_deadline_only_from_a_whole_period_on():
    pace = Pace(PERIOD)
    pace.start(0.0)
    pace.wait(0.5e-3)
    pace.published(1.2e-3)
    assert pace.missed == 0
    assert pace.wait(1.5e-3) == pytest.approx(0.5e-3), "the grid stays"
    pace.published(3.1e-3)
    assert pace.missed == 1
    assert pace.shift == pytest.approx(1.1e-3)
    assert pace.wait(3.6e-3) == pytest.approx(0.5e-3), "the grid has shifted"


def test_quantiles_of_the_lateness_are_at_most_5_percent_above_the_true_ones():
    lateness, times = Lateness(), np.random.default_rng(2).lognormal(np.log(20e-6), 1.0, 20_000)
    for time in times:
        lateness.note(float(time))
    for share in (0.5, 0.99, 0.9999):
        true = float(np.quantile(times, share, method="inverted_cdf"))
        assert true <= lateness.quantile(share) <= 1.05 * true
    assert lateness.quantile(1.0) == lateness.largest == times.max()


def test_nothing_noted_is_no_lateness():
    assert Lateness().quantile(0.99) == 0.0


def test_a_simulator_so_slow_that_its_services_would_wait_is_refused():
    with pytest.raises(ParameterError, match=r"real_time_factor = 0\.001 .* 10000 Hz; allowed: 0, or 0\.002 to 100"):
        validate(SimulatorParameters, {"real_time_factor": 1e-3})
    assert validate(SimulatorParameters, {"real_time_factor": 2e-3}).real_time_factor == 2e-3
