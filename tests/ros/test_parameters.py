"""Parameters describe themselves in numbers and words that a person would write."""

from typing import Any

import pytest
import rclpy

from flexslew_control.controllers import CONTROLLERS
from flexslew_lab.run.domain import own_domain
from flexslew_plant.ros.parameters import declare
from flexslew_plant.ros.plant.settings import PlantSettings


@pytest.fixture(scope="module")
def described() -> Any:
    """Declare all parameters of the plant and of every law; return their descriptors."""
    context, found = rclpy.Context(), {}
    sections = {"plant": PlantSettings()}
    sections |= {name: entry.settings() for name, entry in CONTROLLERS.items()}
    with own_domain() as domain:
        context.init(domain_id=domain)
        for name, section in sections.items():
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
