"""A bench that answers everything with yes and notes what it was asked."""

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

from flexslew_lab.console.link import Iterate, PlanCallback, RequestResult, Then
from flexslew_lab.console.view import BenchView, ControllerView, Joints

JOINTS = Joints("two", ("a", "b"), ("rad", "m"), ("tip",), (150.0, 20.0), 0.01)
SETTINGS = "{kp: [460.0, 460.0], kd: [920.0, 920.0], handover_time: 1.0, computed: {}}"
DRAFT = SimpleNamespace(
    hash="d" * 64, method="reference_only", joint_names=["a", "b"], start=12.0, period=0.01,
    position=[0.0, 0.0, 0.5, 0.1], effort=[3.0, -4.0], request="{}",
    summary="{predicted_residual_tip_deflection: 0.0037}",
)  # fmt: skip


class FakeLink:
    """A console.link.Link."""

    replay = False

    def __init__(self, folder: str = "") -> None:
        self.view, self.folder, self.command = BenchView(), folder, "./flexslew trial"
        self.view.joints = JOINTS
        self.view.controllers["pd"] = ControllerView("pd", "pd_feedforward", True, "", SETTINGS)
        self.request: list[tuple[str, dict[str, Any]]] = []
        self.measures = False

    def poll(self, now: float) -> None:
        """Nothing comes."""

    def ask(self, service: str, values: Mapping[str, Any], then: Then) -> None:
        self.request.append((service, dict(values)))
        then(RequestResult(True, "done"))

    def draft(
        self, request: str, who: str, told: Callable[[Iterate], None], then: PlanCallback
    ) -> None:
        self.request.append(("draft_plan", {"request": request, "who": who}))
        told(Iterate(1, 0.5, 1e-3, 2.0))
        then(RequestResult(True, "drafted"), DRAFT)

    def cancel(self) -> None:
        self.request.append(("cancel", {}))

    def measure(self, on: bool) -> None:
        self.measures = on
