"""amb_core: active magnetic bearings without ROS — plant, control law, excitations, identification and bags."""

import os

# The kernels multiply small dense matrices: with straight-line vectorisation they are a third faster and give the same
# bits. numba reads this when it is imported; where that has happened already, the kernels are only slower.
os.environ.setdefault("NUMBA_SLP_VECTORIZE", "1")

__version__ = "0.1.0"
