"""The notebooks in docs run as they stand, and are stored without what a run leaves in them."""

from __future__ import annotations

import os
import re
import shutil
import sys
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


def read(path: Path) -> nbformat.NotebookNode:
    return nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_without_outputs_and_without_places_of_a_machine(path: Path) -> None:
    notebook = read(path)
    nbformat.validate(notebook)  # type: ignore[no-untyped-call]
    for cell in notebook.cells:
        if cell.cell_type == "code":
            assert (cell.outputs, cell.execution_count) == ([], None)
    assert not re.search(r"/(home|root|tmp|work|Users)/", path.read_text())


@pytest.mark.timeout(180)
def test_the_first_look_shows_what_the_attack_did(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    if shutil.which("gauntlet") is None:
        monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setenv("MPLCONFIGDIR", str(tmp_path))
    notebook = read(ROOT / "docs" / "notebooks" / "first_look.ipynb")
    place = {"metadata": {"path": str(ROOT / "docs" / "notebooks")}}
    NotebookClient(notebook, timeout=90, kernel_name="python3", resources=place).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    text = "".join(
        output.get("text", "") + output.get("data", {}).get("text/plain", "") for output in outputs
    )
    assert "<run adversary-bias, seed 1" in text
    assert re.search(r"s2->e2.*bias@s2->e2.*40.*45.*0\.0", text)
    assert re.search(r"e2 .*6 ", text)
    found = re.search(r"(\d+) genuine packets were rejected, the first at step 46", text)
    assert found is not None
    assert int(found[1]) > 40
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 2
