"""A study from its file to its table: interrupted, resumed, in shards, with others' hands in it."""

import os
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.plant.testbeds.spacecraft.finite_elements.decks import truss_files

import flexslew as fs
from flexslew_lab.run.pool import InThisProcess
from flexslew_lab.studies.cases import Case, case_of
from flexslew_lab.studies.findings.summary import passed, summary
from flexslew_lab.studies.findings.tables import missing_words
from flexslew_lab.studies.finish import finished, keep_worst, repeat_trial
from flexslew_lab.studies.flight import FlightResult, simulate_case
from flexslew_lab.studies.identity import require_same
from flexslew_lab.studies.merge import merged
from flexslew_lab.studies.run import PreparedStudy, Shard, prepare, run_study
from flexslew_lab.studies.store import Store
from flexslew_lab.studies.study import Study
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import NO_CODE
from flexslew_plant.yaml_data import yaml_text


class OneByOne(InThisProcess[Case, FlightResult]):
    """Gives every result alone, so that there are many moments to be killed at."""

    def fly(self, cases: Iterator[Case]) -> Iterator[list[FlightResult]]:
        for results in super().fly(cases):
            yield from ([result] for result in results)


def killed_at(moment: int, work: Callable[[], object]) -> None:
    """Do the work in a process that is killed at a moment: before a sync, before a renaming."""
    pid = os.fork()
    if pid:
        assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == -signal.SIGKILL
        return
    left = moment

    def tick(real: Callable[..., Any]) -> Callable[..., Any]:
        def counted(*arguments: Any) -> Any:
            nonlocal left
            left -= 1
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            return real(*arguments)

        return counted

    os.fsync = tick(os.fsync)
    Path.rename = tick(Path.rename)  # type: ignore[method-assign]
    work()
    os._exit(0)


def test_a_study_killed_at_five_moments_ends_with_the_same_table(
    ready: PreparedStudy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = run_study(ready, tmp_path / "whole", InThisProcess(ready.job))
    monkeypatch.setattr("flexslew_lab.studies.run._PART_TIME", 0.0)
    folder = tmp_path / "killed"
    # three moments for each file: samples, identity and three more come before the first part
    moments = np.random.default_rng(17).integers(1, 24, size=5)
    for moment in moments:
        killed_at(int(moment), lambda: run_study(ready, folder, OneByOne(ready.job)))
    resumed = run_study(ready, folder, OneByOne(ready.job))
    assert resumed.table_path.read_bytes() == whole.table_path.read_bytes()
    assert not list(folder.rglob("*.half"))


def test_ctrl_c_keeps_what_was_flown(ready: PreparedStudy, tmp_path: Path) -> None:
    class Impatient(OneByOne):
        def fly(self, cases: Iterator[Case]) -> Iterator[list[FlightResult]]:
            for k, results in enumerate(super().fly(cases)):
                if k == 3:
                    raise KeyboardInterrupt
                yield results

    with pytest.raises(KeyboardInterrupt):
        run_study(ready, tmp_path / "s", Impatient(ready.job))
    store = Store(tmp_path / "s")
    assert (store.statuses(ready.trials) == 1).sum() == 3
    store = run_study(ready, tmp_path / "s", InThisProcess(ready.job))
    assert (store.statuses(ready.trials) == 1).all()


def test_a_finished_study_flies_nothing_again(ready: PreparedStudy, tmp_path: Path) -> None:
    class Nobody(InThisProcess[Case, FlightResult]):
        def fly(self, cases: Iterator[Case]) -> Iterator[list[FlightResult]]:
            assert next(cases, None) is None
            return iter(())

    run_study(ready, tmp_path / "s", InThisProcess(ready.job))
    run_study(ready, tmp_path / "s", Nobody(ready.job))


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"seed": 4}, "study.seed: 3 there, 4 here"),
        ({"sampling": {"method": "random", "n": 11}}, "study.sampling.n: 12 there, 11 here"),
        ({"flown": {"duration": 2.0}}, "trial.duration: 1.0 there, 2.0 here"),
        ({"compare": {"active": ["collocated_pid"]}}, "study.compare.active: None there"),
    ],
)
def test_another_study_is_not_resumed_and_the_difference_is_named(
    ready: PreparedStudy,
    study_of: Callable[..., Study],
    tmp_path: Path,
    keys: dict[str, Any],
    words: str,
) -> None:
    store = run_study(ready, tmp_path / "s", InThisProcess(ready.job))
    before = {path: path.read_bytes() for path in store.folder.rglob("*") if path.is_file()}
    other = prepare(study_of(**keys))
    with pytest.raises(BadInput, match=words):
        run_study(other, tmp_path / "s", InThisProcess(other.job))
    assert before == {p: p.read_bytes() for p in store.folder.rglob("*") if p.is_file()}


