"""The command line of a node."""

from flexslew_plant.ros.node_process import within


def test_a_namespace_becomes_a_command_line() -> None:
    assert within("") == []
    assert within("bench1") == within("/bench1/") == ["--ros-args", "-r", "__ns:=/bench1"]
