"""Search for the largest amplitude within limits."""

from __future__ import annotations

import math
from collections.abc import Callable

from amb_core.designs.excitation.limits import Use
from amb_core.ground.errors import ExcitationError

SMALLEST_AMPLITUDE = 1e-8  # m; below, no sensor would detect the motion of the rotor
STEP = 2.0  # factor between amplitudes where only the side of the limit is known
LARGEST_STEP = 8.0  # of an extrapolation
_ALIKE = 0.8  # a use that falls by less than this from one amplitude to half of it does not depend on the amplitude


def largest_within(
    use_of: Callable[[float], Use], start: float, highest: float, tolerance: float
) -> tuple[float, float, Use | None]:
    """Largest amplitude at which no limit is exceeded.

    The share of a limit that is used grows about with a power of the amplitude. So amplitudes are predicted along a
    straight line of the logarithms, and halved where only the side of the limit is known. The search ends when one
    amplitude is within the limits and another one, larger by the tolerance at most, is not.

    Parameters
    ----------
    use_of : callable
        The limit of which an amplitude (m) uses most.
    start, highest : float
        First and largest amplitude (m).
    tolerance : float
        Relative error.

    Returns
    -------
    tuple
        Largest amplitude within the limits (m), smallest beyond it, and the limit that is exceeded there. If `highest`
        is within the limits, the amplitude beyond is infinite and the limit None.

    Raises
    ------
    ExcitationError
        If no amplitude down to 1e-8 m is within the limits.
    """
    within: tuple[float, Use] | None = None
    beyond: tuple[float, Use] | None = None
    amplitude = min(max(start, SMALLEST_AMPLITUDE), highest)
    while True:
        use = use_of(amplitude)
        if use.share <= 1.0:
            within = (amplitude, use)
            if amplitude >= highest:
                return highest, math.inf, None
        else:
            if amplitude <= SMALLEST_AMPLITUDE:
                raise ExcitationError(_none(use, beyond))
            beyond = (amplitude, use)
        if within and beyond and beyond[0] <= (1.0 + tolerance) * within[0]:
            return within[0], beyond[0], beyond[1]
        amplitude = _next(within, beyond, tolerance)
        amplitude = min(max(amplitude, SMALLEST_AMPLITUDE), highest)


def _next(within: tuple[float, Use] | None, beyond: tuple[float, Use] | None, tolerance: float) -> float:
    if within and beyond:
        return _between(within, beyond, tolerance)
    amplitude, use = within or beyond or (math.nan, Use(math.nan, ""))
    if math.isinf(use.share) or use.share <= 0.0:
        return amplitude * STEP if within else amplitude / STEP
    # Somewhat beyond the limit from below and within it from above, so that the limit lies between the two
    factor = (1.0 + 0.5 * tolerance if within else 1.0 - 0.5 * tolerance) / use.share
    return amplitude * min(max(factor, 1.0 / LARGEST_STEP), LARGEST_STEP)


def _between(within: tuple[float, Use], beyond: tuple[float, Use], tolerance: float) -> float:
    low, high = within[0], beyond[0]
    used, exceeded = within[1].share, beyond[1].share
    if math.isinf(exceeded) or not 0.0 < used < exceeded:
        return math.sqrt(low * high)
    predicted = low * (high / low) ** (math.log(1.0 / used) / math.log(exceeded / used))
    step = 1.0 + 0.9 * tolerance
    if predicted < low * step:  # the limit is hardly above: show that it is
        return low * step
    if predicted > high / step:
        return high / step
    return predicted / math.sqrt(step)


def _none(use: Use, beyond: tuple[float, Use] | None) -> str:
    text = f"no amplitude down to {SMALLEST_AMPLITUDE:g} m is within the limits; {use.what}"
    if beyond and not math.isinf(use.share) and use.share > _ALIKE * beyond[1].share:
        text += (
            f". It is about the same at {beyond[0]:.3g} m, so nonlinearity is not the cause: the linearised loop does "
            "not describe this bearing"
        )
    return text
