"""Processes that die, hang or stay: none of it shows in the results."""

import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable
from itertools import count
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from flexslew_lab.run.pool import Chunks, Executor, InThisProcess, Pool, _without_script
from flexslew_lab.studies.cases import Case, case_of
from flexslew_lab.studies.flight import FlightResult
from flexslew_lab.studies.run import PreparedStudy, prepare
from flexslew_lab.studies.study import Study
from flexslew_plant.errors import RunFault
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH

LAW = '''
import os, signal
from pathlib import Path

class Odd:
    """PD that does something to its process at tick 20 if told so."""

    def __init__(self, settings, period, effort_limit):
        self.act, self.mark = settings["act"], Path(settings["mark"])

    def update(self, m, estimate, reference):
        if m.tick == 20:
            if self.act == 1:
                os.kill(os.getpid(), signal.SIGKILL)
            if self.act == 2 and not self.mark.exists():
                self.mark.touch()
                os.kill(os.getpid(), signal.SIGKILL)
            if self.act == 3:
                signal.pause()
            if self.act == 4:
                raise RuntimeError("out of ideas")
        return 460.0 * (reference.position - m.joint_position) - 920.0 * m.joint_velocity
'''


def flown(ready: PreparedStudy, executor: Executor[Case, FlightResult]) -> dict[int, FlightResult]:
    """Return the results by number; every trial exactly once."""
    cases = (case_of(ready.study, ready.samples, k) for k in range(ready.trials))
    found: dict[int, FlightResult] = {}
    try:
        for results in executor.fly(cases):
            for result in results:
                assert result.number not in found
                found[result.number] = result
    finally:
        executor.close()
    assert sorted(found) == list(range(ready.trials))
    return found


@pytest.fixture
def odd(study_of: Callable[..., Study], tmp_path: Path) -> Callable[..., PreparedStudy]:
    """Return a function that gives a study whose trials do odd things."""
    (tmp_path / "odd.py").write_text(LAW)

    def make(acts: list[int], **keys: Any) -> PreparedStudy:
        rows = "\n".join(["controllers.odd.act", *map(str, acts)])
        (tmp_path / "acts.csv").write_text(rows + "\n")
        law = {"law": f"{tmp_path / 'odd.py'}:Odd", "act": 0.0, "mark": str(tmp_path / "mark")}
        return prepare(
            study_of(
                flown={"controllers": {"odd": law}, "active": "odd"},
                sampling={"method": "list", "file": "acts.csv"},
                vary=None,
                **keys,
            )
        )

    return make


@pytest.mark.slow
def test_processes_fly_what_one_flies_even_if_some_are_killed_from_outside(
    ready: PreparedStudy,
) -> None:
    pool = Pool(ready.job, 2)
    cases = (case_of(ready.study, ready.samples, k) for k in range(ready.trials))
    found: dict[int, FlightResult] = {}
    for results in pool.fly(cases):
        if not found:
            os.kill(pool.pids()[0], signal.SIGKILL)
        found |= {result.number: result for result in results}
    pool.close()
    assert found == flown(ready, InThisProcess(ready.job))


@pytest.mark.slow
def test_a_trial_that_kills_or_hangs_or_raises_is_a_failed_trial_and_no_other_is(
    odd: Callable[..., PreparedStudy],
) -> None:
    """One trial kills its process every time (1), one only once (2), one hangs, one raises."""
    ready = odd([0, 2, 0, 1, 0, 4, 0, 3, 0], limit=8.0)
    found = flown(ready, Pool(ready.job, 1))
    failed = {k: result.reason for k, result in found.items() if result.status != "ok"}
    assert sorted(failed) == [3, 5, 7]
    assert failed[3] == "its process died 2 times (SIGKILL)"
    assert "the brake takes over" in failed[5]
    assert failed[7] == "no end after 8 s"


def test_processes_do_not_run_the_script_that_flies_a_study(
    ready: PreparedStudy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A script without a guard would fly its study again in each of them, and fail there."""
    script, mark = tmp_path / "script.py", tmp_path / "mark"
    script.write_text(f"open({str(mark)!r}, 'w').close()")
    main = ModuleType("__main__")
    main.__file__ = str(script)
    monkeypatch.setitem(sys.modules, "__main__", main)
    flown(ready, Pool(ready.job, 1))
    assert not mark.exists()
    assert sys.modules["__main__"] is main


def test_threads_that_start_processes_leave_the_script_where_it_was(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def start() -> None:
        with _without_script():
            begun.set()
            leave.wait()

    script, begun, leave = ModuleType("__main__"), threading.Event(), threading.Event()
    monkeypatch.setitem(sys.modules, "__main__", script)
    other = threading.Thread(target=start)
    with _without_script():
        other.start()
        begun.wait(0.2)  # it does not begin before this one has ended
    leave.set()
    other.join()
    assert sys.modules["__main__"] is script


def test_processes_that_do_not_get_ready_are_no_fault_of_a_trial() -> None:
    broken: Any = SimpleNamespace(limit=9.0, at_once=1)  # says nothing of what flies its cases
    pool = Pool[Case, FlightResult](broken, 1)
    try:
        with pytest.raises(RunFault, match=r"3 processes, .* ended \(exit code 1\) before their"):
            list(pool.fly(iter([Case(0, 0, 0, 0, ())])))
    finally:
        pool.close()


EXAMPLES = Path(__file__).parents[4] / "docs/examples"
PLANNER = f"{EXAMPLES / 'my_shaper.py'}:Shaper"
TESTBED = f"{EXAMPLES / 'three_joints.py'}:ThreeJoints"


@pytest.mark.slow
@pytest.mark.parametrize(
    "flown_keys",
    [
        {"plan": {"method": PLANNER, "goal": {"base_yaw": 0.1}}},
        {
            "testbed": {"kind": TESTBED},
            "plan": {"method": "none"},
            "controllers": {"pd_feedforward": {}},
        },
    ],
)
def test_a_job_travels_with_classes_of_the_users_own_that_its_receiver_has_not_loaded(
    flown_keys: dict[str, Any], study_of: Callable[..., Study], monkeypatch: pytest.MonkeyPatch
) -> None:
    vary = {"effort": {"keys": ["testbed.effort_limit"], "relative": {"uniform": [-0.1, 0.1]}}}
    ready = prepare(study_of(flown_keys, vary=vary, sampling={"method": "random", "n": 2}))
    here, sent = flown(ready, InThisProcess(ready.job)), pickle.dumps(ready.job)
    for name in [name for name in sys.modules if name.startswith("flexslew_user_")]:
        monkeypatch.delitem(sys.modules, name)
    assert flown(ready, InThisProcess(pickle.loads(sent))) == here
    assert {result.status for result in here.values()} == {"ok"}


def test_workers_share_a_short_study_in_chunks_of_whole_batches() -> None:
    chunks, rate = Chunks(BATCH_WIDTH), 2000.0  # trials / s
    endless = (Case(k, k, 0, 0, ()) for k in count())
    for _ in range(8):  # it learns that a chunk of seconds holds thousands
        chunk = chunks.next(endless)
        chunks.update_rate(len(chunk), len(chunk) / rate)
    assert len(chunks.next(endless)) == 4096
    left = iter([Case(k, k, 0, 0, ()) for k in range(1024)])
    sizes = list(map(len, iter(lambda: chunks.next(left, 2), [])))
    assert sum(sizes) == 1024
    assert sizes[0] == 256
    assert all(size % BATCH_WIDTH == 0 for size in sizes)
    assert sizes == sorted(sizes, reverse=True)
