"""Axes of varied values say what their numbers are."""

from collections.abc import Callable
from typing import Any

from flexslew_lab.studies.findings.figures import axis_title
from flexslew_lab.studies.study import Study


def test_the_axis_of_a_varied_value_says_whether_it_is_a_share_or_the_value(
    study_of: Callable[..., Study],
) -> None:
    inertia = "testbed.parameters.base_inertia"
    vary: dict[str, Any] = {
        "testbed.parameters.bending_stiffness": {"relative": {"uniform": [-0.2, 0.2]}},
        inertia: {"offset": {"uniform": [-50.0, 50.0]}},
        "sensors.joint_velocity.noise": {"loguniform": [1e-5, 1e-3]},
    }
    study = study_of(vary=vary)
    assert [axis_title(study, name) for name in vary] == [
        "testbed.parameters.bending_stiffness, relative error [-]",
        f"{inertia}, offset",
        "sensors.joint_velocity.noise",
    ]
