"""The report: one file, whatever the bag holds."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flexslew_lab.report.report import write_report
from flexslew_lab.report.run_data import LOT, Thinner, read_run
from flexslew_plant.errors import BadInput

Message = tuple[str, bytes, int]
Write = Callable[..., Path]


@pytest.fixture(scope="module")
def page(bag: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    out = tmp_path_factory.mktemp("report") / "report.html"
    return write_report([bag], out).read_text()


def figures_in(page: str) -> dict[str, dict]:  # type: ignore[type-arg]
    pattern = r'<script type="application/json" data-figure="([^"]+)">(.*?)</script>'
    return {name: json.loads(text) for name, text in re.findall(pattern, page, re.DOTALL)}


def test_the_page_needs_nothing_from_outside(page: str) -> None:
    assert not re.search(r'<(script|link|img|iframe)[^>]*\s(src|href)="', page)
    assert page.count("plotly.js v") == 1


def test_every_figure_is_there(page: str) -> None:
    assert sorted(figures_in(page)) == [
        "estimate-against-truth-0",
        "terms-of-the-effort-0",
        "the-manoeuvre-0",
        "who-is-in-charge-0",
    ]


def test_what_a_reader_looks_for_is_on_the_page(page: str) -> None:
    for text in ("synthetic", "optimized_feedforward", "ab" * 32, "switched", "name: synthetic"):
        assert text in page
    assert "<code>settling_time.hub_pitch</code>" in page
    assert "no valid answer from pi" in page


def test_the_animation_holds_poses_and_shapes(page: str) -> None:
    found = re.search(r'id="scenes">(.*?)</script>', page, re.DOTALL)
    assert found
    (scene,) = json.loads(found.group(1))
    assert len(scene["beams"]) == 2
    assert len(scene["poses"]) == len(scene["time"]) == len(scene["modes"]) > 200
    pose = np.array(scene["poses"][-1])
    rotation = pose[:9].reshape(3, 3)
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4)
    assert np.arctan2(-rotation[0, 1], rotation[1, 1]) == pytest.approx(1.0, abs=1e-3)
    tip = np.array(scene["beams"][0]["shapes"])[:, -1]
    assert np.allclose(tip, [[0, 1, 0], [0, 1, 0]], atol=1e-3)


def test_runs_are_overlaid_and_compared(
    bag: Path, tmp_path: Path, write_bag: Write, messages: list[Message]
) -> None:
    without = write_bag(tmp_path / "without", messages[: len(messages) // 2])
    page = write_report([bag, without], tmp_path / "a.html", comparison=without).read_text()
    figures = figures_in(page)
    assert "with-and-without-feedforward-0" in figures
    names = {trace["name"] for trace in figures["the-manoeuvre-0"]["data"]}
    assert {"synthetic (run)", "synthetic (without)"} <= names


def test_a_bag_with_truth_alone_still_gives_a_report(
    tmp_path: Path, write_bag: Write, messages: list[Message]
) -> None:
    folder = write_bag(tmp_path / "run", [m for m in messages if m[0] == "/truth"])
    page = write_report([folder], tmp_path / "report.html").read_text()
    assert "No plan in this log." in page


def test_a_cut_log_is_announced(tmp_path: Path, write_bag: Write) -> None:
    folder = write_bag(tmp_path / "run")
    file = next(folder.glob("*.mcap"))
    file.write_bytes(file.read_bytes()[:-5000])
    page = write_report([folder], tmp_path / "report.html").read_text()
    assert "is cut:" in page


def test_text_from_the_log_cannot_become_markup(
    tmp_path: Path, write_bag: Write, messages: list[Message]
) -> None:
    from flexslew_lab.log.cdr import encode

    kind = "flexslew_msgs/msg/Event"
    evil = encode(kind, {"kind": "switched", "message": "</script><b>", "data": "{}"})
    folder = write_bag(tmp_path / "run", [*messages, ("/events", evil, 0)])
    assert "</script><b>" not in write_report([folder], tmp_path / "r.html").read_text()


def test_a_report_of_nothing_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="no such bag"):
        write_report([tmp_path / "nothing"], tmp_path / "report.html")
    assert not (tmp_path / "report.html").exists()


def test_thinning_keeps_extremes_and_breaks() -> None:
    t = np.arange(10_000, dtype=np.float64) * 0.01
    y = np.sin(t)[:, None] * [1.0, -2.0]
    y[1234, 0] = 7.0
    thinner = Thinner(100)
    for start in range(0, 10_000, 77):
        thinner.add(t[start : start + 77], y[start : start + 77])
    trace = thinner.trace()
    assert 190 <= len(trace.time) <= 210
    assert trace.value[:, 0].max() == 7.0
    assert trace.time[trace.value[:, 0].argmax(), 0] == t[1234]
    assert (np.diff(trace.time, axis=0) >= 0).all()


def test_phases_say_who_was_in_charge(bag: Path) -> None:
    phases = read_run(bag).phases
    assert [(p.controller, round(p.start, 2), round(p.end, 2)) for p in phases] == [
        ("pd_feedforward", 0.0, 3.0),
        ("pi", 3.0, 5.0),
    ]


@pytest.mark.parametrize("size", [3, 7000])
def test_what_waits_to_be_thinned_does_not_grow_with_the_run(size: int) -> None:
    thinner, lot = Thinner(size), 100
    for k in range(2000):
        time = np.arange(k * lot, (k + 1) * lot, dtype=float)
        thinner.add(time, np.sin(time)[:, None])
        assert sum(len(rows) for rows, _ in thinner._pending) <= max(LOT, size) + lot
    time = np.arange(2000 * lot, dtype=float)
    kept = np.sort(thinner.trace().value[:, 0])
    buckets = np.split(np.sin(time), range(size, len(time), size))
    extremes = np.sort([x for b in buckets for x in (b.min(), b.max())])
    assert np.array_equal(kept, extremes)
