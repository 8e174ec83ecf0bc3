"""Fig. 3: the two-axis bearing under a sweep on y, over the instantaneous frequency, in its regions."""

from __future__ import annotations

import numpy as np

from amb_bringup.paper.study import Claim, DrawnFigure, Study, StudyResult
from amb_core.control import ControllerParameters, PdController
from amb_core.excitation import Sweep, generate
from amb_core.figures.sweep import onset_text, sweep_chart
from amb_core.loop import simulate
from amb_core.plant import Plant
from amb_core.regions import Region, classify

AMPLITUDE = 50e-6  # m; the paper does not tell its own
SETTLING = 2_000  # steps


class TwoAxisSweep(Study):
    """Sweep from 10 Hz to 5 kHz in 20 s, until the rotor delevitates."""

    name = "fig3"
    heading = "Fig. 3: the two-axis bearing under a sweep"

    def run(self) -> StudyResult:
        """Simulate, classify, draw."""
        plant, controller = Plant(), ControllerParameters()
        sweep = Sweep(amplitude=AMPLITUDE, frequency_start=10.0, frequency_end=5_000.0, duration=20.0, axes="y")
        signal = generate(sweep, controller.sample_rate)
        record = simulate(plant, PdController(controller), SETTLING + signal.steps, signal.samples, SETTLING)
        assert signal.frequency is not None
        frequency = np.concatenate([np.full(SETTLING, np.nan), signal.frequency])[: record.steps]
        found = classify(record, delevitated=plant.delevitated, frequency=frequency)
        chart = sweep_chart(record, found, frequency, over="frequency", axes="y", title="Sweep on y, two-axis bearing")
        onsets = {region: onset_text(onset) for region, onset in found.onsets.items()}
        return StudyResult(
            [DrawnFigure.of("fig3", chart)],
            [
                Claim(
                    id="two-axis-regions",
                    paper_figure="Fig. 3",
                    statement="A bearing with two axes goes through the same regions as one with a single axis: with "
                    "rising frequency its bias drifts, then it oscillates slowly.",
                    finding="; ".join(f"{region.name} from {text}" for region, text in onsets.items()),
                    verdict="agrees in part" if Region.C not in onsets and Region.B in onsets else "agrees",
                    reason="" if Region.C in onsets else "It delevitates before any oscillation slower than its input.",
                    figure="fig3",
                )
            ],
            {"amplitude": f"{1e6 * AMPLITUDE:g} um", "frequency": "10 Hz to 5 kHz in 20 s, linear", "axis": "y"},
        )
