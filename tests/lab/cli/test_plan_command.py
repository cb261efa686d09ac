"""The command `plan` with a trajectory of another tool."""

from pathlib import Path

from tests.lab.conftest import Call

SLEW = """
joint_names: [base_yaw]
points:
- {positions: [0.5], velocities: [0.0], time_from_start: {sec: 5, nanosec: 0}}
"""


def test_the_shapers_that_were_compared_are_printed_as_a_table(tmp_path: Path, call: Call) -> None:
    (tmp_path / "slew.yaml").write_text(SLEW)
    section = f"{{method: input_shaping, trajectory: {tmp_path / 'slew.yaml'}, shaper: auto}}"
    code, out, _ = call("plan", "m1", "--set", f"plan={section}")
    assert code == 0
    lines = [line.split() for line in out.splitlines()]
    head = lines.index(["shaper", "delay", "[s]", "smoothing", "[s]", "residual", "[%]"])
    rows = [line for line in lines[head + 1 :] if len(line) == 4]
    chosen = next(line for line in lines if line[:1] == ["shaper_choice"])[1]
    assert rows[0][0] == chosen
    assert len(rows) == 7
    delays = [float(row[1]) for row in rows]
    residuals = [float(row[3]) for row in rows]
    assert delays == sorted(delays)  # all leave at most 5 %
    assert max(residuals) <= 5.0
