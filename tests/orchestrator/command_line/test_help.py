"""What the command says of itself, before it is given anything to do."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version

import pytest

from orchestrator.registry import ROLES
from tests.orchestrator.command_line.conftest import PATIENCE_S, ROOT, Command

COMMANDS = [
    ("run",),
    ("validate",),
    ("score",),
    ("compare",),
    ("graph",),
    ("schema",),
    ("plugins",),
    ("log",),
    ("log", "info"),
    ("log", "recover"),
    ("log", "export"),
]
HEAVY = {"numpy", "scipy", "zenoh", "pydantic", "networkx", "mcap", "msgspec", "ruamel"}


def test_help_names_every_command_and_the_exit_codes(gauntlet: Command) -> None:
    answer = gauntlet("--help")
    assert answer.code == 0
    for command, *_ in COMMANDS:
        assert f" {command} " in answer.out
    assert "Usage: gauntlet " in answer.out
    assert "2 bad input" in answer.out


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
@pytest.mark.parametrize("option", ["--help", "-h"])
def test_every_command_has_help(gauntlet: Command, command: tuple[str, ...], option: str) -> None:
    answer = gauntlet(*command, option)
    assert answer.code == 0
    assert f"Usage: gauntlet {' '.join(command)} " in answer.out
    assert not answer.err


def test_help_loads_nothing_heavy() -> None:
    """Every command would wait for it: help answers in a fraction of a second because of this."""
    program = (
        "import json, sys; sys.argv = ['gauntlet', '--help']\n"
        "from orchestrator.command_line.app import main\n"
        "try: main()\n"
        "except SystemExit: print(json.dumps(sorted(sys.modules)))"
    )
    answer = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, timeout=PATIENCE_S, check=True
    )
    loaded = set(json.loads(answer.stdout.splitlines()[-1]))
    assert "orchestrator.command_line.app" in loaded
    assert not loaded & HEAVY


def test_version_is_that_of_the_installed_package(gauntlet: Command) -> None:
    answer = gauntlet("--version")
    assert answer.code == 0
    try:
        assert answer.out == f"gauntlet {version('gauntlet')}\n"
    except PackageNotFoundError:
        assert "without being installed" in answer.out


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("log",),
        ("launch",),
        ("--nonsense",),
        ("run",),
        ("run", "small.yaml", "--nonsense"),
        ("run", "small.yaml", "--backend", "threads"),
        ("run", "small.yaml", "--seed", "-1"),
        ("run", "small.yaml", "--seed", "x"),
        ("validate",),
        ("score",),
        ("log", "mend"),
        ("log", "export", "run.mcap", "--out", "x", "--format", "xls"),
    ],
    ids=lambda arguments: " ".join(arguments) or "nothing",
)
def test_what_the_command_does_not_know_is_bad_input(gauntlet: Command, arguments: tuple[str, ...]) -> None:
    answer = gauntlet(*arguments)
    assert answer.code == 2
    assert "Usage: gauntlet" in answer.out + answer.err


def test_schema_is_one_json_document(gauntlet: Command) -> None:
    answer = gauntlet("schema")
    assert answer.code == 0
    assert {"plant", "sensors", "estimators", "channel"} <= set(answer.json()["properties"])


def test_plugins_lists_every_role_for_people_and_for_programs(gauntlet: Command) -> None:
    lines = gauntlet("plugins").out.splitlines()
    kinds = gauntlet("plugins", "--json").json()
    assert {kind["role"] for kind in kinds} == set(ROLES)
    assert {"role", "name", "reference", "summary"} == set(kinds[0])
    assert [line.split()[:2] for line in lines] == [[kind["role"], kind["name"]] for kind in kinds]
    assert all(kind["summary"] for kind in kinds)
