"""What every test may rely on, however the tests were started."""

import os
import pickle
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from typing import TYPE_CHECKING

import hypothesis
import numpy as np
import pytest
from typer.main import get_command

from tests.browser import NO_CHROMIUM

if TYPE_CHECKING:
    from flexslew_control.plan import Plan

# A shell starts what runs in its background with SIGINT ignored; so would all children be, and
# those of bash could not even ask for it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# how long an example takes says how busy the machine is
hypothesis.settings.register_profile("bench", deadline=None)
hypothesis.settings.load_profile("bench")


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("campaigns")
    group.addoption("--cases", type=int, help="Random cases of each campaign; ten without it.")
    group.addoption("--transport", default="", help="Of questions over ROS: auto or dds.")
    group.addoption("--seed", type=int, default=1, help="Of the first case; the next has the next.")


def pytest_terminal_summary(terminalreporter: "pytest.TerminalReporter") -> None:
    """Report in one line how many tests lacked a browser, and how to run them."""
    skipped = terminalreporter.stats.get("skipped", [])
    count = sum(NO_CHROMIUM in str(report.longrepr) for report in skipped)
    if count:
        tests = "1 test was" if count == 1 else f"{count} tests were"
        remedy = "apt-get install chromium chromium-driver, then run the same command again"
        terminalreporter.write_line(f"{tests} skipped, {NO_CHROMIUM} here: {remedy}", yellow=True)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Draw the random cases of a test with a `case`; without --cases, mark all but the first."""
    own = any("case" in mark.args[0] for mark in metafunc.definition.iter_markers("parametrize"))
    if "case" not in metafunc.fixturenames or own:
        return
    option = metafunc.config.option
    share = metafunc.definition.get_closest_marker("share")
    part = share.args[0] if share else 1.0
    count = max(1, round(part * (10 if option.cases is None else option.cases)))
    beyond = [pytest.mark.campaign] if option.cases is None else []
    seeds = range(option.seed + 1, option.seed + count)
    cases = [option.seed, *(pytest.param(seed, marks=beyond) for seed in seeds)]
    metafunc.parametrize("case", cases, indirect=True)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark as `matrix` what a test marked `first(count)` has beyond that many parameters."""
    seen: Counter[str] = Counter()
    for item in items:
        if mark := item.get_closest_marker("first"):
            test = item.nodeid.split("[")[0]
            if seen[test] >= mark.args[0]:
                item.add_marker(pytest.mark.matrix)
            seen[test] += 1


@pytest.fixture(autouse=True, scope="session")
def _commands_are_built_once() -> Iterator[None]:
    """Keep what typer makes of an app, as a quarter of a short command's time goes into it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("typer.testing._get_command", cache(get_command))
        yield


@pytest.fixture
def case(request: pytest.FixtureRequest) -> np.random.Generator:
    """Return what a random case is drawn from; its seed is in the name of the test."""
    return np.random.default_rng(request.param)


@pytest.fixture(scope="session")
def shipped_plan(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], "Plan | None"]:
    """Return a function that gives the plan of a shipped trial: one for all processes of a run."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent  # which this process has not for itself

    def planned(name: str) -> "Plan | None":
        from flexslew_lab.trial.sources import read_trial
        from flexslew_lab.trial.trial import plan_of_trial
        from flexslew_plant.processes.file_lock import lock_handle

        kept = folder / f"{name}.plan"
        handle = os.open(folder / f"{name}.lock", os.O_RDWR | os.O_CREAT)
        try:
            lock_handle(handle, wait=True)
            if not kept.exists():
                kept.write_bytes(pickle.dumps(plan_of_trial(read_trial(name)[0])))
            plan: Plan | None = pickle.loads(kept.read_bytes())
        finally:
            os.close(handle)
        return plan

    return planned
