"""Excitation design: the largest signal of a kind that stays in region A and within limits of nonlinear distortion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from amb_core.designs.excitation.certificate import Bench, ExcitationCertificate
from amb_core.designs.excitation.check import check_excitation
from amb_core.designs.excitation.excited_order import ExcitedOrder
from amb_core.designs.excitation.limits import Limits
from amb_core.designs.excitation.linear_response import LinearLoop
from amb_core.designs.excitation.multisine_distortion import CANDIDATES
from amb_core.designs.excitation.notes import made_with
from amb_core.designs.excitation.result import ExcitationCheck
from amb_core.designs.excitation.search import SMALLEST_AMPLITUDE, largest_within
from amb_core.designs.excitation.trial import Trial
from amb_core.excitation import ExcitationSignal, excitation_from_settings, generate
from amb_core.excitation.axes import ALL, BOTH
from amb_core.excitation.deterministic import HIGHEST_AMPLITUDE
from amb_core.ground.errors import ExcitationError, one_line
from amb_core.ground.given_values import number, require_callable, require_kind, whole_number
from amb_core.ground.parameters import given_set
from amb_core.ground.progress import Progress
from amb_core.ground.results import Result
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions import Region, RegionParameters
from amb_core.regions.distortion import Distortion
from amb_core.regions.region_map import RegionMap

DESIGNED_KINDS = ("square", "multisine", "prbs")

FIRST_AMPLITUDE = 10e-6  # m; for the first check on the map; its margin then gives the amplitude
_FIRST_LOAD = 0.1  # control current of the first trial over its limit, rms
_LOWERED = 0.8  # factor on an amplitude that exceeds a limit though a larger one did not


@dataclass(frozen=True)
class TriedAmplitude:
    """An amplitude (m) that was simulated, the region in which the rotor ran, and the limit of which it used most."""

    amplitude: float
    region: Region
    use: str


@dataclass(frozen=True, repr=False)
class DesignedExcitation(Result):
    """An excitation designed to stay in region A and within limits of distortion, clipping and slew.

    Attributes
    ----------
    signal : ExcitationSignal
        The excitation.
    limits : Limits
        The limits.
    largest_amplitude : float
        Largest amplitude within the limits by simulation, within the tolerance (m).
    beyond_amplitude : float
        Smallest amplitude found beyond them (m); infinity if the largest allowed one is still within.
    limited_by : str
        The limit that is exceeded at `beyond_amplitude`, with its value there.
    certificate : ExcitationCertificate
        Simulations of the excitation with all seeds.
    excited_order : ExcitedOrder
        Order of the models that identification accepts of its recording.
    tried : tuple of TriedAmplitude
        Simulations in the order in which they were run, one seed each.
    predicted_amplitude : float or None
        Largest amplitude in A according to the map (m); None without a map.
    check : ExcitationCheck or None
        The excitation on the map; None without a map.
    """

    signal: ExcitationSignal
    limits: Limits
    largest_amplitude: float
    beyond_amplitude: float
    limited_by: str
    certificate: ExcitationCertificate
    excited_order: ExcitedOrder
    tried: tuple[TriedAmplitude, ...]
    predicted_amplitude: float | None
    check: ExcitationCheck | None

    @property
    def amplitude(self) -> float:
        """Amplitude of the excitation (m)."""
        return float(self.signal.parameters.model_dump()["amplitude"])

    @property
    def trial(self) -> Trial:
        """Simulation with the seed of `signal`, in region A."""
        return self.certificate.trials[0]

    @property
    def distortion(self) -> Distortion | None:
        """Nonlinear distortion by random-phase multisines of the same band and power; None if it is no multisine."""
        return self.certificate.distortion

    @property
    def summary(self) -> str:
        """The verdict."""
        return self.verdict

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Amplitudes, and what limits them."""
        by_map = (
            [] if self.predicted_amplitude is None else [("largest in region A by the map", self.predicted_amplitude)]
        )
        lengths = [("amplitude", self.amplitude), ("largest within the limits", self.largest_amplitude), *by_map]
        return [*((name, f"{1e6 * value:.5g} um") for name, value in lengths), ("limited by", self.limited_by)]

    @property
    def verdict(self) -> str:
        """One line: the amplitude, what was shown, and what limits it."""
        worst = self.certificate.worst
        deviation = ", ".join(f"{item.axis} {100.0 * item.deviation:.2g} %" for item in worst)
        seeds = len(self.certificate.trials)
        runs = f"this signal and {seeds - 1} with other seeds" if seeds > 1 else "this signal"
        shown = f"region A and a deviation from the linear response of at most {deviation}, simulated for {runs}"
        if self.distortion is not None:
            of_axis = dict(zip(self.distortion.axes, 100.0 * self.distortion.upper_ratio, strict=True))
            shown += "; nonlinear distortion of random-phase multisines of this band and power at most " + ", ".join(
                f"{item.axis} {of_axis[item.axis]:.2g} %" for item in worst
            )
            shown += f" at 95 %, by the {self.distortion.experiments // 2} of {CANDIDATES} that request most current"
        return f"{1e6 * self.amplitude:.4g} um: {shown}; a larger amplitude is limited by {self.limited_by}"


