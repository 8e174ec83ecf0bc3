"""Robustness of the closed loop of an identified model: margins, structured singular value, certificate."""
