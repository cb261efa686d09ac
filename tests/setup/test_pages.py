"""README and pages: the commands, options, files and links that they name are there."""

import re
import shlex
import tomllib
from itertools import takewhile
from pathlib import Path

import pytest
import typer.main

from flexslew_lab.cli.main import app
from flexslew_lab.reproduce import REPRODUCTIONS
from flexslew_plant.yaml_data import load_yaml

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def commands(page: Path) -> list[list[str]]:
    """Return the words of each `./flexslew ...` of a page, in blocks and between backticks."""
    prose, *fenced = page.read_text().split("```")
    blocks, between = fenced[::2], [prose, *fenced[1::2]]
    found = [line for block in blocks for line in block.splitlines()]
    text = "\n".join(between)
    found += re.findall(r"`([^`\n]+)`", text)
    lines = [
        line.partition("./flexslew ")[2].partition(" # ")[0]
        for line in found
        if "./flexslew " in line
    ]
    return [first_command(line) for line in lines]


def first_command(line: str) -> list[str]:
    """Return the words up to a comma, semicolon or pipe outside of quotes."""
    words = shlex.shlex(line, posix=True, punctuation_chars=",;|")
    words.whitespace_split, words.commenters = True, ""
    return list(takewhile(lambda word: not set(word) <= set(",;|"), words))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_of_a_page_exists_with_its_options(page: Path) -> None:
    for words in commands(page):
        place = typer.main.get_command(app)
        while words and hasattr(place, "commands") and not words[0].startswith("-"):
            assert words[0] in place.commands, f"{page.name}: {' '.join(words)}"
            place, words = place.commands[words[0]], words[1:]
        options = {option for param in place.params for option in param.opts} | {"--help"}
        if place.name == "test":  # the rest goes to pytest
            continue
        for word in takewhile(lambda word: word != "--", words):
            if word.startswith("--"):
                assert word.split("=")[0] in options, f"{page.name}: {word} of {place.name}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_to_a_file_leads_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text()):
        if not target.startswith("reference/") and "/reference/" not in target:  # made by the site
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def sections(page: Path) -> dict[str, str]:
    """Return the text of a page below each heading, by the anchor of the site; "" is the page."""
    fence = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)  # whose comments are no headings
    text = fence.sub(lambda match: match[0].replace("\n#", "\n #"), page.read_text())
    parts = re.split(r"^(#+ .*)$", text, flags=re.MULTILINE)
    return {"": page.read_text()} | {
        re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", heading).strip().lower()): heading + body
        for heading, body in zip(parts[1::2], parts[2::2], strict=True)
    }


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_to_a_heading_leads_to_one(page: Path) -> None:
    for target, anchor in re.findall(r"\]\(([^)#:\s]*)#([^)\s]+)\)", page.read_text()):
        if "reference/" not in target:  # made by the site
            linked = page.parent / target if target else page
            assert anchor in sections(linked), f"{page.name}: {target}#{anchor}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_table_ends_with_an_empty_line(page: Path) -> None:
    """Without one the site shows the next line, even a heading, as a row of the table."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    for row, after in re.findall(r"^(\|.*)\n([^|\n].*)$", text, re.MULTILINE):
        raise AssertionError(f"{page.name}: {after!r} follows {row!r}")


SMALL_WORDS = {"with", "from", "which", "large", "does", "many", "write", "about"}


def test_the_section_that_answers_a_question_contains_its_words() -> None:
    """The search of the site finds a section by its words."""
    page = ROOT / "docs/questions.md"
    questions = re.findall(r"^\| (.+)\? \| \[.*\]\((.+\.md)#?(.*)\) \|$", page.read_text(), re.M)
    assert len(questions) >= 30
    for question, target, anchor in questions:
        text = sections(page.parent / target)[anchor].lower()
        title = page.parent.joinpath(target).read_text().partition("\n")[0].lower()
        for word in set(re.findall(r"[a-z]{4,}", question.lower())) - SMALL_WORDS:
            assert word[:4] in text + title, f"{question}: {word} in {target}#{anchor}"


def test_files_of_the_source_tree_that_a_page_names_exist() -> None:
    for page in PAGES:
        for path in re.findall(
            r"(?<![\w/])(?:ros2_ws/src|setup|docker|docs/examples|tests|benchmarks)/[\w./-]+\w",
            page.read_text(),
        ):
            assert (ROOT / path).exists(), f"{page.name}: {path}"


def test_every_paper_that_is_computed_again_is_in_its_table_and_in_the_help() -> None:
    page = (ROOT / "docs/reproduce.md").read_text()
    command = typer.main.get_command(app).commands["reproduce"]  # type: ignore[attr-defined]
    told = next(param.help for param in command.params if param.name == "name")
    for name, entry in REPRODUCTIONS.items():
        row = next(line for line in page.splitlines() if line.startswith(f"| `{name}` |"))
        assert ("| none |" in row) == (not entry.figures_name)
        assert f"{name}: {entry.about}" in told


def test_the_readme_stays_short() -> None:
    assert len((ROOT / "README.md").read_text().splitlines()) <= 120


def test_what_is_cited_is_this_version() -> None:
    cited = load_yaml((ROOT / "CITATION.cff").read_text(), "CITATION.cff")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    for key, own in (("title", "name"), ("version", "version"), ("license", "license")):
        assert cited[key] == project[own]


def test_every_page_is_in_the_navigation_of_the_site() -> None:
    navigation = (ROOT / "mkdocs.yml").read_text().partition("\nnav:")[2]
    docs = ROOT / "docs"
    for page in [*docs.rglob("*.md"), *(docs / "notebooks").glob("*.py")]:
        assert f" {page.relative_to(docs)}\n" in navigation, page
