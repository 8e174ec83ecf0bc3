"""`amb subharmonics`: what is refused before anything runs, and what stays when a surface fails."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_bringup.commands import subharmonics
from amb_core.ground.errors import SpectrumError, TaskError
from amb_core.ground.tasks import cluster


def amb(*words):
    return CliRunner().invoke(app, ["subharmonics", *map(str, words)], catch_exceptions=False)


def test_tones_that_the_shifted_test_cannot_have_are_refused_before_anything_runs(monkeypatch, tmp_path):
    monkeypatch.setattr(subharmonics, "run_subharmonics", lambda *given: pytest.fail("a test was run"))
    with pytest.raises(SpectrumError, match="a tone of 5006 Hz is requested; allowed: below the Nyquist frequency"):
        amb("--inducing-frequency", 4999, "--out", tmp_path)


def test_the_spectra_stay_when_the_surface_fails(monkeypatch, tmp_path):
    monkeypatch.setattr(cluster, "CONNECT_TIMEOUT", 0.5)
    tones = ("--inducing-amplitude", 1e-6, "--cache", tmp_path / "cache", "--out", tmp_path / "out")
    with pytest.raises(TaskError, match=r"tcp://127\.0\.0\.1:9 does not answer"):
        amb(*tones, "--surface", "--scheduler", "tcp://127.0.0.1:9")
    spectra = json.loads((tmp_path / "out" / "summary.json").read_text())["spectra"]
    assert {test["state"] for test in spectra["as given"].values()} == {"steady"}
    assert (tmp_path / "out" / "spectrum.png").exists()
