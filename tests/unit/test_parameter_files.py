"""Parameter files: a key that no node hears is refused, and what is accepted means what it means in ROS."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from rclpy.context import Context
from rclpy.node import Node

from amb_bringup.client import NODES as CLIENT_NODES
from amb_bringup.graph.node_parameters import PARAMETERS, check_parameter_file
from amb_core.ground.errors import ParameterError
from amb_core.ground.files.parameter_files import CONTROLLERS, KNOWN_NODES, NODES, ParameterFile, full_name, of_rclpy
from amb_core.ground.parameters import flatten, load_parameters, own_declarations
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions import RegionParameters
from amb_ros import overflowed_wait
from amb_sim_node.parameters import SimulatorParameters

ROOT = Path(__file__).parents[2]
MASS = "{ros__parameters: {rotor: {mass: 5.0}}}"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "my_bearing.yaml"


def refusal(file: Path, text: str) -> str:
    file.write_text(text)
    with pytest.raises(ParameterError) as caught:
        load_parameters(SimulatorParameters, file, "simulator")
    message = str(caught.value)
    assert message.startswith(f"parameter file {file}")
    assert message.isprintable()
    return message


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (f"/amb/simulater: {MASS}", "there is no node '/amb/simulater', ROS would ignore it; did you mean '/amb/simul"),
        (f"simulator: {MASS}", "'simulator' names no node, ROS would ignore it; the node is '/amb/simulator'"),
        (f"/simulator: {MASS}", "the node is '/amb/simulator'"),
        (f"/other/simulator: {MASS}", "the node is '/amb/simulator'"),
        (f"/amb/pd_controler: {MASS}", "did you mean '/amb/pd_controller'?"),
        (f"/amb/camera: {MASS}", "nodes: /amb/simulator, /amb/pd_controller"),
        (f"/**/simulater: {MASS}", "did you mean '/amb/simulator'?"),
        (f"/*: {MASS}", "there is no node '/*'"),
        (f"/amb/sim*: {MASS}", "'/amb/sim*' is not a valid node name; * and ** may only replace whole parts"),
        (f"/amb/simulator/: {MASS}", "is not a valid node name"),
        (f"amb: {{simulater: {MASS}}}", "did you mean '/amb/simulator'?"),
        (f"/amb/simulator: {MASS}\n/amb/simulator: {MASS}", "'/amb/simulator' is given twice, again in line 2"),
        (f"/amb/simulator: {MASS}\n/amb: {{simulator: {MASS}}}", "'/amb/simulator' is given twice"),
        ("/amb/simulator: {ros__parameters: {rotor: {mass: 5.0}, rotor.mass: 6.0}}", "'rotor.mass' is given twice"),
        ("/amb/simulator: {ros__parameters: {autostart: true, autostart: false}}", "'autostart' is given twice"),
        ("/amb/simulator: {ros__parameters: {}, more: 1}", "has 'more' in addition to 'ros__parameters'"),
        ("", "is empty; it must give parameters to at least one node"),
        ("# nothing but a comment\n", "is empty"),
        ("{}", "is empty"),
        ("rotor:\n  mass: 5.0\n", "each entry must be a node name with a mapping 'ros__parameters'; 'rotor/mass' is"),
        ("rotor.mass: 5.0\n", "each entry must be a node name with a mapping 'ros__parameters'; 'rotor.mass' is not"),
        ("/amb/simulator:\n", "'/amb/simulator' is not"),
        ("/amb/simulator: {ros__parameters: }\n", "'/amb/simulator' is not"),
        ("just words", "each entry must be"),
        (f"--- \n/amb/simulator: {MASS}\n---\n/amb/simulator: {MASS}\n", "cannot be read"),
        ("/amb/simulator: {ros__parameters: {autostart: 2020-99-99}}", "cannot be read"),
        ("/amb/simulator: {ros__parameters: {use_sim_times: true}}", "unknown parameter 'use_sim_times'"),
    ],
)
def test_what_ros_would_ignore_or_read_otherwise_is_refused(file: Path, text: str, reason: str) -> None:
    assert reason in refusal(file, text)


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ("[0, 1.0e-6]", "mixes int and float, which ROS does not read; write all with a point, as 0.0"),
        ("[1.0e-6, 0]", "write all with a point, as 0.0"),
        ("[true, 1]", "mixes bool and int, which ROS does not read; allowed: values of one type"),
        ("[]", "the list 'nominal_reference' is empty, which ROS does not read; leave it out"),
    ],
)
def test_a_list_that_ros_does_not_read_is_refused_with_its_name(file: Path, values: str, reason: str) -> None:
    file.write_text(f"/amb/pd_controller: {{ros__parameters: {{nominal_reference: {values}}}}}\n")
    with pytest.raises(ParameterError) as caught:
        check_parameter_file(file)
    assert str(caught.value).startswith(f"parameter file {file}: '/amb/pd_controller': the list 'nominal_reference'")
    assert reason in str(caught.value)


def test_aliases_cannot_explode(file: Path) -> None:
    lines = ["a: &a [x, x, x, x, x, x, x, x, x, x]"]
    lines += [
        f"{name}: &{name} [{', '.join(['*' + last] * 10)}]" for last, name in zip("abcdefgh", "bcdefghi", strict=True)
    ]
    assert "line 2 has an alias (*a), which ROS does not allow" in refusal(file, "\n".join(lines))


@pytest.mark.parametrize("text", ["[" * 100_000, "{a: " * 50_000, "".join(" " * i + "a:\n" for i in range(1000))])
def test_deep_nesting_is_refused_before_anything_is_built(file: Path, text: str) -> None:
    assert "nested deeper than 32 levels" in refusal(file, text)


@pytest.mark.timeout(60)
def test_a_file_of_a_mebibyte_is_the_largest(file: Path) -> None:
    assert "too large; allowed: at most 1 MiB" in refusal(file, "#" * (1 << 20) + "\n")


SECTIONS = [
    "/amb/simulator: {m: 1.0}",
    "amb/simulator: {m: 1.0}",
    "/**: {m: 1.0}",
    "**: {m: 1.0}",
    "/**/simulator: {m: 1.0}",
    "**/simulator: {m: 1.0}",
    "/*/simulator: {m: 1.0}",
    "'*/simulator': {m: 1.0}",
    "/amb/*: {m: 1.0}",
    "/amb/**: {m: 1.0}",
    "/*/*: {m: 1.0}",
    "/amb/**/simulator: {m: 1.0}",
    "/**/amb/simulator: {m: 1.0}",
    "/amb/simulator/**: {m: 1.0}",
    "/amb/recorder: {m: 1.0}",
    "/amb/simulator: {a: {b: {c: 1}}, d.e: 2, f: [1.0, 2.0], g: text, h: true}",
    "/amb/simulator: {m: 2.0}\n/**: {m: 1.0}",
    "/**: {m: 1.0}\n/amb/simulator: {m: 2.0}",
    "/**/simulator: {m: 1.0}\n/amb/*: {m: 2.0}",
    "/amb/*: {m: 2.0}\n/**/simulator: {m: 1.0, n: 3}",
    "/**: {use_sim_time: true, m: 1.0}",
]


@pytest.mark.parametrize("sections", SECTIONS)
def test_keys_and_wildcards_mean_what_they_mean_in_ros(file: Path, sections: str) -> None:
    file.write_text(_as_file(sections))
    assert ParameterFile(file).values("simulator") == by_ros(file)


@pytest.mark.parametrize("key", ["amb", "/amb"])
def test_a_namespace_may_be_a_mapping_around_its_nodes_as_in_ros(file: Path, key: str) -> None:
    file.write_text(f"{key}:\n  simulator: {MASS}\n  '*': {{ros__parameters: {{n: 1}}}}\n")
    values = ParameterFile(file).values("simulator")
    assert values == {"rotor.mass": 5.0, "n": 1}
    assert values == by_ros(file)


def _as_file(sections: str) -> str:
    content = {key: {"ros__parameters": values} for key, values in map(_section, sections.splitlines())}
    return yaml.safe_dump(content, sort_keys=False)


def _section(line: str) -> tuple[str, Any]:
    key, _, values = line.partition(": ")
    return key.strip("'"), yaml.safe_load(values)


def by_ros(file: Path) -> dict[str, Any]:
    """Parameters that a node of the name /amb/simulator finds in a file."""
    overflowed_wait.correct()
    context = Context()
    rclpy.init(context=context, args=["--ros-args", "--params-file", str(file)])
    try:
        node = Node(
            "simulator",
            namespace="/amb",
            context=context,
            automatically_declare_parameters_from_overrides=True,
            start_parameter_services=False,
        )
        parameters = {
            name: item.value for name, item in node.get_parameters_by_prefix("").items() if not of_rclpy(name)
        }
        node.destroy_node()
    finally:
        context.try_shutdown()
    return {name: list(value) if hasattr(value, "tolist") else value for name, value in parameters.items()}


def test_a_graph_in_another_namespace_reads_its_own_section(file: Path) -> None:
    file.write_text(f"/rig/simulator: {MASS}\n/amb/simulator: {{ros__parameters: {{rotor.mass: 6.0}}}}\n")
    assert load_parameters(SimulatorParameters, file, "/rig/simulator").rotor.mass == 5.0


@pytest.mark.parametrize(
    ("model", "node", "name"),
    [
        (PlantParameters, "simulator", "rotor.mas"),
        (ControllerParameters, "pd_controller", "proportional_gian"),
        (RegionParameters, "region_monitor", "backup_bearing_radios"),
    ],
)
def test_a_misspelt_parameter_of_a_part_is_not_taken_for_one_of_the_node(
    file: Path, model: type[Any], node: str, name: str
) -> None:
    file.write_text(f"/amb/{node}: {{ros__parameters: {{{name}: 1.0}}}}\n")
    with pytest.raises(ParameterError, match=f"unknown parameter '{name}'"):
        load_parameters(model, file, node, part=True)


@pytest.mark.parametrize("part", [PlantParameters, ControllerParameters, RegionParameters])
def test_a_part_leaves_the_other_parameters_of_its_node_to_it(file: Path, part: type[Any]) -> None:
    node, whole = next((node, model) for node, model in PARAMETERS.items() if issubclass(model, part))
    own = {item.name.split(".")[0] for item in own_declarations(whole)}
    given = flatten(whole().model_dump())
    values = {name: value for name, value in given.items() if name.split(".")[0] in own and value != ()}
    file.write_text(yaml.safe_dump({full_name(node): {"ros__parameters": values}}))
    load_parameters(part, file, node, part=True)


def test_there_is_one_list_of_nodes() -> None:
    launched = yaml.safe_load((ROOT / "src/amb_bringup/launch/bearing.launch.yaml").read_text())["launch"]
    names = tuple(entry["node"]["name"] for entry in launched if "node" in entry)
    assert names == tuple("$(var controller)" if name in CONTROLLERS else name for name in NODES)
    assert set(PARAMETERS) == set(KNOWN_NODES)
    assert CLIENT_NODES is NODES


@pytest.mark.parametrize("path", sorted((ROOT / "src/amb_bringup/config").glob("*.yaml")), ids=lambda path: path.name)
def test_shipped_files_pass_the_check(path: Path) -> None:
    check_parameter_file(path)


def test_the_check_of_a_file_covers_every_node(file: Path) -> None:
    for node in NODES:
        file.write_text(f"/amb/{node}: {{ros__parameters: {{no_such_name: 1}}}}\n")
        with pytest.raises(ParameterError, match=f"node {node}: unknown parameter 'no_such_name'"):
            check_parameter_file(file)


def test_a_sample_rate_of_the_controller_is_refused_before_a_graph_starts(file: Path) -> None:
    file.write_text("/amb/pd_controller: {ros__parameters: {sample_rate: 20000.0}}\n")
    with pytest.raises(ParameterError, match=r"the machine decides it: give 'integration\.sample_rate' of the"):
        check_parameter_file(file)


def test_the_controller_of_a_file_runs_at_the_rate_of_its_simulator(file: Path) -> None:
    file.write_text("/amb/simulator: {ros__parameters: {integration: {sample_rate: 20000.0}}}\n")
    assert load_parameters(ControllerParameters, file, "pd_controller", part=True).sample_rate == 20_000.0


def test_a_list_for_other_axes_than_the_machine_has_is_refused_before_a_graph_starts(file: Path) -> None:
    file.write_text("/amb/pd_controller: {ros__parameters: {nominal_reference: [0.0, 0.0, 1.0e-6]}}\n")
    with pytest.raises(ParameterError, match="nominal_reference has 3 values; the machine has 2 axes"):
        check_parameter_file(file)
