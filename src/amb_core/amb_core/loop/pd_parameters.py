"""Parameters and coefficients of the PD law (`control`): apart from it, so that they load without a compiler."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import ParameterError
from amb_core.ground.parameters import (
    Parameters,
    choice,
    flatten,
    of_machine,
    quantities,
    quantity,
    validate,
)


def current_limit() -> Any:
    """Declaration of the limit that every controller has.

    Returns
    -------
    FieldInfo
        The declaration, for a field of a parameter set.
    """
    return quantity(
        3.0, "A", "limit on the magnitude of the control current references", 0.0, 100.0, runtime=True, source="assumed"
    )


def nominal_reference() -> Any:
    """Declaration of the nominal reference that every controller has.

    Returns
    -------
    FieldInfo
        The declaration, for a field of a parameter set.
    """
    return quantities(
        "m",
        "nominal reference position of each axis, in their order; empty: 0 on all",
        -1e-3,
        1e-3,
        runtime=True,
        source="assumed",
    )


class ControllerParameters(Parameters):
    """Parameters of the PD controller: the same gains on all axes (paper, table 1), or others on each."""

    sample_rate: float = of_machine(
        10_000.0, "Hz", "controller sample rate f_s", 1.0, 1e6, simulator_parameter="integration.sample_rate"
    )
    proportional_gain: float = quantity(
        20_000.0, "A/m", "proportional gain K_P", 0.0, 1e6, runtime=True, source="stated: table 1, unit assumed"
    )
    derivative_gain: float = quantity(
        38.0, "A s/m", "derivative gain K_D", 0.0, 1e4, runtime=True, source="stated: table 1, unit assumed"
    )
    derivative_filter: float = quantity(
        0.0,
        "s",
        "time constant of the first-order filter on the derivative; 0 for none",
        0.0,
        0.1,
        runtime=True,
        source="assumed",
    )
    derivative_on: Literal["error", "measurement"] = choice(
        "error",
        "signal that is differentiated: the position error (paper, Fig. 10) or the measured position",
        source="stated: Fig. 10",
    )
    current_limit: float = current_limit()
    proportional_gains: tuple[float, ...] = quantities(
        "A/m", "K_P of each axis, in the order of the axes; empty: proportional_gain on all", 0.0, 1e6, runtime=True
    )
    derivative_gains: tuple[float, ...] = quantities(
        "A s/m", "K_D of each axis, in the order of the axes; empty: derivative_gain on all", 0.0, 1e4, runtime=True
    )
    nominal_reference: tuple[float, ...] = nominal_reference()

    def at_rate(self, sample_rate: float) -> Self:
        """The same controller at the sample rate of a machine (Hz).

        Parameters
        ----------
        sample_rate : float
            Sample rate of the machine (Hz).

        Returns
        -------
        ControllerParameters
            The parameters at that rate.

        Raises
        ------
        ParameterError
            If the rate is out of its range.
        """
        if sample_rate == self.sample_rate:
            return self
        return validate(type(self), {**flatten(self.model_dump()), "sample_rate": sample_rate})

    def references(self, axes: int) -> NDArray[np.float64]:
        """Nominal reference position of each axis (m), shape (axes,).

        Parameters
        ----------
        axes : int
            Number of axes.

        Returns
        -------
        ndarray, shape (axes,)
            Positions (m).

        Raises
        ------
        ParameterError
            If `nominal_reference` is given for another number of axes.
        """
        return one_each("nominal_reference", self.nominal_reference, 0.0, axes)

    def require_axes(self, axes: int) -> None:
        """Check that no list is given for another number of axes.

        Parameters
        ----------
        axes : int
            Number of axes of the machine.

        Raises
        ------
        ParameterError
            If one is.
        """
        pack_gains(self, axes)
        self.references(axes)


def with_present_names(values: Mapping[str, object]) -> dict[str, object]:
    """Parameters as version 0.1 recorded them, where the nominal reference of x and y had a name each.

    Parameters
    ----------
    values : mapping of str to object
        Parameters by name, of any version.

    Returns
    -------
    dict of str to object
        The same values under today's names.
    """
    renamed = dict(values)
    former = [renamed.pop(f"nominal_reference_{axis}", None) for axis in "xy"]
    if any(former):
        renamed["nominal_reference"] = [value or 0.0 for value in former]
    return renamed


def require_one_rate(controller_rate: float, sample_rate: float) -> None:
    """Check that the controller runs at the sample rate of the plant.

    Parameters
    ----------
    controller_rate, sample_rate : float
        Rates of the two (Hz).

    Raises
    ------
    ParameterError
        If they differ.
    """
    if abs(controller_rate - sample_rate) > 1e-9 * sample_rate:
        raise ParameterError(
            f"the controller runs at {controller_rate:g} Hz, the plant is sampled at {sample_rate:g} Hz; "
            "the two rates must be equal"
        )


def pack_gains(parameters: ControllerParameters, axes: int) -> NDArray[np.float64]:
    """Coefficients of `pd_update`, shape (axes, 6).

    They are K_P, K_D, filter pole, difference weight, 1 for derivative on error, limit.

    Parameters
    ----------
    parameters : ControllerParameters
        Gains and limit.
    axes : int
        Number of axes.

    Returns
    -------
    ndarray, shape (axes, 6)
        A row for each axis.

    Raises
    ------
    ParameterError
        If gains are given for another number of axes.
    """
    sample_time = 1.0 / parameters.sample_rate
    span = parameters.derivative_filter + sample_time
    gains = np.empty((axes, 6))
    gains[:, 0] = one_each("proportional_gains", parameters.proportional_gains, parameters.proportional_gain, axes)
    gains[:, 1] = one_each("derivative_gains", parameters.derivative_gains, parameters.derivative_gain, axes)
    gains[:, 2] = parameters.derivative_filter / span
    gains[:, 3] = 1.0 / span
    gains[:, 4] = 1.0 if parameters.derivative_on == "error" else 0.0
    gains[:, 5] = parameters.current_limit
    return gains


def one_each(name: str, values: tuple[float, ...], default: float, axes: int) -> NDArray[np.float64]:
    """One value per axis, shape (axes,); the default on all where no values are given.

    Parameters
    ----------
    name : str
        Name of the parameter, for messages.
    values : tuple of float
        One value for each axis, in the unit of the parameter, or none.
    default : float
        Value on all axes where none are given (unit of the parameter).
    axes : int
        Number of axes.

    Returns
    -------
    ndarray, shape (axes,)
        The values.

    Raises
    ------
    ParameterError
        If they are given for another number of axes.
    """
    if values and len(values) != axes:
        raise ParameterError(f"{name} has {len(values)} values; the machine has {axes} axes; allowed: {axes}, or none")
    return np.array(values) if values else np.full(axes, default)
