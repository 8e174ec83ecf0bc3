"""Limits against tests that hang, never what a test is about: a machine four times slower and busy keeps them."""

TIMEOUT = 120.0  # s; for whatever takes a moment: start of a process, discovery, an answer
TEST_TIMEOUT = 600.0  # s
