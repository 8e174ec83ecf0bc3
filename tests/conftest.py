"""Settings of all tests."""

import signal

from hypothesis import settings

# In the background of a shell SIGINT is ignored, and so it would be by the processes that tests start and interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)

# A run that failed fails again, one that passed passes; on a slow machine too.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")
