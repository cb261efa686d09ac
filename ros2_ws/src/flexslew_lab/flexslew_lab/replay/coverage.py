"""The part of a run that its log holds: a comparison does not cover the rest."""

from flexslew_lab.log.bag_layout import RUN_RECORD
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.trial.trial import Trial
from flexslew_plant.counted import count_text
from flexslew_plant.events import PlantLost, RunFinished, RunStopped, StateLost

_ENDS = (RunFinished, RunStopped, StateLost, PlantLost)  # with which the plant ends


def missing_part(bag: BagReader, trial: Trial, first: int, last: int, missing_ticks: int) -> str:
    """Return what of the run could not be compared, in words; empty where the log holds all of it.

    Args:
        bag: the log.
        trial: that it was recorded from.
        first: tick of the last epoch with which the comparison began.
        last: tick with which it ended.
        missing_ticks: how many ticks in between the log does not hold.
    """
    overview = bag.overview
    why = []
    if overview.cut is not None:
        why.append(f"the log is cut at byte {overview.cut.offset}")
    if missing_ticks:
        why.append(
            f"{count_text(missing_ticks, 'tick')} in between "
            f"{'is' if missing_ticks == 1 else 'are'} missing"
        )
    if first > 0:
        why.append(f"the log begins at tick {first}")
    has_end = any(isinstance(event.what, _ENDS) for event in overview.events)
    recorded = overview.metadata.get(RUN_RECORD, {})
    if overview.cut is None and not has_end and ("recovered" in recorded or not recorded):
        why.append("the log does not hold the end of the run")
    if not why:
        return ""
    ticks = round(trial.duration / trial.period)
    return f"ticks {first} to {last} of {ticks} compared: {', '.join(why)}"
