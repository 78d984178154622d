"""The content of a report, as data: a list of sections, which :mod:`terminal` prints and :mod:`page` writes as HTML.

A section consists of blocks: tables, facts, lists, texts, charts. A part that only one of the two shows says so by
``shown``; the terminal leaves out charts, matrices and folded blocks. To show one more figure of a result,
add a row to a section: it appears on both.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from markupsafe import Markup

from fmu_didim.report.drawing.charts import Chart
from fmu_didim.report.drawing.skeleton import Skeleton
from fmu_didim.report.numbers import MISSING, decimal_aligned
from fmu_didim.report.verdict import Banner

Shown = Literal["both", "terminal", "page"]
MOST_VALUES = 14
"""[columns] Widest matrix whose values are written in its cells."""
STRONGEST = 60
"""[percent] Colour strength of the largest value of a matrix: text on it stays legible."""
_PLACE = re.compile(r"^(?:[^:]{1,40}: )?(?:joint \d+: )?")
"""An experiment, a joint or both, at the beginning of a remark."""
_NUMBER = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Bar:
    """A bar beside a number; lengths in percent of the longest one.

    Attributes:
        style: ``good``, ``doubtful``, ``refused``, or ``final``; former: how long it was before, drawn hatched.
    """

    style: str
    length: float
    former: float = 0.0


@dataclass(frozen=True)
class Link:
    """A link to a place on the page or to a file beside it; plain text where ``target`` is empty."""

    text: str
    target: str = ""
    hint: str = ""


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        texts: of the cells; marks: follow the texts, such as a star; is_text: aligned at the left.
        limit: most characters on the terminal; shrinks: cut off there if the table would be too wide.
        page_head: a longer head for the page.
        bars: drawn beside the texts; links: of each cell, which the page shows in place of its text.
    """

    head: str
    texts: Sequence[str]
    is_text: bool = False
    shown: Shown = "both"
    marks: Sequence[str] = ()
    limit: int | None = None
    shrinks: bool = False
    page_head: str = ""
    bars: Sequence[Bar | None] = ()
    links: Sequence[Sequence[Link]] = ()


@dataclass(frozen=True)
class Table:
    """Columns beside each other.

    Attributes:
        groups: head of each group of rows, empty or not, and how many rows it has.
        chosen: rows in bold; anchors: the id of each row, for links.
    """

    kind: ClassVar[str] = "table"
    columns: Sequence[Column]
    groups: Sequence[tuple[str, int]] = ()
    shown: Shown = "both"
    chosen: Sequence[int] = ()
    anchors: Sequence[str] = ()

    def __bool__(self) -> bool:
        return any(column.texts for column in self.columns)

    def on(self, place: Shown) -> list[Column]:
        """The columns that the terminal or the page shows."""
        return [column for column in self.columns if column.shown in ("both", place)]


@dataclass(frozen=True)
class Fact:
    """A head and a text."""

    head: str
    text: str
    shown: Shown = "both"


@dataclass(frozen=True)
class Facts:
    """Heads and texts in two columns."""

    kind: ClassVar[str] = "facts"
    facts: Sequence[Fact]
    shown: Shown = "both"

    def __bool__(self) -> bool:
        return bool(self.facts)

    def on(self, place: Shown) -> list[Fact]:
        """The facts that the terminal or the page shows."""
        return [fact for fact in self.facts if fact.shown in ("both", place)]


@dataclass(frozen=True)
class Items:
    """A list.

    Attributes:
        links: to a file, at the end of each item, or none; is_code: formulas.
        limit: most items on the terminal; empty: text of the page where there are no items.
    """

    kind: ClassVar[str] = "items"
    items: Sequence[str]
    links: Sequence[Link] = ()
    is_code: bool = False
    limit: int | None = None
    empty: str = ""
    shown: Shown = "both"

    def __bool__(self) -> bool:
        return bool(self.items or self.empty)


@dataclass(frozen=True)
class Text:
    """A paragraph; ``style``: ``note`` (small print), ``code`` or empty."""

    kind: ClassVar[str] = "text"
    text: str
    style: str = ""
    shown: Shown = "both"

    def __bool__(self) -> bool:
        return bool(self.text)


@dataclass(frozen=True)
class Charts:
    """Charts, below each other or in a grid."""

    kind: ClassVar[str] = "charts"
    charts: Sequence[Chart]
    in_grid: bool = False
    shown: ClassVar[Shown] = "page"

    def __bool__(self) -> bool:
        return bool(self.charts)


@dataclass(frozen=True)
class MatrixCell:
    """A value of a matrix: its text, its sign, and its colour in percent of the strongest."""

    text: str
    sign: int
    size: int


@dataclass(frozen=True)
class Matrix:
    """Values over two lists of names as a map of colours, two hues for two signs.

    Attributes:
        shows_values: whether the cells show their texts; else the text appears under the pointer.
    """

    kind: ClassVar[str] = "matrix"
    shown: ClassVar[Shown] = "page"
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[MatrixCell, ...]], ...]
    shows_values: bool


