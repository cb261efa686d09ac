"""Check that the search of the built site finds the page of each question of docs/questions.md.

`python docs/check_search.py site`. The index is that of the site; the ranking is BM25 with a
weight on titles, as lunr.js computes it in the browser, and a page counts by its best section.
"""

import json
import re
import sys
from collections import Counter
from math import log
from pathlib import Path

QUESTIONS = Path(__file__).with_name("questions.md")
PLACES = 10  # results of the first screens
_K1, _B, _TITLE = 1.2, 0.75, 5  # constants of BM25; occurrences that one in a title counts for
_COMMON = {"how", "the", "and", "its", "for", "does", "are", "with", "that", "which", "why"}


def terms(text: str) -> list[str]:
    """Return the words of a text without its tags, each cut to a stem of five letters."""
    words = re.findall(r"[a-z0-9]{3,}", re.sub(r"<[^>]*>", " ", text).lower())
    return [word[:5] for word in words if word not in _COMMON]


def ranked_pages(index: list[dict[str, str]], question: str) -> list[str]:
    """Return the pages of an index by their best section, best first, as paths of Markdown."""
    sections = [Counter(terms(f"{e['title']} " * _TITLE + e["text"])) for e in index]
    mean = sum(map(Counter.total, sections)) / len(sections)
    score: Counter[str] = Counter()
    wanted = {term: sum(term in section for section in sections) for term in terms(question)}
    for entry, section in zip(index, sections, strict=True):
        length = 1.0 - _B + _B * section.total() / mean
        points = sum(
            log(1.0 + (len(sections) - n + 0.5) / (n + 0.5))
            * section[term] * (_K1 + 1.0) / (section[term] + _K1 * length)
            for term, n in wanted.items()
        )  # fmt: skip
        page = entry["location"].partition("#")[0].removesuffix(".html") + ".md"
        score[page] = max(score[page], points)  # type: ignore[assignment]
    return [page for page, _ in score.most_common() if page != QUESTIONS.name]


def main(site: Path) -> int:
    """Print the questions that are not found; return how many there are."""
    index = json.loads((site / "search" / "search_index.json").read_text(encoding="utf-8"))["docs"]
    rows = re.findall(r"^\| (.+\?) \| \[.*\]\((.+\.md)#?.*\) \|$", QUESTIONS.read_text(), re.M)
    lost = 0
    for question, page in rows:
        found = ranked_pages(index, question)
        if page not in found[:PLACES]:
            lost += 1
            print(f"{question} {page} is result {found.index(page) + 1}, after {found[:3]}")
    print(f"{len(rows) - lost} of {len(rows)} questions lead to their page in {PLACES} results")
    return lost


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])) > 0)
