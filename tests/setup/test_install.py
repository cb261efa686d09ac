"""setup/install.sh behind ./flexslew: when it installs, when it refuses, how it is interrupted."""

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from hashlib import sha1
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

# Stands for python3, and for the .venv/bin/python that it makes. Every call is a line of the log.
STUB = r"""#!/bin/bash
echo "${*:1:4}" >>"$STUB_LOG"
case "$*" in
  "-m venv "*)
    mkdir -p "${@: -1}/bin" && cp "$0" "${@: -1}/bin/python" ;;
  "-P -m pip "*)
    for n in $(seq 60); do echo "Collecting package-$n==1.0"; done
    echo "Installing collected packages: package-1, package-2"
    if [ -e "$STUB_FOLDER/hang" ]; then
      trap 'echo cancelled >>"$STUB_LOG"; exit 1' INT
      echo pip hangs >"$STUB_FOLDER/hanging"
      while :; do read -r -t 1 <>"$STUB_FOLDER/nothing"; done
    fi
    [ ! -e "$STUB_FOLDER/fail" ] || { echo "ERROR: no space left" >&2; exit 1; } ;;
  "-P -m colcon "*)
    mkdir -p install
    echo 'export PYTHONPATH=/of/colcon LD_LIBRARY_PATH=/of/colcon/lib:' >install/local_setup.bash ;;
  "-P -m flexslew_lab.cli.main"*)
    echo "here is the command line" ;;
esac
"""


