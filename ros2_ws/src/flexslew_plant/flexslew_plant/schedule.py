"""The `schedule` section: what happens to the bench at which simulated time."""

from typing import TypeAlias

from pydantic import model_validator

from flexslew_plant.settings import NonNegative, section


@section
class ScheduleEntry:
    """One entry: a switch at a time, or a disturbance from a time to another."""

    at: NonNegative  # [s]
    until: NonNegative | None = None  # end of a disturbance [s]; None: to the end of the run
    switch: str | None = None  # controller to hand the bench to
    disturbance: dict[str, float] | None = None  # effort on joints by name [N m or N]

    @model_validator(mode="after")
    def _one_thing(self) -> "ScheduleEntry":
        if (self.switch is None) == (self.disturbance is None):
            raise ValueError("give exactly one of switch, disturbance")
        if self.switch is not None and self.until is not None:
            raise ValueError("until goes with a disturbance, not with a switch")
        if self.until is not None and self.until <= self.at:
            raise ValueError("until must be later than at")
        return self


Schedule: TypeAlias = tuple[ScheduleEntry, ...]
