"""A log is data: no command runs a class that a file of somebody else's names."""

import json
import shutil
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexslew_lab import notebook
from flexslew_lab.cli.main import main
from flexslew_lab.console.panels.compare import _read as overlay
from flexslew_lab.console.replay import Replay
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.messages.cdr import decode, encode
from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.errors import FlexslewError
from flexslew_plant.own_code import ANY_CODE
from flexslew_plant.yaml_data import load_yaml, yaml_text
from tests.representatives import representatives

TRIAL = """
name: short
duration: 0.3
controllers: {pd_feedforward: {kp: [460.0, 460.0], kd: [920.0, 920.0]}}
plan: {method: none, goal: {base_yaw: 0.01}, duration: 0.2}
"""
STUDY = """
study: small
trial: trial.yaml
sampling: {method: random, n: 2}
vary: {testbed.parameters.bending_stiffness: {relative: {uniform: [-0.2, 0.2]}}}
keep: {bags: none}
batch: false
"""
EVIL = """
from pathlib import Path

from flexslew_plant.settings import section

Path({marker!r}).touch()


@section
class Evil:
    kind: str = ""
"""
NAMES = ("evil.py:Evil", "{folder}/evil.py:Evil", "evil.Evil", "./evil.py:Evil")


def changed(values: dict[str, Any], path: str, name: str) -> dict[str, Any]:
    """Return a trial with a class named at a path of it."""
    key, _, rest = path.partition(".")
    inner = values.get(key)
    if not rest:
        return {**values, key: name}
    return {**values, key: changed(inner if isinstance(inner, dict) else {}, rest, name)}


# where a trial names a class
PLACES: Mapping[str, Callable[[dict[str, Any], str], dict[str, Any]]] = {
    "law": lambda v, n: changed(v, "controllers.pd_feedforward.law", n),
    "controller": lambda v, n: {**v, "controllers": {n: {}}, "active": n},
    "kind": lambda v, n: changed(v, "testbed.kind", n),
    "model of the plan": lambda v, n: changed(v, "plan.model.kind", n),
    "model of a law": lambda v, n: {
        **v, "controllers": {"lqr": {"model": {"kind": n}}}, "active": "lqr"},
    "method": lambda v, n: changed(v, "plan.method", n),
    "metrics": lambda v, n: {**v, "metrics": [n]},
}  # fmt: skip


def command(*words: str) -> None:
    """Run a command; whatever it says of the file, it ends as commands do."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["flexslew", *words])
        with pytest.raises(SystemExit) as end:
            main()
    assert end.value.code in (0, 1, 2, 3, None)


def quietly(call: Callable[[], Any]) -> None:
    with suppress(FlexslewError):
        call()


# every reader of a log
BAG: Mapping[str, Callable[[Path], None]] = {
    "info": lambda bag: command("log", "info", str(bag)),
    "log check": lambda bag: command("log", "check", str(bag)),
    "diff": lambda bag: command("log", "diff", str(bag), str(bag)),
    "export": lambda bag: command("log", "export", str(bag), "--out", "exported"),
    "recover": lambda bag: command("recover", str(bag)),
    "report": lambda bag: command("report", str(bag), "--out", "page.html"),
    "overlaid": lambda bag: command("report", str(bag), str(bag), "--out", "page.html"),
    "resim": lambda bag: command("resim", str(bag)),
    "check": lambda bag: command("check", str(bag)),
    "notebook": lambda bag: quietly(lambda: notebook.read(bag)),
    "metrics": lambda bag: quietly(lambda: metrics_of(bag)),
    "console": lambda bag: quietly(lambda: Replay(bag).seek(0.2)),
    "console's overlay": lambda bag: quietly(lambda: overlay(bag)),
}
STUDIES: Mapping[str, Callable[[Path], None]] = {
    "status": lambda folder: command("study", "status", str(folder)),
    "report": lambda folder: command("study", "report", str(folder)),
    "compare": lambda folder: command("study", "report", str(folder), str(folder)),
    "fly": lambda folder: command("study", "fly", str(folder), "1", "--out", "flown"),
    "merge": lambda folder: command("study", "merge", str(folder), "--out", "joined"),
}


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a bag and the folder of a study, before anybody changed them."""
    folder = tmp_path_factory.mktemp("honest")
    run_trial(parse_trial(TRIAL, "test"), "test", folder / "run", in_process=True, report=False)
    (folder / "trial.yaml").write_text(TRIAL)
    (folder / "study.yaml").write_text(STUDY)
    command("study", "run", str(folder / "study.yaml"), "--out", str(folder / "study"))
    assert (folder / "study" / "study.yaml").exists()
    return folder


