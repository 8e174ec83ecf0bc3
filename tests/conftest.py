"""Settings of all tests."""

from hypothesis import settings

settings.register_profile("repeatable", derandomize=True)  # a run that failed fails again, one that passed passes
settings.load_profile("repeatable")
