"""The DDS domain that the environment names. Beyond the last one the middleware ends a process without a reason."""

from __future__ import annotations

import os

from amb_core.ground.errors import AmbError, ParameterError
from amb_core.ground.given_values import refusal

DOMAIN = "ROS_DOMAIN_ID"
LAST_DOMAIN = 232  # its ports are the highest that there are


def require_domain(error: type[AmbError] = ParameterError) -> None:
    """Raise ParameterError, or `error`, if the environment names what is no domain."""
    named = os.environ.get(DOMAIN, "")
    if named and not (named.isdecimal() and int(named) <= LAST_DOMAIN):
        raise refusal(DOMAIN, named, f"0 to {LAST_DOMAIN}", error)
