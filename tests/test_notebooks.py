"""The notebooks run as they are, in a dozen lines, and show tables, pictures and findings.

Outputs are not kept in the files: a picture is a hundred times the text, and nobody would know whether it still holds.
"""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import ROOT, package
from tests.patience import patience

pytestmark = pytest.mark.gate

nbformat = package("nbformat")
nbclient = package("nbclient")
package("ipykernel")
FOLDER = ROOT / "examples" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
MOST_LINES = 15


def code_cells(notebook: Any) -> list[Any]:
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_short_and_holds_no_outputs(path: Path) -> None:
    notebook = json.loads(path.read_text(encoding="utf-8"))
    nbformat.validate(nbformat.from_dict(notebook))
    cells = code_cells(notebook)
    lines = [line for cell in cells for line in cell["source"].splitlines() if line.strip()]
    assert 0 < len(lines) <= MOST_LINES
    assert max(map(len, lines)) <= 120
    assert not any(cell["outputs"] or cell["execution_count"] for cell in cells), "strip its outputs"


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """Last line of each code cell of the first hour -> what it shows, by MIME type."""
    folder = tmp_path_factory.mktemp("notebook")
    for name in ("examples", "fmus", "controllers"):
        shutil.copytree(ROOT / name, folder / name)
    notebook = nbformat.read(FOLDER / "first_hour.ipynb", as_version=4)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(ROOT), prepend=os.pathsep)
        patch.setenv("IPYTHONDIR", str(folder / "ipython"))
        patch.setenv("JUPYTER_DATA_DIR", str(folder / "jupyter"))  # no kernel of somebody else
        where = {"metadata": {"path": str(folder / "examples" / "notebooks")}}
        nbclient.NotebookClient(
            notebook, timeout=round(patience(300)), kernel_name="python3", resources=where
        ).execute()
    found = {}
    for cell in code_cells(notebook):
        results = [output["data"] for output in cell["outputs"] if "data" in output]
        found[cell["source"].splitlines()[-1]] = results[-1] if results else {}
    return found


@pytest.mark.slow
def test_identify_shows_its_parameters_and_its_verdict(shown: dict[str, dict[str, Any]]) -> None:
    names = ("ZZ1R", "Fv1", "Fc1", "ZZ2", "MX2", "MY2", "Fv2", "Fc2")
    for cell in ("outcome", "outcome.to_frame()"):
        assert "<table" in shown[cell]["text/html"]
        assert [name for name in names if name not in shown[cell]["text/html"]] == []
    assert "VALID" in shown["outcome"]["text/html"]
    inertia = re.search(r"^ZZ1R +(\S+) +(\S+)", shown["outcome.to_frame()"]["text/plain"], re.M)
    assert inertia is not None
    assert abs(float(inertia[1]) - 3.43) < 4 * float(inertia[2])  # the paper's value


@pytest.mark.slow
def test_discover_shows_what_it_has_found(shown: dict[str, dict[str, Any]]) -> None:
    for effect in ("Lag of the current loop, joint 2", "Stribeck friction, joint 1"):
        assert effect in shown["found"]["text/html"]
    for name in ("actuator_lag", "stribeck", "T_2", "vs_1"):
        assert name in shown["found.to_frame()"]["text/html"]


@pytest.mark.slow
def test_the_study_shows_its_groups(shown: dict[str, dict[str, Any]]) -> None:
    assert "20 of 20 runs done" in shown["results"]["text/html"]
    assert all(f">{rate}<" in shown["results"]["text/html"] for rate in (100, 50, 20, 10, 5))
    assert "coverage" in shown["results.by_parameter()"]["text/html"]


@pytest.mark.slow
@pytest.mark.parametrize("cell", ["outcome.plot()", 'found.plot("validation")', "results.plot()"])
def test_pictures(shown: dict[str, dict[str, Any]], cell: str) -> None:
    """In a notebook that never imports pyplot."""
    assert base64.b64decode(shown[cell]["image/png"]).startswith(b"\x89PNG")
