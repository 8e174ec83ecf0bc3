"""The identified model: a discrete-time state-space model with its offsets, units and files."""

from amb_core.linear.model.state_space import StateSpaceModel

__all__ = ["StateSpaceModel"]
