"""A page made of sections: texts, tables and panels, in one HTML file that needs nothing else."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple, TypeAlias

from flexslew_lab.report.page import render
from flexslew_lab.report.panels import Group


class Text(NamedTuple):
    """A paragraph; one without words is left out."""

    title: str
    words: str
    verdict: str = ""  # good or bad, for its colour


class Table(NamedTuple):
    """A table; one without rows is left out."""

    title: str
    words: str  # how it is read
    columns: Sequence[str]  # none: the cells are words
    rows: Sequence[Sequence[object]]
    note: str = ""
    colours: Sequence[str] = ()  # of the rows in the figures, if they have one


Section: TypeAlias = Text | Table | Group


def page_of_sections(
    kind: str, title: str, description: str, sections: Iterable[Section], verdict: str = ""
) -> str:
    """Return a page with all sections that have content.

    Args:
        kind: of page.
        title: at its top.
        description: what it shows.
        sections: in their order.
        verdict: the result in a sentence or two, above all else.
    """
    visible = [section for section in sections if _has_content(section)]
    return render("sections.html.j2", kind=kind, title=title, about=description, sections=visible,
                  verdict=verdict)  # fmt: skip


def _has_content(section: Section) -> bool:
    if isinstance(section, Group):
        return bool(section.panels)
    return bool(section.rows if isinstance(section, Table) else section.words)
