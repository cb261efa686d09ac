"""Figures, tables and animations of runs, from bags with a known motion."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from tests.lab.conftest import Call

import flexslew as fs
from flexslew_lab.publication.animation import write_animation
from flexslew_lab.publication.channels import labelled_runs, panels_of
from flexslew_lab.publication.differences import labels_of
from flexslew_lab.publication.figure import draw_runs, latex_text
from flexslew_lab.publication.media import MEDIA, medium_of
from flexslew_plant.errors import BadInput

INCH = 25.4  # [mm]


@pytest.fixture(scope="module")
def flight(bag: Path) -> fs.Flight:
    return fs.read(bag)


def drawn(figure: Figure) -> list[tuple[str, list[str]]]:
    """Return the title of every panel's axis with the names of its curves."""
    return [
        (axes.get_ylabel(), [str(line.get_label()) for line in axes.lines]) for axes in figure.axes
    ]


def test_a_run_has_a_panel_for_each_quantity_with_its_unit(flight: fs.Flight) -> None:
    figure = fs.plot(flight, show="position,effort.hub_pitch,energy", width="88 mm")
    joints = ["base yaw", "hub pitch"]
    assert drawn(figure) == [
        ("position [rad]", joints),
        ("position\nmode 1 [m]", ["mode 1"]),
        ("effort\nhub pitch [N m]", ["hub pitch"]),
        ("energy [J]", ["_child0"]),
    ]
    assert figure.axes[-1].get_xlabel() == "time [s]"
    assert figure.get_figwidth() * INCH == pytest.approx(88.0)
    curve = figure.axes[0].lines[0]
    assert np.array_equal(curve.get_ydata(), flight["position.base_yaw"])


def test_several_runs_share_a_panel_for_each_signal_and_a_legend(flight: fs.Flight) -> None:
    figure = fs.plot(flight, flight, show=["effort"], labels=["a_b", "cost $5"])
    names = ["a_b", r"cost \$5"]
    assert drawn(figure) == [
        ("effort\nbase yaw [N m]", names),
        ("effort\nhub pitch [N m]", names),
    ]
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == names


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ("applied_effort.hub_pitch", "effort.hub_pitch"),  # as the log names it
        ("tip_deflection.positive", "tip.positive"),
        ("reference_velocity.base_yaw", "reference_rate.base_yaw"),
        ("root_curvature.negative", "curvature.negative"),
        ("joint_position.base_yaw", "measured.base_yaw"),
        ("tips.negative", "tip.negative"),  # as the console does
        ("error.base_yaw", "error.base_yaw"),
        ("estimate minus truth.hub_pitch", "estimate_error.hub_pitch"),
        ("terms.proportional.base_yaw", "term.proportional.base_yaw"),
    ],
)
def test_a_channel_has_the_names_of_the_log_and_of_the_plots(
    flight: fs.Flight, given: str, name: str
) -> None:
    (panel,) = panels_of([flight], [given])
    assert panel.names == (name,)


def test_errors_of_joints_are_reference_and_estimate_minus_position(flight: fs.Flight) -> None:
    assert np.nanmax(np.abs(flight["error"])) < 1e-12  # it follows its reference exactly
    assert flight["estimate_error.base_yaw"][:-1] == pytest.approx(0.001)
    assert flight.units["estimate_error.base_yaw"] == "rad"


def test_terms_add_up_to_the_demand(flight: fs.Flight) -> None:
    assert flight.units["term.feedforward.base_yaw"] == "N m"
    found = flight["term.feedforward.base_yaw"] + flight["term.proportional.base_yaw"]
    assert found[:-1] == pytest.approx(flight["demand.base_yaw"][:-1])


def test_what_never_moves_is_left_out_unless_it_is_named(flight: fs.Flight) -> None:
    (panel, *_) = panels_of([flight], ["position.mode_2"])
    assert panel.names == ("position.mode_2",)
    assert all("mode_2" not in panel.names[0] for panel in panels_of([flight], ["position"]))


@pytest.mark.parametrize(
    ("trials", "labels"),
    [
        ([{"testbed": {"modes": 1}}, {"testbed": {"modes": 5}}], ["modes 1", "modes 5"]),
        (
            [{"plan": {"method": "none", "rho": 1}}, {"plan": {"method": "hat"}}],
            ["method none", "method hat"],
        ),
        (
            [{"active": k, "controllers": {k: {"kp": 1.0}}} for k in ("pd", "lqr")],
            ["active pd", "active lqr"],
        ),
        ([{"seed": 1, "name": "x"}, {"seed": 1, "name": "y"}], ["a", "b"]),
        (
            [
                {"plan": {"duration": 1.0}, "duration": 2.0},
                {"plan": {"duration": 3}, "duration": 4},
            ],
            ["plan.duration 1, duration 2", "plan.duration 3, duration 4"],
        ),
        ([{"plan": None}, {"plan": {"method": "none"}}], ["plan -", "plan method none"]),
    ],
)
def test_a_label_is_what_differs(trials: list[dict[str, Any]], labels: list[str]) -> None:
    assert labels_of(trials, ["a", "b"]) == labels


def test_the_same_run_twice_is_told_apart_by_number() -> None:
    assert labels_of([{"seed": 1}] * 2, ["a", "a"]) == ["a (1)", "a (2)"]


