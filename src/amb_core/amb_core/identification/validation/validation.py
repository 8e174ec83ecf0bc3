"""The result of `validate`."""

from __future__ import annotations

from typing import Any

from amb_core.identification.validation.judged import JudgedMeasures
from amb_core.identification.validation.report import report_text, report_values, summary_line


class Validation(JudgedMeasures):
    """Validation of a model on data.

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
        Poles in the z plane (-) of model and controller, also without a reference; None if the controller or the units
        are not known.
    overlap : float
        Share of the samples of the identification that these data hold again, about (-).
    search : SearchEnd or None
        How the search of the identification ended, where it is known. None otherwise.
    undecided : str or None
        What the uncertainty says of poles whose stability is not decided; empty if there is nothing, None without it.
    noise_from_data : bool
        Whether the model came without a gain K, which was then estimated from these data.
    """

    @property
    def rows(self) -> list[tuple[str, str]]:
        """The conditions with their findings, those that do not hold first."""
        held = (condition for condition in self.conditions if condition.passed)
        return [(one.name, f"{'' if one.passed else f'{one.level}: '}{one.finding}") for one in (*self.failed, *held)]

    @property
    def summary(self) -> str:
        """One line of text."""
        return summary_line(self)

    def report(self) -> str:
        """All results on one page of plain text, with verdicts and advice.

        Returns
        -------
        str
            Text of several lines.
        """
        return report_text(self)

    def as_dict(self) -> dict[str, Any]:
        """All numbers as plain values for strict JSON; values that are not finite are None.

        Returns
        -------
        dict of str to object
            Values by name.
        """
        return report_values(self)
