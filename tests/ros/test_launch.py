"""The launch file: with the real launch where it is installed, else with stand-ins for it.

`launch` and `launch_ros` are not among the wheels. Where they are on the path, the last test flies
a trial as `ros2 launch flexslew_lab trial.launch.py` does.
"""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.run.domain import locked_domain
from flexslew_lab.run.launch_arguments import ARGUMENTS
from flexslew_lab.run.run_trial import run_trial
from flexslew_plant.errors import BadInput, FlexslewError

from .flight import SLEW, slew

FILE = Path(__file__).parents[2] / "ros2_ws/src/flexslew_lab/launch/trial.launch.py"
NAMES = {
    "launch": ("LaunchContext", "LaunchDescription"),
    "launch.actions": (
        "DeclareLaunchArgument", "EmitEvent", "LogInfo", "OpaqueFunction",
        "RegisterEventHandler", "TimerAction",
    ),
    "launch.event_handlers": ("OnProcessExit",),
    "launch.events": ("Shutdown",),
    "launch.substitutions": ("LaunchConfiguration",),
    "launch_ros": (),
    "launch_ros.actions": ("Node",),
}  # fmt: skip
LAUNCH = """
import sys
from ros2launch.api import launch_a_launch_file
path, *arguments = sys.argv[1:]
sys.exit(launch_a_launch_file(
    launch_file_path=path, launch_file_arguments=arguments, noninteractive=True))
"""


def part(name: str) -> Any:
    """Return what stands for a class of launch: it keeps what it was made of."""

    def make(*given: Any, **named: Any) -> SimpleNamespace:
        return SimpleNamespace(
            kind=name, given=given, return_code=0, **named,
            perform=lambda context: context.launch_configurations[given[0]],
        )  # fmt: skip

    return make


