"""Designs: excitations that a bearing bears in region A, and gains that levitate it."""
