"""Reproduction of the paper: its figures and claims on the simulator, as studies that run in parallel and are kept.

`run_campaign` runs them; `amb reproduce` and `make reproduce` write figures, claims.json and a report.
"""
