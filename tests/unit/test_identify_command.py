"""`amb identify`: what it writes and shows, and how it refuses, in one line, what it is wrongly given."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.data.experiments import write_data
from amb_core.ground.errors import AmbError
from amb_core.identification import IdentificationData, StateSpaceModel


@pytest.fixture(scope="module")
def files(bearing, tmp_path_factory) -> list[Path]:
    """Two experiments of the bearing as files."""
    folder = tmp_path_factory.mktemp("data")
    paths = [folder / "slow.npz", folder / "fast.csv"]
    for path, frequency in zip(paths, (15.0, 20.0), strict=True):
        record = bearing.experiment(2e-8, force=0.1, frequency=frequency, duration=0.4)
        write_data(IdentificationData.from_record(record, source=path.stem), path)
    return paths


def run(*arguments: object, controller: str = "paper") -> str:
    words = ["identify", *map(str, arguments), "--controller", controller]
    result = CliRunner().invoke(app, words, env={"COLUMNS": "160"})
    if result.exception is not None:
        raise result.exception
    return result.output


def test_several_files_give_one_model_with_numbers_and_figures(
    files: list[Path], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    out, figures, results = tmp_path / "model.json", tmp_path / "figures", tmp_path / "summary.json"
    shown = run(*files, "--order", "auto", "--orders", "5,6", "--out", out, "--figures", figures, "--results", results)
    assert "6 of 5 to 6; the highest tried, try higher ones with --orders" in shown
    summary = json.loads(results.read_text())
    assert StateSpaceModel.load(out).order == summary["order"] == 6
    assert summary["order_selection"]["orders"] == [5, 6]
    assert [item["source"] for item in summary["experiments"]] == ["slow", "fast"]
    assert min(summary["fit"].values()) > 99.0
    assert len(summary["poles"]) == 6 and all(pole["deviation"] for pole in summary["poles"])
    assert {finding["severity"] for finding in summary["findings"]} <= {"info", "warning"}
    assert summary["search"]["converged"] and summary["drift"] is None and summary["poles_at_one"] == []
    assert "converged" in shown
    names = ["bode", "order", "poles", "experiment_1/response", "experiment_2/orbit"]
    assert all((figures / f"{name}.{ending}").exists() for name in names for ending in ("png", "html"))
    assert not caplog.records, "figures drawn without complaint"


def test_figures_show_the_fit_without_the_tones_that_were_removed(bearing, tmp_path: Path) -> None:
    band = {"amplitude": 5e-6, "frequency_start": 2.0, "frequency_end": 2_000.0, "axes": "all"}
    turning = bearing.experiment(2e-8, kind="multisine", force=0.1, drift="runout", **band)
    write_data(IdentificationData.from_record(turning, source="turning"), tmp_path / "turning.npz")
    run(tmp_path / "turning.npz", "--order", 6, "--out", tmp_path / "run")
    fit = json.loads((tmp_path / "run" / "summary.json").read_text())["fit"]
    page = (tmp_path / "run" / "response.html").read_text()
    assert all(f"{axis}: fit of the model {value:.1f} %" in page for axis, value in fit.items())


def test_warnings_are_shown_with_their_advice(bearing, tmp_path: Path) -> None:
    record = bearing.experiment(2e-8, force=0.1, frequency=20.0, duration=0.6)
    data = IdentificationData.from_record(record).window(0, 250)
    write_data(data, tmp_path / "short.npz")
    assert "record at least 300 samples, or ask for a lower order" in run(
        tmp_path / "short.npz", "--method", "ssarx", "--order", "10"
    )


def test_a_model_of_data_that_are_too_few_for_its_validation_says_why_it_is_not_validated(
    bearing, tmp_path: Path
) -> None:
    record = bearing.experiment(2e-8, force=0.1, frequency=20.0, duration=0.6)
    write_data(IdentificationData.from_record(record).window(0, 200), tmp_path / "short.npz")
    shown = run(tmp_path / "short.npz", "--order", "4", "--out", tmp_path / "results")
    why = "200 samples are too few to test residuals over 25 lags; at least 250 are needed"
    assert why in " ".join(shown.replace("│", " ").split())
    summary = json.loads((tmp_path / "results" / "summary.json").read_text())
    assert summary["verdict"] == "not validated" and why in summary["not_validated_because"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--order", "best"], "--order best is not allowed; it must be a number or auto"),
        (["--order", "41"], "order 41 is not allowed; allowed: 1 to 40"),
        (["--order", "auto", "--orders", "few"], "--orders few is not allowed; it must be such as 4-14 or 4,6,8"),
        (["--order", "4", "--orders", "4-6"], "--orders 4-6 is not allowed with --order 4; it is for --order auto"),
        (["--method", "magic"], "unknown method 'magic'; allowed: pem"),
        (["--focus", "magic"], "unknown focus 'magic'; allowed: prediction, simulation"),
    ],
)
def test_wrong_options_are_refused(files: list[Path], arguments: list[str], message: str) -> None:
    with pytest.raises(AmbError, match=message):
        run(files[0], *arguments)


@pytest.mark.parametrize(
    ("option", "name", "message"),
    [
        ("--out", "model.txt", "model.txt: the name must end in .json, .npz, .mat for a file, or have no ending"),
        ("--results", "summary", "summary: the file name must end in .json"),
        ("--out", "taken/model.json", "taken: cannot be made: "),
    ],
)
def test_results_that_cannot_be_kept_are_refused_before_the_work(
    tmp_path: Path, option: str, name: str, message: str
) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(AmbError, match=message):
        run(tmp_path / "no_bag", option, tmp_path / name)


def test_a_controller_that_is_not_known_is_refused_and_errors_that_are_not_white_are_told(files: list[Path]) -> None:
    with pytest.raises(AmbError, match="lacks the controller's parameters; name it with --controller: paper, pd:K_P"):
        run(files[0], "--order", "3", controller="")
    with pytest.raises(AmbError, match="controller = 'pd_controller' is not allowed; allowed: paper, pd:K_P,K_D in "):
        run(files[0], "--order", "3", controller="pd_controller")
    shown = run(files[0], "--order", "3")
    assert "not white; ± allows for that" in shown
    assert "not white" not in run(files[0], "--order", "6")


def test_data_of_different_sample_times_are_refused(files: list[Path], bearing, tmp_path: Path) -> None:
    record = bearing.experiment(2e-8, force=0.1, frequency=20.0, duration=0.4)
    data = IdentificationData.from_arrays(
        record.current, record.position, 2e-4, input_names=("i_x", "i_y"), output_names=("x", "y")
    )
    write_data(data, tmp_path / "other.npz")
    with pytest.raises(AmbError, match=r"data set 2 has the sample time 0.0002 s, the first 0.0001 s"):
        run(files[0], tmp_path / "other.npz")
