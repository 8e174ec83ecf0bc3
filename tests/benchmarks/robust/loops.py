"""Random loops for the benchmark: unstable plants of one to three axes under LQG controllers, stable or spoilt."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_discrete_are

from amb_core.ground.errors import ParameterError
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.known_controller import LinearControl
from amb_core.loop.linear_control import LinearControllerParameters
from amb_core.robustness import feedback_of

SAMPLE_TIME = 1e-4  # s


def random_loop(seed: int, stable: bool) -> tuple[StateSpaceModel, LinearControl]:
    """A plant with unstable poles and a controller; one that makes it stable, or one that does not."""
    random = np.random.default_rng([seed, int(stable)])
    while True:
        plant = _plant(random)
        controller = _lqg(plant, random)
        if not stable:
            spoilt = float(random.choice([-1.0, 0.0, 0.2, 0.5, 3.0, 10.0, 30.0]))
            controller = _model(controller.a, controller.b, spoilt * controller.c, True)
        try:
            control = LinearControl(controller, LinearControllerParameters())
        except ParameterError:  # an unstable law without anti-windup gain cannot be run
            continue
        radius = feedback_of(plant, control).closed.radius
        if (stable and radius < 0.9999) or (not stable and radius > 1.0 + 1e-6):
            return plant, control


def _plant(random: np.random.Generator) -> StateSpaceModel:
    """Rigid motions on negative stiffness with bending modes, coupled; gains near 1 m/A for the eye."""
    axes = int(random.integers(1, 4))
    blocks = []
    for _ in range(axes):
        rate = 2.0 * np.pi * random.uniform(10.0, 80.0) * SAMPLE_TIME
        blocks.append(np.diag([np.exp(rate), np.exp(-rate)]))
    for _ in range(int(random.integers(0, 3))):
        angle = 2.0 * np.pi * random.uniform(200.0, 1_500.0) * SAMPLE_TIME
        size = np.exp(-random.uniform(0.003, 0.05) * angle)
        blocks.append(size * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]))
    order = 2 * len(blocks)
    a = np.zeros((order, order))
    for place, block in enumerate(blocks):
        a[2 * place : 2 * place + 2, 2 * place : 2 * place + 2] = block
    return _model(a, 0.1 * random.normal(size=(order, axes)), random.normal(size=(axes, order)), False)


def _lqg(plant: StateSpaceModel, random: np.random.Generator) -> StateSpaceModel:
    a, b, c = plant.a, plant.b, plant.c
    axes = len(c)
    effort, noise = 10.0 ** random.uniform(-2.0, 1.0), 10.0 ** random.uniform(-2.0, 1.0)
    p = solve_discrete_are(a, b, c.T @ c, effort * np.eye(axes))
    feedback = np.linalg.solve(effort * np.eye(axes) + b.T @ p @ b, b.T @ p @ a)
    v = solve_discrete_are(a.T, c.T, b @ b.T, noise * np.eye(axes))
    gain = a @ v @ c.T @ np.linalg.inv(c @ v @ c.T + noise * np.eye(axes))
    # w[k+1] = (A - B F - L C) w + L y, u = -F w; the controller acts on e = -y.
    return _model(a - b @ feedback - gain @ c, -gain, -feedback, True)


def _model(a: np.ndarray, b: np.ndarray, c: np.ndarray, controller: bool) -> StateSpaceModel:
    (n, m), p = b.shape, len(c)
    units = (("m",) * m, ("A",) * p) if controller else (("A",) * m, ("m",) * p)
    names = tuple(f"i_{axis + 1}" for axis in range(m)), tuple(f"x_{axis + 1}" for axis in range(p))
    return StateSpaceModel(
        a, b, c, np.zeros((p, m)), np.zeros((n, p)), np.eye(p), np.zeros(m), np.zeros(p), np.zeros(n), SAMPLE_TIME,
        *(names[::-1] if controller else names), input_units=units[0], output_units=units[1],
    )  # fmt: skip
