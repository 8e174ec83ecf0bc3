"""Why no PD controller holds a bearing with good margins: what would have to be better for gains to exist.

Each part of the loop that costs phase is made nearly ideal by itself; where gains are found then, that part is named.
Where none are, no part is named. The gains of the current loops come first: faster switching would change them, too.
"""

from __future__ import annotations

from collections.abc import Mapping

from amb_core.designs.tuning.current_loop import GAINS, current_loop_gains
from amb_core.designs.tuning.gains import HIGHEST_PEAK, tune
from amb_core.designs.tuning.levitation import lift_off_current
from amb_core.ground.errors import ParameterError, PlantError
from amb_core.ground.parameters import flatten, validate
from amb_core.loop.control import ControllerParameters
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.sampled_amplifiers import modulation_is_regular

FASTER = 10.0
HIGHEST_RATE, HIGHEST_SWITCHING = 1e5, 1e6
"""Sample rate and switching frequency that a plant takes (Hz)."""


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

    def holds(machine: tuple[PlantParameters, ControllerParameters]) -> bool:
        try:
            tuned = tune(*machine, highest_peak)
        except PlantError:
            return False
        return tuned is not None and tuned.peak_sensitivity <= highest_peak

    reshaped = _with_current_loop(parameters)
    if reshaped is not None and holds((reshaped, controller)):
        given, better = parameters.amplifier, reshaped.amplifier
        return (
            f"gains of the current loops, K_P = {given.proportional_gain:g} 1/A and K_I = {given.integral_gain:g} "
            f"1/(A s); K_P = {better.proportional_gain:g} 1/A and K_I = {better.integral_gain:g} 1/(A s) would do"
        )
    tried = _better(parameters, controller)
    parts = [text for text, _, machine in tried if holds(machine)]
    return " or ".join(parts) or f"no part alone is the reason; tried nearly ideal: {', '.join(n for _, n, _ in tried)}"


def require_lift_off(parameters: PlantParameters, controller: ControllerParameters) -> float:
    """The control current that lifts the rotor off (A); PlantError if it is beyond the limits."""
    current = lift_off_current(parameters)
    if current >= controller.current_limit:
        limit = controller.current_limit
        needs = f"{current:.3g} A" if current < float("inf") else "more than the amplifiers have"
        raise PlantError(
            "static load beyond the force: lifting the rotor off the backup bearing needs a control current of "
            f"{needs}; allowed: less than {limit:.3g} A; more turns, a larger current limit (unless given: twice the "
            "bias current), a smaller clearance or larger magnets lift more"
        )
    return current


def _better(
    parameters: PlantParameters, controller: ControllerParameters
) -> list[tuple[str, str, tuple[PlantParameters, ControllerParameters]]]:
    """What a part is called when it is the reason, its name, and the machine with this part nearly ideal."""
    amplifier, sensor, delay = parameters.amplifier, parameters.sensor, parameters.converters.computation_delay
    rate = parameters.integration.sample_rate
    machines = [
        (
            f"sampling too slow ({rate:g} Hz, delay of {delay:g} samples)",
            "sampling",
            _changed(parameters, _faster_sampling(parameters)),
        ),
        (
            f"amplifier too slow ({amplifier.supply_voltage:g} V, {amplifier.switching_frequency:g} Hz)",
            "amplifiers",
            _faster_switching(parameters),
        ),
    ]
    if sensor.bandwidth > 0.0:
        text = f"sensor too slow ({sensor.bandwidth:g} Hz)"
        machines.append((text, "sensors", _changed(parameters, {"sensor.bandwidth": 0.0})))
    if parameters.iron.eddy_currents:
        without = {"iron.eddy_currents": False, "iron.laminations": "thin", "iron.solid_journal": False}
        machines.append(("eddy currents too strong", "iron", _changed(parameters, without)))
    tried = [(text, name, (machine, controller)) for text, name, machine in machines if machine is not None]
    if controller.derivative_filter > 0.0:
        text = f"derivative filter too slow ({controller.derivative_filter:g} s)"
        without_filter = controller.model_copy(update={"derivative_filter": 0.0})
        tried.append((text, "derivative filter", (parameters, without_filter)))
    return tried


def _faster_sampling(parameters: PlantParameters) -> dict[str, object]:
    """Up to `FASTER` times the sample rate without delay; switching as before if samples are not shorter than that."""
    rate, step = parameters.integration.sample_rate, parameters.integration.internal_step
    frequency = parameters.amplifier.switching_frequency
    factor = max(int(min(FASTER, HIGHEST_RATE / rate)), 1)
    changes: dict[str, object] = {"converters.computation_delay": 0.0}
    whole = max(min(factor, int(frequency / rate)), 1)
    if modulation_is_regular(parameters) and (whole > 1 or factor == 1):
        switching = round(frequency / (whole * rate)) * whole * rate
        return changes | {
            "integration.sample_rate": whole * rate,
            "integration.internal_step": 1.0 / (switching * parameters.steps_per_period),
            "amplifier.switching_frequency": switching,
        }
    return changes | {
        "integration.sample_rate": factor * rate,
        "integration.internal_step": 1.0 / (factor * rate * max(round(1.0 / (factor * rate * step)), 2)),
        "amplifier.switching": False,
    }


def _faster_switching(parameters: PlantParameters) -> PlantParameters | None:
    """Up to `FASTER` times the switching frequency, with current loops for it."""
    amplifier, step = parameters.amplifier, parameters.integration.internal_step
    factor = int(min(FASTER, HIGHEST_SWITCHING / amplifier.switching_frequency))
    changes: dict[str, object] = {
        "amplifier.switching_frequency": factor * amplifier.switching_frequency,
        "integration.internal_step": step / factor if factor else step,
    }
    faster = _changed(parameters, changes) if factor > 1 else None
    return None if faster is None else _with_current_loop(faster)


def _with_current_loop(parameters: PlantParameters) -> PlantParameters | None:
    """With current loops as `amb new` makes them; None if there are none for this machine."""
    if not parameters.amplifier.switching:
        return None
    try:
        gains = current_loop_gains(parameters)
    except PlantError:
        return None
    return _changed(parameters, dict(zip(GAINS, gains, strict=True)))


def _changed(parameters: PlantParameters, values: Mapping[str, object]) -> PlantParameters | None:
    """The machine with other values; None if it cannot be built."""
    try:
        changed = validate(PlantParameters, {**flatten(parameters.model_dump()), **values})
        Plant(changed)
    except (ParameterError, PlantError):
        return None
    return changed