@pytest.fixture
def evil(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a file that is made when the class of the working directory is loaded."""
    marker = tmp_path / "was_run"
    (tmp_path / "evil.py").write_text(EVIL.format(marker=str(marker)))
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "evil", raising=False)
    return marker


def crafted_bag(honest: Path, out: Path, text: str, name: str) -> Path:
    """Write a bag whose trial is this, and whose testbed, controllers and hashes name a class."""
    reader = BagReader(honest / "run" / "bag")
    metadata = {**reader.metadata, "trial": text, "own_code": json.dumps({name: "0" * 64})}
    given = load_yaml(text, "crafted")
    with BagWriter(out, metadata) as writer:
        for topic, kind, stamp, _, data in reader.messages():
            if topic in ("/testbed", "/controller_status"):
                message = vars(decode(kind, data))
                if topic == "/testbed":
                    settings = load_yaml(message["settings"], "testbed")
                    inner = settings.get("bench", settings)
                    inner["testbed"] = {**inner["testbed"], **(given.get("testbed") or {})}
                    message["settings"] = yaml_text(settings)
                else:
                    message["law"] = name
                data = encode(kind, message)
            writer.write(topic, kind, data, stamp)
    return out


def received_study(honest: Path, out: Path, text: str) -> Path:
    """Copy the folder of a study and change its trial."""
    shutil.copytree(honest / "study", out)
    trials = [path for path in out.rglob("*.yaml") if path.name != "study.yaml"]
    assert trials
    for path in trials:
        path.write_text(text)
    return out


@pytest.mark.slow
@pytest.mark.parametrize("place", representatives(PLACES, *list(PLACES)[:2]))
def test_no_reader_of_a_log_runs_what_it_names(flown: Path, evil: Path, place: str) -> None:
    for k, (reader, read) in enumerate(BAG.items()):
        name = NAMES[k % len(NAMES)].format(folder=evil.parent)
        text = yaml_text(PLACES[place](load_yaml(TRIAL, "test"), name))
        read(crafted_bag(flown, evil.parent / f"bag_{k}", text, name))
        assert not evil.exists(), reader


@pytest.mark.slow
@pytest.mark.parametrize("place", representatives(PLACES, *list(PLACES)[:2]))
def test_no_command_runs_what_a_received_study_names(flown: Path, evil: Path, place: str) -> None:
    for k, (reader, read) in enumerate(STUDIES.items()):
        name = NAMES[k % len(NAMES)].format(folder=evil.parent)
        text = yaml_text(PLACES[place](load_yaml(TRIAL, "test"), name))
        read(received_study(flown, evil.parent / f"study_{k}", text))
        assert not evil.exists(), reader


@pytest.mark.slow
def test_any_reader_any_place_any_name(flown: Path, evil: Path, case: np.random.Generator) -> None:
    values = load_yaml(TRIAL, "test")
    name = str(case.choice(NAMES)).format(folder=evil.parent)
    for place in case.choice(sorted(PLACES), size=2):
        values = PLACES[place](values, name)
    text = yaml_text(values)
    reader = case.choice([*BAG, *(f"study {word}" for word in STUDIES)])
    if reader in BAG:
        BAG[reader](crafted_bag(flown, evil.parent / "bag", text, name))
    else:
        received = received_study(flown, evil.parent / "study", text)
        STUDIES[reader.removeprefix("study ")](received)
    assert not evil.exists(), (reader, text)


@pytest.mark.parametrize("place", ["law", "metrics"])
def test_who_is_trusted_runs(flown: Path, evil: Path, place: str) -> None:
    """The door opens: else the tests above could not fail."""
    name = NAMES[0]
    text = yaml_text(PLACES[place](load_yaml(TRIAL, "test"), name))
    bag = crafted_bag(flown, evil.parent / "bag", text, name)
    word = "report" if place == "metrics" else "resim"
    more = ["--out", "page.html"] if place == "metrics" else []
    command(word, str(bag), "--trust", name, *more)
    assert evil.exists()


def test_the_user_s_own_trial_is_the_user_s_own_word(evil: Path) -> None:
    text = yaml_text(PLACES["law"](load_yaml(TRIAL, "test"), NAMES[0]))
    (evil.parent / "mine.yaml").write_text(text)
    command("trial", "mine.yaml", "--in-process", "--no-report", "--out", "run")
    assert evil.exists()


def test_keys_of_a_trial_cannot_trust_themselves() -> None:
    with pytest.raises(FlexslewError, match="trust"):
        parse_trial(TRIAL + "trust: {everything: true}\n", "test")
    assert parse_trial(TRIAL, "test", ANY_CODE).trust == ANY_CODE
