"""Parameters describe themselves in numbers and words that a person would write."""

from array import array
from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from rcl_interfaces.msg import Parameter as Message
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter

from flexslew_control.controllers import CONTROLLERS
from flexslew_lab.ros.recorder.recorder_settings import RecorderSettings
from flexslew_lab.run.domain import locked_domain
from flexslew_plant.errors import BadInput
from flexslew_plant.ros.parameters import declare, new_node, requested_text, settings_of
from flexslew_plant.ros.plant.settings import PlantSettings
from flexslew_plant.settings import plain, validated

SECTIONS = {"plant": PlantSettings(), **{n: e.settings() for n, e in CONTROLLERS.items()}}


@pytest.fixture(scope="module")
def described() -> Any:
    """Declare all parameters of the plant and of every law; return their descriptors."""
    context, found = rclpy.Context(), {}
    with locked_domain() as domain:
        context.init(domain_id=domain)
        for name, section in SECTIONS.items():
            node = rclpy.create_node(name, context=context, start_parameter_services=False)
            declare(node, section)
            for parameter in node.get_parameters_by_prefix(""):
                found[f"{name}.{parameter}"] = node.describe_parameter(parameter)
            node.destroy_node()
        context.shutdown()
    return found


def test_no_range_ends_where_only_the_numbers_of_a_machine_do(described: Any) -> None:
    assert len(described) > 60
    for name, descriptor in described.items():
        for limits in [*descriptor.floating_point_range, *descriptor.integer_range]:
            for bound in (limits.from_value, limits.to_value):
                assert bound == 0 or 1e-9 < abs(bound) <= 1e12, name


def test_one_sided_bounds_are_words(described: Any) -> None:
    words = {name: each.additional_constraints for name, each in described.items()}
    assert words["plant.bench.period"].startswith("more than 0; read at the start")
    assert words["plant.rate_factor"].startswith("0 or more; ")
    assert words["plant.bench.max_missed"].startswith("1 or more; ")


def dumped(node: Any) -> str:
    """Return the text of `ros2 param dump`: names nested by their dots, null where nothing is."""
    values: dict[str, Any] = {}
    for name, parameter in node.get_parameters_by_prefix("").items():
        *path, last = name.split(".")
        place = values
        for part in path:
            place = place.setdefault(part, {})
        value = parameter.value
        place[last] = list(value) if isinstance(value, (array, list, tuple)) else value
    return yaml.safe_dump({node.get_fully_qualified_name(): {"ros__parameters": values}})


@pytest.mark.parametrize("name", SECTIONS)
def test_what_param_dump_writes_is_read_again_to_the_same_settings(
    name: str, tmp_path: Path
) -> None:
    section, path = SECTIONS[name], tmp_path / "dump.yaml"
    context = rclpy.Context()
    with locked_domain() as domain:
        context.init(domain_id=domain)
        node = rclpy.create_node(name, context=context, start_parameter_services=False)
        declare(node, section)
        path.write_text(dumped(node))
        node.destroy_node()
        again = rclpy.create_node(
            name,
            context=context,
            start_parameter_services=False,
            cli_args=["--ros-args", "--params-file", str(path)],
            allow_undeclared_parameters=True,
            automatically_declare_parameters_from_overrides=True,
        )
        read = settings_of(again, type(section))
        again.destroy_node()
        context.shutdown()
    assert plain(read) == plain(section)


class Named:
    """All that a request needs of its node."""

    def get_name(self) -> str:
        return "plant"


def typed(**values: Any) -> list[Any]:
    return [Parameter(k.replace("__", "."), value=v).to_parameter_msg() for k, v in values.items()]


@pytest.mark.parametrize("words", ["x", "[1]", '"text"'])
def test_metadata_of_a_recorder_that_are_no_json_are_refused_before_it_begins(
    words: str,
) -> None:
    with pytest.raises(BadInput, match=r"node recorder: metadata: .*a JSON object of texts"):
        validated(RecorderSettings, {"metadata": words}, "node recorder")
    validated(RecorderSettings, {"metadata": '{"operator": "ann"}'}, "node recorder")


def test_typed_values_are_the_yaml_that_they_stand_for() -> None:
    node: Any = Named()
    assert requested_text(node, "fault", "{kind: command_lost}", []) == "{kind: command_lost}"
    values = typed(kind="actuator_gain", joint="base_yaw", gain=0.1, until=2.0, names=["a", "b"])
    text = requested_text(node, "fault", "", [*values, *typed(disturbance__base_yaw=[1.0, 2.0])])
    assert yaml.safe_load(text) == {
        "kind": "actuator_gain", "joint": "base_yaw", "gain": 0.1, "until": 2.0,
        "names": ["a", "b"], "disturbance": {"base_yaw": [1.0, 2.0]},
    }  # fmt: skip


@pytest.mark.parametrize(
    ("text", "values", "words"),
    [
        ("{kp: 1.0}", typed(kp=1.0), "give settings or values, not both"),
        ("", typed(kp=1.0) * 2, "kp stands twice"),
        ("", typed(a__b=1.0, a=2.0), "a.b stands twice"),
        ("", typed(a=1.0, a__b=2.0), "a.b stands twice"),
        ("", [Message(name="kp", value=ParameterValue(type=99))], "kp has type 99"),
    ],
)
def test_values_that_contradict_each_other_are_refused(text: str, values: Any, words: str) -> None:
    node: Any = Named()
    with pytest.raises(BadInput, match=words):
        requested_text(node, "settings", text, values)


def test_a_parameter_of_no_type_of_ros_is_refused_and_ends_no_node() -> None:
    bad, good = Message(name="kp", value=ParameterValue(type=99)), typed(kp=1.0)[0]
    with locked_domain() as domain:
        rclpy.init(domain_id=domain)
        node = new_node("one")
        try:
            serve = {service.srv_type: service.callback for service in node.services}
            one_by_one = serve[SetParameters](
                SetParameters.Request(parameters=[bad, good]), SetParameters.Response()
            )
            together = serve[SetParametersAtomically](
                SetParametersAtomically.Request(parameters=[bad]),
                SetParametersAtomically.Response(),
            )
            for result in (*one_by_one.results, together.result):
                assert not result.successful
                assert "kp has type 99" in result.reason
            assert len(one_by_one.results) == 2
            request = SetParameters.Request(parameters=[good])
            (result,) = serve[SetParameters](request, SetParameters.Response()).results
            assert result.successful
            assert node.get_parameter("kp").value == 1.0
        finally:
            node.destroy_node()
            rclpy.shutdown()
