"""By which way a trial of a study was flown: in a batch, or by the bench and why."""

from enum import StrEnum


class Way(StrEnum):
    """How a trial was flown, as its row in the table has it."""

    BATCH = "batch"
    BENCH = "bench"  # batches were not requested
    NOT_ALLOWED = "bench: refused"  # with the reason of the refusal
    METRICS = "bench: a metric of its own raises"
    EDGE = "bench: a value at the edge of a quantum or a pulse"
    ROUNDING = "bench: a motion that magnifies rounding between quanta"
    SCHEDULE = "bench: a switch at the start, or one that is not answered"
    BRAKE = "bench: a switch out of the brake"
    NAN = "bench: a filter that restarts after sensors that read NaN"
    MONITORED = "bench: sensors or an estimate that are looked at"
    SWITCH = "bench: a switch to a law with a memory of its own"
    NO_PLAN = "bench: no plan for a filter about one"
    BLACK_BOX = "bench: a testbed without equations"
    JOINTS = "bench: joints that are read in another way"
    EFFORTS = "bench: efforts that are no joints'"
    FAULT = "bench: a fault that batches do not know"
    SENSOR = "bench: a sensor that batches do not know"
    LAW = "bench: a law that is not linear"
    SETTINGS = "bench: a law that is not linear with these settings"
    TIPS = "bench: a law that reads instruments or rates of tips"
    ATTITUDE = "bench: a filter of joints that are no coordinates"
    ALONG = "bench: a filter about the plan that each law has for itself"
    FAR = "bench: a state without bounds"
