"""What is packed, and what an index shows of it. Nothing is built here: tests/house/test_wheel.py does that."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path, PurePosixPath
from typing import Any

import pytest
import yaml

from fmu_didim import __version__
from fmu_didim.cli.examples import INDEX, examples, write_example
from tests.helpers import ROOT

pytest.importorskip(
    "hatchling", reason="hatchling, which packs the project, is not installed: pip install -e '.[test]'"
)
pytest.importorskip("hatch_fancy_pypi_readme", reason="it is not installed: pip install -e '.[test]'")
from hatchling.builders.sdist import SdistBuilder
from hatchling.builders.wheel import WheelBuilder
from hatchling.metadata.core import ProjectMetadata
from hatchling.plugin.manager import PluginManager

LEFT_OUT: set[str] = set()
"""Files of git that the source distribution does not hold."""
SHIPPED = "fmu_didim/shipped/"


def packed(builder: Any) -> dict[str, str]:
    """Path in the package that is built -> path in the project."""
    found = builder(str(ROOT)).recurse_included_files()
    return {
        PurePosixPath(Path(f.distribution_path)).as_posix(): Path(f.path).relative_to(ROOT).as_posix() for f in found
    }


@pytest.fixture(scope="module")
def metadata() -> Any:
    found = ProjectMetadata(str(ROOT), PluginManager())
    assert found.core is not None
    return found


def test_the_wheel_holds_every_file_of_the_package() -> None:
    files = {path for path in (ROOT / "fmu_didim").rglob("*") if path.is_file() and path.suffix != ".pyc"}
    wheel = packed(WheelBuilder)
    assert len([path for path in files if path.suffix != ".py"]) > 10
    assert {path.relative_to(ROOT).as_posix() for path in files} == {p for p in wheel if not p.startswith(SHIPPED)}


def test_the_wheel_holds_the_examples_and_nothing_else_of_the_project(tmp_path: Path) -> None:
    """All that an example is written from; what none leads to would only be carried."""
    wheel = packed(WheelBuilder)
    names = {name.name for example in examples() for name in write_example(example, tmp_path / example).files}
    shipped = {path: source for path, source in wheel.items() if path.startswith(SHIPPED)}
    assert shipped == {SHIPPED + source: source for source in shipped.values()}
    assert {PurePosixPath(path).name for path in shipped} == names | {PurePosixPath(INDEX).name}


def test_every_folder_with_modules_is_a_package() -> None:
    folders = {path.parent for path in Path(ROOT / "fmu_didim").rglob("*.py")}
    assert not [str(folder) for folder in folders if not (folder / "__init__.py").is_file()]


def test_the_source_distribution_holds_what_git_does() -> None:
    """Also what tests, documentation and the gate need; a new folder at the top must be named in pyproject.toml."""
    if not (ROOT / ".git").exists():
        pytest.skip("no checkout of git: its files are not known")
    listed = subprocess.run(["git", "-C", str(ROOT), "ls-files", "-z"], capture_output=True, check=True)
    tracked = {name for name in listed.stdout.decode("utf-8").split("\0") if name and (ROOT / name).is_file()}
    held = set(packed(SdistBuilder).values())
    assert tracked - held == LEFT_OUT
    assert len(tracked) > 500


def test_the_long_description_has_no_relative_link(metadata: Any) -> None:
    """An index shows the README without the files that it leads to; each link goes to one of the project."""
    home = metadata.core.urls["Homepage"]
    text = re.sub(r"```.*?```", "", metadata.core.readme, flags=re.S)
    links = re.findall(r"\]\(([^)\s]+)\)", text)
    own = re.findall(r"\]\(([^)\s:]+)\)", re.sub(r"```.*?```", "", (ROOT / "README.md").read_text("utf-8"), flags=re.S))
    assert len(own) > 20
    assert [link for link in links if not link.startswith("https://")] == []
    inside = [re.sub(rf"^{re.escape(home)}/(blob|raw)/HEAD/", "", link) for link in links]
    assert [link for link in inside if link in own] == own
    assert metadata.core.readme_content_type == "text/markdown"


def test_one_address_of_the_project(metadata: Any) -> None:
    """The tables of pyproject.toml that need it, and the citation, name the same one."""
    home = metadata.core.urls["Homepage"]
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert set(re.findall(r"https://github\.com/[\w-]+/[\w-]+", text)) == {home}
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))["repository-code"] == home
    for name, url in metadata.core.urls.items():
        place = url.removeprefix(f"{home}/blob/HEAD/")
        assert url in (home, f"{home}/issues") or (ROOT / place).is_file(), name


def test_what_says_who_it_is_for(metadata: Any) -> None:
    """Valid names of classifiers are known to hatchling, which refuses others."""
    assert metadata.version == __version__
    assert metadata.core.license_expression == "BSD-3-Clause"
    versions = [
        c.rpartition(" ")[2] for c in metadata.core.classifiers if c.startswith("Programming Language :: Python :: 3.")
    ]
    assert versions[0] == metadata.core.requires_python.removeprefix(">=")
    assert not [c for c in metadata.core.classifiers if c.startswith("License ::")]  # beside an expression none may be


def test_the_citation_is_of_this_version(metadata: Any) -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["cff-version"] == "1.2.0"
    assert (cited["title"], cited["version"], cited["license"]) == ("fmu_didim", __version__, "BSD-3-Clause")
    (author,) = cited["authors"]
    holder = re.search(r"Copyright \(c\) \d+, (.+)", (ROOT / "LICENSE").read_text(encoding="utf-8"))
    assert holder is not None
    assert author["name"].lower() == holder[1].lower()
    sources = " ".join((ROOT / "README.md").read_text(encoding="utf-8").partition("## Sources")[2].split())
    titles = [reference["title"] for reference in cited["references"]]
    assert len([title for title in titles if title in sources]) >= 3
