"""The parameters of the plant node."""

from flexslew_plant.bench.records import BenchSettings
from flexslew_plant.settings import NonNegative, Positive, section


@section
class PlantSettings:
    """What the node is given at its start."""

    bench: BenchSettings = BenchSettings()
    rate_factor: NonNegative = 0.0  # 0: as fast as possible, 1: real time
    answer_timeout: Positive = 2.0  # silence that counts as missed ticks, not paced [wall s]
    controllers: tuple[str, ...] = ()  # must be ready before tick 0, besides the one in charge
    wait_for: tuple[str, ...] = ()  # recorders: nodes that must hear everything from tick 0 on
    autostart: bool = True  # start when all are there; else the service does
    exit_when_done: bool = False  # end the process after the last tick
    truth: bool = True  # publish the true state every tick
    progress: bool = False  # print the tick twice per wall second, for whoever started it
    display_rate: NonNegative = 50.0  # joint states, tf, markers, clock [1/simulated s]; 0: none
