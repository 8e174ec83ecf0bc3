"""Magnitudes that the paper gives for its bearing."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from amb_core.linear.step_response import fit_step_response
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant
from amb_core.plant.simulation import simulate
from tests.validation.row import Row


def rows() -> Iterator[Row]:
    """Sag under gravity, natural frequency and damping ratio from a step of 1 um on x at 0.2 s."""
    excitation = np.zeros((2_000, 2))
    excitation[:, 0] = 1e-6
    record = simulate(Plant(), PdController(ControllerParameters()), 4_000, excitation, 2_000)
    mode = fit_step_response(record.position[2_000:, 0], record.sample_time)
    sag_um = -1e6 * record.position[1_500:2_000, 1].mean()
    yield Row("natural frequency: deviation from the paper's 63 Hz", abs(mode.natural_hz - 63.0), 3.0, "Hz")
    yield Row("damping ratio: deviation from 0.51", abs(mode.damping_ratio - 0.51), 0.06, "-")
    yield Row("sag: deviation from 66 um", abs(sag_um - 66.0), 4.0, "um")
