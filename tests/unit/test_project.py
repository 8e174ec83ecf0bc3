"""`amb status`: what a project's folder holds, what is stale there, and the command that comes next."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_bringup.commands.inputs import inputs_of, load_loop
from amb_bringup.graph.packages import find_executable
from amb_core.ground.errors import ProjectError
from amb_core.report.project import Kind, State, status_of
from amb_core.robustness import sha256_of
from tests.written_bags import write_telemetry

BEARING = ["--gap", "0.4mm", "--turns", "80", "--mass", "3", "--bias-current", "2", "--voltage", "150"]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A parameter file as `amb new` writes it."""
    path = tmp_path_factory.mktemp("bearing") / "bearing.yaml"
    result = CliRunner().invoke(app, ["new", str(path), *BEARING])
    assert result.exit_code == 0, result.output
    return path


@pytest.fixture
def folder(bearing, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a bearing, its map, a design on the map, and a model of a recording with its summary."""
    monkeypatch.chdir(tmp_path)
    Path("bearing.yaml").write_text(made.read_text())
    plant, controller = load_loop(Path("bearing.yaml"))
    provenance = {"plant": plant.model_dump(mode="json"), "controller": controller.model_dump(mode="json")}
    Path("map.json").write_text(json.dumps({"provenance": provenance, "settings": {}, "sweeps": []}))
    design = {"parameters": {}, "largest_amplitude": 1e-5, "limited_by": "", "inputs": inputs_of(Path("map.json"))}
    Path("design").mkdir()
    Path("design/summary.json").write_text(json.dumps(design))
    Path("data.csv").write_text("u,y\n1,2\n")
    Path("model").mkdir()
    bearing.model.save(Path("model/model.json"))
    Path("model/summary.json").write_text(json.dumps({"inputs": inputs_of(Path("data.csv"))}))
    return tmp_path


def states(folder: Path) -> dict[str, State]:
    return {item.kind: item.state for item in status_of(folder).items}


def test_all_that_belongs_together_is_current(folder: Path) -> None:
    by_kind = states(folder)
    assert by_kind == dict.fromkeys((Kind.BEARING, Kind.MAP, Kind.DESIGN, Kind.MODEL), State.CURRENT)


def test_another_value_in_the_bearings_file_makes_its_map_and_design_stale(folder: Path) -> None:
    path = folder / "bearing.yaml"
    path.write_text(path.read_text().replace("mass: 3.0", "mass: 3.5"))
    items = {item.kind: item for item in status_of(folder).items}
    assert items[Kind.MAP].state is State.STALE
    assert "rotor.mass = 3.0 (now 3.5)" in items[Kind.MAP].reason
    assert (items[Kind.DESIGN].state, items[Kind.DESIGN].reason) == (State.STALE, "map.json is stale")
    assert status_of(folder).step.command == "amb map --params bearing.yaml"


def test_a_comment_in_the_bearings_file_makes_nothing_stale(folder: Path) -> None:
    path = folder / "bearing.yaml"
    path.write_text("# of the new rig\n" + path.read_text())
    assert set(states(folder).values()) == {State.CURRENT}


def test_a_value_that_only_the_map_has_is_named(folder: Path) -> None:
    content = json.loads((folder / "map.json").read_text())
    content["provenance"]["plant"]["sensor"]["noise"] = 5e-8
    (folder / "map.json").write_text(json.dumps(content))
    item = next(item for item in status_of(folder).items if item.kind is Kind.MAP)
    assert (item.state, item.reason) == (State.CURRENT, "with sensor.noise = 5e-08 (now 0.0)")


def test_what_was_made_from_changed_files_is_stale(folder: Path) -> None:
    (folder / "data.csv").write_text("u,y\n1,3\n")
    with (folder / "map.json").open("a") as file:
        file.write("\n")
    items = {item.kind: (item.state, item.reason) for item in status_of(folder).items}
    assert items[Kind.MODEL] == (State.STALE, "data.csv has changed since")
    assert items[Kind.DESIGN] == (State.STALE, "map.json has changed since")


def test_a_certificate_is_stale_with_its_model(folder: Path) -> None:
    certificate = {
        "certified": False,
        "statement": "predicted",
        "checks": [],
        "request": {"model": "model/model.json"},
        "inputs": {"model model.json": {"sha256": sha256_of(folder / "model/model.json")}},
    }
    (folder / "certificate.json").write_text(json.dumps(certificate))
    item = status_of(folder).items[-1]
    assert (item.kind, item.state, item.reason) == (Kind.CERTIFICATE, State.CURRENT, "predicted; from model/model.json")
    with (folder / "model/model.json").open("a") as file:
        file.write(" ")
    assert status_of(folder).items[-1].state is State.STALE


@pytest.mark.parametrize("statement", ["certified", "certified with reservations"])
def test_a_certificate_is_shown_with_what_it_states(folder: Path, statement: str) -> None:
    inputs = {"model model.json": {"sha256": sha256_of(folder / "model/model.json")}}
    request = {"model": "model/model.json"}
    certificate = {"certified": True, "statement": statement, "checks": [], "inputs": inputs, "request": request}
    (folder / "certificate.json").write_text(json.dumps(certificate))
    assert status_of(folder).items[-1].reason == f"{statement}; from model/model.json"


def certificate_of_files(folder: Path) -> Path:
    """A certificate of the model, data, their description and a controller, made in another folder; its file."""
    files = {"model": "model/model.json", "bag": "fresh.csv", "description": "data.yaml", "controller": "law.json"}
    for name in ("fresh.csv", "data.yaml", "law.json"):
        (folder / name).write_text("{}\n")
    roles = {field: f"{field}{' file' * (field == 'controller')}" for field in files}
    content = {
        "certified": True,
        "statement": "certified",
        "checks": [],
        "request": {field: f"/elsewhere/{path}" for field, path in files.items()} | {"sweep_bag": ""},
        "inputs": {
            **{
                f"{roles[field]} {Path(path).name}": {"sha256": sha256_of(folder / path)}
                for field, path in files.items()
            },
            "controller law.json": {"sha256": "of its gains"},
        },
    }
    path = folder / "certificate.json"
    path.write_text(json.dumps(content))
    return path


@pytest.mark.parametrize("name", ["fresh.csv", "data.yaml", "law.json"])
def test_a_certificate_is_stale_with_every_file_that_it_was_made_from(folder: Path, name: str) -> None:
    certificate_of_files(folder)
    assert status_of(folder).items[-1].state is State.CURRENT
    with (folder / name).open("a") as file:
        file.write("# changed\n")
    judged = status_of(folder).items[-1]
    assert (judged.state, judged.reason) == (State.STALE, f"certified; {name} has changed since")
    (folder / name).unlink()
    judged = status_of(folder).items[-1]
    assert (judged.state, judged.reason) == (
        State.UNKNOWN, f"certified; {name}, which it was made from, is not in the folder",
    )  # fmt: skip


@pytest.mark.parametrize(
    "part", [{"request": []}, {"request": {"bag": 3}}, {"inputs": []}, {"inputs": {"bag fresh.csv": 1}}]
)
def test_a_certificate_of_a_stranger_is_unknown(folder: Path, part: dict[str, object]) -> None:
    path = certificate_of_files(folder)
    content = json.loads(path.read_text())
    path.write_text(json.dumps({**content, "request": {"bag": "/etc/fresh.csv"}} | part))
    assert status_of(folder).items[-1].state is State.UNKNOWN


def test_inputs_that_are_not_recorded_or_not_there_are_unknown(folder: Path) -> None:
    (folder / "data.csv").unlink()
    (folder / "design/summary.json").write_text(
        json.dumps({"parameters": {}, "largest_amplitude": 1e-5, "limited_by": ""})
    )
    by_kind = states(folder)
    assert (by_kind[Kind.MODEL], by_kind[Kind.DESIGN]) == (State.UNKNOWN, State.UNKNOWN)


def test_a_bag_is_an_experiment(folder: Path) -> None:
    write_telemetry(folder / "lab bag", [(1, 100 * number) for number in range(3)])
    status = status_of(folder)
    assert [str(item.path) for item in status.items if item.kind is Kind.EXPERIMENT] == ["lab bag"]
    command = "amb experiment --design design --seed 2 --params bearing.yaml --record validation --no-report"
    assert status.step.command == command


@pytest.fixture
def identified(folder: Path) -> Path:
    """The folder with two bags, of whose names one begins with the other, and a model of the longer one."""
    for bag, number in (("run1", 3), ("run10", 4)):
        write_telemetry(folder / bag, [(1, 100 * block) for block in range(number)])
    (folder / "model/summary.json").write_text(json.dumps({"inputs": inputs_of(Path("run10"))}))
    return folder


def certificate(folder: Path, certified: bool, statement: str) -> None:
    inputs = {"model model.json": {"sha256": sha256_of(folder / "model/model.json")}}
    request = {"model": "model/model.json"}
    content = {"certified": certified, "statement": statement, "checks": [], "inputs": inputs, "request": request}
    (folder / "certificate.json").write_text(json.dumps(content))


def test_the_bag_of_the_model_and_another_one_are_named_for_the_certificate(identified: Path) -> None:
    assert status_of(identified).step.command == "amb certify model/model.json --bag run10 --validation-bag run1"


@pytest.mark.parametrize(
    ("certified", "statement", "end"),
    [(True, "certified", ""), (False, "predicted", "; the certificate states: predicted")],
)
def test_at_the_end_the_statement_of_a_certificate_that_certifies_nothing_is_named(
    identified: Path, certified: bool, statement: str, end: str
) -> None:
    certificate(identified, certified, statement)
    assert status_of(identified).step.reason == f"everything is there and current{end}"


def test_at_the_end_what_is_not_known_to_be_current_is_named(identified: Path) -> None:
    certificate(identified, True, "certified")
    (identified / "model/summary.json").unlink()
    unknown = "everything is there; not known to be current: model/model.json, certificate.json"
    assert status_of(identified).step.reason == unknown


def test_the_next_commands_lead_from_an_empty_folder_to_the_map(folder: Path, tmp_path_factory) -> None:
    empty = tmp_path_factory.mktemp("empty")
    assert status_of(empty).step.command == "amb new bearing.yaml"
    (empty / "own.yaml").write_text((folder / "bearing.yaml").read_text())
    assert status_of(empty).step.command == "amb map --params own.yaml"


def test_the_command_shows_the_same_as_json(folder: Path) -> None:
    amb = str(find_executable("amb_bringup", "amb"))
    shown = subprocess.run([amb, "status", str(folder), "--json"], capture_output=True, text=True, check=True)
    content = json.loads(shown.stdout)
    assert [item["state"] for item in content["items"]] == ["current"] * 4
    assert content["next"] == status_of(folder).as_dict()["next"]
    text = CliRunner().invoke(app, ["status", str(folder)], env={"COLUMNS": "160"}).stdout
    assert content["next"]["command"] in text and "data.csv" in text
    assert "cd " not in text


def test_the_next_command_begins_with_the_folder_if_that_is_another(folder: Path, tmp_path_factory) -> None:
    elsewhere = tmp_path_factory.mktemp("else where")
    shown = CliRunner().invoke(app, ["status", str(elsewhere)], env={"COLUMNS": "160"}).stdout
    assert shown.splitlines()[-2:] == [f"  cd '{elsewhere}'", "  amb new bearing.yaml"]


def test_what_is_no_folder_is_refused(folder: Path) -> None:
    with pytest.raises(ProjectError, match="there is no such folder"):
        status_of(folder / "nowhere")
