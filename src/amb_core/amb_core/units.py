"""Factors from SI units, in which the library computes, to those that people read."""

UM = 1e6
"""Micrometres in a metre."""
