"""What the terminal says of a study on its way."""

import pytest

from flexslew_lab.cli import study_words
from flexslew_lab.cli.terminal import for_people


@pytest.mark.parametrize(
    ("left", "words"),
    [
        (None, "1024 of 4096 trials, 0:01:00 so far, estimating the time left"),
        (180.4, "1024 of 4096 trials, 0:01:00 so far, 0:03:00 left"),
    ],
)
def test_a_study_says_how_far_it_is(left: float | None, words: str) -> None:
    assert study_words.far(1024, 4096, 60.0, left) == words


def test_the_log_of_a_batch_queue_gets_a_line_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # at the begin, at the report of what was there, and at each one after it: 40 s of a start
    clock = iter([0.0, 0.0, 40.0, *(40.0 + 5.0 * k for k in range(1, 9)), 100.0])
    monkeypatch.setattr(study_words, "monotonic", lambda: next(clock))
    monkeypatch.setattr(for_people, "_force_terminal", False)
    with study_words.progress("robust") as advance:
        for done in (100, 150, 200, 250, 300, 350, 400, 450, 500, 550, 750):
            advance(done, 1000)
    said = capsys.readouterr().err.splitlines()
    assert said == [
        "robust: 150 of 1000 trials, 0:00:40 so far, estimating the time left",
        "robust: 450 of 1000 trials, 0:01:10 so far, 0:00:55 left",
        "robust: 750 of 1000 trials, 0:01:40 so far, 0:00:25 left",
    ]
