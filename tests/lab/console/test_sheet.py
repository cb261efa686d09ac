"""The colours of the page can be read in both schemes."""

import re

import pytest

from flexslew_lab.console.sheet import PRIMARY, SHEET

LEAST = 4.5  # contrast of text, WCAG 2.1 AA
PAIRS = [
    *((text, ground) for text in ("text", "dim", "refused", "good", "link")
      for ground in ("panel", "page")),
    ("on-notice", "notice"),
]  # fmt: skip


def luminance(color: str) -> float:
    parts = [int(color[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [p / 12.92 if p <= 0.03928 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    low, high = sorted(map(luminance, (one, other)))
    return (high + 0.05) / (low + 0.05)


def scheme(name: str) -> dict[str, str]:
    light, dark = (
        dict(re.findall(r"--([a-z-]+): (#[0-9a-f]{6})", block))
        for block in re.findall(r":root \{(.*?)\}", SHEET, re.DOTALL)
    )
    assert light.keys() == dark.keys()
    return {"light": light, "dark": dark}[name]


@pytest.mark.parametrize("name", ["light", "dark"])
def test_all_text_has_the_contrast_of_aa(name: str) -> None:
    colors = scheme(name)
    pale = [pair for pair in PAIRS if contrast(*(colors[one] for one in pair)) < LEAST]
    assert pale == []


@pytest.mark.parametrize("ground", [PRIMARY, "#37474f", "#c10015", "#1b6e35"])
def test_white_on_a_button_has_the_contrast_of_aa(ground: str) -> None:
    assert contrast("#ffffff", ground) >= LEAST