@pytest.fixture
def description(monkeypatch: pytest.MonkeyPatch) -> Any:
    """What the launch file describes, with stand-ins for launch."""
    for name, parts in NAMES.items():
        module = ModuleType(name)
        for one in parts:
            setattr(module, one, part(one))
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("trial_launch", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    (actions,) = module.generate_launch_description().given
    return actions


def ended(end: Any, recorder: Any = None) -> Any:
    """Return what the last of plant and recorder to leave leads to.

    Args:
        end: the handler of the plant's exit.
        recorder: that writes until after the plant has left; None: it has left before.
    """
    (handler,) = end.given
    if recorder is None:
        (timer,) = handler.on_exit(None, None)
    else:
        recorder.return_code = None
        (later,) = handler.on_exit(None, None)
        (handler,) = later.given
        assert (handler.kind, handler.target_action) == ("OnProcessExit", recorder)
        (timer,) = handler.on_exit
    (finish,) = timer.actions
    return finish.function(None)


def performed(actions: Any, **given: str) -> list[Any]:
    """Return the actions that these arguments lead to."""
    *declared, opaque = actions
    defaults = {one.given[0]: one.default_value for one in declared}
    return list(opaque.function(SimpleNamespace(launch_configurations=defaults | given)))


def trial_file(folder: Path) -> Path:
    path = folder / "short.yaml"
    more = ", lqr: {}"
    path.write_text(SLEW.format(duration=1.0, rate=0.0, more=more, extra="", patience=20.0))
    return path


def test_every_argument_is_declared_with_its_words(description: Any) -> None:
    *declared, _ = description
    assert {one.given[0]: (one.default_value, one.description) for one in declared} == ARGUMENTS


def test_the_nodes_of_a_trial_are_described_and_the_plant_ends_it(
    description: Any, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    *nodes, end = performed(
        description, trial=str(trial_file(tmp_path)), out=str(out), namespace="bench1", rate="2"
    )
    assert [(node.name, node.executable) for node in nodes] == [
        ("recorder", "recorder"), ("planner", "planner"), ("pd_feedforward", "controller"),
        ("lqr", "controller"), ("plant", "plant"),
    ]  # fmt: skip
    assert {node.namespace for node in nodes} == {"/bench1"}
    assert all(node.remappings == [("/clock", "clock")] for node in nodes)
    assert all(node.parameters == [str(out / "parameters.yaml")] for node in nodes)
    assert "rate_factor: 2" in (out / "parameters.yaml").read_text()
    (handler,) = end.given
    assert (handler.kind, handler.target_action) == ("OnProcessExit", nodes[-1])


def test_controllers_and_the_recorder_may_be_chosen(description: Any, tmp_path: Path) -> None:
    given = {"trial": str(trial_file(tmp_path)), "out": str(tmp_path / "run"), "record": "false"}
    *nodes, _ = performed(description, **given, controllers="lqr")
    assert [node.name for node in nodes] == ["planner", "lqr", "plant"]


def test_after_the_plant_the_metrics_and_the_report_are_written(
    description: Any, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    recorder, *_, end = performed(description, trial=str(trial_file(tmp_path)), out=str(out))
    flown = tmp_path / "flown"
    run_trial(slew(1.0), "test", flown, in_process=True, report=False)
    (flown / "bag").rename(out / "bag")
    (leave,) = ended(end, recorder)
    assert (leave.kind, leave.event.kind) == ("EmitEvent", "Shutdown")
    assert json.loads((out / "metrics.json").read_text())["ticks"] == 100
    assert (out / "report.html").is_file()


def test_it_can_be_included_with_arguments_of_another_launch_file(
    description: Any, tmp_path: Path
) -> None:
    given = {"trial": str(trial_file(tmp_path)), "out": str(tmp_path / "run")}
    given |= {"ros_namespace": "/fleet", "namespace": "bench1"}  # of a group, with PushRosNamespace
    *nodes, end = performed(description, **given, shutdown="false", arm="left", ratte="1")
    assert nodes[-1].name == "plant"
    assert {node.namespace for node in nodes} == {"/fleet/bench1"}
    assert "/fleet/bench1/plant:" in (tmp_path / "run" / "parameters.yaml").read_text()
    run_trial(slew(0.1), "test", tmp_path / "flown", in_process=True, report=False)
    (tmp_path / "flown" / "bag").rename(tmp_path / "run" / "bag")
    assert ended(end) == []  # what else was launched goes on


def test_a_bench_that_did_not_fly_ends_its_own_launch_but_no_other(
    description: Any, tmp_path: Path
) -> None:
    given = {"trial": str(trial_file(tmp_path)), "out": str(tmp_path / "included")}
    *_, end = performed(description, **given, shutdown="false")
    (told,) = ended(end)
    assert told.kind == "LogInfo"
    assert "included/bag" in told.msg
    *_, end = performed(description, **given | {"out": str(tmp_path / "alone")})
    with pytest.raises(FlexslewError, match="alone/bag"):
        ended(end)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"rate": "fast"}, "rate: fast is not allowed"),
        ({"record": "perhaps"}, "record: 'perhaps' is not allowed"),
        ({"trial": "no_such_trial"}, "no_such_trial"),
        ({"controllers": "lqr,pdf"}, "controllers.pdf: pdf is not a law"),
    ],
)
def test_what_is_not_allowed_is_refused_before_anything_is_made(
    given: dict[str, str], words: str, description: Any, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    with pytest.raises(BadInput, match=words):
        performed(description, **({"out": str(out)} | given))
    assert not out.exists()


@pytest.mark.ros
@pytest.mark.skipif(
    importlib.util.find_spec("ros2launch") is None, reason="launch_ros is not installed"
)
def test_the_real_launch_flies_a_trial_and_refuses_what_is_wrong(tmp_path: Path) -> None:
    def launched(*arguments: str) -> subprocess.CompletedProcess[str]:
        with pytest.MonkeyPatch.context() as patch, locked_domain() as domain:
            patch.setenv("ROS_DOMAIN_ID", str(domain))
            command = [sys.executable, "-c", LAUNCH, str(FILE), *arguments]
            return subprocess.run(command, capture_output=True, text=True, check=False)

    out = tmp_path / "run"
    trial = f"trial:={trial_file(tmp_path)}"
    done = launched(trial, f"out:={out}", "namespace:=bench1")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "process has died" not in done.stdout + done.stderr
    metrics = json.loads((out / "metrics.json").read_text())
    assert (metrics["ticks"], metrics["missed_ticks"], metrics["log_complete"]) == (100, 0, True)
    assert (out / "report.html").is_file()
    assert BagReader(out / "bag").overview.counts["/truth"] == 101
    refused = launched(trial, "rate:=fast")
    assert refused.returncode != 0
    assert "rate: fast is not allowed" in refused.stdout + refused.stderr
