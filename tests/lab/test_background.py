"""Work in the background: by whom, and until when it is waited for."""

import os
import subprocess
import sys
from pathlib import Path

from flexslew_lab.background import wait_for
from flexslew_plant.processes.file_lock import lock_file

PROGRAM = """
import os, sys
from pathlib import Path
from flexslew_lab.background import in_background
folder = Path(sys.argv[1])
if in_background(folder / "log"):
    (folder / "go_on").read_text()  # a FIFO
    print(os.nice(0), os.getsid(0) == os.getpid(), flush=True)
"""


def test_it_outlives_its_command_yields_to_others_and_is_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "go_on")
    subprocess.run([sys.executable, "-c", PROGRAM, str(tmp_path)], check=True)
    log = tmp_path / "log"
    assert lock_file(log) is None  # it is at work
    subprocess.run([sys.executable, "-c", PROGRAM, str(tmp_path)], check=True)  # no second one
    (tmp_path / "go_on").write_text("now")
    wait_for(log)
    assert log.read_text() == "19 True\n"


def test_where_nobody_works_nobody_waits(tmp_path: Path) -> None:
    wait_for(tmp_path / "log")
    assert not (tmp_path / "log").exists()
    (tmp_path / "log").write_text("done\n")
    wait_for(tmp_path / "log")
    assert (tmp_path / "log").read_text() == "done\n"
