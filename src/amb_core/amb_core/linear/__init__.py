"""Linear systems: the one state-space type, its response, peak gain, connections, sampling and simulation.

>>> import numpy as np
>>> from amb_core.linear import LinearSystem
>>> from amb_core.linear.peak import peak_gain
>>> lag = LinearSystem(np.array([[0.5]]), np.array([[1.0]]), np.array([[0.5]]), np.zeros((1, 1)), sample_time=1e-4)
>>> round(peak_gain(lag).value, 9), peak_gain(lag).frequency
(1.0, 0.0)
"""

from amb_core.linear.system import Arrays, Complexes, LinearSystem, rates_of

__all__ = ["Arrays", "Complexes", "LinearSystem", "rates_of"]
