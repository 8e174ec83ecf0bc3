"""Parameters of the node `identifier`."""

from __future__ import annotations

from amb_core.data.experiments.drift import DriftOption
from amb_core.ground.parameters import Parameters, choice, quantity
from amb_core.identification import Method


class IdentifierParameters(Parameters):
    """Parameters of the node."""

    order: int = quantity(10, "-", "number of states if a request gives none", 1, 40)
    method: Method = choice("pem", "method if a request gives none")
    drift: DriftOption = choice(
        "auto", "slow drift of the outputs: auto (removed where the checks find it), none, or prefilter (always)"
    )
    max_steps: int = quantity(
        1_200_000, "-", "steps of telemetry that are kept; older ones are dropped", 1_000, 100_000_000
    )
    controller: str = choice("pd_controller", "node whose parameters describe the controller, relative or full name")
    simulator: str = choice("simulator", "node whose parameters describe the plant, if there is one")
    parameter_timeout: float = quantity(1.0, "s", "longest wait for the parameters of either", 0.05, 10.0)
