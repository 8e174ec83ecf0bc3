"""The subharmonic test: products of tones in the response prove that the bearing is not linear (paper, Fig. 6, 7)."""

from amb_core.regions.subharmonics.analysis import analyse
from amb_core.regions.subharmonics.causes import VARIANTS
from amb_core.regions.subharmonics.products import Product
from amb_core.regions.subharmonics.results import Line, SlowComponent, State, SubharmonicSpectrum, SubharmonicSurface
from amb_core.regions.subharmonics.run import run_subharmonics
from amb_core.regions.subharmonics.settings import SubharmonicSettings, SurfaceSettings
from amb_core.regions.subharmonics.surface import subharmonic_surface

__all__ = [
    "VARIANTS",
    "Line",
    "Product",
    "SlowComponent",
    "State",
    "SubharmonicSettings",
    "SubharmonicSpectrum",
    "SubharmonicSurface",
    "SurfaceSettings",
    "analyse",
    "run_subharmonics",
    "subharmonic_surface",
]
