"""Data of a loop with what is known of it: what every reader returns, and what identification to certificate take."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from amb_core.identification.data.dataset import IdentificationData
from amb_core.identification.data.interpret import DescribedData

if TYPE_CHECKING:
    from amb_core.loop.known_controller import KnownController
    from amb_core.plant import PlantParameters


@dataclass(frozen=True, eq=False)
class RecordedLoop:
    """Data of a loop, and its known parameters.

    Attributes
    ----------
    data : IdentificationData
        The data.
    controller : KnownController or None
        The controller of the experiment; None if it is not known.
    plant : PlantParameters or None
        The simulated plant; None if it was not recorded, as for a real bearing.
    damage : str
        Why a bag cannot be read to its end; empty for a complete one.
    described : DescribedData or None
        What was understood of a file; None for files and bags of this workbench.
    """

    data: IdentificationData
    controller: KnownController | None
    plant: PlantParameters | None = None
    damage: str = ""
    described: DescribedData | None = None
