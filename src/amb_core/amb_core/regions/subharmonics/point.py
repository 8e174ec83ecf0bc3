"""One point of a subharmonic surface. It is the unit of work, and of the results on disk."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.plant.loop_task import LoopTask
from amb_core.regions.subharmonics.results import State, SubharmonicSpectrum
from amb_core.regions.subharmonics.run import run_subharmonics
from amb_core.regions.subharmonics.settings import SubharmonicSettings


@dataclass(frozen=True)
class SurfacePoint:
    """The values of one response in the surface; see `SubharmonicSurface`."""

    state: State
    difference: float
    slow_amplitude: float
    slow_frequency: float
    slow_rms: float
    slow_origin: str
    bias: float

    @classmethod
    def of(cls, spectrum: SubharmonicSpectrum) -> SurfacePoint:
        """The point of a spectrum."""
        nan = float("nan")
        slow, line = spectrum.slow, spectrum.line(-1, 1)
        if slow is None or spectrum.state == "delevitated":
            return cls(spectrum.state, nan, nan, nan, nan, "", nan)
        difference = abs(line.amplitude) if line is not None and spectrum.state == "steady" else nan
        return cls(spectrum.state, difference, slow.amplitude, slow.frequency, slow.rms, slow.origin, spectrum.bias)


@dataclass(frozen=True)
class PointTask(LoopTask[SurfacePoint]):
    """Everything that determines one point.

    Attributes
    ----------
    plant, controller : PlantParameters, ControllerParameters
        The loop. Subclasses (parameters of nodes) are reduced to these.
    test : SubharmonicSettings
        The tones, the inducing one included.
    """

    plant: PlantParameters
    controller: ControllerParameters
    test: SubharmonicSettings

    def describe(self) -> dict[str, Any]:
        """Parameters, files they name, version of the code."""
        return super().describe() | {"test": self.test.model_dump()}

    def run(self) -> SurfacePoint:
        """Simulate and analyse the test; errors are those of `run_subharmonics`."""
        return SurfacePoint.of(run_subharmonics(self.plant, self.controller, self.test))

    @staticmethod
    def to_json(result: SurfacePoint) -> dict[str, Any]:
        """A point as JSON values; missing numbers are NaN, as Python's module json reads and writes it."""
        return asdict(result)

    @staticmethod
    def from_json(entry: dict[str, Any]) -> SurfacePoint:
        """The point that `to_json` wrote."""
        return SurfacePoint(**entry)
