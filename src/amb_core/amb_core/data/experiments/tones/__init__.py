"""Tones, as of an unbalance or of the mains: found in signals, and removed from data whose reference lacks them."""

from amb_core.data.experiments.tones.cure import ToneCure, cure_tones, without_unanswered
from amb_core.data.experiments.tones.find import Tones, find_tones, standing_out, without_tones

__all__ = ["ToneCure", "Tones", "cure_tones", "find_tones", "standing_out", "without_tones", "without_unanswered"]
