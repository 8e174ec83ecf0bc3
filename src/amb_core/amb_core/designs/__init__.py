"""Designs: excitations under which a bearing stays in region A, and gains that levitate it."""
