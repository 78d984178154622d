"""Puts the figures of docs/figures into the pages and the README.

    python docs/include.py

A page holds a figure between ``<!-- figure: FILE.NAME -->`` and ``<!-- /figure -->``, which no reader sees: in a line,
or, where the figure is a list of lines, as a block. ``docs/figures/FILE.json`` was written by the command that it
names (``tests/figures.py``). A test says when a page does not show what the files hold.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

DOCS = Path(__file__).parent
FOLDER = DOCS / "figures"
GENERATED = DOCS / "reference"
"""Pages that ``make_reference.py`` writes, from the package alone."""
MARKED = re.compile(r"<!-- figure: (\S+) -->(.*?)<!-- /figure -->", re.S)
BEGIN, END = "<!-- figure:", "<!-- /figure -->"
FENCED = re.compile(r"^```.*?^```$", re.M | re.S)
BLOCK_BEFORE = re.compile(r"(?:^|\n)[ >]*(?:[-*+] |\d+[.)] )?[ ]*$")
"""What stands before the first word of a line: a comment there begins a block, and hides what follows on its line."""

Figures = Mapping[str, str | Sequence[str]]


class MarkerError(Exception):
    """A marker of a page cannot be filled."""


def main() -> list[Path]:
    """Fill all pages; returns those that have changed."""
    known, changed = figures(), []
    for page in pages():
        text = page.read_text(encoding="utf-8")
        new = filled(text, known, page.name)
        if new != text:
            page.write_text(new, encoding="utf-8")
            changed.append(page)
    return changed


def pages() -> Iterator[Path]:
    """The README and all pages that are written by hand."""
    yield DOCS.parent / "README.md"
    yield from (path for path in sorted(DOCS.rglob("*.md")) if GENERATED not in path.parents)


def figures(folder: Path = FOLDER) -> dict[str, str | Sequence[str]]:
    """``FILE.NAME`` -> text, or lines of a block; ``FILE.command``, ``FILE.date`` and ``FILE.machine`` among them."""
    found: dict[str, str | Sequence[str]] = {}
    for path in sorted(folder.glob("*.json")):
        content = json.loads(path.read_text(encoding="utf-8"))
        own = {"command": f"`{content['command']}`", "date": content["date"], "machine": content["machine"]}
        found |= {f"{path.stem}.{name}": value for name, value in {**own, **content["figures"]}.items()}
    return found


def filled(text: str, known: Figures, page: str) -> str:
    """The text of a page with its figures.

    Raises:
        MarkerError: a marker names no figure, has no end, stands in a block of code, or would hide what it holds.
    """
    if text.count(BEGIN) != text.count(END) or text.count(BEGIN) != len(MARKED.findall(text)):
        raise MarkerError(
            f"{page}: {text.count(BEGIN)} figures begin and {text.count(END)} end. Each is written as "
            f"'{BEGIN} FILE.NAME -->...{END}', none inside another."
        )
    for block in FENCED.findall(text):
        if BEGIN in block:
            raise MarkerError(f"{page}: a figure stands in a block of code, where its marker is seen:\n{block}")
    return MARKED.sub(lambda match: _marked(match, text, known, page), text)


def _marked(match: re.Match[str], text: str, known: Figures, page: str) -> str:
    name = match[1]
    if name not in known:
        file = name.partition(".")[0]
        valid = [other for other in known if other.partition(".")[0] == file] or sorted(
            {n.split(".")[0] for n in known}
        )
        raise MarkerError(f"{page}: no figure is called '{name}'. Valid: {', '.join(valid)}. See docs/figures.")
    value, starts_line = known[name], bool(BLOCK_BEFORE.search(text[: match.start()]))
    if isinstance(value, str):
        if starts_line:
            raise MarkerError(
                f"{page}: the marker of '{name}' is the first of its line, which hides the line; put a word before it."
            )
        return f"{BEGIN} {name} -->{value}{END}"
    if not starts_line:
        raise MarkerError(f"{page}: '{name}' is a block of lines; its marker must stand alone on a line.")
    return "\n".join([f"{BEGIN} {name} -->", "", *value, "", END])


if __name__ == "__main__":
    for written in main():
        print(written)
