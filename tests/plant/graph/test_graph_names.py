import pytest

from flexslew_plant.errors import BadInput
from flexslew_plant.graph.graph_names import require_name


@pytest.mark.parametrize("name", ["bench1", "/bench1", "lab/bench_1", "/a/_b/C2", "a__b"])
def test_a_name_is_taken(name: str) -> None:
    require_name(name, "--namespace")


@pytest.mark.parametrize("name", ["", "/", "//", "a/", "a//b", "1a", "a b", "-x", "\u00e4", "~/a"])
def test_what_rclpy_would_raise_for_is_one_line(name: str) -> None:
    with pytest.raises(BadInput, match=r"--namespace: .* is not allowed: letters, digits and _"):
        require_name(name, "--namespace")