@pytest.mark.slow
def test_other_criteria_are_no_other_study(
    ready: PreparedStudy, study_of: Callable[..., Study], tmp_path: Path
) -> None:
    run_study(ready, tmp_path / "s", InThisProcess(ready.job))
    again = prepare(study_of(criteria={"peak_tip_deflection": {"below": 1.0}}))
    store = run_study(again, tmp_path / "s", InThisProcess(again.job))
    assert passed(finished(again.study, store))
    harder = prepare(study_of(criteria={"peak_tip_deflection": {"below": 1e-6}}))
    store = run_study(harder, tmp_path / "s", InThisProcess(harder.job))
    assert not passed(finished(harder.study, store))


def test_versions_and_law_files_are_part_of_a_study(ready: PreparedStudy, tmp_path: Path) -> None:
    run_study(ready, tmp_path / "s", InThisProcess(ready.job))
    older = replace(ready)
    older.identity = older.identity | {"versions": older.identity["versions"] | {"numba": "0.1"}}
    with pytest.raises(BadInput, match=r"versions.numba: '.*' there, '0.1' here"):
        run_study(older, tmp_path / "s", InThisProcess(ready.job))


METRIC = """
from flexslew_lab.metrics import Key

class Count:
    KEYS = {"count": Key("-", False, "of ticks")}
    def __init__(self, setup): self.count = 0.0
    def add(self, block): self.count += len(block.time)
    def result(self, ending): return {"count": self.count}
"""
LAW = """
import numpy as np

class Still:
    def __init__(self, settings, period, effort_limit): pass
    def update(self, measurement, estimate, reference): return np.zeros(2)
"""
EXAMPLES = Path(__file__).parents[3] / "docs/examples"
SHIPPED = Path(str(resources.files("flexslew_plant"))) / "testbeds/spacecraft/data"
MASS = {"testbed.platform.mass": {"relative": {"uniform": [-0.1, 0.1]}}}
CRAFT = {
    "testbed": {
        "kind": "spacecraft",
        "appendages": {"boom": {"shape": {"kind": "modal_data", "file": "own.yaml"}}},
    },
    "plan": {"method": "none"},
    "controllers": {"pd_feedforward": {"kp": [9.0], "kd": [9.0]}},
}


@pytest.mark.parametrize(
    ("name", "text", "flown", "keys"),
    [
        ("own.py", METRIC, {}, {"compare": {"metrics": {"own": ["own.py:Count"]}}}),
        ("own.py", (EXAMPLES / "my_shaper.py").read_text(),
         {"plan": {"method": "own.py:Shaper", "goal": {"base_yaw": 0.1}}}, {}),
        ("own_module.py", LAW, {"controllers": {"own": {"law": "own_module.Still"}},
                                "active": "own"}, {}),
        ("own.yaml", (SHIPPED / "solar_panel.yaml").read_text(), CRAFT, {"vary": MASS}),
    ],
)  # fmt: skip
def test_files_that_trials_run_or_read_are_part_of_a_study(
    name: str,
    text: str,
    flown: dict[str, Any],
    keys: dict[str, Any],
    study_of: Callable[..., Study],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / name).write_text(text)
    before = prepare(study_of(flown, **keys)).identity
    (tmp_path / name).write_text(text + "# another\n")
    after = prepare(study_of(flown, **keys)).identity
    with pytest.raises(BadInput, match=r"holds another study, files\.own"):
        require_same(before, after, tmp_path)


