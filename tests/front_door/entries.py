"""What the front door offers, and how each of it is run on every commit: the only list.

A target of the Makefile, a program beside the tests, a part of one, a command of `amb` or a page with code that is not
listed here fails `tests/unit/test_front_door.py`. To add one, add one entry.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Program:
    """A program beside the tests, which `make quick` runs as `python -m MODULE --quick`.

    Attributes
    ----------
    module : str
        Of the program.
    results : str
        File that it writes to `results`, and with `--quick` to `results/quick`; programs of one file run in this order.
    figures : str
        MODULE:CLASS that declares all keys of that file.
    parts : tuple of str
        Modules beside it that measure, or can be started by themselves.
    seconds : float
        Duration of the quick form on two processors, about; the longest starts first.
    shared : tuple of str
        Other modules beside it, which parts share.
    """

    module: str
    results: str
    figures: str
    parts: tuple[str, ...] = ()
    seconds: float = 10.0
    shared: tuple[str, ...] = ()


@dataclass(frozen=True)
class Covered:
    """Covered by a test that `make test` runs, or by a slow one that says why.

    Attributes
    ----------
    test : str
        FILE::NAME.
    slow_because : str
        Why a slow test is enough.
    needs : str
        What the test needs that the default set-up may lack; it is skipped without.
    without : str
        FILE::NAME of the test that is run even then.
    """

    test: str
    slow_because: str = ""
    needs: str = ""
    without: str = ""


@dataclass(frozen=True)
class Left:
    """Not run, for a reason."""

    reason: str


DEMO = "tests/graph/test_demo.py::test_demo_reaches_its_numbers_and_leaves_its_results"
RIG_DEMO = "tests/graph/test_rig_demo.py::test_a_session_levitates_excites_identifies_lands_and_reports"

PROGRAMS = (
    Program(
        "tests.benchmarks.run",
        "bench.json",
        "tests.benchmarks.figures:Bench",
        ("averaged_plant", "c_kernel", "composed", "first_call", "lockstep", "peer_ross", "plant", "pong", "region_map",
         "region_monitor"),
        47.0,
        ("skipped", "subjects"),
    ),
    Program(
        "tests.benchmarks.regions.run",
        "bench_regions.json",
        "tests.benchmarks.regions.figures:BenchRegions",
        ("constant_line", "constant_line_drift", "dead_time", "design", "drift_identification", "lamination",
         "light_damping", "paper_sweeps", "planted", "slow_line", "turning_map"),
        55.0,
        ("drift_cases", "spread"),
    ),
    Program(
        "tests.benchmarks.ident.run",
        "bench_ident.json",
        "tests.benchmarks.ident.figures:BenchIdent",
        ("bound", "ours", "peers", "real_data", "worker"),
        56.0,
        ("cases", "linear_loop", "plant", "rotors", "scores"),
    ),
    Program(
        "tests.benchmarks.uncertainty",
        "bench_uncertainty.json",
        "tests.benchmarks.uncertainty:BenchUncertainty",
        seconds=6.0,
    ),
    Program(
        "tests.benchmarks.explained.run",
        "bench_explained.json",
        "tests.benchmarks.explained.figures:BenchExplained",
        ("distortion", "excitation", "identification", "map_lines", "map_rates", "plant", "region_maps",
         "subharmonics"),
        52.0,
        ("excitation_trials", "subharmonics_cases"),
    ),
    Program(
        "tests.benchmarks.first_hour.run",
        "first_hour.json",
        "tests.benchmarks.first_hour.figures:FirstHour",
        ("files", "live_page", "new", "pages", "tutorial", "wishes"),
        62.0,
        ("player",),
    ),
    Program(
        "tests.benchmarks.robust.run", "bench_robust.json", "tests.benchmarks.robust.figures:BenchRobust",
        ("again", "hidden_modes", "misfit", "monte_carlo", "swept"),
        56.0,
        ("loops", "misfit_plants", "misfit_simulated", "records"),
    ),
    Program(
        "tests.benchmarks.verdicts.run", "bench_verdicts.json", "tests.benchmarks.verdicts.figures:BenchVerdicts",
        ("after_stop", "bad_data", "controllers", "coverage", "distortion", "models"),
        46.0,
        ("alone", "bearings", "drawn_loops", "size"),
    ),
    Program(
        "tests.benchmarks.robust.emulator", "bench_robust.json", "tests.benchmarks.robust.figures:BenchRobust",
        seconds=70.0,
    ),
    Program(
        "tests.validation.run",
        "validation.json",
        "tests.validation.figures:Validation",
        ("dynamics", "eddy", "independent", "iron", "laminations", "paper", "rotors", "statics"),
        11.0,
        ("energy", "implicit_iron", "implicit_plant", "row"),
    ),
    Program(
        "tests.soak.run",
        "soak.json",
        "tests.soak.figures:Soak",
        ("board", "board_model", "commissioning", "conformance", "parts", "recovery", "safety", "same", "trips"),
        154.0,
        ("on_path", "session", "tap"),
    ),
    Program(
        "tests.fuzz.run", "fuzz.json", "tests.fuzz.figures:Fuzz", ("campaign",), 16.0,
        ("attacked_graph", "hostile", "targets"),
    ),
    Program("tests.fuzz.target", "target_fuzz.json", "tests.fuzz.figures:TargetFuzz", seconds=4.0),
    Program(
        "tests.fuzz.files",
        "security.json",
        "tests.fuzz.figures:Security",
        ("crafted_files", "pages", "peers"),
        32.0,
        ("crafted", "crafted_bags", "crafted_tables"),
    ),
    Program("tests.stress_leaving", "leaving.json", "tests.stress_leaving:Leaving", seconds=17.0),
    Program("tests.stress", "stress.json", "tests.stress:Stress", seconds=31.0),
    Program(
        "tests.front_door.commands", "commands.json", "tests.front_door.commands:CommandSeconds", seconds=98.0
    ),
)  # fmt: skip

TARGETS: dict[str, tuple[str, ...] | Covered | Left] = {
    "help": Covered("tests/unit/test_front_door.py::test_help_lists_every_target"),
    "setup": Left("every other target begins with it"),
    "demo": Covered(
        DEMO,
        "the paper's main experiment has one length; the guides' tests run it too",
    ),
    "rig-demo": Covered(
        RIG_DEMO,
        "a session has one length; `make quick` runs its steps as the commands of `amb rig`",
    ),
    "reproduce": ("tests.front_door.commands",),
    "test": Left(".ci/run runs it after this"),
    "test-slow": Left("the slow tests are run before a release"),
    "test-graph": ("tests.stress",),
    "stress": ("tests.stress",),
    "validate": ("tests.validation.run",),
    "soak": ("tests.soak.run",),
    "fuzz": ("tests.fuzz.run",),
    "fuzz-files": ("tests.fuzz.files",),
    "leaving": ("tests.stress_leaving",),
    "floor": Left("the unit tests again, in an environment of older packages: half an hour, before a release"),
    "bench": ("tests.benchmarks.run",),
    "bench-regions": ("tests.benchmarks.regions.run",),
    "bench-ident": ("tests.benchmarks.uncertainty", "tests.benchmarks.ident.run"),
    "bench-explained": ("tests.benchmarks.explained.run",),
    "bench-view": ("tests.benchmarks.first_hour.run",),
    "bench-robust": ("tests.benchmarks.robust.run", "tests.benchmarks.robust.emulator"),
    "bench-verdicts": ("tests.benchmarks.verdicts.run",),
    "quick": Left("runs this list"),
    "measured": Covered("tests/unit/test_measured.py::test_make_measured_lists_what_is_stale"),
    "docs": Left(".ci/run runs it before this"),
    "lint": Left(".ci/run runs it before this"),
    "clean": Left("removes the environment that everything here runs in"),
}
"""Targets of the Makefile: the programs that a target runs, or how it is covered."""

COMMANDS = """
amb new bearing.yaml --gap 0.4mm --turns 80 --mass 3 --bias-current 2 --voltage 150
amb status
amb tune chart bearing.yaml --points 8 --out chart
amb tune gains bearing.yaml
amb plant describe --params bearing.yaml
amb plant figures --out plant
amb plant modes
amb plant campbell --speeds 2 --params {config}/rig.yaml --out campbell
amb plant shaft --length 0.6 --diameter 0.05 --bearings 0.2 --out shaft.npz
amb plant ross {rotor}:overhung --bearing-nodes 3,11 --bending-modes 1 --out ross.yaml
amb map --initial-sweeps 2 --max-sweeps 2 --duration 0.5 --workers 1 --cache cache --out map
amb excitation check multisine --amplitude 1um --duration 0.1 --map map/map.json --no-simulate --out check
amb excitation design prbs --duration 0.05 --tolerance 0.5 --map map/map.json --out design
amb campbell --at 3000 --order 4 --period 0.1 --frequency-start 10 --workers 1 --cache cache --out modes
amb subharmonics --inducing-amplitude 1e-6 --out subharmonics
amb reproduce --only equations --workers 1 --out paper
& amb up --composed | amb: ready
& amb view --port 0 | http://
& amb run amb_sim_node target_emulator --ros-args -r __ns:=/other -p port:=0 | UDP port
amb experiment multisine --amplitude 5um --frequency-end 1kHz --duration 0.4 --periods 2 --odd --no-report
^C
amb bag info results/experiment/bag
amb bag play results/experiment/bag --rate 100
amb bag recover results/experiment/bag --out recovered
amb bag export results/experiment/bag --csv --out samples.csv
amb regions results/experiment/bag
amb distortion results/experiment/bag --out distortion
amb identify results/experiment/bag --order 4 --method ssarx --out model.json
amb validate model.json results/experiment/bag --out validation | 3
amb compare model.json model.json results/experiment/bag --out comparison | 3
amb certify model.json --controller paper --frequencies 50 --out certificate | 4
amb report results/experiment/bag --order 4 --no-certify --out report.html
amb model export model.json --c --out model_c
& amb rig up --emulator --params slow.yaml | amb: ready
amb rig connect --patience 60
amb rig levitate
amb rig status
amb jitter --seconds 0.5
amb rig reset
amb rig land
amb rig off
amb rig disconnect
amb rig check --port {port} --timeout 10 | 3
^C
"""
"""Every command at its smallest, one after the other in a folder of their own.

