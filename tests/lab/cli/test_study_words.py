"""What the terminal says of a study on its way."""

import pytest

from flexslew_lab.cli import study_words


@pytest.mark.parametrize(
    ("done", "wanted", "flown", "seconds", "words"),
    [
        (0, 4096, 0, 3.0, "0 of 4096 trials, 0:00:03 so far"),
        (1024, 4096, 1024, 60.0, "1024 of 4096 trials, 0:01:00 so far, 0:03:00 left"),
        (3072, 4096, 1024, 60.0, "3072 of 4096 trials, 0:01:00 so far, 0:01:00 left"),  # resumed
        (4096, 4096, 1024, 60.0, "4096 of 4096 trials, 0:01:00 so far, 0:00:00 left"),
    ],
)
def test_the_time_left_counts_the_trials_of_this_run_alone(
    done: int, wanted: int, flown: int, seconds: float, words: str
) -> None:
    assert study_words.far(done, wanted, flown, seconds) == words


def test_the_log_of_a_batch_queue_gets_a_line_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = iter([0.0, 10.0, 31.0, 40.0, 70.0])  # at the begin, and at each report after the first
    monkeypatch.setattr(study_words, "monotonic", lambda: next(clock))
    monkeypatch.setattr(study_words.for_people, "_force_terminal", False)
    with study_words.progress("robust") as advance:
        for done in (100, 200, 300, 400):
            advance(done, 500)
    said = capsys.readouterr().err.splitlines()
    assert said == [
        "robust: 200 of 500 trials, 0:00:31 so far, 0:01:33 left",
        "robust: 400 of 500 trials, 0:01:10 so far, 0:00:23 left",
    ]
