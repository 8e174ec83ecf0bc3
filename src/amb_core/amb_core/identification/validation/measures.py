"""What a validation measures on its data: predictions, residuals, closed loop, frequency response, deviations."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments import Finding, IdentificationData
from amb_core.ground.results import Result
from amb_core.identification.prediction import Prediction
from amb_core.identification.progress import SearchEnd
from amb_core.identification.validation.deviations import Deviation
from amb_core.identification.validation.frequency import FrequencyComparison
from amb_core.identification.validation.model_error import BandError
from amb_core.identification.validation.possible import PossibleFit
from amb_core.identification.validation.residuals import ResidualTests
from amb_core.identification.validation.ringing import Ringing
from amb_core.identification.validation.simulation import ClosedLoop
from amb_core.identification.validation.undisturbed import Tone
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.regions.distortion import Evidence


@dataclass(frozen=True, eq=False, repr=False)
class Measures(Result):
    """What a validation measures, without a verdict.

    Attributes
    ----------
    model : StateSpaceModel
        The model.
    data : IdentificationData
        The data, with removed trends added again, without tones that their reference lacks and without slow drift.
    horizons : tuple of int
        Requested prediction horizons (steps).
    prediction : Prediction
        Predictions over the horizons.
    residuals : ResidualTests
        Whiteness of the one-step prediction errors and their independence of past inputs.
    closed_loop : ClosedLoop or None
        Simulation with the known controller; None if controller or reference are not known.
    frequency : FrequencyComparison
        The model's frequency response compared with other estimates of the plant's.
    evidence : Evidence
        Distortion of these data, or coherence of position and reference: what no linear model can follow.
    notes : tuple of str
        What was left out, and why.
    controller_check : Finding
        Whether the controller computed the recorded currents.
    findings : tuple of Finding
        What the samples of the data show, see `check_recording`, and the drift that was removed from them.
    band_errors : tuple of BandError
        Error of the model's response in each band of which the data say anything.
    deviations : tuple of Deviation
        Kinds of deviation of the plant, the least probable for a true model first.
    ringing : Ringing or None
        The most significant peak in the spectrum of the residuals. None if no peak is significant.
    possible_fit : PossibleFit or None
        Closed-loop fit that a true model reaches on these data; None without a loop, or for too few samples.
    without_loop : str
        Why there is no simulated closed loop; empty if there is one.
    loop_poles : ndarray of complex, shape (n + c,), or None
        Poles in the z plane (-) of model and controller, largest magnitude first; None if the controller or the units
        are not known. They need no reference.
    overlap : float
        Share of the samples of the identification that these data hold again, about (-); NaN where not known.
    search : SearchEnd or None
        How the search of the identification ended, where it is known. None otherwise.
    tones : tuple of Tone
        Tones of the residuals of the longest experiment that its reference lacks, the strongest first.
    removed_tones : tuple of float
        Frequencies (Hz) of tones that were removed from the data before all else, see `cure_tones`.
    undecided : str or None
        What the uncertainty says of poles whose stability is not decided; empty if there is nothing, None without it.
    noise_from_data : bool
        Whether the model came without a gain K, which was then estimated from these data.
    """

    model: StateSpaceModel
    data: IdentificationData
    horizons: tuple[int, ...]
    prediction: Prediction
    residuals: ResidualTests
    closed_loop: ClosedLoop | None
    frequency: FrequencyComparison
    evidence: Evidence
    notes: tuple[str, ...]
    controller_check: Finding
    findings: tuple[Finding, ...] = ()
    band_errors: tuple[BandError, ...] = ()
    deviations: tuple[Deviation, ...] = ()
    ringing: Ringing | None = None
    possible_fit: PossibleFit | None = None
    without_loop: str = ""
    loop_poles: NDArray[np.complex128] | None = None
    overlap: float = math.nan
    search: SearchEnd | None = None
    undecided: str | None = None
    tones: tuple[Tone, ...] = ()
    removed_tones: tuple[float, ...] = ()
    noise_from_data: bool = False

    @property
    def fit(self) -> NDArray[np.float64]:
        """Closed-loop fit of each output (percent), shape (p,); empty where the closed loop was left out."""
        return np.empty(0) if self.closed_loop is None else self.closed_loop.fit

    @property
    def one_step_fit(self) -> NDArray[np.float64]:
        """Fit of the one-step prediction of each output (percent), shape (p,)."""
        return self.prediction.fit_at(1)

    @property
    def white(self) -> bool:
        """Whether the residuals pass the test of whiteness at 99.9 %."""
        return self.residuals.whiteness.passed

    @property
    def independent(self) -> bool:
        """Whether the residuals pass the test of independence of past inputs at 99.9 %."""
        return self.residuals.independence.passed

    @property
    def closed_loop_stable(self) -> bool | None:
        """Whether model and controller make a stable loop; None if the controller or the units are not known."""
        return None if self.loop_poles is None else bool(np.all(np.abs(self.loop_poles) < 1.0))

    @cached_property
    def possible_one_step_fit(self) -> NDArray[np.float64]:
        """One-step fit of each output that the past of all signals explains, but for tones (percent), shape (p,)."""
        residuals = self.residuals
        tests = zip(residuals.undisturbed_whiteness_by_output, residuals.independence_by_output, strict=True)
        explained = np.array([white.beyond_chance + driven.beyond_chance for white, driven in tests])
        left = np.clip(1.0 - residuals.undisturbed_share * explained, 0.0, 1.0)
        return np.asarray(100.0 - (100.0 - self.one_step_fit) * np.sqrt(left))
