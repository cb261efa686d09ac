from xml.etree import ElementTree

import pytest

from flexslew_plant.graph.policies import NODES, ROLES, policies
from flexslew_plant.graph.topics import JOINT_TRAJECTORY, TOPICS

LAWS = ["first", "second"]


def test_every_topic_is_said_by_somebody_and_heard_by_the_recorder() -> None:
    said = {name for rights in ROLES.values() for name in rights.publish}
    assert said >= {*TOPICS} - {"/rosout", JOINT_TRAJECTORY}  # of every node; of other tools


# the format of SROS 2: children, then attributes, by element
QUALIFIER = {"ALLOW", "DENY"}
FORMAT: dict[str, tuple[set[str], set[str]]] = {
    "policy": ({"enclaves"}, {"version"}),
    "enclaves": ({"enclave"}, set()),
    "enclave": ({"profiles"}, {"path"}),
    "profiles": ({"profile"}, set()),
    "profile": ({"topics", "services", "actions"}, {"ns", "node"}),
    "topics": ({"topic"}, {"publish", "subscribe"}),
    "services": ({"service"}, {"reply", "request"}),
    "actions": ({"action"}, {"execute", "call"}),
    "topic": (set(), set()),
    "service": (set(), set()),
    "action": (set(), set()),
}


@pytest.mark.parametrize("namespace", ["/", "/bench1"])
def test_the_policies_have_the_format_of_sros2(namespace: str) -> None:
    root = ElementTree.fromstring(policies(LAWS, namespace))
    assert (root.tag, root.attrib) == ("policy", {"version": "0.2.0"})
    for element in root.iter():
        children, attributes = FORMAT[element.tag]
        assert {child.tag for child in element} <= children
        assert {*element.attrib} <= attributes
        assert bool(len(element)) == bool(children)  # no list is empty
        if element.tag in ("topics", "services", "actions"):
            assert len(element.attrib) == 1
            assert {*element.attrib.values()} <= QUALIFIER
        if not children:
            assert element.text
            assert not element.text.startswith("~")


def test_a_hidden_node_lives_in_the_enclave_of_its_process() -> None:
    root = ElementTree.fromstring(policies(LAWS))
    enclaves = {e.get("path"): [p.get("node") for p in e.iter("profile")] for e in root[0]}
    assert enclaves["/recorder"] == ["recorder", "_recorder"]
    hidden = [node for nodes in enclaves.values() for node in nodes[1:]]
    assert hidden == [node for node in NODES if node.startswith("_")]
    assert all(path == f"/{nodes[0]}" for path, nodes in enclaves.items())


@pytest.mark.parametrize("namespace", ["/", "/bench1"])
def test_the_policies_are_xml_with_a_profile_per_node(namespace: str) -> None:
    root = ElementTree.fromstring(policies(LAWS, namespace))
    profiles = root.findall("./enclaves/enclave/profiles/profile")
    assert [p.get("node") for p in profiles] == [*NODES, *LAWS]
    assert {p.get("ns") for p in profiles} == {namespace}
    plant = profiles[0]
    assert "brake" in [s.text for s in plant.findall("services[@reply='ALLOW']/service")]


def test_nobody_but_controllers_may_command_the_drive() -> None:
    who = [role for role, rights in ROLES.items() if "effort_command" in rights.publish]
    assert who == ["controller"]


def test_the_console_may_tune_every_controller_and_nobody_else_may() -> None:
    root = ElementTree.fromstring(policies(LAWS))
    may = {
        profile.get("node"): [s.text for s in profile.findall("services[@request]/service")]
        for profile in root.iter("profile")
    }
    tuning = {node: [s for s in asked if s and "tune" in s] for node, asked in may.items()}
    assert {node: asked for node, asked in tuning.items() if asked} == {
        "console": ["first/tune", "second/tune"]
    }
