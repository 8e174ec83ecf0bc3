"""Measured data: tables, experiments for identification, and what recordings contain."""
