"""Settings of all tests."""

import signal

from hypothesis import settings

# In the background of a shell SIGINT is ignored, and so it would be by the processes that tests start and interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)

# A run under nohup ignores SIGHUP, and so would they. A handler that does nothing is not passed on to them.
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, lambda _number, _frame: None)

# A run that failed fails again, one that passed passes; on a slow machine too.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")
