"""Certification of an excitation by simulation: the very signal that will run, and others of its class.

The signal with its own seed is simulated, and so are some with other seeds: each must be in region A and within limits.

For signals of every kind the measure is the deviation from the response of the linearised loop to the same signal
(`amb_core.designs.excitation.measures`). For multisines the nonlinear distortion is measured in addition, by
random-phase multisines of the same band and power (`amb_core.regions.distortion`): those of many realisations that
request most of the amplifiers, as rare peaks clip. What is compared with the limit is an upper confidence bound.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from amb_core.designs.excitation.excited_order import ExcitedOrder, excited_order
from amb_core.designs.excitation.limits import Limits, Use, use_of_distortion, use_of_trial
from amb_core.designs.excitation.linear_response import LinearLoop
from amb_core.designs.excitation.measures import AxisMeasure, worst_measures
from amb_core.designs.excitation.multisine_distortion import distortion_settings, most_demanding
from amb_core.designs.excitation.spans import spans_on_one_bearing
from amb_core.designs.excitation.trial import Trial, TrialBench
from amb_core.excitation import ExcitationSignal, Multisine
from amb_core.ground.errors import ExcitationError, SpectrumError
from amb_core.ground.progress import Progress, as_stage
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions import Region, RegionParameters
from amb_core.regions.distortion import Distortion, simulate_distortion

_REST = 0.5  # s, before the excitation; rotors settle within a tenth of a second or two


@dataclass(frozen=True)
class ExcitationCertificate:
    """What simulations of an excitation showed.

    Attributes
    ----------
    amplitude : float
        Amplitude of the excitation (m).
    trials : tuple of Trial
        One for each seed.
    distortion : Distortion or None
        For multisines, by the most demanding random-phase multisines of the same band and power.
    use : Use
        The limit of which it uses most.
    """

    amplitude: float
    trials: tuple[Trial, ...]
    distortion: Distortion | None
    use: Use

    @property
    def worst(self) -> tuple[AxisMeasure, ...]:
        """The worst values of each axis over the seeds."""
        return worst_measures([trial.measures for trial in self.trials])


class Bench:
    """Simulations of a signal at any amplitude and with several seeds.

    Parameters
    ----------
    plant, controller : PlantParameters, ControllerParameters
        The loop.
    regions : RegionParameters or None
        Thresholds of the classifier.
    limits : Limits
        The limits.
    signal_of : callable
        The signal of an amplitude (m) and a number that is added to its seed.
    progress : callable or None
        See `amb_core.ground.progress.Progress`.

    Attributes
    ----------
    tried : list of tuple
        Amplitude (m), region and most used limit of each trial.
    """

    def __init__(
        self,
        plant: PlantParameters,
        controller: ControllerParameters,
        regions: RegionParameters | None,
        limits: Limits,
        signal_of: Callable[[float, int], ExcitationSignal],
        progress: Progress | None,
    ) -> None:
        self._trials = TrialBench(plant, controller, regions, _REST)
        self._plant, self._controller, self._limits = plant, controller, limits
        self._signal_of, self._progress = signal_of, progress
        first = signal_of(1e-6, 0)
        self.measures_distortion = isinstance(first.parameters, Multisine)
        self._axes = tuple("xy"[axis] for axis, _, _ in spans_on_one_bearing(first))
        self._seeds = list(range(limits.seeds)) if "seed" in type(first.parameters).model_fields else [0]
        self.tried: list[tuple[float, Region, str]] = []
        self._demanding: list[int] | None = None

    @property
    def linear(self) -> LinearLoop:
        """The linearised loop."""
        return self._trials.linear

    @property
    def current_limit(self) -> float:
        """Limit of the control current (A)."""
        return self._trials.current_limit

    def use_of_trials(self, amplitude: float) -> Use:
        """The limit of which an amplitude uses most; the remaining seeds are not tried once one exceeds a limit."""
        worst = Use(0.0, "")
        for seed in list(self._seeds):
            use = self._use(amplitude, self._run(amplitude, seed))
            if use.share >= worst.share:
                worst = use
            if use.share > 1.0:
                # Likely to exceed it at other amplitudes too, so it is tried first there
                self._seeds.remove(seed)
                self._seeds.insert(0, seed)
                break
        return worst

    def use_of_distortion(self, amplitude: float) -> Use:
        """How much of its limit the nonlinear distortion uses; for multisines."""
        return self._use_of(self._distortion(amplitude))

    def certify(self, amplitude: float) -> ExcitationCertificate:
        """Simulate all seeds, and measure the distortion of multisines."""
        trials = [self._run(amplitude, seed) for seed in sorted(self._seeds)]
        uses = [self._use(amplitude, trial) for trial in trials]
        distortion = self._distortion(amplitude) if self.measures_distortion else None
        if self.measures_distortion:
            uses.append(self._use_of(distortion))
        worst = max(uses, key=lambda use: use.share)
        return ExcitationCertificate(amplitude, tuple(trials), distortion, worst)

    def require_order(
        self, signal: ExcitationSignal, model_order: int | None, trial: Trial | None = None
    ) -> ExcitedOrder:
        """Order of the models that identification accepts, from a trial or, before any, from the linear response.

        Raises
        ------
        ExcitationError
            If both axes carry the same signal, or it determines no model, or none of the given order.
        """
        if len(self._axes) > 1 and (signal.samples[:, 0] == signal.samples[:, 1]).all():
            raise ExcitationError(
                f"{signal.kind}: x and y carry the same signal, so their effects cannot be separated; allowed axes: x, "
                "y, in_turn"
            )
        axes = ["xy".index(axis) for axis in self._axes]
        response = self.linear.respond(signal.samples) if trial is None else trial.record
        last = slice(-signal.steps, None)
        excited = excited_order(
            response.current[last][:, axes], response.position[last][:, axes], signal.sample_time, model_order
        )
        noisy = self._plant.sensor.noise > 0.0
        if excited.order < (model_order or 1) and not (trial is None and noisy):
            raise ExcitationError(_not_persistent(signal, excited, model_order))
        return excited

    def _use_of(self, distortion: Distortion | None) -> Use:
        if distortion is None:
            return Use(math.inf, "delevitation under a random-phase multisine of the same band and power")
        return use_of_distortion(distortion, self._axes, self._limits)

    def _use(self, amplitude: float, trial: Trial) -> Use:
        use = use_of_trial(trial, self._limits, self._trials.regions.drift_threshold)
        self.tried.append((amplitude, trial.region, use.what))
        return use

    def _run(self, amplitude: float, seed: int) -> Trial:
        name = f"{1e6 * amplitude:.4g} um" + (
            f", seed {seed + 1} of {len(self._seeds)}" if len(self._seeds) > 1 else ""
        )
        return self._trials.run(
            self._signal_of(amplitude, seed),
            as_stage(name, self._progress),
        )

    def _distortion(self, amplitude: float) -> Distortion | None:
        name = f"{1e6 * amplitude:.4g} um, distortion"
        settings = distortion_settings(self._signal_of(amplitude, 0), self._limits.seeds)
        if self._demanding is None:  # the same at every amplitude, as the loop is linear
            self._demanding = most_demanding(settings, self.linear, self._controller.sample_rate)
        try:
            return simulate_distortion(
                self._plant,
                self._controller,
                settings,
                as_stage(name, self._progress),
                self._demanding,
            )
        except SpectrumError:  # the rotor delevitates
            return None


def _not_persistent(signal: ExcitationSignal, excited: ExcitedOrder, model_order: int | None) -> str:
    wanted = "any model" if model_order is None else f"a model with {model_order} states"
    return (
        f"{signal.kind}: identification would accept models of {excited.order} states at most from its recording, not "
        f"{wanted}; widen the band, lengthen the duration, or set sensor.noise to what the sensors of the rig have"
    )
