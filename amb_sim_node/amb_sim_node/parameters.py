"""Parameters of the simulator; no ROS needed to read a parameter file with them."""

from __future__ import annotations

from pydantic import model_validator

from amb_core.ground.parameters import quantity, switch
from amb_core.loop.real_time import RealTimeParameters
from amb_core.plant import PlantParameters

LONGEST_PERIOD = 0.05  # s of wall-clock time between two paced steps; services wait as long
LARGEST_FACTOR = 100.0


class SimulatorParameters(PlantParameters):
    """Parameters of the simulator: those of the plant, and of its interface to the graph."""

    autostart: bool = switch(False, "run from the start instead of waiting, paused, for a run request")
    clock_period: float = quantity(0.01, "s", "simulation time between messages on /clock", 1e-4, 10.0)
    answer_timeout: float = quantity(
        0.25, "s", "wall-clock time after which the answer of the controller counts as overdue", 0.05, 10.0
    )
    real_time_factor: float = quantity(
        0.0,
        "-",
        "simulation time over wall-clock time at which the loop is paced; 0 for as fast as it can",
        0.0,
        LARGEST_FACTOR,
    )
    plant_state_steps: int = quantity(
        0, "-", "controller steps between messages on plant_state; 0 for none", 0, 1_000_000
    )
    real_time: RealTimeParameters = RealTimeParameters()

    @model_validator(mode="after")
    def _paced_steps_do_not_block_services(self) -> SimulatorParameters:
        refusal = pace_refusal(self.real_time_factor, self.integration.sample_rate)
        if refusal:
            raise ValueError(refusal)
        return self


def pace_refusal(factor: float, sample_rate: float) -> str:
    """Why a loop cannot be paced so; empty where it can.

    Parameters
    ----------
    factor : float
        Simulation time over wall-clock time; 0 for as fast as it can.
    sample_rate : float
        Of the loop (Hz).
    """
    least = 1.0 / (sample_rate * LONGEST_PERIOD)
    if factor == 0.0 or least <= factor <= LARGEST_FACTOR:
        return ""
    return (
        f"real_time_factor = {factor:g} is not allowed at {sample_rate:g} Hz; "
        f"allowed: 0, or {least:g} to {LARGEST_FACTOR:g}"
    )
