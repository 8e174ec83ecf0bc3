"""The compiled integrator of the plant, on plain arrays.

`advance` works through internal steps, `layout` says what lies where, and each other module holds one effect. numba's
cache notices no change in a module that a compiled one calls: `scripts/setup.sh` empties it when a file has changed.
"""
