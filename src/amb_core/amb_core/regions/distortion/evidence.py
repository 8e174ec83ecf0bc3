"""How far a recording's motion is from a linear response: distortion where it can be measured, else coherence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import SpectrumError
from amb_core.loop.records import LoopRecord
from amb_core.regions.distortion.coherence import Coherence, measure_coherence
from amb_core.regions.distortion.recorded import measure_recorded, periodic_once
from amb_core.regions.distortion.result import Distortion


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a recording shows about distortion.

    Attributes
    ----------
    distortion : Distortion or None
        The distortions; None if the recording does not permit it.
    coherence : Coherence or None
        Coherence of position and reference, noise and distortion together; None if there is none either.
    problem : str
        Why there is no distortion, and what is needed; empty if there is.
    coherence_problem : str
        Why there is no coherence; empty if there is.
    tones : tuple of float
        Frequencies of tones that the reference lacks, as of an unbalance (Hz): they were left out.
    """

    distortion: Distortion | None
    coherence: Coherence | None
    problem: str = ""
    coherence_problem: str = ""
    tones: tuple[float, ...] = ()

    @property
    def measured(self) -> bool:
        """Whether there is any measure."""
        return self.distortion is not None or self.coherence is not None

    @property
    def brief(self) -> str:
        """The best measure in a few words; that of the coherence says what it mixes."""
        if self.distortion is not None:
            return self.distortion.brief
        if self.coherence is not None:
            return f"{self.coherence.brief} (distortion alone not measured)"
        return "distortion not measured"

    @property
    def lines(self) -> tuple[str, ...]:
        """A sentence for each measure, and why one is missing."""
        texts = [item.summary for item in (self.distortion, self.coherence) if item is not None]
        if self.distortion is None:
            texts.append(f"distortion not measured: {self.problem}")
        if self.distortion is None and self.coherence is None:
            texts.append(self.coherence_problem)
        if self.tones:
            shown = ", ".join(f"{frequency:.4g}" for frequency in self.tones)
            texts.append(f"tones that the reference lacks, as of an unbalance, are left out: {shown} Hz")
        return tuple(texts)

    @property
    def best_fit(self) -> NDArray[np.float64]:
        """Largest NRMSE fit of a linear loop to each axis (percent), shape (axes,); NaN where not known.

        One NaN without a measure.

        A simulation in which the controller limits the current is no linear loop, and can fit better.
        """
        measures = [item.ratio for item in (self.distortion, self.coherence) if item is not None]
        if not measures:
            return np.full(1, np.nan)
        ratio = np.fmax.reduce(measures)
        return np.asarray(
            100.0 * (1.0 - np.sin(np.arctan(ratio)))
        )  # ratio / sqrt(1 + ratio^2), also where it is infinite

    def as_dict(self) -> dict[str, Any]:
        """Plain values for strict JSON.

        Returns
        -------
        dict of str to object
            Values by name.
        """
        return {
            "distortion": self.distortion and self.distortion.as_dict(),
            "method": self.distortion and self.distortion.method,
            "coherence": self.coherence and self.coherence.as_dict(),
            "problem": self.problem,
            "coherence_problem": self.coherence_problem,
            "tones": list(self.tones),
        }


def find_evidence(records: Sequence[LoopRecord], window: Sequence[LoopRecord] | None = None) -> Evidence:
    """Distortion and coherence of recorded samples.

    Parameters
    ----------
    records : sequence of LoopRecord
        Consecutive samples each, in which realisations of a multisine are searched for.
    window : sequence of LoopRecord, optional
        The samples for the coherence, by default the same.

    Returns
    -------
    Evidence
        Both measures, or the reason why one is missing.
    """
    distortion, coherence, problem, coherence_problem = None, None, "", ""
    try:
        distortion = measure_recorded(records)
    except SpectrumError as reason:
        problem = str(reason)
    try:
        coherence = measure_coherence(periodic_once(records if window is None else window))
    except SpectrumError as reason:
        coherence_problem = str(reason)
    return Evidence(distortion, coherence, problem, coherence_problem)