`& COMMAND | TEXT` starts one behind the others and goes on when it shows TEXT; `^C` ends these. `COMMAND | CODE` has
a verdict as its exit code: a model of so little data is not good, and a target slower than real time has a slow clock.
"""

COMMANDS_ELSEWHERE: dict[str, Covered | Left] = {
    "amb demo": Covered(DEMO, "see `make demo`"),
    "amb rig demo": Covered(RIG_DEMO, "see `make rig-demo`"),
    "amb commission": Covered(
        "tests/graph/test_commission.py::test_it_leads_from_the_connection_to_the_identified_plant"
    ),
    "amb foxglove": Covered(
        "tests/graph/test_foxglove.py::"
        "test_a_viewer_sees_the_samples_of_the_loop_bit_for_bit_and_the_bridge_ends_on_ctrl_c",
        needs="the extra foxglove",
        without="tests/unit/test_extras.py::test_foxglove_without_its_extra_says_in_one_line_what_to_install",
    ),
}  # fmt: skip
"""Commands that a test runs."""

PAGES: dict[str, Covered | Left] = {
    "docs/how-to/*.md": Covered(
        "tests/docs/test_how_to.py::test_a_reader_gets_through",
        "the guides together take half an hour; COMMANDS has what they call",
    ),
    "docs/tutorial/my-bearing.md": Covered(
        "tests/docs/test_tutorial.py::test_a_reader_arrives_at_a_certificate_and_sees_what_the_page_states",
        "ten minutes; COMMANDS has what it calls",
    ),
    "docs/tutorial/twenty-lines.md": Covered(
        "tests/docs/test_twenty_lines.py::test_the_lines_lead_to_a_certificate",
        "two recordings are simulated, and a certificate takes half a minute",
    ),
    "docs/tutorial/notebooks/*.md": Left(".ci/run builds the site, which runs the notebooks"),
    "docs/gallery.md": Left(".ci/run builds the site, which runs its cells"),
    "docs/explanation/*.md": Covered("tests/unit/test_docs_examples.py::test_the_examples_run"),
    "docs/reference/*.md": Covered("tests/unit/test_docs_examples.py::test_the_examples_run"),
    "src/amb_core/README.md": Covered("tests/unit/test_docs.py::test_examples_without_ros_run"),
    "CONTRIBUTING.md": Covered("tests/unit/test_contributing.py::test_the_examples_run"),
    "README.md": Covered(
        "tests/graph/test_programs_of_the_readme.py::"
        "test_one_records_and_identifies_and_a_node_identifies_the_same_bag",
    ),
    "amb_*/README.md": Covered("tests/unit/test_docs_commands.py::test_commands_have_the_options_that_are_shown"),
    "src/amb_*/README.md": Covered("tests/unit/test_docs.py::test_python_examples_are_python"),
    "docs/index.md": Covered("tests/unit/test_docs_commands.py::test_commands_have_the_options_that_are_shown"),
    "docs/coming-from.md": Covered("tests/unit/test_docs_commands.py::test_commands_have_the_options_that_are_shown"),
    "target/*.md": Left("for a compiler of the target"),
}  # fmt: skip
"""Pages with examples, by pattern; the first one that fits counts."""
