"""The parameters of the controller node."""

from flexslew_control.controllers import DEFAULT
from flexslew_plant.settings import section


@section
class ControllerNodeSettings:
    """The parameters of the node; those of the law are added to them."""

    law: str = DEFAULT  # a key of CONTROLLERS, or package.module.Class of your own
    requires_plan: bool = False  # not ready without a plan
    wait_for: tuple[str, ...] = ()  # nodes that must receive all it publishes before it is ready
    exit_with_plant: bool = False  # end the process when the plant is gone
    trust: tuple[str, ...] = ()  # classes of your own that testbed and requests may name
