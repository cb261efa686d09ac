"""A question of somebody else's is put aside; a gap of the bench's own is not the end of it."""

from flexslew_control.controllers.question_thread import Key, QuestionThread


def taken(*keys: Key) -> list[bool]:
    thread = QuestionThread()
    return [thread.take(key) for key in keys]


def test_ticks_repetitions_and_resets_count_and_so_does_the_first_question() -> None:
    assert all(taken((0, 7), (0, 7), (0, 8), (0, 9), (1, 0), (1, 1), (3, 0), (3, 1)))


def test_a_stray_question_is_put_aside_and_the_next_one_of_the_bench_counts() -> None:
    for stray in ((0, 3009), (0, 1 << 60), (0, 2), (7, 5)):
        assert taken((0, 9), stray, (0, 10), (0, 11)) == [True, False, True, True]


def test_a_bag_that_is_played_beside_the_bench_never_counts() -> None:
    thread = QuestionThread()
    for k in range(50):
        assert thread.take((0, k))
        assert not thread.take((0, 3000 + 2 * k))
        assert not thread.take((0, 3001 + 2 * k))


def test_after_a_gap_the_bench_is_heard_again_once_it_has_asked_a_few_times() -> None:
    thread = QuestionThread()
    assert thread.take((0, 9))
    assert [thread.take((0, 500)) for _ in range(4)] == [False, False, False, True]
    assert thread.resumed
    assert thread.take((0, 501))
    assert not thread.resumed


def test_who_heard_somebody_else_first_comes_back_to_the_bench() -> None:
    assert taken((0, 1 << 60), (0, 0), (0, 0), (0, 0), (0, 0), (0, 1))[-2:] == [True, True]
