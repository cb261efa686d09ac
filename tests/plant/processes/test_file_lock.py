import os
import subprocess
import sys
from pathlib import Path

import pytest

from flexslew_plant.processes.file_lock import lock_file

HOLD = """
import sys
from pathlib import Path
from flexslew_plant.processes.file_lock import lock_file
handle = lock_file(Path(sys.argv[1]))
print(handle is not None, flush=True)
sys.stdin.read()
"""


def test_one_process_holds_a_file_until_it_ends(tmp_path: Path) -> None:
    path = tmp_path / "lock"
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "True\n"
        assert lock_file(path) is None
        other.kill()
    handle = lock_file(path)
    assert handle is not None
    os.close(handle)


def test_a_link_is_no_lock_and_no_file_is_made_unasked(tmp_path: Path) -> None:
    (tmp_path / "there").write_text("kept")
    (tmp_path / "link").symlink_to(tmp_path / "there")
    with pytest.raises(OSError, match="symbolic link"):
        lock_file(tmp_path / "link")
    with pytest.raises(FileNotFoundError):
        lock_file(tmp_path / "none", create=False)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link", "there"]
