"""The parameters of the plant that may change at run time."""

from time import monotonic
from typing import TYPE_CHECKING, Any

from flexslew_plant.errors import BadInput
from flexslew_plant.ros.parameters import serve_changes
from flexslew_plant.ros.plant.settings import PlantSettings
from flexslew_plant.settings import validated

if TYPE_CHECKING:
    from flexslew_plant.ros.plant_node import Plant

CHANGEABLE = ("rate_factor", "display_rate")


class PlantParameters:
    """Passes changes on.

    Args:
        plant: whose parameters they are.
    """

    def __init__(self, plant: "Plant") -> None:
        self._plant = plant
        serve_changes(plant.node, self._change)

    def _change(self, changes: dict[str, Any]) -> str:
        """Take parameters in flight; return why not, or an empty text."""
        try:
            validated(PlantSettings, changes, f"node {self._plant.node.get_name()}")
        except BadInput as error:
            return str(error)
        rate = changes.get("rate_factor", self._plant.session.pacing.rate_factor)
        if rate != self._plant.session.pacing.rate_factor:
            reply = self._plant.session.set_rate(rate, monotonic(), "a ROS parameter")
            if not reply.ok:
                return reply.message
        if "display_rate" in changes:
            self._plant.display.set_rate(changes["display_rate"])
        self._plant.loop.hurry()
        return ""
