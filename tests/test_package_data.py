"""What is installed: every file of the package, not the modules alone."""

from __future__ import annotations

import tomllib
from pathlib import Path

from tests.helpers import ROOT


def test_every_file_that_is_no_module_is_package_data() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    patterns = project["tool"]["setuptools"]["package-data"]
    package = ROOT / "fmu_didim"
    files = [path for path in package.rglob("*") if path.is_file() and path.suffix not in (".py", ".pyc")]
    named = {path for pattern in patterns["fmu_didim"] for path in package.glob(pattern)}
    assert len(files) > 10
    assert not {str(path.relative_to(package)) for path in set(files) - named}


def test_every_folder_with_modules_is_a_package() -> None:
    """A folder without ``__init__.py`` is not installed."""
    folders = {path.parent for path in Path(ROOT / "fmu_didim").rglob("*.py")}
    assert not [str(folder) for folder in folders if not (folder / "__init__.py").is_file()]
