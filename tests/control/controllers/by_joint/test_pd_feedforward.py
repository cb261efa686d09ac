from typing import Any

import numpy as np
import pytest
from tests.plants import plant
from tests.present import present

from flexslew_control.controllers import build_controller
from flexslew_control.controllers.by_joint.pd_feedforward import PdFeedforwardSettings, build
from flexslew_control.law import Reference
from flexslew_control.plan import Plan
from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement
from flexslew_plant.settings import validated
from flexslew_plant.testbeds.csa import CsaTestbed

LIMIT, NOTHING = np.array([150.0, 150.0]), np.zeros(0)


def question(position: Any, velocity: Any) -> Measurement:
    return Measurement(
        0, 0, 0.0, "a", np.array(position), np.array(velocity), NOTHING, NOTHING, np.zeros(2)
    )


def effort(settings: Any, position: Any, velocity: Any, reference: Any) -> tuple[Any, Any]:
    estimator, law = build(settings, plant())
    now = question(position, velocity)
    return law.update(now, estimator.update(now), reference), law


def test_equations_12_and_13() -> None:
    reference = Reference(
        np.array([0.3, 0.2]), np.array([0.1, 0.0]), np.array([5.0, -6.0]), NOTHING
    )
    settings = PdFeedforwardSettings(kp=(460.0, 300.0), kd=(920.0, 100.0))
    found, law = effort(settings, (0.1, 0.5), (0.02, -0.03), reference)
    expected = [5.0 + 460.0 * 0.2 + 920.0 * 0.08, -6.0 + 300.0 * -0.3 + 100.0 * 0.03]
    np.testing.assert_allclose(found, expected, rtol=1e-14)
    np.testing.assert_allclose(sum(law.terms.values()), found, rtol=1e-14)
    assert list(law.terms) == ["feedforward", "proportional", "derivative"]


def test_on_the_reference_the_effort_is_the_feedforward() -> None:
    reference = Reference(
        np.array([0.3, 0.2]), np.array([0.1, 0.0]), np.array([5.0, -6.0]), NOTHING
    )
    found, _ = effort(PdFeedforwardSettings(), (0.3, 0.2), (0.1, 0.0), reference)
    np.testing.assert_array_equal(found, [5.0, -6.0])


def test_the_default_gains_are_those_of_the_paper_on_every_joint() -> None:
    reference = Reference(np.zeros(2), np.zeros(2), np.zeros(2), NOTHING)
    found, _ = effort(PdFeedforwardSettings(), (-1.0, 0.0), (0.0, -1.0), reference)
    np.testing.assert_array_equal(found, [460.0, 920.0])


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"kp": [-1.0, 2.0]}, "kp.0: -1.0"),
        ({"kp": []}, "kp"),
        ({"kd": [float("nan")]}, "kd.0: nan"),
        ({"kq": [1.0]}, "kq: unknown key"),
    ],
)
def test_bad_gains_are_refused(values: Any, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        validated(PdFeedforwardSettings, values, "trial.yaml")


def test_gains_for_other_joints_are_refused() -> None:
    with pytest.raises(BadInput, match="kp"):
        build(PdFeedforwardSettings(kp=(1.0, 2.0, 3.0)), plant())


def test_a_step_settles_on_the_bench_as_in_figure_5() -> None:
    bed = Bench(
        BenchSettings(
            testbed=CsaTestbed(variant="printed", modes=1), duration=130.0, active="pd_feedforward"
        )
    )
    pd = build_controller(
        "pd_feedforward", "pd_feedforward", {}, plant(0.01, (150.0, 150.0)), "here"
    )
    goal = np.tile([0.2, 0.2], (2, 1))
    step = Plan(
        "none", bed.model.joint_names, 0.0, 0.01, goal, np.zeros((2, 2)), np.zeros((1, 2)),
        np.zeros((2, 0)), 0.01,
    )  # fmt: skip
    assert pd.adopt(step) is None
    tips, yaw = [], []
    while not bed.done:
        bed.offer(present(pd.observe(bed.question)).command)
        bed.advance()
        tips.append(bed.question.tip_deflection[0])
        yaw.append(bed.question.joint_position[0])
    assert np.abs(tips).max() == pytest.approx(3.5646, abs=0.01)
    assert np.abs(tips[7500:10000]).max() == pytest.approx(0.269, abs=0.01)
    outside = np.nonzero(np.abs(np.array(yaw) - 0.2) > 0.02 * 0.2)[0]
    assert 0.01 * outside[-1] == pytest.approx(106.4, abs=0.3)
