from xml.etree import ElementTree

import pytest

from flexslew_plant.policies import NODES, ROLES, policies
from flexslew_plant.topics import TOPICS


def test_every_topic_is_said_by_somebody_and_heard_by_the_recorder() -> None:
    said = {name for rights in ROLES.values() for name in rights.publish}
    assert said >= {*TOPICS} - {"/rosout", "/tf_static"}


@pytest.mark.parametrize("namespace", ["/", "/bench1"])
def test_the_policies_are_xml_with_a_profile_per_node(namespace: str) -> None:
    root = ElementTree.fromstring(policies(namespace=namespace))
    profiles = root.findall("./enclaves/enclave/profiles/profile")
    assert [p.get("node") for p in profiles] == [*NODES]
    assert {p.get("ns") for p in profiles} == {namespace}
    plant = profiles[0]
    assert "brake" in [s.text for s in plant.findall("services[@reply='ALLOW']/service")]


def test_nobody_but_controllers_may_command_the_drive() -> None:
    who = [role for role, rights in ROLES.items() if "effort_command" in rights.publish]
    assert who == ["controller"]
