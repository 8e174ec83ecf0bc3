"""From the few numbers of a bearing to one that levitates: plant, PD gains, margins, lift-off, stability chart."""

from amb_core.designs.tuning.bearing import Bearing, plant_of
from amb_core.designs.tuning.design import BearingDesign, design_bearing
from amb_core.designs.tuning.gains import HIGHEST_PEAK, Tuned, tune
from amb_core.designs.tuning.levitation import LiftOff, lift_off, lift_off_current
from amb_core.designs.tuning.parameter_file import parameter_file_of
from amb_core.designs.tuning.reasons import reason

__all__ = [
    "HIGHEST_PEAK",
    "Bearing",
    "BearingDesign",
    "LiftOff",
    "Tuned",
    "design_bearing",
    "lift_off",
    "lift_off_current",
    "parameter_file_of",
    "plant_of",
    "reason",
    "tune",
]
