import multiprocessing
import os
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from flexslew_lab.run import domain, domain_locks
from flexslew_plant.errors import BadInput, FlexslewError


@pytest.fixture(autouse=True)
def alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep the locks of other runs out of sight."""
    monkeypatch.setattr(domain_locks, "folder", lambda: tmp_path)
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)


def trials() -> dict[int, str]:
    return {bench.domain: bench.trial for bench in domain.running_benches()}


def test_a_run_leaves_its_domain_for_those_who_look_for_it(tmp_path: Path) -> None:
    assert trials() == {}
    assert domain.bench_domain() == (0, False)
    with domain.locked_domain("m1", tmp_path / "run") as first:
        assert trials() == {first: "m1"}
        assert domain.bench_domain() == (first, True)
        words = f"m1 in {tmp_path / 'run'}, ROS_DOMAIN_ID {first}"
        assert domain.default_bench().words == words
        with domain.locked_domain("swap_demo") as second:
            assert second != first
            assert trials() == {first: "m1", second: "swap_demo"}
            with pytest.raises(FlexslewError, match=rf"swap_demo, .*ID {second}; m1 .*ID {first}$"):
                domain.bench_domain()
    assert trials() == {}


def test_who_examines_a_controller_is_not_taken_for_a_bench() -> None:
    with domain.locked_domain("conform", bench=False), domain.locked_domain("m1") as number:
        assert trials() == {number: "m1"}
        assert domain.default_bench().trial == "m1"


def test_the_domain_of_this_shell_may_hold_a_bench_that_claims_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def free() -> list[int]:
        return [bench.domain for bench in domain.bench_without_lock()]

    assert free() == [0]
    with domain.locked_domain("m1") as number:
        assert free() == [0]
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        assert free() == []
    assert free() == [number]


def test_the_bench_of_this_checkout_is_meant(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as elsewhere:
        elsewhere.setattr(domain, "_ROOT", "/another/checkout")
        other = domain.locked_domain("theirs")
        first = other.__enter__()
    assert domain.default_bench().domain == first  # the only one
    assert domain.default_bench().words.endswith(", of /another/checkout")
    with domain.locked_domain("mine") as second:
        assert domain.default_bench().domain == second
    other.__exit__(None, None, None)


def test_the_bench_of_another_user_is_never_meant(monkeypatch: pytest.MonkeyPatch) -> None:
    with domain.locked_domain("theirs") as theirs:
        monkeypatch.setattr(domain, "user", lambda: 4321)
        assert domain.running_benches() == []
        assert domain.bench_domain() == (0, False)
        monkeypatch.setenv("ROS_DOMAIN_ID", str(theirs))
        with pytest.raises(FlexslewError, match="the bench of another user"):
            domain.bench_domain()


def test_a_console_tells_its_folder_once_it_has_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with domain.locked_domain("m1") as number:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        with domain.locked_domain("m1", tmp_path / "run"):
            assert domain.default_bench().folder == str(tmp_path / "run")
        assert domain.bench_domain() == (number, True)


def test_the_users_own_domain_wins(monkeypatch: pytest.MonkeyPatch) -> None:
    with domain.locked_domain("m1") as first:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(first + 1))
        assert domain.bench_domain() == (first + 1, False)
        with domain.locked_domain("mine") as requested:
            assert requested == first + 1
            assert domain.bench_domain() == (first + 1, True)


@pytest.mark.parametrize("requested", ["x", "-1", "233", "1.5"])
def test_a_domain_that_is_none_is_told(monkeypatch: pytest.MonkeyPatch, requested: str) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", requested)
    with pytest.raises(BadInput, match="ROS_DOMAIN_ID: "), domain.locked_domain():
        pass


def test_a_lock_of_a_run_that_was_killed_counts_no_more(tmp_path: Path) -> None:
    for number in range(1, 102):
        (tmp_path / f"flexslew_domain_{number}_{domain_locks.user()}.lock").write_text("gone")
    os.utime(tmp_path / f"flexslew_domain_7_{domain_locks.user()}.lock", (0, 0))
    assert trials() == {}
    with domain.locked_domain("m1") as number:
        assert number == 7  # the one that was used last the longest time ago
        assert trials() == {7: "m1"}


def test_a_machine_without_a_free_domain_is_reported_with_the_reason(tmp_path: Path) -> None:
    with ExitStack() as runs:
        for _ in range(98):
            runs.enter_context(domain.locked_domain())
        free = {*range(1, 102)} - {bench.domain for bench in domain.running_benches()}
        for number in free:
            (tmp_path / f"flexslew_domain_{number}_{domain_locks.user()}.lock").mkdir()
        with pytest.raises(FlexslewError) as error, domain.locked_domain():
            pass
    words = str(error.value)
    assert "98 are in use, 3 cannot be locked (" in words
    assert (
        f"{tmp_path}/flexslew_domain_{max(free)}_{domain_locks.user()}.lock: Is a directory"
        in words
    )


@pytest.fixture
def as_another_user() -> Callable[[Callable[[], object]], object]:
    """Return a function that calls another one as the user `nobody`, with a umask of 077."""
    if os.geteuid() != 0:
        pytest.skip("only root can act as two users")

    def call(function: Callable[[], object]) -> object:
        mine, theirs = multiprocessing.Pipe()

        def child() -> None:
            os.setgroups([])
            os.setgid(65534)
            os.setuid(65534)
            os.umask(0o077)
            try:
                theirs.send(function())
            except Exception as error:
                theirs.send(repr(error))

        process = multiprocessing.get_context("fork").Process(target=child)
        process.start()
        assert mine.poll(30.0)
        result: object = mine.recv()
        process.join()
        return result

    return call


def test_every_user_can_fly_after_another_one_has_used_every_domain(
    monkeypatch: pytest.MonkeyPatch,
    as_another_user: Callable[[Callable[[], object]], object],
) -> None:
    """The folder of temporary files is shared: a user cannot write the lock of another one."""
    with tempfile.TemporaryDirectory() as shared:
        os.chmod(shared, 0o1777)
        monkeypatch.setattr(domain_locks, "folder", lambda: Path(shared))

        def every_domain() -> list[int]:
            with ExitStack() as runs:
                return sorted(runs.enter_context(domain.locked_domain()) for _ in range(101))

        def another_domain() -> tuple[int, list[int]]:
            with domain.locked_domain("theirs") as number:
                return number, [bench.domain for bench in domain.running_benches(all_users=True)]

        assert as_another_user(every_domain) == [*range(1, 102)]
        with domain.locked_domain("m1") as first, domain.locked_domain("m1") as second:
            flown: Any = as_another_user(another_domain)
            number, seen = flown
            assert number not in (first, second)
            assert seen == sorted((first, second, number))
        assert as_another_user(every_domain) == [*range(1, 102)]
        umask = os.umask(0o077)
        try:
            assert every_domain() == [*range(1, 102)]
        finally:
            os.umask(umask)
        assert as_another_user(every_domain) == [*range(1, 102)]
