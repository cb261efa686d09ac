"""The testbed in three dimensions: bent as it is, with the reference as an outline."""

from contextlib import suppress
from functools import partial
from typing import Any
from xml.etree import ElementTree

import numpy as np

from flexslew_lab.console.desk import Desk
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds import Testbed, initial_state
from flexslew_plant.testbeds.scene import Scene

_BENT, _OUTLINE, _FLOOR = (0, 114, 178), (150, 150, 150), (225, 225, 225)
_VIEWS = {"View from above": (0.0, -0.01, 1.0), "View from the side": (0.0, -1.0, 0.05)}
_FIRST = (0.5, -0.8, 0.5)


class ScenePanel:
    """Draws the testbed, and says how much its bend is exaggerated.

    Args:
        desk: of the page.
    """

    def __init__(self, desk: Desk) -> None:
        gui, self._desk, self._view = desk.gui, desk, desk.view
        desk.scene.set_up_direction("+z")
        # nothing casts one, yet three maps of them would be drawn for every frame
        desk.scene.configure_default_lights(cast_shadow=False)
        self._scale = gui.add_slider("Deflection scale", 1.0, 50.0, 1.0, 1.0)
        self._outline_wanted = gui.add_checkbox("Reference as an outline", True)
        for name, direction in _VIEWS.items():
            desk.click(gui.add_button(name), partial(self._look, direction))
        self._testbed: Testbed | None = None
        self._bent: _Drawing | None = None
        self._outline: _Drawing | None = None
        self._start = np.zeros(0)  # where it stands before the first tick
        self._reach = 10.0  # how far the testbed reaches [m]
        self._shown: tuple[Any, ...] = ()

    def refresh(self) -> None:
        """Move what has moved."""
        testbed = self._view.testbed
        if testbed is None:
            return
        if testbed is not self._testbed:
            self._build(testbed)
        position = self._view.position
        if not position.size:
            position = self._start
        state = (position.tobytes(), self._view.time, self._scale.value, self._outline_wanted.value)
        if state == self._shown or self._bent is None or self._outline is None:
            return
        self._shown = state
        model = testbed.model()
        if position.size != model.positions:
            return
        bent = position.copy()
        bent[position.size - model.modes :] *= self._scale.value
        reference = self._view.controller_state.column("reference_position")
        with self._desk.server.atomic():
            self._bent.show(bent, self._view.time)
            wanted = bool(self._outline_wanted.value) and reference.shape[1] == model.joints
            self._outline.visible(wanted and len(reference) > 0)
            if wanted and len(reference):
                pose = dict(zip(model.joint_names, reference[-1].tolist(), strict=True))
                self._outline.show(model.rest(pose), self._view.time)

    def _build(self, testbed: Testbed) -> None:
        self._testbed = testbed
        self._start = testbed.model().split(initial_state(testbed))[0]
        scene, still = testbed.scene(), testbed.model().rest({})
        lines = scene.lines(still)
        self._reach = max((float(np.abs(line).max()) for line in lines), default=3.0)
        place = self._desk.scene
        self._bent = _Drawing(place, scene, still, "/bench", _BENT)
        self._outline = _Drawing(place, scene, still, "/reference", _OUTLINE)
        _add_lines(place, "/floor", _floor(self._reach), _FLOOR, 1.0)
        camera = self._desk.server.initial_camera
        camera.position = tuple(3.0 * self._reach * np.array(_FIRST))
        camera.look_at = (0.0, 0.0, 0.0)
        self._look(_FIRST, "")

    def _look(self, direction: tuple[float, float, float], who: str) -> None:
        """Turn every page's camera."""
        for page in self._desk.server.get_clients().values():
            with suppress(ValueError):  # a page that tells nonsense of its camera
                page.camera.position = tuple(3.0 * self._reach * np.array(direction))
                page.camera.look_at = (0.0, 0.0, 0.0)


