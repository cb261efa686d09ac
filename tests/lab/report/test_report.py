"""The report: one file, whatever the bag holds."""

import gzip
import json
import re
from base64 import b64decode
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.panel_numbers import numbers
from tests.present import present

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.messages.cdr import decode, encode
from flexslew_lab.report.report import write_report
from flexslew_lab.report.run_data import read_run
from flexslew_lab.report.thinning import BATCH, MinMaxSampler
from flexslew_plant.errors import BadInput

Message = tuple[str, bytes, int]
Write = Callable[..., Path]


@pytest.fixture(scope="module")
def page(bag: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    out = tmp_path_factory.mktemp("report") / "report.html"
    return write_report([bag], out).read_text()


def panels_in(page: str) -> dict[str, list[Any]]:
    pattern = r'<script type="application/json" data-panels="([^"]+)">(.*?)</script>'
    return {name: json.loads(text) for name, text in re.findall(pattern, page, re.DOTALL)}


def names_in(panels: list[Any]) -> set[str]:
    return {trace["name"] for panel in panels for trace in panel["data"]}


def titles_in(page: str) -> list[str]:
    found = re.findall(r'class="panel"><figcaption>(.*?)</figcaption>', page)
    return [re.sub(r"<[^>]+>", "", title).replace("\xa0", " ") for title in found]


def test_a_report_in_its_run_has_a_thumbnail_beside_it(bag: Path, tmp_path: Path) -> None:
    write_report([bag], tmp_path / "report.html")
    picture = ElementTree.fromstring((tmp_path / "thumbnail.svg").read_text())
    points = re.findall(r"(\d+) (\d+\.\d)", present(picture[1].get("d")))
    heights = [float(y) for _, y in points]
    assert len(points) == 120
    assert min(heights) == 2.0  # the largest deflection
    write_report([bag], tmp_path / "other" / "a.html")
    assert not (tmp_path / "other" / "thumbnail.svg").exists()


def test_the_page_needs_nothing_from_outside(page: str) -> None:
    assert not re.search(r'<(script|link|img|iframe)[^>]*\s(src|href)="', page)
    packed = re.findall(r'<script type="text/plain" id="plotly">([^<]*)</script>', page)
    assert len(packed) == 1
    assert b"plotly.js v" in gzip.decompress(b64decode(packed[0]))[:1000]


def test_every_group_is_there_and_none_is_empty(page: str) -> None:
    groups = panels_in(page)
    assert sorted(groups) == [
        "after-the-manoeuvre",
        "estimate-minus-truth",
        "modes",
        "terms-of-the-effort",
        "the-manoeuvre",
    ]
    for panels in groups.values():
        for panel in panels:
            assert panel["data"]
            for trace in panel["data"]:
                assert np.isfinite(numbers(trace["y"])).any()


def test_panels_are_named_after_the_testbed_of_the_run(page: str) -> None:
    titles = titles_in(page)
    for title in (
        "base_yaw [rad]", "tip deflection of negative [m]", "mode 2 [m]",
        "effort on hub_pitch, limit ±40 N m [N m]",
    ):  # fmt: skip
        assert title in titles


def test_the_residual_is_on_a_scale_of_its_own(page: str) -> None:
    panels = panels_in(page)["after-the-manoeuvre"]
    for panel in panels:
        assert panel["layout"]["yaxis"]["type"] == "log"
        low, high = panel["layout"]["xaxis"]["range"]
        assert (low, high) == (2.0, 5.0)
    tip = numbers(panels[-1]["data"][0]["y"])
    t = np.arange(200, 501) * 0.01
    assert tip.max() == pytest.approx(np.abs(0.3 * np.sin(2.0 * t)).max(), rel=1e-6)


def test_limits_are_always_drawn(page: str) -> None:
    for panel in panels_in(page)["the-manoeuvre"][-2:]:
        drawn = [s["y0"] for s in panel["layout"]["shapes"] if s["xref"] == "paper"]
        assert drawn == [-40.0, 40.0]


def test_what_a_reader_looks_for_is_on_the_page(page: str) -> None:
    for text in ("synthetic", "optimized_feedforward", "ab" * 32, "switched", "name: synthetic"):
        assert text in page.replace("<wbr>", "")
    assert "settling_time.hub_pitch" in page.replace("<wbr>", "")
    assert "no valid answer from pi" in page


def test_the_animation_holds_poses_and_shapes(page: str) -> None:
    found = re.search(r'id="scenes">(.*?)</script>', page, re.DOTALL)
    assert found
    (scene,) = json.loads(found.group(1))
    assert scene["joint_units"] == ["rad", "rad"]
    assert "scene.joint_units[j]" in page  # beside each number of a joint
    assert len(scene["beams"]) == 2
    assert len(scene["poses"][0]) == len(scene["time"]) == len(scene["modes"]) > 200
    pose = np.array(scene["poses"][0][-1])
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
    groups = panels_in(page)
    assert "with-and-without-feedforward" in groups
    assert {"synthetic (run)", "synthetic (without)"} <= names_in(groups["the-manoeuvre"])
    headlines = page[page.index('<div class="cards table">') :].split("</table>")[0]
    for label in ("synthetic (run)", "synthetic (without)", "without feedforward"):
        assert label in headlines


def test_a_run_has_one_colour_wherever_it_is_drawn(
    bag: Path, tmp_path: Path, write_bag: Write, messages: list[Message]
) -> None:
    second = write_bag(tmp_path / "second", messages[: len(messages) // 2])
    page = write_report([bag, second, bag], tmp_path / "a.html").read_text()
    colours: dict[str, set[str]] = {}
    for panels in panels_in(page).values():
        for panel in panels:
            for trace in panel["data"]:
                colours.setdefault(trace["name"], set()).add(trace["line"]["color"])
    runs = {name: found for name, found in colours.items() if name.startswith("synthetic")}
    assert len(runs) == 3
    assert all(len(found) == 1 for found in runs.values())
    assert len(set.union(*runs.values())) == 3


def test_every_joint_of_every_run_has_its_own_panel(
    bag: Path, tmp_path: Path, write_bag: Write, messages: list[Message]
) -> None:
    def renamed(message: Message) -> Message:
        topic, data, stamp = message
        if topic not in ("/testbed", "/plan"):
            return message
        values = {k: v for k, v in vars(decode(TOPICS[topic].type, data)).items()}
        values["joint_names"] = ["mast", "hub_pitch"]
        return topic, encode(TOPICS[topic].type, values), stamp

    other = write_bag(tmp_path / "other", [renamed(m) for m in messages])
    page = write_report([bag, other], tmp_path / "a.html").read_text()
    titles = titles_in(page)
    for title in ("base_yaw [rad]", "mast [rad]", "effort on mast, limit ±40 N m [N m]"):
        assert title in titles
    panels = dict(zip(titles, panels_in(page)["the-manoeuvre"], strict=False))
    names = {t["name"] for t in panels["effort on mast, limit ±40 N m [N m]"]["data"]}
    assert names & {"synthetic (run)", "synthetic (other)"} == {"synthetic (other)"}


def test_faults_and_disturbances_are_shaded_and_explained(
    tmp_path: Path, write_bag: Write, messages: list[Message]
) -> None:
    def said(tick: int, kind: str, **data: Any) -> Message:
        stamp = tick * 10**7
        values = {"stamp": stamp, "tick": tick, "level": 1, "source": "plant", "kind": kind,
                  "message": kind, "data": json.dumps(data)}  # fmt: skip
        return "/events", encode("flexslew_msgs/msg/Event", values), stamp

    fault = {"fault": {"kind": "sensor_bias", "channel": "joint_position", "bias": 0.1},
             "start": 50}  # fmt: skip
    some = [
        *messages,
        said(50, "fault", on=True, **fault),
        said(90, "fault", on=False, **fault),
        said(120, "disturbance", on=True, base_yaw=5.0),
    ]
    folder = write_bag(tmp_path / "run", some)
    spans = [(s.kind, s.start, s.end) for s in read_run(folder).spans]
    assert spans == [("fault", 0.5, 0.9), ("disturbance", 1.2, 5.0)]
    page = write_report([folder], tmp_path / "report.html").read_text()
    text = re.sub(r"<[^>]+>", "", page.replace("<wbr>", "")).replace("\xa0", " ")
    assert "sensor_bias (channel joint_position, bias 0.1), 0.5 to 0.9 s" in text
    assert "disturbance of 5 N m on base_yaw, 1.2 to 5 s" in text
    for panel in panels_in(page)["the-manoeuvre"]:
        shaded = [(s["x0"], s["x1"]) for s in panel["layout"]["shapes"] if s["type"] == "rect"]
        assert shaded == [(0.0, 2.0), (0.5, 0.9), (1.2, 5.0)]


def test_no_state_is_lost_between_estimate_and_truth(
    tmp_path: Path, write_bag: Write, messages: list[Message]
) -> None:
    states = [m for m in messages if m[0] == "/controller_state"]
    truths = [m for m in messages if m[0] == "/truth"]
    rest = [m for m in messages if m[0] not in ("/controller_state", "/truth")]
    for order in ([*states, *truths], [*truths, *states], [*states[:300], *truths, *states[300:]]):
        folder = write_bag(tmp_path / f"run{states.index(order[0]) if order[0] in states else 'x'}"
                           f"{len(list(tmp_path.iterdir()))}", [*rest, *order])  # fmt: skip
        error = read_run(folder).traces["estimate_error"]
        assert len(np.unique(error.time[:, 0])) == 501
        assert np.allclose(error.value, 0.001)


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
    thinner = MinMaxSampler(100)
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
    thinner, batch = MinMaxSampler(size), 100
    for k in range(2000):
        time = np.arange(k * batch, (k + 1) * batch, dtype=float)
        thinner.add(time, np.sin(time)[:, None])
        assert sum(len(rows) for rows, _ in thinner._pending) <= max(BATCH, size) + batch
    time = np.arange(2000 * batch, dtype=float)
    kept = np.sort(thinner.trace().value[:, 0])
    buckets = np.split(np.sin(time), range(size, len(time), size))
    extremes = np.sort([x for b in buckets for x in (b.min(), b.max())])
    assert np.array_equal(kept, extremes)
