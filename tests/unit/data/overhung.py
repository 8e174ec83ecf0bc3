"""A rotor as ROSS gives it, from its matrices; see tests/unit/test_ross_rotor.py."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np


def overhung():
    """The rotor."""
    kept = dict(np.load(Path(__file__).with_name("ross_rotor.npz")))
    shaft = SimpleNamespace(dof_mapping=lambda: {"x_0": 0, "y_0": 1, "z_0": 2, "alpha_0": 3, "beta_0": 4})
    bearings = [SimpleNamespace(n=node) for node in (3, 11)]
    sizes = {"number_dof": int(kept["number_dof"]), "ndof": int(kept["ndof"])}
    parts = {"nodes": kept["nodes"].tolist(), "shaft_elements": [shaft], "bearing_elements": bearings}
    return SimpleNamespace(**kept | {"tag": "overhung"} | parts | sizes)
