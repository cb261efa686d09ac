"""What a person may get wrong: one line that names it, exit code 2, nothing written."""

import sys
from pathlib import Path

import pytest
from tests.lab.conftest import Call

from flexslew_lab.cli import checkout


@pytest.fixture(autouse=True)
def place(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Run every command in an empty folder."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("trial", "--rate", "nan"), "--rate: nan"),
        (("trial", "--rate", "inf"), "--rate: inf"),
        (("trial", "--rate", "-1"), "--rate: -1.0"),
        (
            ("trial", "--in-process", "--set", "period=1e-300"),
            "duration: 100.0 is not allowed",
        ),
        (
            ("plan", "--set", "plan.duration=1e9"),
            "plan: duration: 1000000000.0 is not",
        ),
        (
            ("plan", "--json", "--set", "plan.duration=2"),
            "m1 --set plan.duration=2: plan: the manoeuvre needs",
        ),
        (
            ("plan", "--set", "plan.goal={base_yow: 1}"),
            "error: --set: plan.goal: base_yow is not a joint of the testbed; did you mean",
        ),
        (
            ("trial", "--in-process", "--set", "plan.method=reference_only"),
            "the file's plan is for another method: give all of it, "
            "--set 'plan={method: reference_only, ...}'",
        ),
        (
            ("trial", "--in-process", "--set", "testbed.kind=hub_with_appendages"),
            "(wrong or missing, too: modes); the file's testbed is for another kind",
        ),
        (("trial", "--in-process", "--set", "controllers={}"), "controllers: give at least one"),
        (("trial", "--in-process", "--out", "/proc/x"), "--out: /proc/x cannot be written"),
        (("trial", "--in-process", "--out", "/dev/null"), "--out: /dev/null is a file"),
        (
            ("trial", "nothing.yaml"),
            "nothing.yaml: is neither a file nor a shipped trial",
        ),
        (("trial", "/"), "/: cannot be read: it is a folder"),
        (("trial", sys.executable), "cannot be read: it is not a text file"),
        (("plan", "--out", "/proc/x"), "--out: /proc/x"),
        (("plan", "--figure", "/"), "--figure: / is a folder"),
        (("plan", "--out", "p", "--figure", "./p"), "--figure: p is the file of --out, too"),
        (("gains", "--out", "g", "--journal", "./g"), "--out: g is the file of --journal, too"),
        (("trial", "--in-process", "--open", "--no-report"), "--open: there is no page to open"),
        (("compare", "--out", "/proc/x.html"), "--out: /proc/x.html"),
        (("report", "/nothing"), "/nothing: no such run"),
        (("reproduce", "csa", "--figures", "/proc/x"), "--figures: /proc/x"),
        (("reproduce", "magic"), "magic"),
        (("log", "export", "/nothing", "--out", "/proc/x"), "--out: /proc/x"),
        (("recover", "/nothing", "--out", "/proc/x"), "--out: /proc/x"),
        (("check", "/nothing", "--figure", "/proc/x"), "--figure: /proc/x"),
        (("play", "/nothing", "--rate", "nan"), "play: rate: nan"),
        (("switch", "pd_feedforward", "--at", "nan"), "'--at': 'nan' is not allowed"),
        (("switch", "pd_feedforward", "--max-effort-step", "-1"), "--max-effort-step: -1.0"),
        (("live", "--port", "99999"), "--port: 99999"),
        (
            ("export", "m1", "--c", "c", "--controller", "pid"),
            "no such controller; allowed: pd_feedforward",
        ),
        (("bench", "magic"), "magic is not a benchmark; allowed: "),
        (("trial", "l\udcf6.yaml"), "l\\udcf6.yaml: is no name in utf-8; rename it"),
        (
            ("study", "run", "csa_robustness", "--out", "/proc/x"),
            "--out: /proc/x cannot be written",
        ),
        (("benchmark", "run", "magic"), "magic: is no benchmark task; allowed: acc, antenna"),
        (("benchmark", "run", "acc", "--out", "/proc/x"), "--out: /proc/x"),
        (("benchmark", "run", "acc", "--set", "seed=3"), "--set seed: seed is fixed by acc"),
        (("benchmark", "run", "acc", "--members", "65"), "--members: 65 is not allowed: 1 to 64"),
        (("benchmark", "run", "acc", "--seeds", "evaluation"), "--round"),
        (("benchmark", "verify", "/nothing"), "/nothing"),
        (("trial", "[/nothing]"), "[/nothing]: is neither a file nor a shipped trial"),
        (("step", "0"), "ticks: 0"),
        (("inject", "{kind: x}", "--at", "inf"), "'--at': 'inf' is not allowed"),
        (("trial", "--nothing"), "--nothing"),
        (("magic",), "magic"),
    ],
    ids=lambda words: " ".join(words) if isinstance(words, tuple) else "",
)
def test_bad_input_is_one_line_and_leaves_nothing(
    call: Call, tmp_path: Path, words: tuple[str, ...], told: str
) -> None:
    code, out, err = call(*words)
    assert code == 2
    assert " ".join(err.split()).startswith("error: ")
    assert told in err.replace("\n", " ")
    assert "Traceback" not in err
    assert out == ""
    assert not list(tmp_path.iterdir())


def test_a_broken_benchmark_costs_no_figure_of_the_others(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "benchmarks").mkdir()
    for name, body in (("a", "return {'a': 1.0}"), ("b", "raise OSError('no room')"),
                       ("c", "return {'c': 3.0}")):  # fmt: skip
        (tmp_path / "benchmarks" / f"{name}.py").write_text(f"def figures():\n    {body}\n")
    monkeypatch.setattr(checkout, "_root", lambda: tmp_path)
    code, out, err = call("bench")
    assert code == 1
    assert [line.split() for line in out.splitlines()[1:]] == [["a", "1"], ["c", "3"]]
    assert "failed: b: OSError: no room" in err


@pytest.mark.parametrize(
    "words",
    [
        ("model", "t.yaml", "--to", "t.yaml"),
        ("plan", "t.yaml", "--out", "t.yaml"),
        ("plan", "t.yaml", "--figure", "t.yaml"),
        ("analyse", "t.yaml", "--out", "t.yaml"),
        ("compare", "t.yaml", "--out", "t.yaml"),
        ("gains", "t.yaml", "--out", "t.yaml"),
        ("gains", "t.yaml", "--journal", "t.yaml"),
    ],
    ids=lambda words: " ".join(words[::2]),
)
def test_no_command_writes_over_the_trial_that_it_reads(
    words: tuple[str, ...], call: Call, tmp_path: Path
) -> None:
    (tmp_path / "t.yaml").write_text("duration: 1.0\n")
    code, _, err = call(*words)
    assert (code, err) == (2, f"error: {words[2]}: t.yaml is the trial itself; give another name\n")
    assert (tmp_path / "t.yaml").read_text() == "duration: 1.0\n"


def test_a_fault_of_the_program_is_no_check_that_failed(
    call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise error

    monkeypatch.setattr("flexslew_lab.trial.sources.example_trials", broken)
    error: Exception = RuntimeError("it broke")
    code, _, err = call("trials")
    assert code == 3
    assert err.endswith("RuntimeError: it broke\n")
    error = MemoryError("Unable to allocate 16 GiB")
    assert call("trials") == (3, "", "error: out of memory: Unable to allocate 16 GiB\n")
