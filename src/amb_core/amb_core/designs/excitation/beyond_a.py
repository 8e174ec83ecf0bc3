"""Whether an excitation leaves region A of a map, axis by axis, for machines of any number of axes.

Unlike `check_excitation` it needs no parameters of the plant, so it is what a bridge to a rig can ask.
"""

from __future__ import annotations

from dataclasses import dataclass

from amb_core.designs.excitation.command import command
from amb_core.designs.excitation.content import content_of
from amb_core.designs.excitation.load import AxisLoad
from amb_core.excitation import ExcitationSignal
from amb_core.excitation.signal import excited_spans
from amb_core.loop.control import ControllerParameters, pack_gains
from amb_core.regions.region_map import RegionMap


@dataclass(frozen=True)
class HighestLoad:
    """The axis on which an excitation comes closest to the end of region A.

    Attributes
    ----------
    axis : str
        Its name.
    load : float
        1 where region A may end: see `Load.linear`.
    """

    axis: str
    load: float


def highest_load(signal: ExcitationSignal, region_map: RegionMap, controller: ControllerParameters) -> HighestLoad:
    """The highest load of an excitation on any axis in terms of a map, which is taken to hold for each axis.

    Parameters
    ----------
    signal : ExcitationSignal
        From `amb_core.excitation.generate`.
    region_map : RegionMap
        Of the machine, or of a bearing of it.
    controller : ControllerParameters
        The PD law in the loop.
    """
    gains = pack_gains(controller, len(signal.machine.axes))
    loads = []
    for axis, first, last in excited_spans(signal):
        samples = signal.samples[first:last, axis]
        if not samples.any():
            continue
        law = controller.model_copy(update={"proportional_gain": gains[axis, 0], "derivative_gain": gains[axis, 1]})
        current = command(samples, law, signal.sample_time)
        content = content_of(signal, (first, last), axis)
        load = AxisLoad(content, current, signal.sample_time, region_map, law, law.current_limit).at()
        loads.append(HighestLoad(signal.machine.axis_names[axis], load.linear))
    return max(loads, key=lambda one: one.load, default=HighestLoad(signal.machine.axis_names[0], 0.0))
