"""How long the internal step of the integrator may be: for eddy currents, laminations, bending modes, contact."""

from __future__ import annotations

import numpy as np

from amb_core.ground.errors import PlantError
from amb_core.plant.magnetostatics import Magnetostatics
from amb_core.plant.parameters import PlantParameters
from amb_core.plant.rotor import RotorModel, contact_mass


def require_short_step(parameters: PlantParameters, magnetostatics: Magnetostatics, rotor: RotorModel | None) -> None:
    """Refuse an internal step with which the integrator is not stable or not accurate.

    Parameters
    ----------
    parameters : PlantParameters
        Parameters of the plant.
    magnetostatics : Magnetostatics
        Its magnetic circuit.
    rotor : RotorModel or None
        Its rotor in two bearings; None for a point mass.

    Raises
    ------
    PlantError
        If the step is too long.
    """
    step = parameters.integration.internal_step
    if parameters.iron.laminations == "diffusion":
        _check_means(parameters, step * magnetostatics.fastest_mean_rate())
    else:
        _check_eddy_currents(step, 1.0 / magnetostatics.shortest_time_constant())
    if rotor is not None:
        _check_modes(step, rotor)
    if parameters.backup_bearing.contact:
        _check_contact(parameters, rotor)


def contact_limits(parameters: PlantParameters, rotor: RotorModel | None) -> tuple[float, float]:
    """Largest stiffness (N/m) and damping (N s/m) of a backup bearing that the internal step resolves.

    With mass m at the contact the integrator is stable up to one step h per time constant m / c of the damper, and half
    of that is allowed. A rotor rebounds from the spring k faster than it came: for h sqrt(k / m) below 0.2 by less than
    0.8 %.

    Parameters
    ----------
    parameters : PlantParameters
        Parameters of the plant.
    rotor : RotorModel or None
        Its rotor in two bearings; None for a point mass.
    """
    mass, step = contact_mass(parameters, rotor), parameters.integration.internal_step
    return mass * (0.2 / step) ** 2, 0.5 * mass / step


def _check_eddy_currents(step: float, fastest: float) -> None:
    """The integrator is stable up to one step per fastest eddy-current time constant; half of that is allowed."""
    if step * fastest > 0.5:
        raise PlantError(
            f"integration.internal_step = {step:g} s is too long for the eddy currents, whose shortest time "
            f"constant is {1.0 / fastest:.3g} s; allowed: at most {0.5 / fastest:.3g} s"
        )


def _check_means(parameters: PlantParameters, change: float) -> None:
    """Fluxes that no coil links change by this share of their deviation in a step: beyond 1.9 they oscillate."""
    if change > 1.9:
        circuit = parameters.magnetic_circuit
        raise PlantError(
            f"integration.internal_step = {parameters.integration.internal_step:g} s is too long for the "
            f"diffusion of flux into laminations of {circuit.lamination_thickness:g} m and "
            f"{circuit.iron_conductivity:g} S/m, which hardly delays it; allowed: a shorter step, or "
            "iron.eddy_currents: false with iron.laminations: thin"
        )


def _check_modes(step: float, rotor: RotorModel) -> None:
    """Explicit steps of undamped modes grow by (omega h)^4 / 4; for omega h below 0.2 that is less than 0.05 %."""
    fastest = 2.0 * np.pi * float(rotor.natural_frequencies().max())
    if step * fastest > 0.2:
        raise PlantError(
            f"integration.internal_step = {step:g} s is too long for the rotor's fastest mode, "
            f"{fastest / (2.0 * np.pi):.3g} Hz; allowed: at most {0.2 / fastest:.3g} s, or modes up to "
            f"{0.1 / (np.pi * step):.3g} Hz"
        )


def _check_contact(parameters: PlantParameters, rotor: RotorModel | None) -> None:
    contact, step = parameters.backup_bearing, parameters.integration.internal_step
    mass = contact_mass(parameters, rotor)
    stiffest, strongest = contact_limits(parameters, rotor)
    for name, value, limit, unit, power in (
        ("stiffness", contact.stiffness, stiffest, "N/m", 0.5),
        ("damping", contact.damping, strongest, "N s/m", 1.0),
    ):
        if value > limit:
            longest = step * (limit / value) ** power
            raise PlantError(
                f"integration.internal_step = {step:g} s is too long for backup_bearing.{name} = {value:g} {unit} "
                f"with {mass:.3g} kg at the contact; allowed: at most {longest:.3g} s, or {limit:.3g} {unit}"
            )