class _Drawing:
    """The frames of a scene with its rigid parts and lines, below one name."""

    def __init__(
        self, place: Any, scene: Scene, still: Vector, root: str,
        color: tuple[int, int, int],
    ) -> None:  # fmt: skip
        self._scene, self._shown = scene, True
        self._paths = {scene.frames(still)[0].parent: root}
        self._root = place.add_frame(root, show_axes=False)
        self._frames = {}
        for frame in scene.frames(still):
            path = self._paths[frame.child] = f"{self._paths[frame.parent]}/{frame.child}"
            self._frames[frame.child] = place.add_frame(path, show_axes=False)
        outline = color == _OUTLINE
        _add_links(place, scene.robot_description, self._paths, outline)
        width = 1.5 if outline else 3.0
        self._lines = [
            _add_lines(place, f"{self._paths[frame]}/line_{k}", _segments(line), color, width)
            for k, (line, frame) in enumerate(
                zip(scene.lines(still), scene.line_frames, strict=True)
            )
        ]

    def show(self, q: Vector, t: float) -> None:
        for frame in self._scene.frames_at(q, t):
            x, y, z, w = frame.rotation
            handle = self._frames[frame.child]
            handle.position, handle.wxyz = frame.translation, (w, x, y, z)
        for handle, line in zip(self._lines, self._scene.lines(q), strict=True):
            handle.points = _segments(line)

    def visible(self, wanted: bool) -> None:
        if wanted != self._shown:
            self._root.visible = self._shown = wanted


def _add_lines(
    place: Any, label: str, segments: Any, color: tuple[int, int, int], width: float
) -> Any:
    """Add lines of a width in pixels, which cost less to draw than those of a width in metres."""
    return place.add_line_segments(
        label, segments, color, thickness=width, thickness_units="screen"
    )


def _floor(reach: float) -> Any:
    """Return a square grid [m]: viser's own costs time for every dot of the plane."""
    steps = np.linspace(-2.0 * reach, 2.0 * reach, 9)
    ends = [[(s, steps[0], 0.0), (s, steps[-1], 0.0)] for s in steps]
    lines = np.array(ends, np.float32)
    return np.concatenate((lines, lines[:, :, [1, 0, 2]]))


def _segments(line: Matrix) -> Any:
    return np.stack((line[:-1], line[1:]), axis=1).astype(np.float32)


def _add_links(place: Any, description: str, frames: dict[str, str], outline: bool) -> None:
    """Draw the rigid parts of a robot description, those of an outline see-through."""
    robot = ElementTree.fromstring(description)
    at = {name: (path, np.zeros(3)) for name, path in frames.items()}
    for joint in robot.iter("joint"):
        parent, child = _name(joint, "parent"), _name(joint, "child")
        if child not in at and parent in at:
            path, origin = at[parent]
            at[child] = path, origin + _xyz(joint.find("origin"))
    for number, link in enumerate(robot.iter("link")):
        visual, name = link.find("visual"), link.get("name", "")
        if visual is None or name not in at:
            continue
        path, origin = at[name]
        shape = next(iter(visual.find("geometry") or ()), None)
        color = visual.find("material/color")
        rgba = color.get("rgba", "") if color is not None else ""
        *rgb, opacity = map(float, (rgba or "1 1 1 1").split())
        if shape is None or (outline and opacity < 1.0):
            continue
        common = {
            "position": tuple(origin + _xyz(visual.find("origin"))),
            "color": _OUTLINE if outline else tuple(round(255 * part) for part in rgb),
            "opacity": 0.25 if outline else opacity,
            "cast_shadow": False,
        }
        label = f"{path}/part_{number}"
        if shape.tag == "box":
            size = tuple(map(float, shape.get("size", "1 1 1").split()))
            place.add_box(label, dimensions=size, **common)
        elif shape.tag == "cylinder":
            radius, height = float(shape.get("radius", 1)), float(shape.get("length", 1))
            place.add_cylinder(label, radius=radius, height=height, **common)
        else:
            place.add_icosphere(label, radius=float(shape.get("radius", 1)), **common)


def _name(joint: ElementTree.Element, end: str) -> str:
    found = joint.find(end)
    return found.get("link", "") if found is not None else ""


def _xyz(origin: ElementTree.Element | None) -> Vector:
    text = origin.get("xyz", "0 0 0") if origin is not None else "0 0 0"
    return np.array([float(part) for part in text.split()])
