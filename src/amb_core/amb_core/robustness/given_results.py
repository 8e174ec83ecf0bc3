"""What a certificate takes of earlier steps: a validation and an uncertainty, which must be those of its model."""

from __future__ import annotations

import numpy as np

from amb_core.ground.errors import RobustnessError
from amb_core.ground.given_values import require_kind
from amb_core.ground.sample_times import same_sample_time
from amb_core.identification.given import OF_UNCERTAINTY
from amb_core.identification.uncertainty import ModelUncertainty
from amb_core.identification.validation import Validation
from amb_core.linear.model import StateSpaceModel


def require_results(validation: Validation | None, uncertainty: ModelUncertainty | None) -> None:
    """Raise RobustnessError for what is no result of `validate` or `estimate_uncertainty`."""
    none = type(None)
    require_kind("validation", validation, (Validation, none), "what validate returns, or None", RobustnessError)
    require_kind("uncertainty", uncertainty, (ModelUncertainty, none), OF_UNCERTAINTY, RobustnessError)


def require_of_model(
    model: StateSpaceModel, validation: Validation | None, uncertainty: ModelUncertainty | None
) -> None:
    """Raise RobustnessError for a result of another model: it says nothing of this one."""
    for what, result, to_do in (
        ("validation", validation, "validate this one"),
        ("uncertainty", uncertainty, "take that of its identification, or estimate_uncertainty of this one"),
    ):
        if result is not None and not _is_same_plant(result.model, model):
            raise RobustnessError(f"{what} is of another model; {to_do}")


def _is_same_plant(one: StateSpaceModel, other: StateSpaceModel) -> bool:
    """Whether two models answer currents alike; the data may have given one of them a gain that the other lacks."""
    return same_sample_time(one.sample_time, other.sample_time) and all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in "abcd"
    )
