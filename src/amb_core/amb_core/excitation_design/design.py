"""Excitation design: the largest signal of a kind that stays in region A and determines a model of the given order."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from amb_core.errors import ExcitationError
from amb_core.excitation import ExcitationSignal, excitation_from_request, generate
from amb_core.excitation.deterministic import HIGHEST_AMPLITUDE
from amb_core.excitation_design.check import check_excitation
from amb_core.excitation_design.notes import made_with
from amb_core.excitation_design.persistence import Persistence, persistence
from amb_core.excitation_design.result import ExcitationCheck
from amb_core.excitation_design.trial import Trial, TrialBench
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions import Region, RegionParameters
from amb_core.regions.region_map import RegionMap

DESIGNED_KINDS = ("square", "multisine", "prbs")

FIRST_AMPLITUDE = 10e-6  # m; for the first check on the map; its margin then gives the amplitude
STEP = 1.25  # factor between amplitudes until one is in A and the next is not
SMALLEST_AMPLITUDE = 1e-8  # m; below, no sensor would detect the motion of the rotor


@dataclass(frozen=True)
class TriedAmplitude:
    """An amplitude (m) that was simulated, and the region in which the rotor ran."""

    amplitude: float
    region: Region


@dataclass(frozen=True)
class DesignedExcitation:
    """An excitation designed to stay in region A.

    Attributes
    ----------
    signal : ExcitationSignal
        The excitation.
    predicted_amplitude : float
        Largest amplitude in A according to the map (m).
    largest_amplitude : float
        Largest amplitude in A by simulation, within `tolerance` (m).
    beyond_amplitude : float
        Smallest amplitude found not in A by simulation (m); infinity if the largest allowed one is still in A.
    check : ExcitationCheck
        The excitation on the map.
    trial : Trial
        Its simulation, in region A.
    persistence : Persistence
        Persistence of excitation: the order of the model that it determines.
    tried : tuple of TriedAmplitude
        Simulations, in the order in which they were run.
    """

    signal: ExcitationSignal
    predicted_amplitude: float
    largest_amplitude: float
    beyond_amplitude: float
    check: ExcitationCheck
    trial: Trial
    persistence: Persistence
    tried: tuple[TriedAmplitude, ...]

    @property
    def amplitude(self) -> float:
        """Amplitude of the excitation (m)."""
        return float(self.signal.parameters.model_dump()["amplitude"])


def design_excitation(
    kind: str,
    values: Mapping[str, Any],
    region_map: RegionMap,
    controller: ControllerParameters | None = None,
    plant: PlantParameters | None = None,
    regions: RegionParameters | None = None,
    *,
    model_order: int = 10,
    margin: float = 0.9,
    tolerance: float = 0.02,
    progress: Callable[[float, int, int], None] | None = None,
) -> DesignedExcitation:
    """Find the largest amplitude of a signal that stays in region A.

    The map gives the start value; the simulation of the full plant decides, see `amb_core.excitation_design.trial`.
    Starting there, amplitudes with steps of a quarter are simulated until one is in A and the next is not. Then the
    interval is halved down to the tolerance.

    Parameters
    ----------
    kind : {"square", "multisine", "prbs"}
        Kind of excitation.
    values : Mapping
        Its fields except the amplitude, as in `excitation_from_request`. By default a multisine has optimised phases
        and, with axes `both`, interleaved lines.
    region_map : RegionMap
        Map of the bearing.
    controller, plant : ControllerParameters, PlantParameters, optional
        The loop to simulate; by default those the map was made with.
    regions : RegionParameters, optional
        Thresholds of the classifier.
    model_order : int, optional
        Number of states of the model that is to be identified.
    margin : float, optional
        Amplitude of the result over the largest in A, above 0 and at most 1.
    tolerance : float, optional
        Relative error of the largest amplitude, above 0.
    progress : callable, optional
        Called with the simulated amplitude (m), the number of finished steps and that of all steps.

    Raises
    ------
    ExcitationError
        If a value is not allowed, the signal is not persistently exciting for the order, or no amplitude stays in A.
    """
    if kind not in DESIGNED_KINDS:
        raise ExcitationError(f"kind {kind!r} is not designed; allowed: {', '.join(DESIGNED_KINDS)}")
    if "amplitude" in values:
        raise ExcitationError(
            f"amplitude = {values['amplitude']!r} m: the amplitude is what the design finds; leave it out"
        )
    for name, value in (("margin", margin), ("tolerance", tolerance)):
        if not 0.0 < value <= 1.0:
            raise ExcitationError(f"{name} = {value!r} is not allowed; it must be above 0, and 1 at most")
    if model_order < 1:
        raise ExcitationError(f"model_order = {model_order!r} is not allowed; it must be 1 or more")
    controller = controller or made_with(region_map, "controller", ControllerParameters)
    plant = plant or made_with(region_map, "plant", PlantParameters)
    fields = _fields(kind, values)

    def signal_of(amplitude: float) -> ExcitationSignal:
        return generate(excitation_from_request(kind, {**fields, "amplitude": amplitude}), controller.sample_rate)

    first = signal_of(FIRST_AMPLITUDE)
    excited = persistence(first, model_order)
    if not excited.sufficient:
        raise ExcitationError(_not_persistent(kind, excited, model_order))
    predicted = FIRST_AMPLITUDE * check_excitation(first, region_map, controller, plant).margin
    search = _Search(TrialBench(plant, controller, regions), signal_of, progress)
    largest, beyond = search.largest(min(max(predicted, SMALLEST_AMPLITUDE), HIGHEST_AMPLITUDE), tolerance)
    amplitude = margin * largest
    trial = search.run(amplitude)
    while trial.region > Region.A:  # a smaller amplitude may leave A even if a larger one is in A
        amplitude = _lowered(amplitude)
        trial = search.run(amplitude)
    signal = signal_of(amplitude)
    return DesignedExcitation(
        signal=signal,
        predicted_amplitude=predicted,
        largest_amplitude=largest,
        beyond_amplitude=beyond,
        check=check_excitation(signal, region_map, controller, plant),
        trial=trial,
        persistence=excited,
        tried=tuple(search.tried),
    )


class _Search:
    """Searches for the largest amplitude that stays in region A in simulation."""

    def __init__(
        self,
        bench: TrialBench,
        signal_of: Callable[[float], ExcitationSignal],
        progress: Callable[[float, int, int], None] | None,
    ) -> None:
        self._bench, self._signal_of, self._progress = bench, signal_of, progress
        self.tried: list[TriedAmplitude] = []

    def run(self, amplitude: float) -> Trial:
        progress = self._progress
        trial = self._bench.run(
            self._signal_of(amplitude),
            None if progress is None else lambda done, total: progress(amplitude, done, total),
        )
        self.tried.append(TriedAmplitude(amplitude, trial.region))
        return trial

    def largest(self, start: float, tolerance: float) -> tuple[float, float]:
        """Largest amplitude found in A and smallest found not in A (m), their ratio within 1 + tolerance."""
        low = high = start
        if self._linear(start):
            while self._linear(high):
                if high >= HIGHEST_AMPLITUDE:
                    return high, float("inf")
                low, high = high, min(STEP * high, HIGHEST_AMPLITUDE)
        else:
            low = _lowered(high)
            while not self._linear(low):
                low, high = _lowered(low), low
        while high > (1.0 + tolerance) * low:
            middle = (low * high) ** 0.5
            low, high = (middle, high) if self._linear(middle) else (low, middle)
        return low, high

    def _linear(self, amplitude: float) -> bool:
        known = {tried.amplitude: tried.region for tried in self.tried}
        return (known[amplitude] if amplitude in known else self.run(amplitude).region) == Region.A


def _lowered(amplitude: float) -> float:
    if amplitude < STEP * SMALLEST_AMPLITUDE:
        raise ExcitationError(f"no amplitude down to {SMALLEST_AMPLITUDE:g} m stays in region A in simulation")
    return amplitude / STEP


def _fields(kind: str, values: Mapping[str, Any]) -> dict[str, Any]:
    if kind != "multisine":
        return dict(values)
    interleaved = (values.get("axes") or "both") == "both"
    return {"phasing": "optimised", "interleaved": interleaved, **values}


def _not_persistent(kind: str, excited: Persistence, model_order: int) -> str:
    if excited.order == 0 and min(excited.lines) > 0:
        return (
            f"{kind}: x and y carry the same signal, so their effects cannot be separated; allowed axes: x, y, in_turn"
        )
    return (
        f"{kind}: persistently exciting of order {excited.order}, but a model with {model_order} states needs "
        f"{excited.wanted}; lengthen the duration or widen the band"
    )
