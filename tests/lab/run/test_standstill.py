import threading
from pathlib import Path

import pytest

from flexslew_lab.run.standstill import PATIENCE, StallMonitor


class Process:
    """What the kernel shows of a process with three threads."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.show("python", 7)
        self.show("dds.udp.7410", 7)

    def show(self, name: str, woken: int, state: str = "S (sleeping)") -> None:
        thread = self.folder / "42" / "task" / name
        thread.mkdir(parents=True, exist_ok=True)
        (thread / "comm").write_text(f"{name}\n")
        lines = f"Name:\t{name}\nState:\t{state}\nvoluntary_ctxt_switches:\t{woken}\n"
        (thread / "status").write_text(f"{lines}nonvoluntary_ctxt_switches:\t{woken}\n")


@pytest.mark.parametrize(
    ("wakes", "state", "stuck"),
    [
        (False, "S (sleeping)", True),
        (True, "S (sleeping)", False),
        (False, "T (stopped)", False),  # by a debugger
        (False, "R (running)", False),  # the machine is busy
    ],
)
def test_only_timers_that_never_wake_are_stuck(
    tmp_path: Path, wakes: bool, state: str, stuck: bool
) -> None:
    now = 0.0
    process, look = Process(tmp_path), StallMonitor(lambda: now, tmp_path)
    found = []
    for turn in range(20):
        process.show("dds.ev.0", turn if wakes else 7, state)
        found.append((now, look.of(42)))
        now += PATIENCE / 10.0
    assert found == [(at, stuck and at > PATIENCE) for at, _ in found]
    assert any(is_stuck for _, is_stuck in found) is stuck
    assert not look.of(43)  # that has ended


def test_one_that_was_stopped_has_its_time_again(tmp_path: Path) -> None:
    now = 0.0
    process, look = Process(tmp_path), StallMonitor(lambda: now, tmp_path)
    for turn in range(30):
        process.show("dds.ev.0", 7, "T (stopped)" if turn < 20 else "S (sleeping)")
        assert not look.of(42)
        now += 0.1 * PATIENCE
    now += 0.1 * PATIENCE
    assert look.of(42)


def test_the_kernel_shows_what_is_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """A thread that waits for a lock that nobody opens, as the kernel shows it."""
    monkeypatch.setattr("flexslew_lab.run.standstill.PATIENCE", 0.2)
    lock, named = threading.Lock(), threading.Event()
    lock.acquire()

    def stuck() -> None:
        Path(f"/proc/self/task/{threading.get_native_id()}/comm").write_text("dds.ev.0")
        named.set()
        with lock:
            pass

    thread = threading.Thread(target=stuck)
    thread.start()
    named.wait()
    look, pid = StallMonitor(), int(Path("/proc/self").resolve().name)
    pause = threading.Event()
    assert not look.of(pid)
    pause.wait(0.1)
    look.of(pid)  # it sleeps by now
    pause.wait(0.4)
    assert look.of(pid)
    lock.release()
    thread.join()
    assert not look.of(pid)