def design_excitation(
    kind: str,
    values: Mapping[str, Any],
    region_map: RegionMap | None = None,
    controller: ControllerParameters | None = None,
    plant: PlantParameters | None = None,
    regions: RegionParameters | None = None,
    *,
    limits: Limits | None = None,
    model_order: int | None = None,
    margin: float = 0.9,
    tolerance: float = 0.02,
    progress: Progress | None = None,
) -> DesignedExcitation:
    """Find the largest amplitude of a signal that stays in region A and within limits.

    The simulation of the full plant decides, see `amb_core.designs.excitation.certificate`. Every amplitude is tried
    with several seeds. The map, if there is one, gives no more than a bound for the first amplitude.

    Parameters
    ----------
    kind : {"square", "multisine", "prbs"}
        Kind of excitation.
    values : Mapping
        Its fields except the amplitude, as in `excitation_from_settings`. By default a multisine has optimised phases
        and, with axes `all`, interleaved lines. Other seeds follow the one given.
    region_map : RegionMap, optional
        Map of the bearing. None if there is none.
    controller, plant : ControllerParameters, PlantParameters, optional
        The loop to simulate; by default those the map was made with.
    regions : RegionParameters, optional
        Thresholds of the classifier. The defaults if None.
    limits : Limits, optional
        Limits of distortion, fit and saturation, and the number of seeds. The defaults if None.
    model_order : int, optional
        Number of states of a model that the signal must determine; by default that is reported only.
    margin : float, optional
        Amplitude of the result over the largest within the limits, above 0 and at most 1 (-).
    tolerance : float, optional
        Relative error of the largest amplitude, above 0 (-).
    progress : callable, optional
        Called with what is simulated, and the numbers of finished and of all steps. None for no calls.

    Returns
    -------
    DesignedExcitation
        The signal with its amplitude, the trials, and what limits it.

    Raises
    ------
    ExcitationError
        If a value is not allowed, the signal does not determine a model of the order, or no amplitude is within the
        limits.
    RegionError
        If neither the map nor the caller gives the parameters of the loop.
    """
    _check_options(kind, values, model_order, margin, tolerance)
    require_callable("progress", progress, ExcitationError)
    allowed = "a RegionMap, such as RegionMap.load(path), or None"
    require_kind("region_map", region_map, (RegionMap, type(None)), allowed, ExcitationError)
    if controller is None:
        controller = made_with(region_map, "controller", ControllerParameters)
    controller = given_set(ControllerParameters, "controller", controller)
    plant = given_set(
        PlantParameters, "plant", made_with(region_map, "plant", PlantParameters) if plant is None else plant
    )
    regions = given_set(RegionParameters, "regions", regions)
    limits = given_set(Limits, "limits", limits)
    fields = _fields(kind, values)

    signal_of = _Signals(kind, fields, controller.sample_rate)
    first = signal_of(FIRST_AMPLITUDE)
    bench = Bench(plant, controller, regions, limits, signal_of, progress)
    bench.require_order(first, model_order)
    predicted = None
    start = _start(first, bench.linear, bench.current_limit)
    if region_map is not None:
        predicted = FIRST_AMPLITUDE * check_excitation(first, region_map, controller, plant).map_margin
        start = min(start, predicted)
    largest, beyond, exceeded = largest_within(bench.use_of_trials, start, HIGHEST_AMPLITUDE, tolerance)
    if bench.measures_distortion:
        lower = largest_within(bench.use_of_distortion, largest, largest, tolerance)
        largest, beyond, exceeded = lower if lower[2] else (largest, beyond, exceeded)
    certificate = _certify(bench, margin * largest)
    signal = signal_of.generated(certificate.amplitude)
    order = bench.require_order(signal, model_order, certificate.trials[0])
    return DesignedExcitation(
        signal=signal,
        limits=limits,
        largest_amplitude=largest,
        beyond_amplitude=beyond,
        limited_by=exceeded.what
        if exceeded
        else f"nothing up to the largest allowed amplitude, {HIGHEST_AMPLITUDE:g} m",
        certificate=certificate,
        excited_order=order,
        tried=tuple(TriedAmplitude(*tried) for tried in bench.tried),
        predicted_amplitude=predicted,
        check=None if region_map is None else check_excitation(signal, region_map, controller, plant),
    )


