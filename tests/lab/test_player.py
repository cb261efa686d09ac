"""The player without ROS: order, stamps, rate, pause, step, seek, loop, topics, remapping."""

from math import inf

import pytest

from flexslew_lab.bag_reader import BagReader
from flexslew_lab.player import Player, PlaySettings
from flexslew_plant.errors import BadInput

END = 5.0  # of the synthetic bag [s]


def player(bag, **settings):
    return Player(PlaySettings(bag=str(bag), **settings))


def everything(it, now=0.0):
    found = []
    while not it.done:
        found += it.due(now)
        now += 0.1
    return found


def in_bag(bag):
    return [(m.topic, m.type, m.stamp, m.data) for m in BagReader(bag).messages()]


def test_as_fast_as_it_goes_everything_comes_in_the_order_of_the_bag(bag):
    assert [tuple(m) for m in everything(player(bag, rate=0.0))] == in_bag(bag)


def test_paced_everything_comes_too_byte_for_byte(bag):
    assert [tuple(m) for m in everything(player(bag, rate=10.0))] == in_bag(bag)


@pytest.mark.parametrize("rate", [0.5, 1.0, 20.0])
def test_nothing_comes_before_its_time_and_everything_at_it(bag, rate):
    it = player(bag, rate=rate)
    it.due(100.0)  # the clock of the wall starts anywhere
    for wall in (0.105, 0.255, 0.305):
        it.due(100.0 + wall / rate, most=100_000)
        assert it.time == pytest.approx(wall + 0.005, abs=1e-6)
    assert it.wait(100.0 + 0.305 / rate) == pytest.approx(0.005 / rate, rel=1e-3)


def test_a_lot_is_not_larger_than_asked_for(bag):
    it = player(bag, rate=0.0)
    assert len(it.due(0.0, most=7)) == 7
    assert it.wait(0.0) == 0.0


def test_a_start_brings_what_is_latched_before_it(bag):
    found = everything(player(bag, rate=0.0, start=2.0))
    early = [m for m in found if m.stamp == 2_000_000_000]
    assert {m.topic for m in early} >= {"/testbed", "/plan", "/events"}
    assert [m.stamp for m in found] == sorted(m.stamp for m in found)
    truths = [m for m in found if m.topic == "/truth"]
    assert len(truths) == 301


def test_a_duration_ends_it(bag):
    found = everything(player(bag, rate=0.0, start=2.0, duration=1.0))
    assert max(m.stamp for m in found) == pytest.approx(3.0e9, abs=1e3)


def test_a_pause_is_not_caught_up(bag):
    it = player(bag)
    it.due(0.0)
    it.due(1.005, most=100_000)
    it.pause()
    assert it.due(50.0) == []
    assert it.wait(50.0) == inf
    it.resume()
    it.due(60.0)
    it.due(60.105, most=100_000)
    assert it.time == pytest.approx(1.12, abs=1e-6)


def test_it_may_begin_paused_and_be_stepped(bag):
    it = player(bag, paused=True, topics=("truth",))
    assert it.due(0.0) == []
    assert len(it.step(0.0055)) == 1
    assert len(it.step(0.0555)) == 5
    assert it.time == pytest.approx(0.06)


@pytest.mark.parametrize(("to", "expected"), [(3.0, 3.0), (0.0, 0.0), (99.0, END), (-1.0, 0.0)])
def test_a_seek_goes_both_ways_and_stays_inside(bag, to, expected):
    it = player(bag, topics=("/truth",), rate=0.0)
    it.due(0.0, most=250)
    assert it.seek(to) == pytest.approx(expected, abs=1e-6)
    assert len(it.due(0.0)) == round((END - expected) * 100) + (expected < END)


def test_a_loop_begins_again_and_never_ends(bag):
    it = player(bag, rate=0.0, topics=("truth",), start=4.0, loop=True)
    found = []
    while it.rounds < 3:
        found += [m.stamp for m in it.due(0.0)]
    assert not it.done
    assert len(found) >= 303
    assert found[:101] == found[101:202]


def test_topics_are_chosen_and_renamed(bag):
    it = player(bag, rate=0.0, topics=("truth", "/plan"), remap=("/truth:=/recorded/truth",))
    assert it.topics == {
        "/plan": "flexslew_msgs/msg/Plan",
        "/recorded/truth": "flexslew_msgs/msg/PlantState",
    }
    assert {m.topic for m in everything(it)} == {*it.topics}


def test_an_own_clock_leaves_the_recorded_one_out(bag):
    assert "/clock" not in player(bag, clock=100.0).topics


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"topics": ("nowhere",)}, "no topic /nowhere; it has"),
        ({"remap": ("truth",)}, "not of the form old:=new"),
        ({"remap": ("/nowhere:=/x",)}, "no topic /nowhere"),
        ({"start": 6.0}, "behind the end"),
    ],
)
def test_wrong_wishes_are_told(bag, wrong, words):
    with pytest.raises(BadInput, match=words):
        player(bag, **wrong)
