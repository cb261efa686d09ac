"""The parameters of the planner node."""

from flexslew_control.law import ActiveLaw
from flexslew_plant.settings import section
from flexslew_plant.yaml_data import load_yaml


@section
class PlannerSettings:
    """The parameters of the node."""

    law: str = ""  # of the controller that flies `plan`, until its status comes; empty: wait for it
    law_settings: str = ""  # its section as YAML
    plan: str = ""  # `plan` section as YAML: planned as soon as the testbed is known; empty: none
    file: str = ""  # a saved plan to publish instead; empty: none
    # text of an identified.yaml: what plans believe that name no model; may be set while paused
    model: str = ""
    # keys of input_shaping as YAML, with which trajectories of the topic and the action are shaped;
    # empty: they are flown as they are; may be set at any time
    shaping: str = ""
    exit_with_plant: bool = False  # end the process when the plant is gone
    trust: tuple[str, ...] = ()  # classes of your own that testbed and requests may name

    def first_law(self) -> ActiveLaw | None:
        """Return the law of the controller that flies the plan; None: its status reports it.

        Raises:
            BadInput: its section is not YAML.
        """
        settings = load_yaml(self.law_settings, "law_settings") or {}
        return ActiveLaw(self.law, settings) if self.law else None
