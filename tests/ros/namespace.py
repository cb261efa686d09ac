"""Mounts of one's own: as root in a mount namespace, else as root of a user namespace."""

import os
import subprocess
from functools import cache

import pytest


@cache
def _prefix() -> tuple[str, ...]:
    who = () if os.geteuid() == 0 else ("--user", "--map-root-user")
    return ("unshare", *who, "--mount")


def in_a_namespace(script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a shell script that may mount; skip the test where nobody lets it.

    Args:
        script: for sh.
        arguments: its $1, $2, ...
    """
    if subprocess.run([*_prefix(), "true"], capture_output=True, check=False).returncode:
        pytest.skip("neither root nor user namespaces: no right to mount a tmpfs here")
    command = [*_prefix(), "sh", "-c", script, "sh", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)
