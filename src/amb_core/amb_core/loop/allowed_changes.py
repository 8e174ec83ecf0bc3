"""What may change at the controller of a rig while its node runs.

Whoever reaches a node sets its parameters. So the values with which the node of a rig starts are the operator's, and
from then on gains, limit and nominal reference only take values in the ranges that the operator gave at the start, too.
"""

from __future__ import annotations

from typing import Self

from pydantic import BaseModel, model_validator

from amb_core.ground.errors import ParameterError
from amb_core.ground.parameters import Parameters, quantities

LISTS = {"proportional_gain": "proportional_gains", "derivative_gain": "derivative_gains"}
"""Where each axis may have its own value, the parameter with these values."""


class AllowedChanges(Parameters):
    """Lowest and highest value of what a rig lets change; empty: nothing else than at the start."""

    proportional_gain: tuple[float, ...] = quantities("A/m", "lowest and highest K_P of a running rig", 0.0, 1e6)
    derivative_gain: tuple[float, ...] = quantities("A s/m", "lowest and highest K_D of a running rig", 0.0, 1e4)
    derivative_filter: tuple[float, ...] = quantities(
        "s", "lowest and highest time constant of the filter on the derivative of a running rig", 0.0, 0.1
    )
    current_limit: tuple[float, ...] = quantities(
        "A", "lowest and highest limit on the control current references of a running rig", 0.0, 100.0
    )
    nominal_reference: tuple[float, ...] = quantities(
        "m", "lowest and highest nominal reference of a running rig", -1e-3, 1e-3
    )

    @model_validator(mode="after")
    def _ranges(self) -> Self:
        for name in type(self).model_fields:
            ends = getattr(self, name)
            if ends and (len(ends) != 2 or ends[0] > ends[1]):
                raise ValueError(f"{name} = {list(ends)}; allowed: lowest and highest value, or empty")
        return self

    def require(self, wanted: BaseModel, start: BaseModel) -> None:
        """Raise ParameterError if changed parameters of a controller are neither as at the start nor in these ranges.

        Parameters
        ----------
        wanted, start : Parameters
            Those of the same controller; names that it does not have are passed over.
        """
        for name in type(self).model_fields:
            if not hasattr(wanted, name) or _values(wanted, name) == _values(start, name):
                continue
            ends, values = getattr(self, name), _values(wanted, name)
            if not (ends and all(ends[0] <= value <= ends[1] for value in values)):
                allowed = f"{ends[0]:g} to {ends[1]:g}" if ends else "as at the start of this node"
                shown = ", ".join(f"{value:g}" for value in values)
                raise ParameterError(
                    f"'{name}' = {shown} is not allowed on a rig; allowed: {allowed} (allowed.{name}, in the parameter "
                    "file of this node)"
                )


def _values(parameters: BaseModel, name: str) -> tuple[float, ...]:
    """What holds on the axes; the same value on all counts once."""
    value = getattr(parameters, LISTS.get(name, name), ()) or getattr(parameters, name) or 0.0
    return tuple(value) if isinstance(value, tuple) else (value,)