@pytest.mark.parametrize("kind", ["pdf", "svg", "png"])
@pytest.mark.parametrize("style", ["ieee", "slides"])
def test_a_figure_is_the_same_file_again(
    flight: fs.Flight, tmp_path: Path, kind: str, style: str
) -> None:
    files = [tmp_path / f"{name}.{kind}" for name in "ab"]
    for file in files:
        fs.plot(flight, show="tip", to=file, style=style)
    assert files[0].read_bytes() == files[1].read_bytes()
    heads = {"pdf": b"%PDF", "svg": b"<?xml", "png": b"\x89PNG"}
    assert files[0].read_bytes().startswith(heads[kind])
    if kind == "png":
        assert Image.open(files[0]).width == int(MEDIA[style].width / INCH * 300)


def test_the_settings_of_a_style_stay_in_its_figure(flight: fs.Flight) -> None:
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    figure = fs.plot(flight, style="slides")
    assert dict(mpl.rcParams) == before
    assert figure.axes[0].yaxis.label.get_fontsize() == 18.0


def test_special_letters_of_latex_are_letters() -> None:
    assert latex_text(r"a_b 5 % \x") == r"a\_b 5 \% \textbackslash{}x"
    assert latex_text("(N m)^2 s, m s^-2, ^a") == "(N m)$^{2}$ s, m s$^{-2}$, \\textasciicircum{}a"


def test_without_latex_it_is_refused_in_a_line(
    flight: fs.Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(BadInput, match="--latex: needs latex and dvipng: apt-get install"):
        fs.plot(flight, latex=True)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"show": "tib"}, r"--show: tib is no channel of these runs; did you mean tip\? there are"),
        ({"show": "tip.nose"}, "--show: tip.nose is no channel"),
        ({"style": "iee"}, r"--style: 'iee' is not allowed: did you mean ieee\? allowed: ieee, "),
        ({"width": "88"}, "--width: '88' is not allowed: from 20 mm to 1 m"),
        ({"width": "9 s"}, "--width: '9 s' is not allowed: give a number in m, mm"),
        ({"to": "a.jpg"}, r"--to: 'a.jpg' is not allowed: a file that ends in .pdf, .svg, .png"),
        ({"labels": ["one", "two"]}, "--label.*1 runs need as many labels"),
    ],
)
def test_a_wrong_request_is_refused(flight: fs.Flight, keys: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        fs.plot(flight, **keys)


def test_more_panels_than_fit_are_refused(flight: fs.Flight) -> None:
    show = ["position", "velocity", "effort", "measured", "reference", "estimate", "demand"]
    with pytest.raises(BadInput, match="panels, at most 12; name signals, such as position"):
        draw_runs(labelled_runs([flight, flight]), show)


def test_a_length_has_a_unit() -> None:
    assert medium_of("ieee", "3.5 cm").width == pytest.approx(35.0)
    assert medium_of("ieee", 0.088).width == pytest.approx(88.0)


def test_the_command_writes_figure_and_tables(bag: Path, tmp_path: Path, call: Call) -> None:
    files = [tmp_path / name for name in ("f.pdf", "m.csv", "m.tex")]
    figure = ["figure", bag, bag, "--label", "now", "--label", "a_b", "--to", files[0]]
    _, _, err = call(*figure, "--show", "tip,effort", "--width", "88mm", "--table", files[1])
    assert err.count("written file://") == 2
    assert files[0].read_bytes().startswith(b"%PDF")
    rows = list(csv.reader(files[1].read_text().splitlines()))
    metrics = fs.read(bag).metrics
    assert rows[0] == ["metric", "unit", "now", "a_b"]
    assert rows[1][:2] == ["residual_tip_deflection", "m"]
    assert float(rows[1][2]) == metrics["residual_tip_deflection"]
    call("figure", bag, "--label", "a_b", "--table", files[2], "--metrics", "peak_effort,ticks")
    text = files[2].read_text()
    assert r"metric & unit & a\_b \\" in text
    assert r"peak effort, base yaw & N\,m & $40$ \\" in text
    assert r"ticks &  & 500 \\" in text
    assert text.endswith("\\bottomrule\n\\end{tabular}\n")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ((), "error: give at least one of --to, --table and --animation"),
        (("--table", "m.xls"), "--table: 'm.xls' is not allowed: a file that ends in .tex, .csv"),
        (
            ("--table", "m.csv", "--metrics", "peak_efort"),
            "--metrics: peak_efort is no metric of these runs; did you mean peak_effort?",
        ),
        (("--animation", "m.avi"), "--animation: 'm.avi' is not allowed: a file that ends in .gif"),
        (("--animation", "m.gif", "--seconds", "0"), "--seconds: 0.0 is not allowed"),
    ],
)
def test_the_command_refuses_in_a_line(
    bag: Path, call: Call, words: tuple[str, ...], told: str, monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    _, _, err = call("figure", bag, *words)
    assert told in err
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_film_has_its_length_and_moves(bag: Path, tmp_path: Path) -> None:
    film = tmp_path / "slew.gif"
    write_animation(bag, film, seconds=0.4, style="ieee")
    with Image.open(film) as pictures:
        assert getattr(pictures, "n_frames", 0) == 6
        first = np.asarray(pictures.convert("L"), dtype=float)
        pictures.seek(5)
        last = np.asarray(pictures.convert("L"), dtype=float)
    assert np.abs(first - last).max() > 100.0


def test_without_ffmpeg_mp4_is_refused_with_the_remedy(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shutil.which", lambda name: None)
    with pytest.raises(BadInput, match="needs ffmpeg, which is not on the PATH: apt-get install"):
        write_animation(bag, tmp_path / "slew.mp4")
    assert not list(tmp_path.iterdir())
