"""amb_core: active magnetic bearings without ROS — plant, control law, excitations, identification and bags.

The names of the way from data to a certificate are here too; each loads its module when it is used first:

>>> import amb_core as amb
>>> loop = amb.read("measured.csv", controller="pd:20000,38")  # doctest: +SKIP
>>> amb.certify(amb.identify(loop, order=10))  # doctest: +SKIP
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from amb_core.data.analysis import read
    from amb_core.data.controller_choice import named_controller
    from amb_core.designs.excitation import design_excitation as design
    from amb_core.ground.version import __version__ as __version__
    from amb_core.identification import IdentificationData, StateSpaceModel, compare, response_of, validate
    from amb_core.identification.identify import identify
    from amb_core.identification.nonparametric import estimate_response
    from amb_core.plant.simulation import simulate
    from amb_core.report.pages.certificate import write_certificate
    from amb_core.robustness import certify_from_data as certify

# The kernels multiply small dense matrices: with straight-line vectorisation they are a third faster and give the same
# bits. numba reads this when it is imported; where that has happened already, the kernels are only slower.
os.environ.setdefault("NUMBA_SLP_VECTORIZE", "1")

_HOMES = {
    "__version__": "amb_core.ground.version",
    "IdentificationData": "amb_core.identification",
    "StateSpaceModel": "amb_core.identification",
    "certify": "amb_core.robustness:certify_from_data",
    "compare": "amb_core.identification",
    "design": "amb_core.designs.excitation:design_excitation",
    "estimate_response": "amb_core.identification.nonparametric",
    "identify": "amb_core.identification",
    "named_controller": "amb_core.data.controller_choice",
    "plot": "amb_core.report.figures",  # for the cards of results, whose room lies below
    "read": "amb_core.data.analysis",
    "response_of": "amb_core.identification",
    "simulate": "amb_core.plant.simulation",
    "validate": "amb_core.identification",
    "write_certificate": "amb_core.report.pages.certificate",
}
"""Where each name is defined, and as what if not by its own name."""

__all__ = [
    "IdentificationData",
    "StateSpaceModel",
    "certify",
    "compare",
    "design",
    "estimate_response",
    "identify",
    "named_controller",
    "read",
    "response_of",
    "simulate",
    "validate",
    "write_certificate",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, _, defined = _HOMES[name].partition(":")
    value = globals()[name] = getattr(importlib.import_module(module), defined or name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
