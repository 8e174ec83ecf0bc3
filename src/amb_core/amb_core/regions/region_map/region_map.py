"""The region map (the paper's frequency-amplitude graph): where regions B, C and D begin, amplitude by amplitude."""

from __future__ import annotations

import contextlib
import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from amb_core.ground.errors import RegionError
from amb_core.ground.files.regular_files import MIB, read_text, shown
from amb_core.regions import Region
from amb_core.regions.region_map.confirmation import Confirmation, confirmation_from_json, confirmation_to_json
from amb_core.regions.region_map.map_sweep import BOUNDARIES, MapSweep, sweep_from_json, sweep_to_json
from amb_core.regions.region_map.settings import MapSettings

Side = Literal["sweep", "dwell"]
"""Where boundaries come from: the sweeps, or the fixed sines that confirm the map.

Without confirmation the dwell side is the sweep side; the same holds for a boundary that was not bisected.
"""

FORMAT = 1  # of the file; raised when older files can no longer be read
LARGEST = 64 * MIB  # of a file that is read; a map of 24 sweeps takes about 10 KiB


@dataclass(frozen=True)
class RegionMap:
    """Sweeps of many amplitudes, and the boundaries between the regions that follow from them.

    Between sweeps the logarithm of a boundary is linear over the logarithm of the amplitude. If only one of two
    neighbouring sweeps has the boundary, it ends half-way between them.

    Attributes
    ----------
    settings : MapSettings
        The settings it was built with.
    sweeps : tuple of MapSweep
        In order of amplitude, at least one.
    provenance : dict
        Parameters of plant, controller and classifier, version of the code: everything needed to repeat it.
    complete : bool
        Whether the boundaries are resolved as requested; false if `max_sweeps` or a cancellation ended the map earlier.
    confirmation : Confirmation or None
        Boundaries under fixed sines and in sweeps at another rate; None if the map was not confirmed.

    Raises
    ------
    RegionError
        If there is no sweep, or they are not in order of amplitude.
    """

    settings: MapSettings
    sweeps: tuple[MapSweep, ...]
    provenance: dict[str, Any] = field(default_factory=dict)
    complete: bool = True
    confirmation: Confirmation | None = None

    def __post_init__(self) -> None:
        amplitudes = [sweep.amplitude for sweep in self.sweeps]
        if not amplitudes or amplitudes != sorted(set(amplitudes)):
            raise RegionError("a region map needs at least one sweep, in order of amplitude and no amplitude twice")

    @property
    def amplitudes(self) -> NDArray[np.float64]:
        """Amplitudes of the sweeps (m), shape (sweeps,)."""
        return np.array([sweep.amplitude for sweep in self.sweeps])

    def frequencies(self, region: Region, side: Side = "sweep") -> NDArray[np.float64]:
        """Frequency at which a region begins at each amplitude (Hz), shape (sweeps,); NaN where it does not occur.

        Parameters
        ----------
        region : Region
            B, C or D.
        side : {"sweep", "dwell"}, optional
            See `Side`.

        Returns
        -------
        ndarray, shape (sweeps,)
            Frequencies (Hz).
        """
        return np.array([self._frequency(sweep, region, side) for sweep in self.sweeps])

    def _frequency(self, sweep: MapSweep, region: Region, side: Side) -> float:
        if side == "dwell" and self.confirmation is not None:
            confirmed = self.confirmation.frequency(region, sweep.amplitude)
            if confirmed is not None:
                return confirmed if math.isfinite(confirmed) else math.nan
        return sweep.boundaries[region].frequency if region in sweep.boundaries else math.nan

    def boundary(self, region: Region, amplitude: ArrayLike, side: Side = "sweep") -> NDArray[np.float64]:
        """Frequency at which a region begins at any amplitude (Hz); infinity where it does not occur.

        Outside the amplitudes of the map the nearest sweep is used.

        Parameters
        ----------
        region : Region
            B, C or D.
        amplitude : array_like, of any shape
            Amplitudes (m), positive.
        side : {"sweep", "dwell"}, optional
            See `Side`.

        Returns
        -------
        ndarray, shape of `amplitude`
            Frequencies (Hz).
        """
        wanted = np.log(np.asarray(amplitude, dtype=np.float64))
        known = np.log(self.amplitudes)
        frequencies = self.frequencies(region, side)
        values = np.where(np.isnan(frequencies), np.inf, np.log(frequencies))
        if len(known) == 1:
            return np.exp(np.full(wanted.shape, values[0]))
        wanted = np.clip(wanted, known[0], known[-1])
        right = np.clip(np.searchsorted(known, wanted, side="right"), 1, len(known) - 1)
        share = (wanted - known[right - 1]) / (known[right] - known[right - 1])
        both = np.isfinite(values[right - 1]) & np.isfinite(values[right])
        nearest = np.where(share < 0.5, values[right - 1], values[right])
        with np.errstate(invalid="ignore"):
            between = values[right - 1] + share * (values[right] - values[right - 1])
        return np.exp(np.where(both, between, nearest))

    def region_at(self, frequency: ArrayLike, amplitude: ArrayLike, side: Side = "sweep") -> NDArray[np.int_]:
        """Region in which a sine of an amplitude (m) runs at a frequency (Hz), as values of `Region`; broadcasts.

        Parameters
        ----------
        frequency : array_like, of any shape
            Frequencies (Hz).
        amplitude : array_like
            Amplitudes (m), of a shape that broadcasts with the frequencies.
        side : Side, optional
            See `Side`.

        Returns
        -------
        ndarray of int, shape of both together
            Values of `Region`.
        """
        frequency, amplitude = np.broadcast_arrays(
            np.asarray(frequency, dtype=np.float64), np.asarray(amplitude, dtype=np.float64)
        )
        regions = np.full(frequency.shape, int(Region.A))
        for region in BOUNDARIES:
            regions[frequency >= self.boundary(region, amplitude, side)] = int(region)
        return regions

    def save(self, path: str | Path) -> None:
        """Write the map as JSON; an existing file stays unchanged until the new one is complete.

        Parameters
        ----------
        path : str or Path
            File to write.

        Raises
        ------
        RegionError
            If it cannot be written.
        """
        content = {
            "format": FORMAT,
            "settings": self.settings.model_dump(),
            "complete": self.complete,
            "provenance": self.provenance,
            "sweeps": [sweep_to_json(sweep) for sweep in self.sweeps],
        }
        if self.confirmation is not None:
            content["confirmation"] = confirmation_to_json(self.confirmation)
        path = Path(path)
        part = path.with_name(f"{path.name}.part")
        try:
            part.write_text(json.dumps(content, indent=1) + "\n")
            part.replace(path)
        except OSError as problem:
            with contextlib.suppress(OSError):
                part.unlink()
            raise RegionError(f"region map {path}: cannot be written: {problem.strerror}") from None

    @classmethod
    def load(cls, path: str | Path) -> RegionMap:
        """Read a map that `save` wrote.

        Parameters
        ----------
        path : str or Path
            JSON file.

        Returns
        -------
        RegionMap
            The map.

        Raises
        ------
        RegionError
            If there is no such file, or it is not a region map.
        """
        try:
            content = json.loads(read_text(path, LARGEST))
            if content["format"] != FORMAT:
                raise RegionError(f"has format {content['format']}, this version reads {FORMAT}")
            return cls(
                MapSettings.model_validate(content["settings"]),
                tuple(sweep_from_json(entry) for entry in content["sweeps"]),
                content["provenance"],
                content["complete"],
                None if content.get("confirmation") is None else confirmation_from_json(content["confirmation"]),
            )
        except OSError as problem:
            raise RegionError(f"region map {shown(path)}: cannot be read: {problem.strerror}") from None
        except RegionError as problem:
            raise RegionError(f"region map {path}: {problem}") from None
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as problem:
            raise RegionError(
                f"region map {path}: is no region map as `amb map` or region_monitor/build_map writes it ({problem!r})"
            ) from None
