"""Data of a loop with what is known of it: what every reader returns, and what identification to certificate take."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from amb_core.data.experiments.dataset import IdentificationData
from amb_core.data.experiments.interpret import DescribedData
from amb_core.ground.results import Result

if TYPE_CHECKING:
    from amb_core.loop.known_controller import KnownController
    from amb_core.plant import PlantParameters


@dataclass(frozen=True, eq=False, repr=False)
class RecordedLoop(Result):
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

    @property
    def summary(self) -> str:
        """One line of text."""
        data = self.data
        controller = "no controller known" if self.controller is None else "controller known"
        damage = f"; {self.damage}" if self.damage else ""
        return (
            f"{data.samples} samples at {data.sample_rate:g} Hz, gaps: {len(data.gaps)}; "
            f"{', '.join(data.input_names)} to {', '.join(data.output_names)}; {controller}{damage}"
        )

    @property
    def rows(self) -> list[tuple[str, str]]:
        """The signals as they were understood, and what is doubtful."""
        if self.described is None:
            return []
        signals = [
            (row.signal, f"{row.role}, {row.unit or 'unit unknown'}, {row.low:.4g} to {row.high:.4g} {row.si_unit}")
            for row in self.described.rows
        ]
        return [*signals, *(("note", note) for note in self.described.notes)]
