"""Commands that README, docs and READMEs of packages show: they exist, with the options and fields that are given."""

from __future__ import annotations

import importlib
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
import yaml
from typer.main import get_command

from amb_bringup.cli import COMMANDS as LISTED
from amb_bringup.cli import app
from amb_bringup.examples import EXAMPLES
from docs.generators.commands import commands
from docs.generators.links import PAGES as PAGES_OF_THE_REPOSITORY
from docs.generators.modules import FOLDER

ROOT = Path(__file__).parents[2]
GENERATED = set(PAGES_OF_THE_REPOSITORY.values())
PAGES = sorted(
    page
    for pattern in ("README.md", "docs/**/*.md", "amb_*/README.md", "src/*/README.md")
    for page in ROOT.glob(pattern)
    if page not in GENERATED and page.parent != FOLDER
)
AMB = re.compile(r"(?:^|`)(amb [a-z][^`\n]*)", re.MULTILINE)
ROS_CALL = re.compile(r"^ros2 (?:service call|action send_goal(?: --feedback)?) (/amb/\S+) (\S+)(?: \"(.*?)\")?$")


COMMANDS = dict(commands())


@pytest.mark.parametrize("name", [name for listed in LISTED.values() for name in listed])
def test_the_list_of_commands_shows_their_first_lines(name: str) -> None:
    command = get_command(app).commands[name]
    shown = command.load().help.split("\n\n")[0]
    assert " ".join(shown.split()) == command.help


def lines(page: Path) -> Iterator[str]:
    """Lines of a page without comments, continued ones joined."""
    for line in page.read_text().replace("\\\n", " ").splitlines():
        yield re.split(r"\s#\s", line)[0].strip()


def shown_commands(page: Path) -> Iterator[str]:
    for line in lines(page):
        yield from AMB.findall(line)


def problem_of(shown: str) -> str:
    """What is wrong with a command as it is shown; empty if it is in order."""
    words = [word.strip("[].,;:)") for word in shown.split()]
    name = next((" ".join(words[:count]) for count in (3, 2) if " ".join(words[:count]) in COMMANDS), "")
    if not name:
        groups = {known.rsplit(" ", 1)[0] for known in COMMANDS}
        return "" if " ".join(words[:2]) in groups and len(words) == 2 else "no such command"
    if name == "amb run":  # what follows belongs to the executable
        return ""
    options = {text for item in COMMANDS[name].params for text in (*item.opts, *item.secondary_opts)}
    unknown = {word.split("=")[0] for word in words if word.startswith("--")} - options - {"--help"}
    return f"no option {', '.join(sorted(unknown))}" if unknown else ""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_have_the_options_that_are_shown(page: Path) -> None:
    assert not {shown: problem for shown in shown_commands(page) if (problem := problem_of(shown))}


@pytest.mark.parametrize(
    ("shown", "problem"),
    [
        ("amb mapp", "no such command"),
        ("amb bag info BAG", ""),
        ("amb map --grid NAME=1,2 --nonsense=3", "no option --nonsense"),
    ],
)
def test_what_does_not_exist_is_found(shown: str, problem: str) -> None:
    assert problem_of(shown) == problem


def test_the_readme_of_amb_bringup_names_every_command() -> None:
    text = (ROOT / "src" / "amb_bringup" / "README.md").read_text()
    assert not {name for name in COMMANDS if f"| `{name}" not in text}


def test_one_page_has_the_purpose_of_every_command_in_the_groups_of_the_help() -> None:
    rows = re.findall(r"^\| (.+?) \|(.*)\|$", (ROOT / "docs/reference/which-command.md").read_text(), re.MULTILINE)
    groups: dict[str, list[str]] = {}
    for purpose, shown in rows[1:]:
        if purpose.startswith("**"):
            groups[purpose.strip("*")] = []
        else:
            groups[list(groups)[-1]] += re.findall(r"`(amb .+?)`", shown)
    assert sorted(name for names in groups.values() for name in names) == sorted(COMMANDS)
    first_words = {group: {name.split()[1] for name in names} for group, names in groups.items()}
    assert first_words == {group: set(listed) for group, listed in LISTED.items()}


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_every_command_ends_with_an_example_that_it_takes(name: str) -> None:
    """With the types and ranges of its options; files of the example need not exist."""
    command, example = COMMANDS[name], EXAMPLES[name.removeprefix("amb ")]
    assert command.epilog == f"Example: {name} {example}".rstrip()
    assert problem_of(f"{name} {example}") == ""
    command.make_context(name, shlex.split(example))  # which raises if a value is not of its type or one is missing


SELDOM = ("subharmonics", "campbell", "jitter", "Julia", "julia")


def test_what_few_need_is_neither_in_the_first_group_of_the_help_nor_on_the_front_page() -> None:
    assert not set(SELDOM) & set(next(iter(LISTED.values())))
    front = (ROOT / "README.md").read_text()
    assert not [word for word in SELDOM if word in front.replace("subharmonic tests", "")]
    last = next(reversed(LISTED.values()))
    assert {"subharmonics", "campbell", "jitter"} <= set(last)


def test_every_option_and_argument_has_its_help() -> None:
    assert not {(name, item.name) for name, command in COMMANDS.items() for item in command.params if not _help(item)}


def _help(item: click.Parameter) -> str:
    return str(getattr(item, "help", "") or "")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_calls_of_services_and_actions_have_the_fields_that_are_shown(page: Path) -> None:
    for line in lines(page):
        match = ROS_CALL.match(re.sub(r"\s+", " ", line))
        if match is None:
            assert not line.startswith(("ros2 service call", "ros2 action")), line
            continue
        package, kind, name = match[2].split("/")
        message = getattr(importlib.import_module(f"{package}.{kind}"), name)
        fields = (message.Goal if kind == "action" else message.Request).get_fields_and_field_types()
        given = yaml.safe_load(match[3] or "{}")
        assert set(given) <= set(fields), f"{line}: {name} has the fields {', '.join(fields)}"


def test_no_help_shows_a_default_that_is_empty() -> None:
    texts = {f"{name} {item.opts[0]}": item.help or "" for name, command in COMMANDS.items() for item in command.params}
    assert not [option for option, text in texts.items() if re.search(r"by default *([.;(]|$)", text)]
