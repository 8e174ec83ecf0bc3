"""The closed loop of plant and controller without ROS, and the parameters of both by one name each."""

from amb_core.plant.simulation.closed_loop import simulate, simulate_first_bearing
from amb_core.plant.simulation.parameters import loop_parameter_names, require_loop, with_values

__all__ = ["loop_parameter_names", "require_loop", "simulate", "simulate_first_bearing", "with_values"]
