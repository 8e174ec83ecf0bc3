"""The subharmonic test: intermodulation products of tones as proof that the bearing is not linear (paper, Fig. 6, 7)."""

from amb_core.subharmonics.products import Product
from amb_core.subharmonics.results import Line, SlowComponent, State, SubharmonicSpectrum, SubharmonicSurface
from amb_core.subharmonics.settings import SubharmonicSettings, SurfaceSettings

__all__ = [
    "Line",
    "Product",
    "SlowComponent",
    "State",
    "SubharmonicSettings",
    "SubharmonicSpectrum",
    "SubharmonicSurface",
    "SurfaceSettings",
]
