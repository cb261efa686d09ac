"""Write the hashes of every pinned distribution into the locks: `python setup/lock.py`.

A lock is a list of `name==version` (with a marker where one is needed). To add or to change a
distribution, edit its line and run this with a recent pip, on one file or without arguments on all.
For each supported Python and processor, pip reports the wheel that it would take on Linux; nothing
is installed.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from pip._vendor.packaging.requirements import Requirement
from pip._vendor.packaging.utils import canonicalize_name

PYTHONS = ("3.11", "3.12", "3.13", "3.14")
GLIBC = (5, 12, 17, 24, 26, 27, 28, 31, 34, 35, 36)  # Debian 12 has 2.36
PLATFORMS = (
    *("linux", "manylinux1", "manylinux2010", "manylinux2014"),
    *(f"manylinux_2_{minor}" for minor in GLIBC),
)
MACHINES = ("x86_64", "aarch64")  # ROS 2 has wheels for the first only
LOCKS = sorted(Path(__file__).parent.glob("requirements.*lock.txt"))


def read(lock: Path) -> tuple[list[str], list[Requirement]]:
    """Return the leading comments of a lock and its requirements, without their hashes."""
    lines = lock.read_text().replace("\\\n", "").splitlines()
    comments = [line for line in lines if line.startswith("#")]
    pins = [line.split("--hash")[0].strip() for line in lines if line and line[0] not in "# "]
    return comments, [Requirement(pin) for pin in pins]


def wheels(pins: list[Requirement], python: str, machine: str) -> dict[str, str]:
    """Return the SHA-256 of the wheel of each distribution for a Python and a processor.

    Raises:
        subprocess.CalledProcessError: if one has no such wheel; pip names it.
    """
    here = {
        "python_version": python,
        "python_full_version": f"{python}.0",
        "platform_machine": machine,
    }
    requested = [
        pin
        for pin in pins
        if (pin.marker is None or pin.marker.evaluate(here))
        and (machine == MACHINES[0] or not pin.name.startswith("ros-"))
    ]
    if not requested:
        return {}
    with tempfile.TemporaryDirectory() as folder:
        names, report = Path(folder, "names.txt"), Path(folder, "report.json")
        names.write_text("".join(f"{pin.name}{pin.specifier}\n" for pin in requested))
        command = [sys.executable, "-m", "pip", "install", "--quiet", "--dry-run"]
        command += ["--ignore-installed", "--no-deps", "--only-binary", ":all:"]
        command += ["--target", folder, "--python-version", python]
        command += [word for p in PLATFORMS for word in ("--platform", f"{p}_{machine}")]
        subprocess.run([*command, "--report", report, "-r", names], check=True)
        found = json.loads(report.read_text())["install"]
    return {
        canonicalize_name(item["metadata"]["name"]): item["download_info"]["archive_info"][
            "hashes"
        ]["sha256"]
        for item in found
    }


def locked(lock: Path) -> str:
    """Return the text of a lock with the hashes of all its wheels."""
    comments, pins = read(lock)
    hashes = [wheels(pins, python, machine) for python in PYTHONS for machine in MACHINES]
    lines = comments
    for pin in sorted(pins, key=lambda pin: canonicalize_name(pin.name)):
        name = canonicalize_name(pin.name)
        own = sorted({found[name] for found in hashes if name in found})
        head = f"{name}{pin.specifier}" + (f" ; {pin.marker}" if pin.marker else "")
        lines += [" \\\n    ".join([head, *(f"--hash=sha256:{digest}" for digest in own)])]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    for path in [Path(name) for name in sys.argv[1:]] or LOCKS:
        path.write_text(locked(path))
