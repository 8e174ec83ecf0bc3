"""The imports of a program lead to the modules that it runs through, and to no others."""

from __future__ import annotations

from tests.benchmarks.ident.run import code_of
from tests.front_door.imports import closure, imports

CORE = "src/amb_core/amb_core"


def test_a_name_that_a_package_passes_on_leads_to_the_module_that_defines_it() -> None:
    found = imports("tests/benchmarks/plant.py")
    assert f"{CORE}/plant/plant.py" in found
    assert f"{CORE}/plant/__init__.py" not in found


def test_a_name_that_loads_when_it_is_used_leads_there_too() -> None:
    assert f"{CORE}/recording/step_audit.py" in imports("tests/soak/parts.py")


def test_imports_in_functions_count_and_those_for_type_checkers_do_not() -> None:
    found = imports(f"{CORE}/data/experiments/checks/region.py")
    assert f"{CORE}/regions/classification.py" in found  # in a function
    assert f"{CORE}/regions/parameters.py" not in found  # a type only


def test_what_is_imported_is_followed_to_its_end() -> None:
    assert f"{CORE}/plant/kernel/advance.py" in closure(["tests/benchmarks/run.py"])


def test_what_is_not_followed_is_found_and_ends_there() -> None:
    found = closure(["tests/benchmarks/plant.py"], lambda name: name != f"{CORE}/plant/plant.py")
    assert f"{CORE}/plant/plant.py" in found
    assert f"{CORE}/plant/kernel/advance.py" not in found


def test_kept_runs_of_identification_count_for_the_code_that_made_data_models_and_scores_only() -> None:
    ours, peers = code_of("ours"), code_of("peers")
    for name in ("linear/system.py", "excitation/seeded.py", "identification/estimate/predictor.py"):
        assert f"{CORE}/{name}" in ours
    assert "tests/benchmarks/ident/peers.txt" in peers - ours
    assert f"{CORE}/identification/estimate/pem.py" in ours - peers
