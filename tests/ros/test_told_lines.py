"""Nodes whose output nobody reads any more."""

import os
import subprocess
import sys

import pytest

TOLD = """
import sys
from flexslew_plant.ros.told_lines import write_line
for k in range(3):
    write_line(str(k), {wrong})
sys.exit(7)
"""


@pytest.mark.parametrize("wrong", [False, True])
def test_who_tells_into_a_pipe_without_a_reader_goes_on(wrong: bool) -> None:
    read_end, write_end = os.pipe()
    os.close(read_end)
    broken, kept = ("stderr", "stdout") if wrong else ("stdout", "stderr")
    outputs = {broken: write_end, kept: subprocess.PIPE}
    command = [sys.executable, "-P", "-c", TOLD.format(wrong=wrong)]
    done = subprocess.run(command, stdout=outputs["stdout"], stderr=outputs["stderr"])
    os.close(write_end)
    assert done.returncode == 7
    assert not getattr(done, kept)
