"""An identified model for other tools: its one-step predictor, SciPy, continuous time.

The deterministic part for python-control is `StateSpaceModel.to_control`; files are `save` and `load`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.ground.errors import IdentificationError
from amb_core.ground.given_values import require_kind
from amb_core.linear import LinearSystem
from amb_core.linear.model.state_space import StateSpaceModel

if TYPE_CHECKING:
    import control

_DEAD = 1e-9  # magnitude of a pole in the z plane, below which it is dead time
_REAL = 1e-9  # imaginary part relative to the magnitude, below which a pole is real
_ACCURACY = 1e-6  # of the conversion back from continuous time, relative to the matrices


def to_predictor(model: StateSpaceModel) -> control.StateSpace:
    """The one-step predictor for python-control: from inputs and outputs to the predictions of the outputs.

    All signals are deviations from the operating point. In innovations form,

        x[k+1] = (A - K C) x[k] + (B - K D) u[k] + K y[k],   yhat[k] = C x[k] + D u[k],

    which is stable even if the model is not. Predictions are named `x_predicted` for an output `x`.

    Parameters
    ----------
    model : StateSpaceModel
        Discrete-time model.

    Returns
    -------
    control.StateSpace
        The predictor, of m + p inputs and p outputs.
    """
    _require_model(model)
    outputs = model.output_names
    return LinearSystem(
        model.a - model.k @ model.c,
        np.hstack([model.b - model.k @ model.d, model.k]),
        model.c,
        np.hstack([model.d, np.zeros((len(outputs), len(outputs)))]),
        model.sample_time,
        (*model.input_names, *outputs),
        [f"{name}_predicted" for name in outputs],
    ).to_control()


def to_scipy(model: StateSpaceModel) -> Any:
    """The deterministic part, from u - input_offset to y - output_offset, as a `scipy.signal.dlti`.

    Parameters
    ----------
    model : StateSpaceModel
        Discrete-time model.

    Returns
    -------
    scipy.signal.dlti
        The system with the sample time of the model.
    """
    from scipy import signal  # takes most of a second to import

    _require_model(model)
    return signal.dlti(model.a, model.b, model.c, model.d, dt=model.sample_time)


def to_continuous(model: StateSpaceModel) -> control.StateSpace:
    """The continuous-time system that is the deterministic part when its inputs are held over each sample.

    From the principal logarithm of [[A, B], [0, I]], which is sample_time [[A_c, B_c], [0, 0]]; C and D stay. The
    states are those of the model.

    Parameters
    ----------
    model : StateSpaceModel
        Discrete-time model.

    Returns
    -------
    control.StateSpace
        The system in continuous time, with the names of the model's signals.

    Raises
    ------
    IdentificationError
        If there is no such real system: a pole at z = 0 is dead time, one on the negative real axis alternates from
        sample to sample; or if the logarithm is too inaccurate.

    References
    ----------
    N. J. Higham, Functions of Matrices, 2008, chapters 1 and 11; G. F. Franklin, J. D. Powell and M. L. Workman,
    Digital Control of Dynamic Systems, 3rd edition, 1998, section 4.3.
    """
    _require_model(model)
    a, b = _held_inverse(model.a, model.b, model.sample_time)
    return LinearSystem(a, b, model.c, model.d, 0.0, model.input_names, model.output_names).to_control()


def _require_model(model: object) -> None:
    require_kind("model", model, StateSpaceModel, "a StateSpaceModel", IdentificationError)


def _held_inverse(
    a: NDArray[np.float64], b: NDArray[np.float64], sample_time: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A_c and B_c whose zero-order-hold equivalent is A and B."""
    n, m = b.shape
    for pole in np.linalg.eigvals(a):
        if abs(pole) < _DEAD:
            raise IdentificationError(
                "the model has a pole at z = 0, a dead time, which no continuous-time system of finite order has; "
                "remove dead time from the data (advance_inputs), or reduce the order"
            )
        if pole.real < 0.0 and abs(pole.imag) < _REAL * abs(pole):
            raise IdentificationError(
                f"the model has a pole at z = {pole.real:.4g}, on the negative real axis, which no real "
                "continuous-time system has under a held input; reduce the order to remove this mode, or stay in "
                "discrete time"
            )
    held = np.eye(n + m)
    held[:n] = np.hstack([a, b])
    logarithm = np.asarray(linalg.logm(held))
    back = linalg.expm(logarithm.real)
    error = max(float(np.abs(logarithm.imag).max()), float(np.abs(back - held).max())) / float(np.abs(held).max())
    if not error < _ACCURACY:
        raise IdentificationError(
            f"the logarithm of the model is inaccurate (relative error {error:.1g}): its poles are too close to the "
            "negative real axis or to one another; reduce the order, or stay in discrete time"
        )
    return logarithm.real[:n, :n] / sample_time, logarithm.real[:n, n:] / sample_time
