"""A model refined to simulate the closed loop well: the simulation focus, and its error over a sweep."""

from amb_core.identification.focus.focus import focus_simulation

__all__ = ["focus_simulation"]
