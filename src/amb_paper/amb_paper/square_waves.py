"""The paper's experiment for identification, square waves on x and then on y, and the model of tenth order from it."""

from __future__ import annotations

from amb_bringup.demos.demo import ORDER, SQUARES
from amb_core.identification import Identification, identify
from amb_paper.graph_experiment import GraphExperiment, LoopRun

EXPERIMENT = GraphExperiment("fig13-square-waves", SQUARES)


def model_from_squares(run: LoopRun) -> Identification:
    """The model by PEM, started from the subspace method SSARX, with its closed loop on the same data."""
    return identify(run.excited, ORDER, "pem", EXPERIMENT.controller)
