"""Sensitivity measured by a swept sine on the running graph of the simulator, and its place in the certificate."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from amb_bringup.client import AmbClient
from amb_core.ground.errors import AmbError
from amb_core.loop.control import ControllerParameters
from amb_core.plant import Plant, PlantParameters, linearize
from tests.graph.limits import TIMEOUT

if TYPE_CHECKING:
    from tests.graph.conftest import Graph

MODULES = (
    "amb_sim_node.simulator",
    "amb_controller_node.pd_controller",
    "amb_controller_node.excitation_generator",
    "amb_ident_node.recorder",
    "amb_ident_node.region_monitor",
    "amb_ident_node.identifier",
)
SWEEP = {"sweep_amplitude": 4e-6, "sweep_duration": 4.0, "sweep_start": 10.0}
MULTISINE = {"amplitude": 4e-6, "duration": 2.0, "frequency_end": 2_000.0}
ALIKE = 0.3  # dB, in region A


def test_the_swept_sine_has_the_sensitivity_of_the_linearised_loop_and_stands_on_the_certificate(
    graph: Graph, tmp_path: Path
) -> None:
    for module in MODULES:
        graph.start(module)
    with AmbClient(domain_id=graph.domain, timeout=TIMEOUT) as amb:
        measured = amb.measure_sensitivity(tmp_path / "sweep", **SWEEP)
        kept = measured.comparable()
        true = linearize(Plant(PlantParameters()), ControllerParameters()).sensitivity
        size = np.abs(true.response(measured.frequency[kept]))
        for axis in range(2):
            difference = 20.0 * np.log10(np.abs(measured.own[kept, axis]) / size[:, axis, axis])
            assert np.abs(difference).max() < ALIKE
        assert measured.frequency[kept].min() < 25.0
        assert measured.frequency[kept].max() > 900.0

        amb.experiment("multisine", tmp_path / "bag", **MULTISINE)
        amb.identify(order=8)
        answer = amb.certify(sweep_bag=tmp_path / "sweep", frequencies=60.0)
        assert answer.measured_peak_sensitivity == pytest.approx(list(answer.peak_sensitivity), rel=0.05)
        assert "measured by a swept sine" in answer.certificate


def test_a_swept_sine_needs_an_amplitude(graph: Graph, tmp_path: Path) -> None:
    with AmbClient(domain_id=graph.domain, timeout=1.0) as amb, pytest.raises(AmbError, match="needs an amplitude"):
        amb.measure_sensitivity(tmp_path / "sweep")
