"""The list of runs: key figures, filter, and what cannot be read."""

import errno
import fcntl
import json
import os
from collections.abc import Iterator
from pathlib import Path
from shutil import copytree
from threading import Thread
from typing import Any
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest
import yaml
from tests.browser import PALE, Browser, chromium, looked_at
from tests.lab.conftest import Call

from flexslew_lab.report.run_notes import TRASH, read_notes
from flexslew_lab.report.runs_index import runs_in, write_index
from flexslew_lab.report.runs_server import runs_server


def run(folder: Path, name: str, law: str, tip: float, **more: Any) -> None:
    (folder / name).mkdir()
    settling = {"yaw": 3.0, "pitch": 9.0}
    metrics = {"residual_tip_deflection": tip, "settling_time": settling, **more}
    metrics["overshoot"] = {"yaw": 0.0, "pitch": None}
    (folder / name / "metrics.json").write_text(json.dumps(metrics))
    trial = {"name": "<b>m1", "active": law, "testbed": {"kind": "csa"}, "plan": None}
    (folder / name / "trial.yaml").write_text(yaml.safe_dump(trial))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    run(tmp_path, "a", "pd", 0.5)
    run(tmp_path, "b", "pi", 0.25)
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "metrics.json").write_text("[1, 2")
    run(tmp_path, "d", "pi", 0.25, settling_time=["not", "ours"])
    return tmp_path


def test_runs_are_listed_with_the_figures_of_the_joints_that_move(folder: Path) -> None:
    found, unread = runs_in(folder)
    assert {(r.folder.name, r.law, r.figures["settling_time"]) for r in found} == {
        ("a", "pd", 3.0),
        ("b", "pi", 3.0),
    }
    assert sorted(unread) == ["c", "d"]


def test_the_largest_effort_is_that_of_any_joint(folder: Path) -> None:
    run(folder, "e", "pd", 0.1, peak_effort={"yaw": 1.0, "pitch": 4.0})
    peaks = {r.folder.name: r.figures["peak_effort"] for r in runs_in(folder)[0]}
    assert peaks["e"] == 4.0


def test_a_pipe_in_place_of_a_file_is_not_waited_for(tmp_path: Path) -> None:
    run(tmp_path, "whole", "pd", 0.5)
    for name in ("metrics.json", "trial.yaml"):
        run(tmp_path, name, "pd", 0.5)
        (tmp_path / name / name).unlink()
        os.mkfifo(tmp_path / name / name)
    found, unread = runs_in(tmp_path)
    assert [r.folder.name for r in found] == ["whole"]
    assert sorted(unread) == ["metrics.json", "trial.yaml"]


def test_runs_that_cannot_be_read_are_told_beside_json_too(folder: Path, call: Call) -> None:
    code, out, err = call("runs", folder, "--json")
    assert code == 0
    assert [Path(row["folder"]).name for row in json.loads(out)] == ["b", "a"]
    assert sorted(err.strip().removeprefix("not readable, left out: ").split(", ")) == ["c", "d"]


def test_runs_of_a_folder_that_cannot_be_written_are_listed_without_a_page(
    folder: Path, monkeypatch: pytest.MonkeyPatch, call: Call
) -> None:
    def refuse(dir: Path, prefix: str) -> None:
        raise OSError(errno.EROFS, "Read-only file system", f"{dir}/{prefix}draft")

    monkeypatch.setattr("tempfile.mkstemp", refuse)
    code, out, err = call("runs", folder, "--json")
    assert code == 0
    assert len(json.loads(out)) == 2
    told = f"no page is written: {folder}/index.html: Read-only file system"
    assert told in " ".join(err.split()).replace(f"{folder} /", f"{folder}/")
    assert call("runs", folder, "--open")[0] == 2


def test_runs_are_filtered_by_trial_law_and_testbed(folder: Path) -> None:
    assert [r.folder.name for r in runs_in(folder, law="pi")[0]] == ["b"]
    assert len(runs_in(folder, trial="<b>m1", testbed="csa")[0]) == 2
    assert runs_in(folder, testbed="spacecraft")[0] == []


def test_what_an_operator_changed_is_told_and_can_be_filtered(folder: Path) -> None:
    run(folder, "e", "pd", 0.1, operator_changes=2)
    run(folder, "f", "pd", 0.1, operator_changes=0)
    told = {r.folder.name: (r.operator, "changed by an operator" in r.verdict)
            for r in runs_in(folder)[0]}  # fmt: skip
    assert told == {
        "a": ("", False),
        "b": ("", False),
        "e": ("changed", True),
        "f": ("untouched", False),
    }
    page = write_index(folder).read_text()
    assert "changed by an operator 2 times" in page
    assert page.count('data-operator="changed"') == 1
    assert "<option>untouched</option>" in page


