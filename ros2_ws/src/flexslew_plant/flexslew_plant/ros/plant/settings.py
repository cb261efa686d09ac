"""The parameters of the plant node."""

from flexslew_plant.bench.records import BenchSettings, RateSettings
from flexslew_plant.settings import section


@section
class PlantSettings(RateSettings):
    """What the node is given at its start."""

    bench: BenchSettings = BenchSettings()  # what determines the trajectory
    controllers: tuple[str, ...] = ()  # must be ready before tick 0, besides the one in charge
    wait_for: tuple[str, ...] = ()  # recorders: nodes that must hear everything from tick 0 on
    autostart: bool = True  # start when all are there; else the service does
    exit_when_done: bool = False  # end the process after the last tick
    truth: bool = True  # publish the true state every tick
    progress: bool = False  # print the tick twice per wall second, for whoever started it
