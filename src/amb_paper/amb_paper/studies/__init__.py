"""The studies, in the order of the paper."""

from collections.abc import Sequence

from amb_paper.studies.arx import ArxTransients
from amb_paper.studies.causes import PaperCauses, SlowAmplifierCauses
from amb_paper.studies.concurrent_sweep import ConcurrentSweep
from amb_paper.studies.excitations_on_the_map import ExcitationsOnTheMap
from amb_paper.studies.force_equations import ForceEquations
from amb_paper.studies.frequency_amplitude_graph import FrequencyAmplitudeGraph
from amb_paper.studies.multisine import MultisineModels
from amb_paper.studies.square_waves import SquareWaves
from amb_paper.studies.subharmonics import Subharmonics
from amb_paper.studies.sweep_one_axis import OneAxisSweep
from amb_paper.studies.sweep_rig import RigSweep
from amb_paper.studies.sweep_two_axes import TwoAxisSweep
from amb_paper.study import Study, StudyError

STUDIES: tuple[Study, ...] = (
    OneAxisSweep(),
    TwoAxisSweep(),
    ForceEquations(),
    PaperCauses(),
    SlowAmplifierCauses(),
    RigSweep(),
    Subharmonics(),
    FrequencyAmplitudeGraph(),
    ExcitationsOnTheMap(),
    SquareWaves(),
    ConcurrentSweep(),
    MultisineModels(),
    ArxTransients(),
)

OPENING = ("fig2-top-coil", "fig9")
"""Names of the figures that open the report: what happens under one sweep, and the map of many."""


def studies_named(names: Sequence[str]) -> tuple[Study, ...]:
    """Studies by name; StudyError if a name is unknown."""
    known = {study.name: study for study in STUDIES}
    unknown = [name for name in names if name not in known]
    if unknown:
        raise StudyError(f"no study {unknown[0]!r}; the studies are {', '.join(known)}")
    return tuple(known[name] for name in names)