def test_the_page_holds_every_run_and_no_markup_of_theirs(folder: Path) -> None:
    page = write_index(folder).read_text()
    assert page.count("<tr data-trial=") == 2
    assert "<b>m1" not in page
    assert len(page) < 30_000


def test_the_page_tells_units(folder: Path) -> None:
    page = write_index(folder).read_text()
    for title in ("residual tip deflection [m]", "settling time [s]", "peak effort [N m or N]"):
        assert f">{title}<" in page.replace("\xa0", " ")
    start = page.index('id="data">') + len('id="data">')
    units = json.loads(page[start : page.index("</script>", start)])["units"]
    assert units["residual_tip_deflection"] == "m"
    assert units["settling_time.yaw"] == "s"
    assert "trajectory_hash" not in units


def test_a_note_and_tags_stand_beside_the_log_and_on_the_page(folder: Path, call: Call) -> None:
    before = {path.name for path in (folder / "a").iterdir()}
    assert call("runs", "note", folder / "a", "figure <3>")[0] == 0
    assert call("runs", "tag", folder / "a", "paper", "robust", "paper")[0] == 0
    assert read_notes(folder / "a") == ("figure <3>", ("paper", "robust"))
    assert {path.name for path in (folder / "a").iterdir()} == before | {"notes.yaml"}
    page = (folder / "index.html").read_text()
    assert '<span class="tag">robust</span> figure &lt;3&gt;' in page
    code, out, _ = call("runs", folder, "--tag", "paper", "--json")
    assert code == 0
    rows = json.loads(out)
    assert [(row["note"], row["tags"]) for row in rows] == [("figure <3>", ["paper", "robust"])]
    assert call("runs", "note", folder / "a", "")[0] == 0
    assert call("runs", "tag", folder / "a")[0] == 0
    assert {path.name for path in (folder / "a").iterdir()} == before


def test_a_run_goes_to_the_trash_and_comes_back(folder: Path, call: Call) -> None:
    before = (folder / "a" / "metrics.json").read_bytes()
    assert call("runs", "trash", folder / "a")[0] == 0
    assert [run.folder.name for run in runs_in(folder)[0]] == ["b"]
    assert ">a<" not in (folder / "index.html").read_text()
    assert call("runs", "restore", folder / "a")[0] == 0
    assert (folder / "a" / "metrics.json").read_bytes() == before
    assert {run.folder.name for run in runs_in(folder)[0]} == {"a", "b"}


def test_what_is_no_run_or_has_no_place_is_refused_and_stays(folder: Path, call: Call) -> None:
    def refused(*words: object) -> str:
        before = sorted(path for path in folder.rglob("*"))
        code, _, err = call("runs", *words)
        assert code == 2
        assert sorted(path for path in folder.rglob("*")) == before
        line = err.strip()
        assert "\n" not in line
        return line

    (folder / "unfinished").mkdir()
    for words in (("note", "x"), ("tag", "x"), ("trash",)):
        name, *rest = words
        assert "no such run" in refused(name, folder / "nobody", *rest)
        assert "is no finished run" in refused(name, folder / "unfinished", *rest)
    assert "is not in the trash; there is: nothing" in refused("restore", folder / "a")
    (folder / TRASH / "a").mkdir(parents=True)
    assert "the trash has a run of this name" in refused("trash", folder / "a")
    assert "its place is taken" in refused("restore", folder / "a")
    (folder / "b" / "bag").mkdir()
    with (folder / "b" / "bag" / ".recording").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert "is being flown" in refused("trash", folder / "b")
    (folder / "b" / "notes.yaml").write_text("tags: 3\n")
    assert "is not a note with tags" in refused("note", folder / "b", "x")


