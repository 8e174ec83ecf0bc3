"""Where simulation focus starts if the best predictor makes an unstable loop, or is far from the best simulator."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from amb_core.identification import IdentificationData, closed_loop_poles, identify
from amb_core.identification.estimate.methods import starts_for_simulation
from amb_core.identification.progress import Watch
from amb_core.linear.numerics import LARGEST_RADIUS
from amb_core.loop.control import ControllerParameters
from tests.benchmarks.ident import plant

if TYPE_CHECKING:
    from conftest import LinearBearing

CONTROLLER = ControllerParameters()


def test_without_noise_it_starts_from_a_stable_loop(bearing: LinearBearing) -> None:
    """PEM of too high an order may keep a mode that such data do not determine, and whose loop is not stable.

    Whether it does depends on the last bits of the computer; the other starts do not.
    """
    record = bearing.experiment(
        duration=0.5,
        noise=0.0,
        force=0.0,
        kind="multisine",
        amplitude=20e-6,
        frequency_start=1.0,
        frequency_end=1_000.0,
    )
    starts = starts_for_simulation(IdentificationData.from_record(record), 8, Watch(), "")
    assert min(np.abs(closed_loop_poles(start, CONTROLLER)[0]) for start in starts) < LARGEST_RADIUS

    identification = identify(record, 8, focus="simulation", controller=CONTROLLER)

    assert identification.stable
    assert min(identification.model.fit) > 99.0


def test_at_too_low_an_order_it_finds_more_than_beside_the_best_predictor() -> None:
    """From the model of PEM alone the search ends at 50 and 30 %."""
    record = plant.record(plant.Experiment("multisine", steps=8_000), 0)
    identification = identify(record, 6, focus="simulation", controller=plant.CONTROLLER)
    assert identification.stable
    assert min(identification.model.fit) > 70.0
