"""The player without ROS: order, stamps, rate, pause, step, seek, loop, topics, remapping."""

import math
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexslew_lab.log import bag_index
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.files.mcap_scan import CHUNK, RecordStream, chunk_content
from flexslew_lab.log.messages.cdr import encode
from flexslew_lab.replay.player import Player, PlaySettings
from flexslew_plant.errors import BadInput

END = 5.0  # of the synthetic bag [s]


def player(bag: Any, **settings: Any) -> Player:
    return Player(PlaySettings(bag=str(bag), **settings))


def everything(it: Any, now: float = 0.0) -> Any:
    found = []
    while not it.done:
        found += it.due(now)
        now += 0.1
    return found


def in_bag(bag: Any) -> list[Any]:
    return [(m.topic, m.type, m.stamp, m.data) for m in BagReader(bag).messages()]


def test_as_fast_as_it_goes_everything_comes_in_the_order_of_the_bag(bag: Any) -> None:
    assert [tuple(m) for m in everything(player(bag, rate=0.0))] == in_bag(bag)


def test_paced_everything_comes_too_byte_for_byte(bag: Any) -> None:
    assert [tuple(m) for m in everything(player(bag, rate=10.0))] == in_bag(bag)


@pytest.mark.parametrize("rate", [0.5, 1.0, 20.0])
def test_nothing_comes_before_its_time_and_everything_at_it(bag: Any, rate: float) -> None:
    it = player(bag, rate=rate)
    it.due(100.0)  # the clock of the wall starts anywhere
    for wall in (0.105, 0.255, 0.305):
        it.due(100.0 + wall / rate, most=100_000)
        assert it.time == pytest.approx(wall + 0.005, abs=1e-6)
    assert it.wait(100.0 + 0.305 / rate) == pytest.approx(0.005 / rate, rel=1e-3)


def test_a_lot_is_not_larger_than_asked_for(bag: Any) -> None:
    it = player(bag, rate=0.0)
    assert len(it.due(0.0, most=7)) == 7
    assert it.wait(0.0) == 0.0


def test_a_start_brings_what_is_latched_before_it(bag: Any) -> None:
    found = everything(player(bag, rate=0.0, start=2.0))
    early = [m.topic for m in found if m.stamp < 2_000_000_000]
    assert early == ["/testbed", "/plan", "/events"]
    assert [m.topic for m in found[:3]] == early
    assert [m.stamp for m in found] == sorted(m.stamp for m in found)
    truths = [m for m in found if m.topic == "/truth"]
    assert len(truths) == 301


def test_a_duration_ends_it(bag: Any) -> None:
    found = everything(player(bag, rate=0.0, start=2.0, duration=1.0))
    assert max(m.stamp for m in found) == pytest.approx(3.0e9, abs=1e3)


def test_a_pause_is_not_caught_up(bag: Any) -> None:
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


def test_it_may_begin_paused_and_be_stepped(bag: Any) -> None:
    it = player(bag, paused=True, topics=("truth",))
    assert it.due(0.0) == []
    assert len(it.step(0.0055)) == 1
    assert len(it.step(0.0555)) == 5
    assert it.time == pytest.approx(0.06)


@pytest.mark.parametrize("to", [3.0, 0.0, END, 1.234])
def test_a_seek_goes_both_ways(bag: Any, to: Any) -> None:
    it = player(bag, topics=("/truth",), rate=0.0)
    it.due(0.0, most=250)
    assert it.seek(to) == pytest.approx(to, abs=0.01)
    found = it.due(0.0)
    assert len(found) == 501 - math.ceil(to * 100)
    assert [m.stamp for m in found] == sorted(m.stamp for m in found)
    assert it.done


@pytest.mark.parametrize("to", [-0.001, END + 0.001, 99.0])
def test_a_seek_out_of_the_bag_is_refused_with_its_range_and_changes_nothing(
    bag: Any, to: Any
) -> None:
    it = player(bag, topics=("/truth",), rate=0.0)
    it.due(0.0, most=250)
    with pytest.raises(BadInput, match="is outside of the bag, which is played from 0 s to 5 s"):
        it.seek(to)
    assert it.time == pytest.approx(2.5, abs=1e-6)
    assert len(it.due(0.0)) == 251


def test_a_seek_behind_the_duration_is_refused(bag: Any) -> None:
    it = player(bag, start=1.0, duration=2.0)
    with pytest.raises(BadInput, match="to 3 s"):
        it.seek(4.0)


def test_a_seek_in_a_pause_tells_at_once_what_is_latched_there(bag: Any) -> None:
    it = player(bag, paused=True)
    it.seek(4.0)
    told = it.due(0.0)
    assert [m.topic for m in told] == ["/testbed", "/plan", "/events", "/events", "/events"]
    assert it.due(0.0) == []
    assert [m.topic for m in it.step(4.005)][:2] == ["/clock", "/truth"]
    it.seek(1.0)
    assert [m.topic for m in it.due(0.0)] == ["/testbed", "/plan", "/events"]
    assert it.time == pytest.approx(1.0, abs=1e-6)


def test_a_seek_in_a_loop_plays_to_the_end_and_begins_at_the_start(bag: Any) -> None:
    it = player(bag, rate=0.0, topics=("truth",), start=2.0, loop=True)
    it.seek(4.0)
    assert len(it.due(0.0)) == 101
    assert len(it.due(0.0)) == 301
    assert it.iterations == 1


