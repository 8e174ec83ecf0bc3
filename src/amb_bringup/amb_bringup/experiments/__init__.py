"""Experiments and commissioning on a running graph."""
