"""Law `policy`: its network from a file, what it flies, and what it refuses."""

import base64
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.networks import save_network
from tests.plants import plant

from flexslew_control.controllers import build_controller, with_file
from flexslew_lab.notebook import fly, trial
from flexslew_lab.replay.resim import resim
from flexslew_plant.errors import BadInput

SHORT = {"duration": 12.0, "plan": {"method": "reference_only", "goal": {"hub_pitch": 0.5},
                                   "duration": 10.0}}  # fmt: skip
GAINS = np.zeros((10, 2))
GAINS[0, 0], GAINS[1, 1] = 4.6, 4.6  # of the errors
GAINS[2, 0], GAINS[3, 1] = 9.2, 9.2  # of their rates


def policy(path: Path, **more: Any) -> dict[str, Any]:
    keys = {"controllers": {"policy": {"file": str(path), **more}}, "active": "policy"}
    return {**SHORT, **keys}


def test_a_linear_network_flies_as_the_pd_law_that_it_is(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    path = tmp_path / "policy.onnx"
    save_network(path, GAINS / 1.5, squash=False)  # of 150 N m: kp 460, kd 920
    ours = fly(trial("m1", policy(path)))
    pd = fly(trial("m1", {**SHORT, "controllers": {"pd_feedforward": {"kp": 460.0, "kd": 920.0}}}))
    np.testing.assert_allclose(ours["position"], pd["position"], atol=2e-5)  # float32


def test_a_policy_flies_again_from_its_log_without_its_file(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    path = tmp_path / "policy.onnx"
    save_network(path, GAINS)
    fly(trial("m1", policy(path, base={}, authority=0.1)), tmp_path / "run")
    path.unlink()
    assert resim(tmp_path / "run" / "bag").identical


def test_a_base_without_a_network_is_that_law_alone() -> None:
    keys = {"controllers": {"policy": {"base": {"kp": [300.0]}}}, "active": "policy"}
    ours = fly(trial("m1", {**SHORT, **keys}))
    theirs = fly(trial("m1", {**SHORT, "controllers": {"pd_feedforward": {"kp": [300.0]}}}))
    assert ours.metrics["trajectory_hash"] == theirs.metrics["trajectory_hash"]


def test_an_action_that_is_not_finite_is_a_failure_with_its_reason(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    path = tmp_path / "policy.onnx"
    save_network(path, np.full((10, 2), np.nan))
    flight = fly(trial("m1", policy(path)))
    assert any("is not finite" in str(event) for event in flight.events)


@pytest.mark.parametrize(
    ("shape", "words"),
    [((9, 2), "shape (1 or N, 10)"), ((10, 3), "shape (1 or N, 2)")],
)
def test_a_network_of_another_shape_is_refused(
    tmp_path: Path, shape: tuple[int, int], words: str
) -> None:
    pytest.importorskip("onnxruntime")
    save_network(tmp_path / "policy.onnx", np.zeros(shape))
    values = with_file("policy", {"file": str(tmp_path / "policy.onnx")}, "here")
    with pytest.raises(BadInput) as refused:
        build_controller("it", "policy", values, plant(), "here")
    assert words in str(refused.value)


@pytest.mark.parametrize("network", ["no base64!", base64.b64encode(b"no model").decode()])
def test_what_is_no_network_is_refused_in_one_line(network: str) -> None:
    pytest.importorskip("onnxruntime")
    with pytest.raises(BadInput, match="network"):
        build_controller("it", "policy", {"network": network}, plant(), "here")


def test_a_file_with_another_ending_or_too_large_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"ends in \.onnx"):
        with_file("policy", {"file": "policy.pt"}, "here")
    (tmp_path / "large.onnx").write_bytes(bytes(600 * 1024))
    with pytest.raises(BadInput, match="at most"):
        with_file("policy", {"file": str(tmp_path / "large.onnx")}, "here")