class Checkout:
    """A copy of what the set-up reads, with a stub for Python."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.root, self.folder, self.log = root, folder, folder / "calls"
        tools = folder / "bin"
        tools.mkdir()
        for name in ("g++", "cmake", "ninja", "python3", "chromedriver", "ip"):
            (tools / name).write_text(STUB)
            (tools / name).chmod(0o755)
        os.mkfifo(folder / "nothing")
        os.mkfifo(folder / "hanging")
        shutil.copytree(ROOT / "setup", root / "setup")
        shutil.copy(ROOT / "flexslew", root / "flexslew")
        profiles = "ros2_ws/src/flexslew_plant/flexslew_plant/profiles"
        shutil.copytree(ROOT / profiles, root / profiles)
        (root / "ros2_ws" / "src" / "msgs").mkdir()
        (root / "ros2_ws" / "src" / "msgs" / "A.msg").write_text("float64 a\n")
        self.environment = {
            "PATH": f"{tools}:{os.environ['PATH']}",
            "STUB_LOG": str(self.log),
            "STUB_FOLDER": str(folder),
        }

    def start(
        self, script: Path | None = None, command: str = "trial", words: Sequence[str] = ()
    ) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [script or self.root / "flexslew", command, *words],
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def call(
        self, script: Path | None = None, command: str = "trial", words: Sequence[str] = ()
    ) -> tuple[int, str]:
        """Return the exit code and what stood on standard error; forget the log of before."""
        self.log.write_text("")
        process = self.start(script, command, words)
        output, errors = process.communicate(timeout=60)
        assert (process.returncode == 0) == (output == "here is the command line\n")
        return process.returncode, errors

    def use_real_python(self) -> None:
        """Run scripts of setup/ for real; all other calls stay with the stub."""
        python = self.folder / "bin" / "python3"
        lines = python.read_text().split("\n", 1)
        python.write_text(
            f'{lines[0]}\ncase $1 in *.py) exec {sys.executable} "$@" ;; esac\n{lines[1]}'
        )

    @property
    def steps(self) -> list[str]:
        """The long steps since the last call, in order."""
        kinds = ("-m venv", "-P -m pip", "-P -m colcon", "-P -m flexslew_lab.compile_kernels")
        calls = self.log.read_text().splitlines()
        return [kind.split()[-1] for call in calls for kind in kinds if call.startswith(kind)]


ALL = ["venv", "pip", "pip", "colcon", "flexslew_lab.compile_kernels"]


@pytest.fixture
def checkout(tmp_path: Path) -> Checkout:
    return Checkout(tmp_path / "checkout", tmp_path)


def test_the_first_call_sets_up_and_the_second_one_does_nothing(checkout: Checkout) -> None:
    assert checkout.call()[0] == 0
    assert checkout.steps == ALL
    assert checkout.call() == (0, "")
    assert checkout.steps == []


@pytest.mark.parametrize("command", ["extras", "test", "bench"])
def test_who_needs_the_extras_gets_them_once(checkout: Checkout, command: str) -> None:
    assert checkout.call()[0] == 0
    code, errors = checkout.call(command=command)
    assert code == 0
    assert "test: Python packages into .venv (93 distributions, 1621 MB at most)" in errors
    assert checkout.steps == ["pip", ALL[-1]]
    for again in (command, "trial"):
        assert checkout.call(command=again) == (0, "")
        assert checkout.steps == []


def test_extras_are_installed_by_name_once_and_an_unknown_name_installs_nothing(
    checkout: Checkout,
) -> None:
    assert checkout.call(command="trial")[0] == 0
    for words in (["sonsole"], ["console", "sonsole"], ["--help"], ["../console"]):
        assert checkout.call(command="extras", words=words) == (0, "")
        assert checkout.steps == []
    code, errors = checkout.call(command="extras", words=["console", "foxglove"])
    assert code == 0
    assert "extras console foxglove: Python packages into .venv (39 distributions, 72 MB" in errors
    listed = (checkout.root / ".venv" / "requirements.extra.txt").read_text()
    assert "\nnicegui==" in listed
    assert "casadi==" not in listed
    assert checkout.steps == ["pip"]
    code, errors = checkout.call(command="extras", words=["console", "export"])
    assert "extras export: " in errors
    assert checkout.steps == ["pip", ALL[-1]]  # the machine code of studies
    code, errors = checkout.call(command="extras")
    assert (
        "extras c casadi control ctrlsys dask fmu gains gym measurements nastran onnx serial test: "
        in errors
    )
    assert checkout.call(command="test")[0] == 0
    assert checkout.steps == []


def test_extras_of_another_list_are_installed_again_and_those_of_another_base_with_it(
    checkout: Checkout,
) -> None:
    assert checkout.call(command="test")[0] == 0
    assert checkout.steps == [*ALL[:3], "pip", *ALL[3:]]
    for lock, steps in (
        ("extra.console.", ["pip"]), ("extra.export.", ["pip", ALL[-1]]),
        ("", [*ALL[:3], "pip", *ALL[3:]]),
    ):  # fmt: skip
        path = checkout.root / "setup" / f"requirements.{lock}lock.txt"
        path.write_text(path.read_text() + "# another\n")
        assert checkout.call(command="test")[0] == 0
        assert checkout.steps == steps


def test_who_builds_an_image_waits_for_all_machine_code(checkout: Checkout) -> None:
    checkout.start(checkout.root / "setup" / "install.sh").communicate(timeout=60)
    assert checkout.steps == [*ALL[:3], "pip", *ALL[3:]]
    assert checkout.log.read_text().splitlines()[-1].endswith("compile_kernels --wait")
    (checkout.root / "ros2_ws" / "src" / "msgs" / "A.msg").write_text("float64 b\n")
    checkout.call()
    assert checkout.log.read_text().splitlines()[-2].endswith("compile_kernels")


def test_beside_an_installed_ros_its_own_packages_and_numpy_are_left_out(
    checkout: Checkout,
) -> None:
    checkout.environment |= {"ROS_DISTRO": "jazzy", "AMENT_PREFIX_PATH": "/opt/ros/jazzy"}
    checkout.environment["FLEXSLEW_INSTALLED_ROS"] = "jazzy"
    assert checkout.call()[0] == 0
    assert checkout.steps == [step for k, step in enumerate(ALL) if k != 2]  # nothing from source
    listed = (checkout.root / ".venv" / "requirements.txt").read_text()
    assert "scipy==" in listed
    assert "numpy==" not in listed
    assert "--hash=sha256:" in listed


def test_the_environment_of_the_workspace_is_that_of_colcon_before_what_is_there(
    checkout: Checkout,
) -> None:
    def seen(**outer: str) -> list[str]:
        script = checkout.root / "setup" / "environment.sh"
        words = f'set -eu; . "{script}"; echo "$PYTHONPATH|$LD_LIBRARY_PATH"'
        done = subprocess.run(
            ["bash", "-c", words],
            env={"PATH": os.environ["PATH"]} | outer,
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout.strip().split("|")

    assert checkout.call()[0] == 0
    assert seen() == ["/of/colcon", "/of/colcon/lib"]
    assert seen(PYTHONPATH="/mine") == ["/of/colcon:/mine", "/of/colcon/lib"]
    (checkout.root / "ros2_ws" / "install" / "environment.sh").unlink()  # built before it was
    assert checkout.call() == (0, "")
    assert seen() == ["/of/colcon", "/of/colcon/lib"]


def test_a_symbolic_link_to_the_folder_is_the_same_checkout(checkout: Checkout) -> None:
    link = checkout.folder / "link"
    link.symlink_to(checkout.root)
    assert checkout.call(link / "flexslew")[0] == 0
    assert checkout.steps == ALL
    for script in (link / "flexslew", checkout.root / "flexslew"):
        assert checkout.call(script) == (0, "")
        assert checkout.steps == []


def test_a_symbolic_link_to_the_script_finds_its_files(checkout: Checkout) -> None:
    link = checkout.folder / "bin" / "flexslew"
    link.symlink_to("../checkout/flexslew")
    assert checkout.call(link)[0] == 0
    assert checkout.steps == ALL
    assert checkout.call() == (0, "")
    assert checkout.steps == []


def test_what_a_file_holds_counts_and_not_when_it_was_written(checkout: Checkout) -> None:
    checkout.call()
    message = checkout.root / "ros2_ws" / "src" / "msgs" / "A.msg"
    lock = checkout.root / "setup" / "requirements.lock.txt"
    for file in (message, lock):
        os.utime(file, (0, 0))
    assert checkout.call() == (0, "")
    assert checkout.steps == []
    message.write_text("float64 b\n")
    assert checkout.call()[0] == 0
    assert checkout.steps == ALL[3:]
    lock.write_text(lock.read_text() + "# another\n")
    assert checkout.call()[0] == 0
    assert checkout.steps == ALL


@pytest.mark.parametrize("copied", [False, True])
def test_a_moved_or_copied_checkout_has_its_paths_rewritten_and_builds_nothing(
    checkout: Checkout, copied: bool
) -> None:
    checkout.use_real_python()
    checkout.call()
    root, moved = checkout.root, checkout.folder / "moved.to"
    tool = root / ".venv" / "bin" / "some-tool"
    tool.write_text(f"#!{root}/.venv/bin/python3\nprint()\n")
    tool.chmod(0o755)
    workspace = root / "ros2_ws"
    (workspace / "build" / "msgs").mkdir(parents=True)
    flags = f"-I{root}/ros2_ws/a -S{root}/b PATH={root}:{root}2:{root}-old:/srv{root}/c\n"
    (workspace / "build" / "msgs" / "build.ninja").write_text(flags)
    binary = f"\0\1{root}/ros2_ws".encode()
    (workspace / "install" / "lib.so").write_bytes(binary)
    (workspace / "install" / "A.msg").symlink_to(workspace / "src" / "msgs" / "A.msg")
    (workspace / "install" / "src").symlink_to(workspace / "src")
    (workspace / "install" / "relative").symlink_to("lib.so")
    folder = workspace / "build" / "msgs" / "msgs"
    (workspace / "src" / "msgs" / "msgs").mkdir()

    def cache(of: Path) -> Path:
        return Path(".numba_cache", "digest", f"msgs_{sha1(str(of).encode()).hexdigest()}")

    (root / cache(folder)).mkdir(parents=True)
    written = {p: p.read_bytes() for p in root.rglob("*") if p.is_file()}
    if copied:
        shutil.copytree(root, moved, symlinks=True)
    else:
        root.rename(moved)
    code, errors = checkout.call(moved / "flexslew")
    assert code == 0, errors
    assert errors.splitlines()[0].endswith(f"the checkout was in {root}; its paths are rewritten")
    assert checkout.steps == []
    script = moved / ".venv" / "bin" / "some-tool"
    assert script.read_text().splitlines()[0] == f"#!{moved}/.venv/bin/python3"
    assert os.access(script, os.X_OK)
    build, install = moved / "ros2_ws" / "build", moved / "ros2_ws" / "install"
    assert (build / "msgs" / "build.ninja").read_text() == (
        f"-I{moved}/ros2_ws/a -S{moved}/b PATH={moved}:{root}2:{root}-old:/srv{root}/c\n"
    )
    assert (install / "lib.so").read_bytes() == binary
    assert os.readlink(install / "A.msg") == f"{moved}/ros2_ws/src/msgs/A.msg"
    assert os.readlink(install / "src") == f"{moved}/ros2_ws/src"
    assert os.readlink(install / "relative") == "lib.so"
    assert (moved / cache(moved / "ros2_ws" / "build" / "msgs" / "msgs")).is_dir()
    assert checkout.call(moved / "flexslew") == (0, "")
    if copied:
        assert {p: p.read_bytes() for p in root.rglob("*") if p.is_file()} == written
        assert checkout.call() == (0, "")
        assert checkout.steps == []


@pytest.mark.parametrize("name", ["my checkout", "a;b", "it's", "50%", "a:b", "Prüfstand", "実験"])
def test_a_path_that_the_build_tools_cannot_take_is_refused_before_anything_is_done(
    tmp_path: Path, name: str
) -> None:
    checkout = Checkout(tmp_path / name, tmp_path)
    code, errors = checkout.call()
    assert code == 2
    assert len(errors.splitlines()) == 1
    assert str(checkout.root) in errors
    assert checkout.log.read_text() == ""
    assert not (checkout.root / ".venv").exists()


@pytest.mark.parametrize(
    ("processor", "words"),
    [
        ("aarch64", "source an installed ROS 2"),
        ("arm64", "ROS 2 has no wheels"),
        ("riscv64", "ARM"),
    ],
)
def test_a_processor_without_wheels_is_reported_before_anything_is_done(
    checkout: Checkout, tmp_path: Path, processor: str, words: str
) -> None:
    stand_in(tmp_path / "bin" / "uname", f"echo {processor}")
    code, errors = checkout.call()
    assert (code, len(errors.splitlines())) == (2, 1)
    assert processor in errors
    assert words in errors
    assert not checkout.log.read_text()
    assert not (checkout.root / ".venv").exists()


def test_beside_an_installed_ros_an_arm_processor_is_set_up(
    checkout: Checkout, tmp_path: Path
) -> None:
    stand_in(tmp_path / "bin" / "uname", "echo aarch64")
    checkout.environment |= {"ROS_DISTRO": "jazzy", "FLEXSLEW_INSTALLED_ROS": "jazzy"}
    assert checkout.call(command="test")[0] == 0
    assert checkout.steps == [ALL[0], "pip", "pip", *ALL[3:]]  # empy comes with ROS


@pytest.mark.parametrize("allowed", [True, False])
def test_the_programs_that_tests_need_are_installed_once_where_the_user_may(
    checkout: Checkout, tmp_path: Path, allowed: bool
) -> None:
    tools = tmp_path / "bin"
    (tools / "chromedriver").unlink()
    stand_in(tools / "id", "echo 1000")
    stand_in(tools / "sudo", f'[ "{allowed}" = True ] && shift && {{ [ "$1" = true ] || "$@"; }}')
    stand_in(tools / "apt-get", 'echo "apt-get $*" >>"$STUB_LOG"')
    for folder in ("/usr/bin", "/bin"):  # where a chromedriver of this machine may be
        for program in Path(folder).iterdir():
            if program.name != "chromedriver" and not (tools / program.name).exists():
                (tools / program.name).symlink_to(program)
    checkout.environment["PATH"] = str(tools)
    assert checkout.call()[0] == 0
    assert "apt-get" not in checkout.log.read_text()
    code, errors = checkout.call(command="test")
    assert code == 0
    assert "system packages for the tests: chromium chromium-driver" in errors
    installs = "install -y -qq --no-install-recommends chromium chromium-driver"
    assert (installs in checkout.log.read_text()) == allowed
    assert ("the tests that need them are skipped" in errors) != allowed
    assert checkout.call(command="test") == (0, "")
    (next((checkout.root / ".venv").glob("flexslew.test_programs"))).unlink()
    checkout.environment["FLEXSLEW_BROWSER"] = "0"
    assert "system packages for the tests" not in checkout.call(command="test")[1]


def stand_in(path: Path, body: str) -> None:
    """Write a program that takes the place of one of the system."""
    path.unlink(missing_ok=True)
    path.write_text(f"#!/bin/bash\n{body}\n")
    path.chmod(0o755)


def test_a_symbolic_link_with_spaces_to_a_good_path_is_no_obstacle(checkout: Checkout) -> None:
    link = checkout.folder / "my checkout"
    link.symlink_to(checkout.root)
    assert checkout.call(link / "flexslew")[0] == 0


@pytest.mark.parametrize("whole_group", [True, False])
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupt_ends_pip_says_so_and_the_next_call_goes_on(
    checkout: Checkout, number: signal.Signals, code: int, whole_group: bool
) -> None:
    """A terminal signals the whole group in the foreground, a supervisor the script alone."""
    (checkout.folder / "hang").touch()
    process = checkout.start()
    (checkout.folder / "hanging").read_text()  # returns when pip is under way
    (os.killpg if whole_group else os.kill)(process.pid, number)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == code
    assert output == ""
    assert errors.splitlines()[-1].startswith("flexslew: interrupted")
    assert "could not" not in errors
    assert checkout.log.read_text().splitlines()[-1] == "cancelled"
    (checkout.folder / "hang").unlink()
    torn = checkout.root / ".venv" / "lib" / "python3.11" / "site-packages" / "torn-1.dist-info"
    torn.mkdir(parents=True)
    assert checkout.call()[0] == 0
    assert checkout.steps == ALL[1:]
    assert not torn.exists()


def test_a_failure_of_pip_is_told_with_its_words_and_is_no_interrupt(checkout: Checkout) -> None:
    (checkout.folder / "fail").touch()
    code, errors = checkout.call()
    assert code == 2
    assert "ERROR: no space left" in errors
    assert errors.splitlines()[-1].startswith("flexslew: pip could not install")
    assert checkout.steps == ["venv", "pip"]


def test_without_a_terminal_the_progress_is_a_few_short_lines(checkout: Checkout) -> None:
    _, errors = checkout.call()
    assert "\r" not in errors
    assert "\033[K" not in errors
    lines = errors.splitlines()
    steps = [line for line in lines if line.startswith("  ")]  # 60 packages
    assert [step.split()[0] for step in steps] == ["25", "50", "unpacking"] * 2
    assert max(map(len, lines)) < 100
