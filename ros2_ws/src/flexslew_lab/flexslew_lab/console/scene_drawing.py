"""The testbed in a browser: in three dimensions, or flat where there is no WebGL."""

from typing import Any

import numpy as np
from nicegui import ui

from flexslew_lab.console.picture import AUTOMATIC, SOLID, BodyGeometry, SceneState, Shape

_BODY_COLOR, _REFERENCE_COLOR = "#0072b2", "#969696"
_Y_TO_Z = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # y to z: of a cylinder
_DOTS = 160  # along each line


class SceneWidget:
    """A place that shows a picture; flat until the browser has reported that it can do more.

    Attributes:
        able: 0: the browser has no WebGL; 1: its processor draws, which slows a bench on the same
            machine, so that three dimensions need a request; 2: it has a graphics card.
    """

    def __init__(self) -> None:
        self._place = ui.element("div").classes("bench-scene")
        self._place.props["aria-label"] = "testbed"
        self.render_support = 0
        self._flat: Any = None
        self._scene: Any = None
        self._shapes: tuple[Shape, ...] = ()
        self._parts: list[list[Any]] = [[], []]  # of the testbed, of its outline
        self._lines: list[list[Any]] = [[], []]
        self._view_number = 0
        self._use(False)

    def _use(self, webgl: bool) -> None:
        """Draw in three dimensions, or flat."""
        self._place.clear()
        self._flat = self._scene = None
        self._shapes = ()
        with self._place:
            if webgl:
                self._scene = ui.scene(
                    width=600, height=300, grid=(40, 20), background_color="#f8f8f8", fps=15
                )
            else:
                self._flat = ui.html("", sanitize=False)

    def show(self, scene_state: SceneState | None) -> None:
        """Move what has moved."""
        if scene_state is None:
            return
        webgl = self.render_support > {AUTOMATIC: 1, SOLID: 0}.get(scene_state.view_mode, 2)
        if webgl != (self._scene is not None):
            self._use(webgl)
        if self._flat is not None:
            self._flat.set_content(scene_state.flat)
            return
        if scene_state.shapes is not self._shapes:
            self._build(scene_state)
        for k, body in enumerate((scene_state.deflection, scene_state.reference_body)):
            self._move(k, body, scene_state)
        if scene_state.look != self._view_number:
            self._view_number = scene_state.look
            self._set_view(scene_state)

    def delete(self) -> None:
        """Take it off the page."""
        self._place.delete()

    def _build(self, scene_state: SceneState) -> None:
        self._shapes = scene_state.shapes
        self._scene.clear()
        size = scene_state.reach / 40.0
        with self._scene:
            for k, color in enumerate((_BODY_COLOR, _REFERENCE_COLOR)):
                self._parts[k] = [_part(self._scene, one, bool(k)) for one in scene_state.shapes]
                self._lines[k] = [
                    self._scene.point_cloud([[0.0, 0.0, 0.0]], None, size).material(color)
                    for _ in scene_state.deflection.lines
                ]
        self._set_view(scene_state)

    def _move(self, k: int, body: BodyGeometry | None, scene_state: SceneState) -> None:
        for part in self._parts[k] + self._lines[k]:
            part.visible(body is not None)
        if body is None:
            return
        for part, shape in zip(self._parts[k], scene_state.shapes, strict=True):
            rotation, at = body.poses[shape.frame]
            x, y, z = (float(v) for v in at + rotation @ shape.origin)
            part.move(x, y, z)
            whole = rotation @ _Y_TO_Z if shape.kind == "cylinder" else rotation
            part.rotate_R(np.round(whole, 6).tolist())
        for cloud, line in zip(self._lines[k], body.lines, strict=True):
            points = np.round(_dotted(line), 4).tolist()
            if points != cloud.args[0]:
                cloud.set_points(points)

    def _set_view(self, scene_state: SceneState) -> None:
        x, y, z = (float(2.0 * scene_state.reach * part) for part in scene_state.direction)
        self._scene.move_camera(x, y, z, 0.0, 0.0, 0.0, duration=0.0)


def _part(scene: Any, shape: Shape, is_reference: bool) -> Any:
    if shape.kind == "box":
        found = scene.box(*shape.size)
    elif shape.kind == "cylinder":
        radius, height = shape.size
        found = scene.cylinder(radius, radius, height)
    else:
        found = scene.sphere(shape.size[0])
    return found.material(
        _REFERENCE_COLOR if is_reference else shape.color, 0.25 if is_reference else shape.opacity
    )


def _dotted(line: Any) -> Any:
    """Return points along a line so close that they look like one."""
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))))
    at = np.linspace(0.0, along[-1], _DOTS)
    return np.column_stack([np.interp(at, along, line[:, k]) for k in range(3)])
