"""A swept sine on a running graph: over the band, then dwells at the peaks that it shows, all in region A."""

from __future__ import annotations

from pathlib import Path

from amb_bringup.client.experiment import Experiment, carry_out
from amb_bringup.client.loop_calls import LoopCalls
from amb_core.data.analysis import RecordedLoop, read
from amb_core.data.analysis.recorded_sweeps import DWELLS, with_dwells
from amb_core.ground.errors import AmbError
from amb_core.ground.progress import Progress
from amb_core.regions import Region
from amb_core.robustness import SweepSettings
from amb_core.robustness.sharp_peaks import SharpMode
from amb_core.robustness.sweep import dwells, modes_of


def measure_swept(
    amb: LoopCalls, settings: SweepSettings, bag: str | Path, controller: str, progress: Progress
) -> tuple[RecordedLoop, list[SharpMode] | None]:
    """Sweep, dwell, read; `progress` names each stage. Returns the data, and their narrow resonances where known.

    The bag of the sweep is the folder `bag`, that of the dwells lies in it. Without a known controller there are no
    dwells.

    Raises
    ------
    AmbError
        If the rotor leaves region A or falls, a target trips, or a node fails; the rotor is landed, the bag closed.
    """

    def watched(stage: str, done: int, total: int | None) -> None:
        progress(stage, done, total)
        state = amb.heard_region()
        if state is not None and state.settled and state.region != Region.A:
            raise AmbError(
                f"{stage}: the rotor is in region {Region(state.region).name} at step {state.step}; a sensitivity is "
                f"measured in region A: give a smaller amplitude than {1e6 * settings.sweep_amplitude:g} um"
            )

    excitation = settings.excitation
    amb.heard_region()
    carry_out(amb, [Experiment("swept sine", excitation)], bag, watched)
    sweep = read(bag, controller=controller)
    if sweep.controller is None:
        return sweep, None
    modes = modes_of(sweep.data, sweep.controller)
    more = [
        Experiment(f"dwell at {0.5 * (one.frequency_start + one.frequency_end):.4g} Hz", one)
        for one in dwells(sweep.data, sweep.controller, settings, modes)
    ]
    if not more:
        return sweep, modes
    carry_out(amb, more, Path(bag) / DWELLS, watched)
    return with_dwells(bag, sweep), None