@dataclass(frozen=True)
class Drawing:
    """A drawing in SVG."""

    kind: ClassVar[str] = "drawing"
    svg: Markup | None
    shown: ClassVar[Shown] = "page"

    def __bool__(self) -> bool:
        return self.svg is not None


@dataclass(frozen=True)
class Moving:
    """A robot that moves."""

    kind: ClassVar[str] = "moving"
    skeleton: Skeleton
    shown: ClassVar[Shown] = "page"


@dataclass(frozen=True)
class Tree:
    """Nested keys and values."""

    kind: ClassVar[str] = "tree"
    content: Mapping[str, Any]
    shown: ClassVar[Shown] = "page"

    def __bool__(self) -> bool:
        return bool(self.content)


@dataclass(frozen=True)
class Folded:
    """A block that the page unfolds on demand; ``is_printed``: also on paper."""

    kind: ClassVar[str] = "folded"
    summary: str
    block: Block
    is_open: bool = False
    is_printed: bool = True
    shown: ClassVar[Shown] = "page"

    def __bool__(self) -> bool:
        return bool(self.block)


Block = Table | Facts | Items | Text | Charts | Matrix | Drawing | Moving | Tree | Folded


@dataclass(frozen=True)
class Section:
    """A part of a report.

    Attributes:
        anchor: its id on the page, listed in the navigation; without one it is part of the section before.
        has_title: whether the terminal prints the heading; tables explain themselves by their heads.
        is_brief: whether a notebook shows it; is_framed: whether the page draws a frame around it.
    """

    heading: str
    blocks: Sequence[Block]
    anchor: str = ""
    has_title: bool = False
    is_brief: bool = False
    is_framed: bool = False

    def on(self, place: Shown) -> list[Block]:
        """The blocks that the terminal or the page shows; none if they are only notes."""
        found = [block for block in self.blocks if block and block.shown in ("both", place)]
        return found if any(not isinstance(block, Text) or not block.style for block in found) else []


@dataclass(frozen=True)
class Report:
    """All that a report says.

    Attributes:
        name: of the case; title: first line on the terminal; what: added to the title of the page.
        subtitles: below the name on the page; banner: the verdict; verdict_first: whether the terminal starts with it.
        cards: heads and values at the top of the page; remarks: below the first section, on the terminal
            with the verdict.
    """

    name: str
    title: str
    banner: Banner
    sections: Sequence[Section]
    what: str = ""
    description: str = ""
    subtitles: Sequence[str] = ()
    verdict_first: bool = False
    cards: Sequence[tuple[str, str]] = ()
    remarks: Sequence[str] = ()
    provenance: Mapping[str, Any] | None = None

    @property
    def charts(self) -> list[Chart]:
        """All charts of its sections."""
        blocks = (block for section in self.sections for block in section.blocks)
        return [chart for block in blocks if isinstance(block, Charts) for chart in block.charts]

    @property
    def remark_groups(self) -> list[tuple[str, list[str]]]:
        """The first remark of each kind, and the others that differ from it by numbers and places alone."""
        kinds: dict[str, list[str]] = {}
        for remark in self.remarks:
            kinds.setdefault(_NUMBER.sub("#", _PLACE.sub("", remark)), []).append(remark)
        return [(first, others) for first, *others in kinds.values()]

    def on(self, place: Shown) -> list[Section]:
        """The sections with content for the terminal or the page, and the headings above them."""
        kept: list[Section] = []
        for section in reversed(self.sections):
            holds = section.anchor and place == "page" and kept and not kept[0].anchor
            if section.on(place) or holds:
                kept.insert(0, section)
        return kept


def numbers(head: str, texts: Sequence[str], **options: Any) -> Column:
    """A column of numbers with decimal points below each other; options as of :class:`Column`."""
    return Column(head, decimal_aligned(texts), **options)


def words(head: str, texts: Sequence[str], **options: Any) -> Column:
    """A column of words; options as of :class:`Column`."""
    return Column(head, texts, is_text=True, **options)


def note(text: str) -> Text:
    """Small print of the page."""
    return Text(text, "note", "page")


def matrix(
    title: str, columns: Sequence[str], rows: Mapping[str, Sequence[float | None]], *, largest: float, digits: int = 2
) -> Matrix:
    """A matrix whose colours reach their full strength at a magnitude ``largest``."""

    def cell(value: float | None) -> MatrixCell:
        if value is None or not math.isfinite(value):
            return MatrixCell(MISSING, 1, 0)
        size = min(round(STRONGEST * abs(value) / largest), STRONGEST)
        text = f"{value:.{digits}f}"
        return MatrixCell(text if float(text) else text.removeprefix("-"), 1 if value >= 0 else -1, size)

    filled = tuple((name, tuple(cell(value) for value in values)) for name, values in rows.items())
    return Matrix(title, tuple(columns), filled, len(columns) <= MOST_VALUES)
