"""Mounts and networks of one's own: in namespaces; who is not root is root of a user namespace."""

import os
import shutil
import subprocess
from functools import cache

import pytest


@cache
def prefix(*kinds: str) -> tuple[str, ...]:
    """Return what starts a command in namespaces of its own; skip the test where nobody lets it.

    Args:
        kinds: options of unshare besides --mount.
    """
    if "--net" in kinds and shutil.which("ip") is None:
        pytest.skip("no program ip here: apt-get install iproute2")
    who = () if os.geteuid() == 0 else ("--user", "--map-root-user")
    words = ("unshare", *who, "--mount", *kinds)
    if subprocess.run([*words, "true"], capture_output=True, check=False).returncode:
        pytest.skip("neither root nor user namespaces: no right to a namespace here")
    return words


def in_a_namespace(script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a shell script that may mount.

    Args:
        script: for sh.
        arguments: its $1, $2, ...
    """
    command = [*prefix(), "sh", "-c", script, "sh", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)
