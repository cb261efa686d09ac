import pytest

from flexslew_lab.trial.trial import DEFAULT, load_trial, parse_trial, plan_of_trial
from flexslew_plant.errors import BadInput

HUB = """
duration: 10.0
testbed: {kind: hub_with_appendages}
plan: {method: time_optimal, goal: {hub: 1.0}, robust: false}
"""


def test_a_time_optimal_plan_believes_in_the_testbed_unless_it_says_otherwise():
    plan = plan_of_trial(parse_trial(HUB, "hub.yaml"))
    assert plan.duration == pytest.approx(6.01986708, abs=1e-6)  # physics/time_optimal
    turned = HUB.replace("appendages}", "appendages, initial: {hub: 0.5}}").replace("1.0}", "1.5}")
    again = plan_of_trial(parse_trial(turned, "hub.yaml"))
    assert again.position[0, 0] == 0.5
    assert again.duration == pytest.approx(plan.duration, abs=1e-9)
    csa = "testbed: {modes: 3, parameters: {bending_stiffness: 1200.0}}\n"
    csa += "plan: {method: time_optimal, goal: {base_yaw: 1.0}}\n"
    model = parse_trial(csa, "csa.yaml").plan.model
    assert (model.modes, model.parameters.bending_stiffness) == (1, 1200.0)
    other = parse_trial(csa.replace("goal", "model: {kind: csa}, goal"), "csa.yaml").plan.model
    assert other.parameters.bending_stiffness == 1500.0


@pytest.mark.parametrize("name", ["m1", "swap_demo", "time_optimal_hub", "time_optimal_oscillator"])
def test_every_trial_that_comes_along_is_sound(name):
    trial = load_trial(DEFAULT.with_name(f"{name}.yaml"))
    assert trial.name == name


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("testbed: hub\nplan: {method: time_optimal, goal: {hub: 1.0}}", "testbed"),
        ("plan: {method: time_optimal}", "goal"),
        ("plan: fast", "plan"),
        ("testbed: {kind: hub_with_appendages, length: 3}\nplan: {method: time_optimal}", "length"),
    ],
)
def test_what_is_wrong_is_named(text, word):
    with pytest.raises(BadInput, match=rf"t\.yaml: .*{word}") as caught:
        parse_trial(text, "t.yaml")
    assert "\n" not in str(caught.value)


def test_an_entry_after_the_end_is_refused(tmp_path):
    path = tmp_path / "t.yaml"
    text = "duration: 10.0\nschedule: [{at: AT, disturbance: {base_yaw: 1.0}}]"
    path.write_text(text.replace("AT", "9.99"))
    assert load_trial(path).duration == 10.0
    for late in ("10.0", "9.996", "70.0"):
        path.write_text(text.replace("AT", late))
        with pytest.raises(BadInput, match=r"schedule\.0\.at: .* the run ends at 10 s"):
            load_trial(path)
