"""When two sample times are one: clocks of rigs, and stamps of files, differ by parts per million."""

from __future__ import annotations

SAME = 1e-4
"""Relative difference up to which two sample times are taken as one. Quartz clocks are off by up to 1e-4, and stamps
that are rounded to 0.1 us by some 1e-6. Taken as one, frequencies are wrong by this share; rates that are meant to
differ do so by far more."""


def same_sample_time(first: float, second: float) -> bool:
    """Whether two sample times (s), or two sample rates (Hz), are one.

    Parameters
    ----------
    first, second : float
        Sample times (s), or rates (Hz).

    Returns
    -------
    bool
        Whether they differ by `SAME` at most.
    """
    return abs(first - second) <= SAME * abs(second)


def difference(first: float, second: float) -> str:
    """By how much two sample times differ, in words, with what to do if they should not.

    Parameters
    ----------
    first, second : float
        Sample times (s), or rates (Hz).

    Returns
    -------
    str
        The difference in percent, and the option that gives the rate.
    """
    return f"they differ by {100.0 * abs(first / second - 1.0):.3g} %; if the times of a file are wrong, give --rate"
