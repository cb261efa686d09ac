"""The testbed: bent as it is, with the reference as an outline."""

from functools import partial
from typing import Any

import numpy as np

from flexslew_lab.console.desk import Desk
from flexslew_lab.console.picture import DRAWINGS, Picture, Shape, body, shapes_of
from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds import Testbed, initial_state
from flexslew_plant.testbeds.scene import Scene

_VIEWS = {"View from above": (0.0, -0.01, 1.0), "View from the side": (0.0, -1.0, 0.05)}
_FIRST = (0.5, -0.8, 0.5)


class ScenePanel:
    """Draws the testbed, and shows by which factor its deflection is exaggerated.

    Args:
        desk: desk of the page.
    """

    def __init__(self, desk: Desk) -> None:
        gui, self._view = desk.gui, desk.view
        self._scale = gui.slider("Deflection scale", 1.0, 50.0, 1.0, 1.0)
        self._outline_box = gui.check("Reference as an outline", True)
        self._drawing = gui.choice("Drawing", DRAWINGS)
        for name, direction in _VIEWS.items():
            desk.click(gui.button(name), partial(self._turn, direction))
        with gui.middle:
            self._drawn = gui.add("scene", "testbed")
        self._testbed: Testbed | None = None
        self._scene: Scene | None = None
        self._shapes: tuple[Shape, ...] = ()
        self._start = np.zeros(0)  # where it stands before the first tick
        self._reach = 3.0  # how far the testbed reaches [m]
        self._look, self._direction = 0, _FIRST
        self._shown: tuple[Any, ...] = ()

    def refresh(self) -> None:
        """Move what has moved."""
        testbed = self._view.testbed
        if testbed is None:
            return
        if testbed is not self._testbed or self._scene is None:
            self._scene = self._build(testbed)
        begun = self._view.position.size > 0
        position = self._view.position if begun else self._start
        outlined = bool(self._outline_box.value)
        chosen = self._scale.value, outlined, self._look, self._drawing.value
        state = (position.tobytes(), self._view.time, *chosen)
        model = testbed.model()
        if state == self._shown or position.size != model.positions:
            return
        self._shown = state
        bent: Vector = position.copy()
        bent[position.size - model.modes :] *= self._scale.value
        reference = self._view.controller_state.column("reference_position")
        outline = None
        if outlined and begun and len(reference) and reference.shape[1] == model.joints:
            pose = dict(zip(model.joint_names, reference[-1].tolist(), strict=True))
            outline = body(self._scene, model.rest(pose), self._view.time)
        self._drawn.data = Picture(
            self._shapes, body(self._scene, bent, self._view.time), outline, self._reach,
            self._look, self._direction, self._drawing.value,
        )  # fmt: skip

    def _build(self, testbed: Testbed) -> Scene:
        self._testbed = testbed
        self._start = testbed.model().split(initial_state(testbed))[0]
        scene, still = testbed.scene(), testbed.model().rest({})
        lines = body(scene, still, 0.0).lines
        self._reach = max((float(np.abs(line).max()) for line in lines), default=3.0)
        frames = scene.frames(still)
        names = [frames[0].parent, *(frame.child for frame in frames)]
        self._shapes = shapes_of(scene.robot_description, names)
        return scene

    def _turn(self, direction: tuple[float, float, float], who: str) -> None:
        """Look from there on every page."""
        self._look, self._direction = self._look + 1, direction
