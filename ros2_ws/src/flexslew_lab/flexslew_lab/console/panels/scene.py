"""The testbed: bent as it is, with the reference as an outline."""

from functools import partial
from typing import Any

import numpy as np

from flexslew_lab.console.desk import PanelContext
from flexslew_lab.console.picture import VIEW_MODES, SceneState, Shape, body, shapes_of
from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds import Testbed, initial_state
from flexslew_plant.testbeds.scene import Scene

_VIEW_AXES = {"View from above": (0.0, -0.01, 1.0), "View from the side": (0.0, -1.0, 0.05)}
_FIRST = (0.5, -0.8, 0.5)


class ScenePanel:
    """Draws the testbed, and shows by which factor its deflection is exaggerated.

    Args:
        context: desk of the page.
    """

    def __init__(self, context: PanelContext) -> None:
        gui, self._view = context.gui, context.view
        self._scale = gui.slider("Deflection scale", 1.0, 50.0, 1.0, 1.0)
        self._reference_box = gui.check("Reference as an outline", True)
        self._view_mode = gui.choice("Drawing", VIEW_MODES)
        for name, direction in _VIEW_AXES.items():
            context.click(gui.button(name), partial(self._set_view, direction))
        with gui.middle:
            self._scene_element = gui.add("scene", "testbed")
        self._testbed: Testbed | None = None
        self._scene: Scene | None = None
        self._shapes: tuple[Shape, ...] = ()
        self._start = np.zeros(0)  # where it stands before the first tick
        self._reach = 3.0  # how far the testbed reaches [m]
        self._view_number, self._direction = 0, _FIRST
        self._last_state: tuple[Any, ...] = ()

    def refresh(self) -> None:
        """Move what has moved."""
        testbed = self._view.testbed
        if testbed is None:
            return
        if testbed is not self._testbed or self._scene is None:
            self._scene = self._build(testbed)
        has_data = self._view.position.size > 0
        position = self._view.position if has_data else self._start
        show_reference = bool(self._reference_box.value)
        view_options = self._scale.value, show_reference, self._view_number, self._view_mode.value
        state = (position.tobytes(), self._view.time, *view_options)
        model = testbed.model()
        if state == self._last_state or position.size != model.positions:
            return
        self._last_state = state
        scaled_position: Vector = position.copy()
        scaled_position[position.size - model.modes :] *= self._scale.value
        reference = self._view.controller_state.column("reference_position")
        reference_body = None
        if show_reference and has_data and len(reference) and reference.shape[1] == model.joints:
            pose = dict(zip(model.joint_names, reference[-1].tolist(), strict=True))
            reference_body = body(self._scene, model.rest(pose), self._view.time)
        self._scene_element.data = SceneState(
            self._shapes, body(self._scene, scaled_position, self._view.time), reference_body,
            self._reach,
            self._view_number, self._direction, self._view_mode.value,
        )  # fmt: skip

    def _build(self, testbed: Testbed) -> Scene:
        self._testbed = testbed
        self._start = testbed.model().split(initial_state(testbed))[0]
        scene, rest_position = testbed.scene(), testbed.model().rest({})
        lines = body(scene, rest_position, 0.0).lines
        self._reach = max((float(np.abs(line).max()) for line in lines), default=3.0)
        frames = scene.frames(rest_position)
        names = [frames[0].parent, *(frame.child for frame in frames)]
        self._shapes = shapes_of(scene.robot_description, names)
        return scene

    def _set_view(self, direction: tuple[float, float, float], who: str) -> None:
        """Look from there on every page."""
        self._view_number, self._direction = self._view_number + 1, direction