def test_matrices_beside_the_deck_of_a_model_are_part_of_a_study(
    study_of: Callable[..., Study], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    truss_files(tmp_path)
    boom = {"kind": "finite_elements", "file": "model.inp", "boundary": ["ROOT"], "modes": 2}
    craft = {**CRAFT, "testbed": {"kind": "spacecraft", "appendages": {"boom": {"shape": boom}}}}
    before = prepare(study_of(craft, vary=MASS)).identity
    mass = tmp_path / "model.mas"
    mass.write_text(mass.read_text().replace("2.0000000000000e+00", "2.1000000000000e+00"))
    after = prepare(study_of(craft, vary=MASS)).identity
    with pytest.raises(BadInput, match=r"holds another study, files\.model"):
        require_same(before, after, tmp_path)


def test_what_flew_while_a_file_changed_is_not_kept(
    study_of: Callable[..., Study], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Edited(OneByOne):
        def fly(self, cases: Iterator[Case]) -> Iterator[list[FlightResult]]:
            for k, results in enumerate(super().fly(cases)):
                if k == 3:
                    panel.write_text(text + "# another\n")
                yield results

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("flexslew_lab.studies.run._PART_TIME", 0.0)
    panel, text = tmp_path / "own.yaml", (SHIPPED / "solar_panel.yaml").read_text()
    panel.write_text(text)
    ready = prepare(study_of(CRAFT, vary=MASS))
    with pytest.raises(BadInput, match=r"own\.yaml: has changed while trials flew"):
        run_study(ready, tmp_path / "s", Edited(ready.job))
    assert np.count_nonzero(Store(tmp_path / "s").statuses(ready.trials)) == 3
    panel.write_text(text)
    store = run_study(ready, tmp_path / "s", InThisProcess(ready.job))
    assert (store.statuses(ready.trials) == 1).all()


@pytest.mark.parametrize("sampling", [{"method": "random"}, {"method": "sobol", "replicates": 1}])
def test_a_study_with_more_samples_goes_on_from_the_one_with_fewer(
    sampling: dict[str, Any], study_of: Callable[..., Study], tmp_path: Path
) -> None:
    def of(n: int, **keys: Any) -> PreparedStudy:
        return prepare(study_of(sampling=sampling | {"n": n}, **keys))

    fewer, more, folder = of(8), of(16), tmp_path / "s"
    run_study(fewer, folder, InThisProcess(fewer.job))
    flew = list[Case]()

    class Counted(InThisProcess[Case, FlightResult]):
        def fly(self, cases: Iterator[Case]) -> Iterator[list[FlightResult]]:
            flew.extend(cases)
            return super().fly(iter(flew))

    store = run_study(more, folder, Counted(more.job))
    assert [case.number for case in flew] == [*range(8, 16)]
    whole = run_study(more, tmp_path / "whole", InThisProcess(more.job))
    assert store.table_path.read_bytes() == whole.table_path.read_bytes()
    with pytest.raises(BadInput, match=r"study\.sampling\.n: 16 there, 8 here"):
        run_study(fewer, folder, InThisProcess(fewer.job))
    other = of(32, seed=4)
    with pytest.raises(BadInput, match="holds another study"):
        run_study(other, folder, InThisProcess(other.job))


def test_samples_that_lie_elsewhere_with_more_of_them_are_another_study(
    study_of: Callable[..., Study], tmp_path: Path
) -> None:
    fewer, more = (
        prepare(study_of(sampling={"method": "lhs", "replicates": 1, "n": n})) for n in (6, 12)
    )
    run_study(fewer, tmp_path / "s", InThisProcess(fewer.job))
    with pytest.raises(BadInput, match=r"study\.sampling\.n: 6 there, 12 here"):
        run_study(more, tmp_path / "s", InThisProcess(more.job))


def test_of_two_studies_that_begin_in_one_folder_at_once_the_second_is_refused(
    study_of: Callable[..., Study], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, other = (prepare(study_of(seed=seed)) for seed in (3, 4))
    locked = Store.locked

    def late(store: Store) -> Any:
        """Let the other one go first, after this one has found the folder empty."""
        monkeypatch.setattr(Store, "locked", locked)
        run_study(other, store.folder, InThisProcess(other.job))
        return locked(store)

    monkeypatch.setattr(Store, "locked", late)
    with pytest.raises(BadInput, match=r"holds another study, study\.seed: 4 there, 3 here"):
        run_study(one, tmp_path / "s", InThisProcess(one.job))


def test_shards_make_the_table_of_the_whole(ready: PreparedStudy, tmp_path: Path) -> None:
    whole = run_study(ready, tmp_path / "whole", InThisProcess(ready.job))
    for k in (1, 2, 3):
        run_study(ready, tmp_path / f"shard-{k}", InThisProcess(ready.job), Shard(k, 3))
    _, joined = merged([tmp_path / f"shard-{k}" for k in (3, 1, 2)], tmp_path / "joined", NO_CODE)
    assert joined.table_path.read_bytes() == whole.table_path.read_bytes()
    assert summary(*merged([tmp_path / "shard-1"], tmp_path / "joined", NO_CODE), {})["complete"]
    shards = [tmp_path / f"shard-{k}" for k in (1, 3)]
    part = finished(*merged(shards, tmp_path / "part", NO_CODE))
    assert "trials are missing" in Path(part["report"]).read_text()
    assert not part["complete"]
    missing = part["to_fly"] - part["trials"]
    assert missing_words(part).startswith(f"{missing} of {part['planned']} trials are missing")
    with pytest.raises(BadInput, match="is one of the shards"):
        merged([tmp_path / "shard-1"], tmp_path / "shard-1", NO_CODE)


def test_the_library_does_what_the_command_does(
    study_of: Callable[..., Study], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flexslew_lab.run.pool.Pool", lambda job, workers: InThisProcess(job))
    study_of(batch=True, keep={"bags": "worst 1"}, sampling={"method": "random", "n": 2})
    found = fs.study(tmp_path / "study.yaml", tmp_path / "s")
    assert found["check"]["ok"]
    assert found["check"]["trials"] == 2
    (worst,) = (tmp_path / "s" / "worst").iterdir()
    assert int(worst.name) == found["metrics"]["residual_tip_deflection"]["worst"][0]["index"]
    with pytest.raises(BadInput, match="workers: 0 is not allowed: a whole number, at least 1"):
        fs.study(tmp_path / "study.yaml", tmp_path / "s", workers=0)


@pytest.mark.slow
def test_failed_trials_are_results_and_are_flown_again_on_demand(
    ready: PreparedStudy, tmp_path: Path
) -> None:
    class Clumsy(InThisProcess[Case, FlightResult]):
        def fly(self, cases: Iterator[Case]) -> Iterator[list[FlightResult]]:
            for results in super().fly(cases):
                yield [
                    r._replace(status="failed", reason="clumsy") if r.number % 4 == 0 else r
                    for r in results
                ]

    store = run_study(ready, tmp_path / "s", Clumsy(ready.job))
    found = finished(ready.study, store)
    assert found["failed"] == 3
    assert found["reasons"] == {"clumsy": 3}
    metric = found["metrics"]["residual_tip_deflection"]
    assert metric["failed"] == 3
    assert metric["mean"] is None  # of numbers of which some are unbounded
    assert [w["value"] for w in metric["worst"][:3]] == [None] * 3
    run_study(ready, tmp_path / "s", InThisProcess(ready.job))
    assert finished(ready.study, store)["failed"] == 3
    run_study(ready, tmp_path / "s", InThisProcess(ready.job), retry_failed=True)
    assert finished(ready.study, store)["failed"] == 0


def test_any_trial_flies_again_with_the_same_hash(
    study_of: Callable[..., Study], tmp_path: Path
) -> None:
    ready = prepare(
        study_of(
            compare={"active": ["pd_feedforward", "lqr"]},
            sampling={"method": "sobol", "n": 16},
        )
    )
    store = run_study(ready, tmp_path / "s", InThisProcess(ready.job))
    hashes = store.table(["trajectory_hash"])["trajectory_hash"].to_pylist()
    assert len(set(hashes)) == 32
    for number in np.random.default_rng(5).choice(32, size=6, replace=False).tolist():
        again, difference = repeat_trial(ready.study, store, number, tmp_path / f"run-{number}")
        assert not difference
        assert again.metrics["trajectory_hash"] == hashes[number]


def test_a_trial_that_flies_again_tells_what_it_warns_of(
    study_of: Callable[..., Study], tmp_path: Path
) -> None:
    study = study_of(vary={"plan.duration": {"uniform": [1.1, 1.5]}})
    said: list[str] = []
    repeat_trial(study, None, 0, tmp_path / "run", said.append)
    assert any(words.startswith("warning: the plan ends at 1.") for words in said)


SETTLES = """
from flexslew_lab.metrics import Key


class Settles:
    KEYS = {
        "drift": Key("N m or N", False, "how far it drifts"),
        "drift_ends_at": Key("s", False, "when; null: never", never="drift"),
        "drift_by_rate": Key("rad or m", False, "by frequency", spectrum=True),
    }

    def __init__(self, setup):
        pass

    def add(self, block):
        self.last = float(block.position[-1, 0])

    def result(self, ending):
        ends = None if self.last > 0.0 else 1.0
        return {"drift": 1.0, "drift_ends_at": ends, "drift_by_rate": {"1": 1.0}}
"""


@pytest.mark.parametrize("batch", [False, True])
def test_what_a_metric_of_one_s_own_says_of_its_keys_holds_in_a_study(
    study_of: Callable[..., Study], tmp_path: Path, batch: bool
) -> None:
    (tmp_path / "settles.py").write_text(SETTLES)
    keys = {"metrics": [f"{tmp_path}/settles.py:Settles"]}
    ready = prepare(study_of(keys, batch=batch, sampling={"method": "random", "n": 3}))
    store = run_study(ready, tmp_path / "s", InThisProcess(ready.job))
    assert not [name for name in store.columns if name.startswith("drift_by_rate")]
    found = finished(ready.study, store)["metrics"]
    assert (found["drift"]["unit"], found["drift_ends_at"]["unit"]) == ("N m", "s")
    assert found["drift_ends_at"]["missing"] == 0  # what never ends is worse than any number
    assert found["drift_ends_at"]["mean"] is None


def test_the_worst_trials_are_flown_again_by_the_plan_that_they_share(
    study_of: Callable[..., Study], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ready = prepare(study_of(keep={"bags": "worst 2"}, sampling={"n": 3}))
    store = run_study(ready, tmp_path / "s", InThisProcess(ready.job))
    monkeypatch.delattr("flexslew_lab.trial.trial.make_plan")
    assert len(keep_worst(ready, store, print)) == 2


def test_a_failed_trial_has_no_log_and_the_reason_of_its_row(
    study_of: Callable[..., Study], tmp_path: Path
) -> None:
    fault = {"kind": "controller_silent", "controller": "pd_feedforward"}
    lost = {"allow_faults": True, "schedule": [{"at": 0.2, "fault": fault}]}
    ready = prepare(study_of(lost, keep={"bags": "worst 1"}, sampling={"n": 1}))
    store = run_study(ready, tmp_path / "s", InThisProcess(ready.job))
    messages: list[str] = []
    assert keep_worst(ready, store, messages.append) == []
    reason = store.table(["reason"])["reason"][0].as_py()
    assert reason
    assert messages == [f"trial 0: no log: {reason}"]


def test_as_many_logs_are_kept_as_the_file_asks_for(
    study_of: Callable[..., Study], tmp_path: Path
) -> None:
    most = {"peak_tip_deflection": {"below": 1.0}}
    ready = prepare(study_of(keep={"bags": "worst 7"}, criteria=most, sampling={"n": 9}))
    store = run_study(ready, tmp_path / "s", InThisProcess(ready.job))
    kept = [int(folder.name) for folder in keep_worst(ready, store, print)]
    values = store.table(["peak_tip_deflection"])["peak_tip_deflection"].to_numpy()
    assert kept == np.argsort(-values)[:7].tolist()


@pytest.mark.slow
def test_a_study_stops_when_a_quantile_is_known(
    study_of: Callable[..., Study], tmp_path: Path
) -> None:
    stop = {"metric": "peak_tip_deflection", "quantile": 0.5, "half_width": 0.01}
    ready = prepare(study_of(sampling={"method": "random", "n": 400}, stop=stop))
    store = run_study(ready, tmp_path / "s", InThisProcess(ready.job))
    found = finished(ready.study, store)
    assert found["stopped"]["samples"] == found["trials"] == 64
    assert found["stopped"]["half_width"] <= 0.01
    low, _, high = found["metrics"]["peak_tip_deflection"]["quantiles"]["0.5"]
    assert 0.5 * (high - low) <= 0.01
    cases = [case_of(ready.study, ready.samples, k).sample for k in range(64)]
    assert cases == list(range(64))


LAW = """
from pathlib import Path

class Tired:
    def __init__(self, settings, period, effort_limit):
        if Path(__file__).with_name("tired_today").exists():
            raise KeyError("no gains today")

    def update(self, measurement, estimate, reference):
        raise TypeError("enough for today")
"""


@pytest.mark.parametrize(
    ("begins", "words"),
    [(False, "TypeError: enough for today ("), (True, "KeyError: 'no gains today'")],
)
def test_a_failed_trial_keeps_the_exception_of_its_law(
    study_of: Callable[..., Study], tmp_path: Path, begins: bool, words: str
) -> None:
    law = tmp_path / "tired.py"
    law.write_text(LAW)
    study = study_of({"controllers": {"mine": {"law": f"{law}:Tired"}}, "active": "mine"})
    ready = prepare(study)
    if begins:
        (tmp_path / "tired_today").touch()
    store = run_study(ready, tmp_path / "s", InThisProcess(ready.job))
    reasons = finished(study, store)["reasons"]
    assert sum(reasons.values()) == 12
    assert all(words in reason for reason in reasons), reasons


def test_metrics_by_axis_have_their_columns_before_the_first_flight(
    study_of: Callable[..., Study], tmp_path: Path
) -> None:
    """A craft of wheels that is pointed for two windows: every column is known, and full."""
    wheels = {name: {"axis": axis} for name, axis in zip("abc", np.eye(3).tolist(), strict=True)}
    wheel = {"inertia": 0.02, "limit": 0.5, "momentum_limit": 10.0}
    craft = {
        "duration": 3.0,
        "period": 0.05,
        "testbed": {
            "kind": "spacecraft",
            "pointing_window": 1.0,
            "actuators": {},
            "appendages": {},
            "wheels": {name: {**given, **wheel} for name, given in wheels.items()},
        },
        "plan": {"method": "none", "goal": {"a": 0.1, "b": -0.05, "c": 0.02}, "duration": 0.5},
        "controllers": {"pd_feedforward": {"kp": [1.0], "kd": [5.0]}},
        "active": "pd_feedforward",
    }
    (tmp_path / "craft.yaml").write_text(yaml_text(craft))
    names = [
        f"{name}.{axis}"
        for name in ("absolute_performance_error", "relative_performance_error", "rms_jitter")
        for axis in "xyz"
    ]
    study = study_of(
        trial="craft.yaml",
        sampling={"method": "random", "n": 2},
        vary={"testbed.platform.mass": {"relative": {"uniform": [-0.1, 0.1]}}},
        criteria={name: {"below": 1.0} for name in names},
    )
    ready = prepare(study)
    store = run_study(ready, tmp_path / "s", InThisProcess(ready.job))
    found = finished(study, store)
    assert passed(found)
    assert found["failed"] == 0
    rows = store.table(names).to_pydict()
    for name in ("absolute_performance_error", "rms_jitter"):
        largest = store.table([name])[name].to_pylist()
        by_axis = np.array([rows[f"{name}.{axis}"] for axis in "xyz"])
        np.testing.assert_array_equal(by_axis.max(axis=0), largest)
        assert by_axis.min() > 0.0
    one = simulate_case(study, case_of(study, ready.samples, 0), ready.plans)
    assert list(one.metrics) == ready.columns
