"""The compiled integrator of the plant, on records and plain arrays.

`advance` works through internal steps, `records` says what there is, and each other module holds one effect and begins
with its equations. numba's cache notices no change in a module that a compiled one calls: `scripts/setup.sh` empties it
when a file has changed.
"""
