"""The moving testbed of a run as an animation: GIF by Pillow, MP4 by ffmpeg."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np

from flexslew_lab.progress import phase
from flexslew_lab.publication.figure import format_of
from flexslew_lab.publication.media import MM, medium_of, settings_of
from flexslew_lab.report.run_data import read_run
from flexslew_lab.report.scene_data import scene_of
from flexslew_lab.trial.outputs import bag_folder
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.extras import required
from flexslew_plant.own_code import NO_CODE, Trust

ANIMATION_FORMATS = ("gif", "mp4")
_RATE = 15  # frames a second


def write_animation(
    run: Path, to: Path, seconds: float = 10.0, style: str = "slides", trust: Trust = NO_CODE
) -> None:
    """Write the animation of a run: bodies, and appendages with their bend exaggerated.

    Args:
        run: folder of the run, or its bag.
        to: file, .gif or .mp4.
        seconds: length of the animation [s].
        style: medium; see MEDIA.
        trust: classes that the log names and that may be loaded.

    Raises:
        BadInput: if the file is not allowed, the testbed cannot be drawn, or ffmpeg is missing.
        ModuleNotFoundError: if Matplotlib is not installed.
    """
    from flexslew_lab.log.bag_reader import BagReader

    matplotlib = required("matplotlib")
    kind, medium = format_of(to, "--animation", ANIMATION_FORMATS), medium_of(style, None)
    if not 0.0 < seconds <= 600.0:
        raise BadInput("above 0, at most 600", key="--seconds", value=seconds)
    if kind == "mp4" and shutil.which("ffmpeg") is None:
        raise BadInput(
            f"--animation: {to} needs ffmpeg, which is not on the PATH: apt-get install ffmpeg, or "
            "give a file that ends in .gif"
        )
    scene = scene_of(read_run(BagReader(bag_folder(run), trust=trust)))
    if scene is None:
        raise BadInput("--animation: the testbed of this run cannot be drawn", run)
    to.parent.mkdir(parents=True, exist_ok=True)
    settings = settings_of(medium, False) | {"figure.constrained_layout.use": False}
    with matplotlib.rc_context(settings):
        _save(scene, to, kind, round(seconds * _RATE), medium.width)


def _save(scene: dict[str, Any], to: Path, kind: str, count: int, width: float) -> None:
    """Draw the frames of a scene and save them; the width of a picture is in millimetres."""
    from matplotlib.animation import FFMpegWriter, PillowWriter
    from matplotlib.figure import Figure

    numbers = np.unique(np.linspace(0, len(scene["time"]) - 1, max(count, 2)).round().astype(int))
    pictures = [_lines(scene, k) for k in numbers]
    places = np.concatenate([line for lines in pictures for line in lines])
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    half = max(0.5 * float(np.ptp(places, axis=0).max()), 1e-6)
    figure = Figure(figsize=(width * MM, 0.75 * width * MM))
    axes: Any = figure.add_axes((0.0, 0.0, 1.0, 0.94), projection="3d")
    axes.set(**{f"{a}lim": (c - half, c + half) for a, c in zip("xyz", middle, strict=True)})
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    axes.set_box_aspect((1.0, 1.0, 1.0), zoom=0.9)
    curves = [axes.plot([], [], [], "-", color="#0072b2")[0] for _ in scene["beams"]]
    (bodies,) = axes.plot([], [], [], "s", color="#4d4d4d")
    title = figure.text(0.5, 0.95, "", ha="center")
    writer = (PillowWriter if kind == "gif" else FFMpegWriter)(fps=_RATE)
    with phase("drawing the animation", "pictures") as update, writer.saving(figure, to, dpi=100):
        for done, (k, (*lines, centres)) in enumerate(zip(numbers, pictures, strict=True)):
            for curve, line in zip(curves, lines, strict=True):
                curve.set_data_3d(*line.T)
            bodies.set_data_3d(*centres.T)
            gain = f", bend x {scene['gain']}" if scene["gain"] != 1 else ""
            title.set_text(f"{scene['label']}: {scene['time'][k]:.1f} s{gain}".replace("$", r"\$"))
            writer.grab_frame()
            update(done + 1, len(numbers))


def _lines(scene: dict[str, Any], k: int) -> list[Matrix]:
    """Return the appendages of a frame in the world, (points, 3) [m], then the bodies' places."""
    modes: Vector = np.asarray(scene["modes"][k])
    poses = [np.asarray(pose[k]) for pose in scene["poses"]]
    found = []
    for beam in scene["beams"]:
        bend = np.tensordot(modes, np.asarray(beam["shapes"]), axes=1)
        pose = poses[beam["frame"]]
        line = np.asarray(beam["line"]) + scene["gain"] * bend
        found.append(line @ pose[:9].reshape(3, 3).T + pose[9:])
    return [*found, np.array([pose[9:] for pose in poses])]