class _Signals:
    """The signals of a kind: phases are optimised once a seed, since every kind is in proportion to its amplitude."""

    def __init__(self, kind: str, fields: Mapping[str, Any], sample_rate: float) -> None:
        self._kind, self._fields, self._sample_rate = kind, fields, sample_rate
        self._by_seed: dict[int, ExcitationSignal] = {}

    def __call__(self, amplitude: float, seed: int = 0) -> ExcitationSignal:
        """The signal of an amplitude (m) with a number added to its seed, to rounding."""
        if seed not in self._by_seed:
            self._by_seed[seed] = self.generated(FIRST_AMPLITUDE, seed)
        known = self._by_seed[seed]
        parameters = known.parameters.model_copy(update={"amplitude": amplitude})
        return replace(known, parameters=parameters, samples=amplitude / FIRST_AMPLITUDE * known.samples)

    def generated(self, amplitude: float, seed: int = 0) -> ExcitationSignal:
        """The same, exactly as the excitation generator makes it."""
        values = {**self._fields, "amplitude": amplitude}
        if seed:
            values["seed"] = int(self._fields.get("seed") or 0) + seed
        return generate(excitation_from_settings(self._kind, values), self._sample_rate)


def _certify(bench: Bench, amplitude: float) -> ExcitationCertificate:
    """A smaller amplitude may exceed a limit even if a larger one does not: then it is lowered further."""
    while True:
        certificate = bench.certify(amplitude)
        if certificate.use.share <= 1.0:
            return certificate
        amplitude *= _LOWERED
        if amplitude < SMALLEST_AMPLITUDE:
            raise ExcitationError(
                f"no amplitude down to {SMALLEST_AMPLITUDE:g} m is within the limits; {certificate.use.what}"
            )


def _start(signal: ExcitationSignal, loop: LinearLoop, current_limit: float) -> float:
    """Amplitude with a small control current in the linear loop."""
    rms = float(loop.respond(signal.samples).current.std(axis=0).max())
    amplitude = FIRST_AMPLITUDE * _FIRST_LOAD * current_limit / rms if rms > 0.0 else FIRST_AMPLITUDE
    return min(max(amplitude, SMALLEST_AMPLITUDE), HIGHEST_AMPLITUDE)


def _check_options(
    kind: str, values: Mapping[str, Any], model_order: int | None, margin: float, tolerance: float
) -> None:
    if not isinstance(kind, str) or kind not in DESIGNED_KINDS:
        raise ExcitationError(f"kind {one_line(repr(kind), 80)} is not designed; allowed: {', '.join(DESIGNED_KINDS)}")
    require_kind("values", values, Mapping, "values by name of the field", ExcitationError)
    if "amplitude" in values:
        raise ExcitationError(
            f"amplitude = {values['amplitude']!r} m: the amplitude is what the design finds; leave it out"
        )
    for name, value in (("margin", margin), ("tolerance", tolerance)):
        if not 0.0 < number(name, value, ExcitationError) <= 1.0:
            raise ExcitationError(f"{name} = {value!r} is not allowed; it must be above 0, and 1 at most")
    if model_order is not None and whole_number("model_order", model_order, ExcitationError) < 1:
        raise ExcitationError(f"model_order = {model_order!r} is not allowed; it must be 1 or more")


def _fields(kind: str, values: Mapping[str, Any]) -> dict[str, Any]:
    if kind != "multisine":
        return dict(values)
    interleaved = (values.get("axes") or ALL) in (ALL, BOTH)
    return {"phasing": "optimised", "interleaved": interleaved, **values}
