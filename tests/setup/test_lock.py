"""The locks: exact versions with hashes, no place to fetch from, all that the project asks for."""

import re
import subprocess
import tomllib
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from inspect import getdoc
from itertools import chain
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version
from scipy.stats import bootstrap, qmc
from tests.present import present

ROOT = Path(__file__).parents[2]
MAIN, DEVELOP = "requirements.lock.txt", "requirements.develop.lock.txt"
EXTRAS = sorted(path.name for path in (ROOT / "setup").glob("requirements.extra.*.lock.txt"))
LOCKS = (MAIN, *EXTRAS, DEVELOP, "requirements.source.txt")
# required by their metadata, not by what the bench imports of them: FMPy builds FMUs by CMake and
# writes notebooks, nothing of it takes msgpack; the lock of ROS brings its parser as lark-parser;
# pyYeti reads Nastran's files without its spreadsheets, parallel jobs and HDF5
NOT_IMPORTED = {
    "fmpy": ("cmake", "lark", "msgpack", "nbformat"),
    "pyyeti": ("h5py", "joblib", "xlsxwriter"),
}
JAZZY = "requirements.jazzy.lock.txt"  # in the place of what LOCKS[0] has of ROS


def pins(name: str) -> list[tuple[Requirement, list[str]]]:
    """Return the requirements of a lock with their hashes."""
    return parsed((ROOT / "setup" / name).read_text())


def parsed(text: str) -> list[tuple[Requirement, list[str]]]:
    text = text.replace("\\\n", "")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    return [
        (Requirement(line.split("--hash")[0]), re.findall(r"--hash=sha256:([0-9a-f]{64})\b", line))
        for line in lines
    ]


@pytest.mark.parametrize("name", [*LOCKS, JAZZY])
def test_each_distribution_is_pinned_once_and_has_a_hash(name: str) -> None:
    found = pins(name)
    assert found
    assert len({canonicalize_name(pin.name) for pin, _ in found}) == len(found)
    for pin, hashes in found:
        assert re.fullmatch(r"==[0-9][^*,]*", str(pin.specifier)), pin
        assert hashes, pin


@pytest.mark.parametrize("name", [*LOCKS, JAZZY])
def test_no_lock_says_where_to_fetch_from(name: str) -> None:
    text = (ROOT / "setup" / name).read_text()
    assert "://" not in text
    assert [line for line in text.splitlines() if line.startswith("-")] == []


def test_the_lock_satisfies_the_project_and_its_extras() -> None:
    versions = {
        canonicalize_name(pin.name): str(pin.specifier)[2:]
        for name in (MAIN, *EXTRAS, DEVELOP)
        for pin, _ in pins(name)
    }
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"].values()
    for line in chain(project["dependencies"], *extras):
        requirement = Requirement(line)
        # pictures of the docs; what a notebook brings along
        if canonicalize_name(requirement.name) in ("matplotlib", "xarray"):
            continue
        version = versions[canonicalize_name(requirement.name)]
        assert requirement.specifier.contains(version), line


