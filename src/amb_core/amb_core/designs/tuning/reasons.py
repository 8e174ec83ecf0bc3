"""Why no PD controller holds a bearing with good margins: what would have to be better for gains to exist.

Each part of the loop that costs phase is made nearly ideal by itself; where gains are found then, that part is named.
"""

from __future__ import annotations

from amb_core.designs.tuning.gains import HIGHEST_PEAK, tune
from amb_core.designs.tuning.levitation import lift_off_current
from amb_core.ground.errors import PlantError
from amb_core.ground.parameters import flatten, validate
from amb_core.loop.control import ControllerParameters
from amb_core.plant import Plant, PlantParameters

FASTER = 10.0


def reason(parameters: PlantParameters, controller: ControllerParameters, highest_peak: float = HIGHEST_PEAK) -> str:
    """The part of the loop that keeps the peak sensitivity above the limit, in words.

    Parameters
    ----------
    parameters, controller : PlantParameters, ControllerParameters
        The machine; the controller's gains are not used.
    highest_peak : float, optional
        The limit (-).

    Returns
    -------
    str
        A phrase for a message.
    """
    parts = []
    for text, better in _better(parameters, controller):
        try:
            tuned = tune(*better, highest_peak)
        except PlantError:
            continue
        if tuned is not None and tuned.peak_sensitivity <= highest_peak:
            parts.append(text)
    return " or ".join(parts) or "several parts of the loop together are too slow for this rotor, or it bends too much"


def require_lift_off(parameters: PlantParameters, controller: ControllerParameters) -> float:
    """The control current that lifts the rotor off (A); PlantError if it is beyond the limits."""
    current = lift_off_current(parameters)
    if current >= controller.current_limit:
        limit = controller.current_limit
        needs = f"{current:.3g} A" if current < float("inf") else "more than the amplifiers have"
        raise PlantError(
            "static load beyond the force: lifting the rotor off the backup bearing needs a control current of "
            f"{needs}; allowed: less than {limit:.3g} A; more turns, a larger bias current, a smaller clearance or "
            "larger magnets lift more"
        )
    return current


def _better(
    parameters: PlantParameters, controller: ControllerParameters
) -> list[tuple[str, tuple[PlantParameters, ControllerParameters]]]:
    """Machines with one part nearly ideal, and what the part is called when it is not."""
    sampling, amplifier, sensor = parameters.integration, parameters.amplifier, parameters.sensor
    rate = min(FASTER * sampling.sample_rate, 1e5)
    factor = max(int(rate / sampling.sample_rate), 1)
    step = min(sampling.internal_step, 0.5 / (factor * sampling.sample_rate))
    changes: list[tuple[str, dict[str, object]]] = [
        (
            f"sampling too slow ({sampling.sample_rate:g} Hz, delay of {parameters.converters.computation_delay:g} "
            "samples)",
            {
                "integration.sample_rate": factor * sampling.sample_rate,
                "integration.internal_step": step,
                "converters.computation_delay": 0.0,
                "amplifier.switching": False,
            },
        ),
        (
            f"amplifier too slow ({amplifier.supply_voltage:g} V, {amplifier.switching_frequency:g} Hz)",
            {
                "amplifier.switching": False,
                "amplifier.proportional_gain": min(FASTER * amplifier.proportional_gain, 1e3),
            },
        ),
    ]
    if sensor.bandwidth > 0.0:
        changes.append((f"sensor too slow ({sensor.bandwidth:g} Hz)", {"sensor.bandwidth": 0.0}))
    if parameters.iron.eddy_currents:
        changes.append(
            (
                "eddy currents too strong",
                {"iron.eddy_currents": False, "iron.laminations": "thin", "iron.solid_journal": False},
            )
        )
    machines = [(text, (_changed(parameters, values), controller)) for text, values in changes]
    if controller.derivative_filter > 0.0:
        text = f"derivative filter too slow ({controller.derivative_filter:g} s)"
        machines.append((text, (parameters, controller.model_copy(update={"derivative_filter": 0.0}))))
    return [(text, machine) for text, machine in machines if _can_be_built(machine[0])]


def _changed(parameters: PlantParameters, values: dict[str, object]) -> PlantParameters:
    return validate(PlantParameters, {**flatten(parameters.model_dump()), **values})


def _can_be_built(parameters: PlantParameters) -> bool:
    try:
        Plant(parameters)
    except PlantError:
        return False
    return True