def test_a_paced_player_goes_on_from_where_it_was_sent(bag: Any) -> None:
    it = player(bag, topics=("truth",))
    it.due(0.0)
    it.seek(3.0)
    it.due(10.0)
    it.due(10.105, most=100_000)
    assert it.time == pytest.approx(3.11, abs=1e-6)


def test_a_jump_reads_the_chunks_behind_it_only(bag: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    read = []

    def counted(*arguments: Any) -> Any:
        read.append(arguments)
        return chunk_content(*arguments)

    monkeypatch.setattr(bag_index, "chunk_content", counted)
    it = player(bag, topics=("truth",), rate=0.0)
    it.due(0.0, most=100_000)
    whole = len(read)
    read.clear()
    it.seek(4.99)
    it.due(0.0)
    assert whole > 5
    assert len(read) == 1


def test_a_bag_without_its_end_is_played_and_sought_in_the_same_way(
    tmp_path: Path, bag: Any, write_bag: Any
) -> None:
    cut = write_bag(tmp_path / "cut", close=False)
    it, whole = player(cut, rate=0.0), player(bag, rate=0.0)
    for one in (it, whole):
        one.seek(2.5)
    found = everything(it)
    assert len(found) > 1000
    assert found == everything(whole)[: len(found)]


def test_a_damaged_chunk_stops_a_seek_and_nothing_else(tmp_path: Path, write_bag: Any) -> None:
    file = next(write_bag(tmp_path / "bag").glob("*.mcap"))
    data = bytearray(file.read_bytes())
    chunks = [r.offset for r in RecordStream(file) if r.opcode == CHUNK]
    data[chunks[-1] + 300] ^= 0xFF
    file.write_bytes(data)
    it = player(file, topics=("/truth",), rate=0.0)
    with pytest.raises(BadInput, match="damaged chunk"):
        it.seek(END)
    assert it.time == pytest.approx(0.0, abs=1e-6)


def test_a_flipped_byte_gives_a_clear_refusal_or_the_messages_themselves(
    tmp_path: Path, write_bag: Any
) -> None:
    file = next(write_bag(tmp_path / "bag").glob("*.mcap"))
    whole, rng, original = file.read_bytes(), np.random.default_rng(3), in_bag(file)
    refused = 0
    for at in rng.integers(0, len(whole), 100):
        data = bytearray(whole)
        data[at] ^= 1 << rng.integers(8)
        file.write_bytes(data)
        try:
            assert [tuple(m) for m in everything(player(file, rate=0.0))] == original
        except BadInput:
            refused += 1
    assert refused > 50


def test_of_every_controller_the_last_word_before_a_seek_is_told(
    tmp_path: Path, write_bag: Any
) -> None:
    def status(name: Any, tick: Any, reason: str = "") -> tuple[str, Any, Any]:
        stamp = tick * 10_000_000
        message = {"stamp": stamp, "controller": name, "last_tick": tick, "reason": reason}
        return "/controller_status", encode("flexslew_msgs/msg/ControllerStatus", message), stamp

    said = [status(name, tick, f"{tick}") for tick in range(0, 6000, 100) for name in ("a", "b")]
    gone = status("gone", 200)
    bag = write_bag(tmp_path / "bag", sorted([*said, gone], key=lambda m: m[2]))
    it = player(bag, paused=True)
    it.seek(3.05)
    assert [m.data for m in it.due(0.0)] == [m[1] for m in (gone, *said[6:8])]
    it.seek(50.0)
    assert [m.data for m in it.due(0.0)] == [m[1] for m in said[98:100]]


def test_a_loop_begins_again_and_never_ends(bag: Any) -> None:
    it = player(bag, rate=0.0, topics=("truth",), start=4.0, loop=True)
    found = []
    while it.iterations < 3:
        found += [m.stamp for m in it.due(0.0)]
    assert not it.done
    assert len(found) >= 303
    assert found[:101] == found[101:202]


def test_topics_are_chosen_and_renamed(bag: Any) -> None:
    it = player(bag, rate=0.0, topics=("truth", "/plan"), remap=("/truth:=/recorded/truth",))
    assert it.topics == {
        "/plan": "flexslew_msgs/msg/Plan",
        "/recorded/truth": "flexslew_msgs/msg/PlantState",
    }
    assert {m.topic for m in everything(it)} == {*it.topics}


def test_what_is_latched_stays_so_under_another_name(bag: Any) -> None:
    it = player(bag, remap=("/plan:=/recorded/plan",))
    assert it.latched == {"/testbed", "/recorded/plan", "/events"}


def test_an_own_clock_leaves_the_recorded_one_out(bag: Any) -> None:
    assert "/clock" not in player(bag, clock=100.0).topics


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"topics": ("nowhere",)}, "no topic /nowhere; it has"),
        ({"remap": ("truth",)}, "not of the form old:=new"),
        ({"remap": ("truth:=/my truth",)}, "--remap: '/my truth' is not allowed: letters, digits"),
        ({"remap": ("/nowhere:=/x",)}, "no topic /nowhere"),
        ({"remap": ("/truth:=/plan",)}, "/plan is a flexslew_msgs/msg/Plan, /truth"),
        ({"start": 6.0}, "after the end"),
    ],
)
def test_wrong_wishes_are_told(bag: Any, wrong: Any, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        player(bag, **wrong)
