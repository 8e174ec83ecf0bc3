"""Excitations: signals that are added to the reference position to excite the dynamics of the bearing.

`excitation_from_request` makes the validated parameters of a kind, `generate` makes the samples from them, and
`Playback` makes the same samples a window at a time:

>>> square = excitation_from_request("square", {"amplitude": 50e-6, "duration": 4.0})
>>> generate(square, sample_rate=10_000.0).samples.shape
(40000, 2)
"""

from amb_core.excitation.deterministic import Square, Sweep, Tones
from amb_core.excitation.playback import Playback, generate, instantaneous_frequency
from amb_core.excitation.request import (
    KINDS,
    definition_of,
    excitation_from_definition,
    excitation_from_request,
    excitation_from_settings,
)
from amb_core.excitation.seeded import Multisine, Prbs, WhiteNoise
from amb_core.excitation.signal import Excitation, ExcitationSignal, experiments_of, steps_of

__all__ = [
    "KINDS",
    "Excitation",
    "ExcitationSignal",
    "Multisine",
    "Playback",
    "Prbs",
    "Square",
    "Sweep",
    "Tones",
    "WhiteNoise",
    "definition_of",
    "excitation_from_definition",
    "excitation_from_request",
    "excitation_from_settings",
    "experiments_of",
    "generate",
    "instantaneous_frequency",
    "steps_of",
]
