"""What a new user looks for and where: the home page, per cent, URDF, how to cite, what Ctrl-C leaves, test times."""

from __future__ import annotations

import re

import pytest
import yaml

from fmu_didim import __version__
from tests.conftest import ROOT

USERS = (
    "engineer with a robot",
    "control engineer",
    "Modelica",
    "any other FMU",
    "researcher",
    "why a model does not fit",
)


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_the_home_page_has_a_picture_and_a_sentence_for_each_kind_of_user() -> None:
    page = text("docs/index.md")
    (picture,) = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", page)
    assert (ROOT / "docs" / picture).is_file()
    rows = page.partition("| you are |")[2].partition("\n\n")[0].splitlines()[2:]
    assert len(rows) == len(USERS)
    for user, row in zip(USERS, rows, strict=True):
        _, who, what, _ = row.split("|")
        assert user in who
        links = re.findall(r"\]\(([^)#]+)", what)
        assert links and all((ROOT / "docs" / link).is_file() for link in links)


@pytest.mark.parametrize(
    ("page", "words"),
    [
        ("docs/howto/own-data.md", ("Per cent", "rated:", "CiA 402")),
        ("docs/robot.md", ("URDF", "robot: arm.urdf", "--tip LINK")),
        ("docs/index.md", ("How to cite", "CITATION.cff")),
        ("docs/case.md", ("Ctrl-C",)),
        ("docs/howto/campaigns.md", ("Ctrl-C", "finished runs are kept")),
        ("README.md", ("four minutes on two cores", ".ci/run")),
        ("CONTRIBUTING.md", ("four minutes on two cores", "15 minutes")),
        ("docs/trust.md", ("Dask", "no authentication")),
    ],
)
def test_it_is_found(page: str, words: tuple[str, ...]) -> None:
    assert [word for word in words if word not in text(page)] == []


def test_the_citation_is_whole() -> None:
    citation = yaml.safe_load(text("CITATION.cff"))
    assert citation["version"] == __version__
    assert {"title", "authors", "license", "references", "cff-version"} <= set(citation)
