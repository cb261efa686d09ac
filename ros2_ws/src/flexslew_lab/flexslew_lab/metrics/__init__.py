"""The metrics of a run. A new one is a class in a file, and a line here.

One of your own: a class that fulfils `metric.Metric`, named in the trial as `metrics:
[my_metric.py:MyMetric]`, or offered by an installed package as an entry point of the group
flexslew.metrics.
"""

from flexslew_lab.metrics.course import Course
from flexslew_lab.metrics.efforts import Efforts
from flexslew_lab.metrics.joint_errors import JointErrors
from flexslew_lab.metrics.line_of_sight import LineOfSight
from flexslew_lab.metrics.metric import Key as Key
from flexslew_lab.metrics.metric import Metric as Metric
from flexslew_lab.metrics.platform_error import PlatformError
from flexslew_lab.metrics.pointing import Pointing
from flexslew_lab.metrics.settling import Settling
from flexslew_lab.metrics.takeovers import Takeovers
from flexslew_lab.metrics.tip_deflection import TipDeflection
from flexslew_lab.metrics.trajectory import Trajectory
from flexslew_lab.metrics.vibration import Vibration

METRICS: dict[str, type[Metric]] = {
    "tip_deflection": TipDeflection,
    "joint_errors": JointErrors,
    "settling": Settling,
    "efforts": Efforts,
    "takeovers": Takeovers,
    "course": Course,
    "trajectory": Trajectory,
    "pointing": Pointing,  # after what it says by appendage
    "platform_error": PlatformError,
    "line_of_sight": LineOfSight,
    "vibration": Vibration,
}

KEYS: dict[str, Key] = {  # of metrics.json
    key: told for metric in METRICS.values() for key, told in metric.KEYS.items()
}