@pytest.mark.browser
def test_the_page_is_searched_sorted_and_selected_by_hand(folder: Path) -> None:
    run(folder, "e", "lqr", 0.0625)
    (folder / "e" / "notes.yaml").write_text("note: the best\ntags: [paper]\n")
    (folder / "e" / "thumbnail.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 140 36"><path d="M0 0L9 9"/></svg>'
    )
    names = (
        "return [...document.querySelectorAll('#runs tbody tr:not([hidden])')]"
        ".map(row => row.cells[1].innerText.trim())"
    )
    with chromium() as browser:
        browser.open(write_index(folder), 1440)
        tip = "//th/button[starts-with(normalize-space(), 'residual')]"
        browser.click(tip)
        assert browser.run(names) == ["e", "b", "a"]
        browser.click(tip)
        assert browser.run(names) == ["a", "b", "e"]
        browser.write("//input[@type='search']", "PAPER best")
        assert browser.run(names) == ["e"]
        browser.write("//input[@type='search']", "")
        browser.until("return document.querySelectorAll('#runs tr[hidden]').length === 0")
        browser.click("//input[@aria-label='compare a']")
        browser.click("//input[@aria-label='compare b']")
        told = browser.run("return document.getElementById('command').innerText")
        assert told == f"./flexslew report {folder / 'a'} {folder / 'b'} --open"
        thrown = browser.run("return document.getElementById('trash').innerText")
        assert thrown.splitlines() == [f"./flexslew runs trash {folder / n}" for n in "ab"]
        for width in (390, 1440):
            browser.open(folder / "index.html", width)
            assert_whole(browser)


def assert_whole(browser: Browser) -> None:
    """Check that no text of the page collides, is cut off or is pale."""
    seen = looked_at(browser)
    assert (seen["overlaps"], seen["outside"], seen["broken"]) == ([], [], [])
    assert seen["scroll"] <= 0
    assert browser.run(PALE) == []
    assert browser.complaints() == []


@pytest.fixture
def served(folder: Path) -> Iterator[str]:
    server, address = runs_server(folder)
    with server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield address
        server.shutdown()


def sent(address: str, body: object = None, **headers: str) -> tuple[int, str]:
    data = None if body is None else json.dumps(body).encode()
    try:
        with urlopen(Request(address, data, headers), timeout=20) as reply:
            return reply.status, reply.read().decode()
    except HTTPError as error:
        return error.code, error.read().decode()


def test_a_served_page_acts_on_runs_of_its_folder_alone(folder: Path, served: str) -> None:
    assert sent(served)[0] == 200
    assert sent(f"{served}note", {"runs": ["a"], "value": "seen"}) == (200, "")
    assert sent(f"{served}tags", {"runs": ["a", "b"], "value": "x, y"}) == (200, "")
    assert read_notes(folder / "a") == ("seen", ("x", "y"))
    assert "seen" in sent(served)[1]
    for name in ("nobody", "../a", ".", "", 3):
        status, words = sent(f"{served}trash", {"runs": [name], "value": ""})
        assert status == 400, name
        assert "run" in words
    assert sent(f"{served}format", {"runs": ["a"], "value": ""})[0] == 400
    assert sent(f"{served}trash", ["a"])[0] == 400
    assert sent(f"{served}trash", {"runs": ["a"], "value": ""}) == (200, "")
    assert [run.folder.name for run in runs_in(folder)[0]] == ["b"]


def test_a_request_without_the_token_or_of_another_host_is_refused(served: str) -> None:
    root = served.rsplit("/", 2)[0]
    for address in (f"{root}/", f"{root}/index.html", f"{root}/wrong/"):
        assert sent(address)[0] == 403
    assert sent(f"{root}/trash", {"runs": ["a"], "value": ""})[0] == 403
    assert sent(served, None, Host="evil.example")[0] == 403
    with pytest.raises(HTTPError, match="403"):
        urlopen(Request(f"{root}/index.html", method="HEAD"), timeout=20)


def test_a_served_page_lays_runs_over_one_another(folder: Path, served: str, bag: Path) -> None:
    copytree(bag, folder / "a" / "bag")
    status, page = sent(f"{served}overlay", {"runs": ["a"], "value": ""})
    assert status == 200
    assert "synthetic" in (folder / page).read_text()
    assert sent(f"{served}overlay", {"runs": [], "value": ""}) == (400, "select at least one run")
    assert sent(f"{served}overlay", {"runs": ["b"], "value": ""})[0] == 400  # it has no log


@pytest.mark.browser
def test_buttons_of_a_served_page_act_on_what_is_selected(folder: Path, served: str) -> None:
    with chromium() as browser:
        browser.open(served, 1440)
        browser.click("//input[@aria-label='compare b']")
        browser.write("//input[@id='tags']", "paper")
        browser.click("//button[.='Set tags']")
        browser.until("return document.querySelector('.tag')?.innerText === 'paper'")
        browser.click("//input[@aria-label='compare a']")
        browser.click("//button[.='Move to trash']")
        browser.until("return document.querySelectorAll('#runs tr[data-trial]').length === 1")
    assert read_notes(folder / "b").tags == ("paper",)
    assert (folder / TRASH / "a").is_dir()