def test_the_oldest_scipy_that_is_allowed_takes_the_generators_that_it_is_given() -> None:
    """Studies draw with `rng=`; its pages say since when each function takes it."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    allowed = next(
        Requirement(line).specifier for line in project["dependencies"] if line.startswith("scipy")
    )
    for drawn in (qmc.Sobol, qmc.LatinHypercube, bootstrap):
        changes = re.findall(r"versionchanged:: ([\d.]+)\s+As part of the", getdoc(drawn) or "")
        assert len(changes) == 1
        before = f"{Version(changes[0]).major}.{Version(changes[0]).minor - 1}.9"
        assert not allowed.contains(before)


def test_beside_an_installed_ros_the_rest_of_the_lock_fits_its_numpy() -> None:
    """Ubuntu 24.04, of Jazzy and Kilted: Python 3.12 with NumPy 1.26.4."""
    there = {"python_version": "3.12", "python_full_version": "3.12.3", "extra": ""}
    for pin, _ in beside_installed_ros():
        installed = distribution_or_none(pin.name)
        if installed is None:
            assert pin.marker  # of another Python
            continue
        for line in installed.requires or ():
            needed = Requirement(line)
            if needed.name == "numpy" and (not needed.marker or needed.marker.evaluate(there)):
                assert needed.specifier.contains("1.26.4"), f"{pin.name} needs {line}"


def test_beside_an_installed_ros_everything_but_what_it_brings_is_pinned_with_hashes() -> None:
    kept = beside_installed_ros()
    locked = {pin.name for name in (MAIN, *EXTRAS) for pin, _ in pins(name)}
    left = locked - {pin.name for pin, _ in kept}
    assert {name for name in left if not name.startswith("ros-")} == {
        "catkin-pkg", "ctrlsys", "fmpy", "lark-parser", "ml-dtypes", "numpy", "onnx", "pandas",
        "pyyeti",
    }  # fmt: skip
    assert all(hashes for _, hashes in kept)


def beside_installed_ros() -> list[tuple[Requirement, list[str]]]:
    """Return what setup/install.sh takes of the locks there."""
    script = (ROOT / "setup" / "install.sh").read_text()
    body = r"^beside_installed_ros\(\) \{\n.*?^\}"
    function = present(re.search(body, script, re.MULTILINE | re.DOTALL))
    text = subprocess.run(
        ["bash", "-euc", f"{function[0]}\nbeside_installed_ros"],
        input="".join((ROOT / "setup" / name).read_text() for name in (MAIN, *EXTRAS)),
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    return parsed(text)


def test_only_extras_share_distributions_and_then_the_same_ones() -> None:
    names = [
        {canonicalize_name(pin.name) for lock in group for pin, _ in pins(lock)}
        for group in ((MAIN,), EXTRAS, (DEVELOP,), (LOCKS[-1],))
    ]
    assert sum(map(len, names)) == len(set().union(*names))
    shared: dict[str, set[str]] = {}
    for lock in EXTRAS:
        for pin, hashes in pins(lock):
            shared.setdefault(pin.name, set()).add(f"{pin} {hashes}")
    assert [name for name, lines in shared.items() if len(lines) > 1] == []


@pytest.mark.parametrize("lock", EXTRAS)
def test_an_extra_holds_all_that_its_distributions_require_and_states_its_size(lock: str) -> None:
    """A person may install this one alone."""
    assert re.fullmatch(r"# .+: \d+ MB", (ROOT / "setup" / lock).read_text().splitlines()[0])
    held = {canonicalize_name(pin.name) for name in (MAIN, lock) for pin, _ in pins(name)}
    for pin, _ in pins(lock):
        try:
            requires = distribution(pin.name).requires or ()
        except PackageNotFoundError:
            assert pin.marker  # of another Python
            continue
        for line in requires:
            needed = Requirement(line)
            if needed.name in NOT_IMPORTED.get(pin.name, ()):
                continue
            if needed.marker is None or needed.marker.evaluate({"extra": ""}):
                assert canonicalize_name(needed.name) in held, f"{pin.name} needs {line}"


def test_every_extra_of_the_project_that_is_locked_brings_what_it_names() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    locked = {lock.split(".")[2]: {pin.name for pin, _ in pins(lock)} for lock in EXTRAS}
    main = {canonicalize_name(pin.name) for pin, _ in pins(MAIN)}
    offered = project["optional-dependencies"]
    assert {*offered} - {*locked} == {"docs", "pandas", "xarray"}
    assert {*locked} - {*offered} == {"control"}  # which `pip install .` always brings
    for extra in {*offered} & {*locked}:
        names = {canonicalize_name(Requirement(line).name) for line in offered[extra]}
        assert names <= locked[extra] | main, extra


def test_every_compiled_distribution_beside_an_installed_ros_has_wheels_for_both_processors() -> (
    None
):
    """One for each Python and processor, but for those that have one wheel for all Pythons."""
    for pin, hashes in beside_installed_ros():
        wheel = distribution_or_none(pin.name)
        if wheel is None or "-none-any" in (wheel.read_text("WHEEL") or ""):
            continue
        assert len(hashes) >= 2, pin


def distribution_or_none(name: str) -> Distribution | None:
    try:
        return distribution(name)
    except PackageNotFoundError:
        return None


def test_the_wheels_of_jazzy_bring_every_interface_that_those_of_kilted_bring() -> None:
    kilted, jazzy = ({pin.name for pin, _ in pins(lock)} for lock in (LOCKS[0], JAZZY))
    interfaces = {
        name for name in kilted if re.fullmatch(r"ros-[a-z-]*(msgs|srvs|interfaces)", name)
    }
    assert {"ros-sensor-msgs", "ros-nav-msgs", "ros-trajectory-msgs"} <= interfaces
    assert {name for name in interfaces if "kilted" not in name} <= jazzy
    assert {name for name in jazzy if not name.startswith("ros-")} == set()


def test_readme_and_installation_give_the_size_of_all_extras() -> None:
    page = (ROOT / "docs" / "installation.md").read_text()
    rows = re.findall(r"^\| `(\w+)` \| (\d+) MB", page, re.MULTILINE)
    assert {name for name, _ in rows} == {lock.split(".")[2] for lock in EXTRAS}
    total = sum(int(size) for _, size in rows)
    readme = (ROOT / "README.md").read_text()
    for text, sentence in (
        (page, r"extras` installs the rest, ([\d,]+) MB"),
        (readme, r"flexslew extras +# ([\d,]+) MB more"),
    ):
        found = re.search(sentence, text)
        assert found is not None
        assert abs(int(found[1].replace(",", "")) - total) <= 25, (found[0], total)
