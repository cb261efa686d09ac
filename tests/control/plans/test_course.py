"""Plans one after the other, each from its start on."""

import numpy as np

from flexslew_control.law import Reference
from flexslew_control.plan import Plan
from flexslew_control.plans.course import LARGEST_JUMP, PlanSequence, jump

REST = np.zeros(1)
HOLD = Reference(np.array([7.0]), REST, REST, np.zeros(0))


def plan(start: float, at: float, to: float) -> Plan:
    """Return a plan of 10 ticks."""
    position = np.linspace(at, to, 11)[:, None]
    velocity = np.zeros((11, 1))
    return Plan(
        "test", ("a",), start, 0.01, position, velocity, np.zeros((10, 1)), np.zeros((11, 0)), 0.1
    )


def place(course: PlanSequence, tick: int) -> float:
    return float(course.reference(tick, HOLD).position[0])


def test_without_a_plan_and_until_the_first_one_starts_it_holds() -> None:
    course = PlanSequence()
    assert course.plan is None
    assert place(course, 5) == 7.0
    course.add(plan(0.2, 7.0, 8.0))
    assert [place(course, k) for k in (0, 19, 20, 30, 99)] == [7.0, 7.0, 7.0, 8.0, 8.0]


def test_the_plan_of_the_start_says_itself_where_the_joints_rest_before_it() -> None:
    course = PlanSequence()
    course.begin_with(plan(0.2, 1.0, 2.0))
    assert [place(course, k) for k in (0, 19, 30)] == [1.0, 1.0, 2.0]


def test_each_is_flown_to_the_start_of_the_next() -> None:
    course = PlanSequence()
    course.begin_with(plan(0.0, 0.0, 1.0))
    course.add(plan(0.5, 1.0, 2.0))
    course.add(plan(1.0, 2.0, 3.0))
    assert [place(course, k) for k in (0, 5, 40, 55, 99, 110)] == [0.0, 0.5, 1.0, 1.5, 2.0, 3.0]
    course.add(plan(0.8, 2.0, 9.0))  # the one that would begin after it is not flown any more
    assert [place(course, k) for k in (55, 85, 110)] == [1.5, 5.5, 9.0]


def test_it_is_known_when_another_plan_is_flown_in_place_of_one() -> None:
    course, first, second, late = (
        PlanSequence(),
        plan(0.0, 0.0, 1.0),
        plan(0.5, 1.0, 2.0),
        plan(1, 2, 3),
    )
    course.begin_with(first)
    course.add(late)
    course.add(second)  # late is dropped
    assert [course.has_later_plan(first, k) for k in (0, 50, 51, 99)] == [False, False, True, True]
    assert not course.has_later_plan(second, 200)
    assert course.has_later_plan(late, 0)


def test_a_reset_leaves_the_plan_of_the_start() -> None:
    course = PlanSequence()
    course.begin_with(plan(0.0, 0.0, 1.0))
    course.add(plan(0.5, 1.0, 2.0))
    course.restart()
    assert place(course, 110) == 1.0
    course = PlanSequence()
    course.add(plan(0.5, 7.0, 2.0))
    course.restart()
    assert course.plan is None
    assert place(course, 110) == 7.0


def test_a_jump_is_told_with_joint_places_and_bound() -> None:
    assert jump(plan(1.0, 7.0 + 0.99 * LARGEST_JUMP, 0.0), HOLD) is None
    assert str(jump(plan(1.0, 7.5, 0.0), HOLD)) == (
        "at its start, 1 s, the reference of a stands at 7, the plan begins with 7.5; at most 0.01 "
        "apart is allowed"
    )
    moving = HOLD._replace(velocity=np.array([-0.3]))
    assert "a moves at -0.3, the plan begins with 0;" in str(jump(plan(1.0, 7.0, 0.0), moving))
