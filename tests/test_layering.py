"""The folders are the data flow: who may import whom, and that only one room knows the bus library."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
MAY_IMPORT = {
    "bus": set(),
    "nodes": {"bus"},
    "channel": {"bus"},
    "orchestrator": {"bus", "nodes", "channel"},
}
ROOMS = {
    "score": set(),
    "log": set(),
    "backends": {"log"},
    "topology": {"backends", "log", "score"},
    "evidence": {"log", "score", "topology"},
    "report": {"evidence", "log", "score", "topology"},
    "handoff": {"evidence", "log", "score", "topology"},
    "campaign": {"backends", "evidence", "log", "score", "topology"},
    "reproduction": {"campaign", "evidence", "log", "report", "run", "score", "topology"},
    "testing": {"backends", "evidence", "log", "run", "score", "topology"},
}
"""Which rooms of the orchestrator each room may import; what is `ABOVE` imports all."""
ABOVE = {"command_line", "quick_start", "run", "validation"}
ONLY_IN = {
    "zenoh": {"bus/zenoh/"},
    "mcap": {"orchestrator/log"},
    "plotly": {"orchestrator/report"},
    "kaleido": {"orchestrator/report"},
    "jinja2": {"orchestrator/report"},
    "pydantic": {"orchestrator/topology", "orchestrator/registry.py"},
}
PURE = [
    "nodes/plants",
    "nodes/sensors",
    "nodes/estimators",
    "nodes/controllers",
    "channel/impairments",
    "channel/attacks",
]
SHELL_MODULES = {
    "os",
    "sys",
    "time",
    "threading",
    "multiprocessing",
    "socket",
    "subprocess",
    "pathlib",
    "random",
}


def imported_modules(path: Path) -> set[str]:
    modules = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute here, so that they can be read anywhere"
            module = node.module or ""
            modules |= {module, *(f"{module}.{alias.name}" for alias in node.names)}
    return modules


def sources(folder: str) -> list[Path]:
    found = sorted((ROOT / folder).rglob("*.py"))
    assert found, f"{folder} has moved: this test must follow"
    return found


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_a_package_imports_only_what_lies_below_it(package: str) -> None:
    forbidden = set(MAY_IMPORT) - MAY_IMPORT[package] - {package}
    for path in sources(package):
        tops = {module.partition(".")[0] for module in imported_modules(path)}
        assert not tops & forbidden, f"{path.relative_to(ROOT)} imports {sorted(tops & forbidden)}"


def test_every_room_of_the_orchestrator_has_its_place() -> None:
    rooms = {path.parent.name for path in (ROOT / "orchestrator").glob("*/__init__.py")}
    assert rooms - ABOVE == set(ROOMS)


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_of_the_orchestrator_imports_only_what_lies_below_it(room: str) -> None:
    forbidden = ABOVE.union(ROOMS) - ROOMS[room] - {room}
    for path in sources(f"orchestrator/{room}"):
        parts = [module.split(".") for module in imported_modules(path)]
        rooms = {own[1] for own in parts if own[0] == "orchestrator" and len(own) > 1}
        assert not rooms & forbidden, f"{path.relative_to(ROOT)} imports {sorted(rooms & forbidden)}"


@pytest.mark.parametrize("library", ONLY_IN)
def test_a_library_with_a_room_of_its_own_is_imported_only_there(library: str) -> None:
    users = {
        str(path.relative_to(ROOT))
        for package in MAY_IMPORT
        for path in sources(package)
        if library in {module.partition(".")[0] for module in imported_modules(path)}
    }
    assert users, f"nobody imports {library}"
    strangers = {user for user in users if not any(user.startswith(room) for room in ONLY_IN[library])}
    assert not strangers


@pytest.mark.parametrize("folder", PURE)
def test_the_mathematics_knows_no_clock_no_files_and_no_processes(folder: str) -> None:
    for path in sources(folder):
        tops = {module.partition(".")[0] for module in imported_modules(path)}
        assert not tops & SHELL_MODULES, f"{path.relative_to(ROOT)} imports {sorted(tops & SHELL_MODULES)}"
