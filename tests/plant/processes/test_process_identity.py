import os
import signal
import subprocess
import sys

from flexslew_plant.processes.process_identity import current_identity, has_terminated

HERE = current_identity().split("/")[0]


def test_only_a_process_of_this_machine_and_namespace_that_has_ended_is_dead() -> None:
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    name = f"{HERE}/{child.pid}"
    try:
        assert not has_terminated(current_identity())
        assert not has_terminated(name)
        os.kill(child.pid, signal.SIGSTOP)
        assert not has_terminated(name)
    finally:
        child.kill()
    os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)
    assert has_terminated(name)  # nobody has asked how it ended
    child.communicate()
    assert has_terminated(name)
    boot, _, namespace = HERE.partition(":")
    elsewhere = (f"{boot}:pid:[1]/{child.pid}", f"1-2:{namespace}/{child.pid}")
    for unknown in ("", "/", f"{HERE}/", f"{HERE}/me", f"/{child.pid}", str(child.pid), *elsewhere):
        assert not has_terminated(unknown), unknown
