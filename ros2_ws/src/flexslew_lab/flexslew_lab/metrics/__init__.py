"""The metrics of a run. A new one is a file that ends in its entry, and a line here.

One of your own: a class that fulfils `metric.Metric`, named in the trial as `metrics:
[my_metric.py:MyMetric]`, or offered by an installed package as an entry point of the group
flexslew.metrics.

Offers: course, efforts, epoch, from_bag, goal, joint_errors, metric, operator_changes, own,
platform.keep_out, rows, settling, takeovers, tip_deflection, trajectory.
"""

from flexslew_lab.metrics.metric import Key as Key
from flexslew_lab.metrics.metric import Metric as Metric
from flexslew_lab.metrics.metric import MetricEntry as MetricEntry
from flexslew_plant.entries import table

# the metrics, a line each, in the order of metrics.json
# isort: off
from flexslew_lab.metrics.tip_deflection import TIP_DEFLECTION as TIP_DEFLECTION
from flexslew_lab.metrics.joint_errors import JOINT_ERRORS as JOINT_ERRORS
from flexslew_lab.metrics.settling import SETTLING as SETTLING
from flexslew_lab.metrics.efforts import EFFORTS as EFFORTS
from flexslew_lab.metrics.takeovers import TAKEOVERS as TAKEOVERS
from flexslew_lab.metrics.operator_changes import OPERATOR_CHANGES as OPERATOR_CHANGES
from flexslew_lab.metrics.course import COURSE as COURSE
from flexslew_lab.metrics.trajectory import TRAJECTORY as TRAJECTORY
from flexslew_lab.metrics.plant_timing import PLANT_TIMING as PLANT_TIMING
from flexslew_lab.metrics.platform.pointing import POINTING as POINTING  # after those by appendage
from flexslew_lab.metrics.platform.platform_error import PLATFORM_ERROR as PLATFORM_ERROR
from flexslew_lab.metrics.platform.performance_errors import (
    PERFORMANCE_ERRORS as PERFORMANCE_ERRORS,
)
from flexslew_lab.metrics.platform.jitter import JITTER as JITTER
from flexslew_lab.metrics.momentum import MOMENTUM as MOMENTUM
from flexslew_lab.metrics.platform.line_of_sight import LINE_OF_SIGHT as LINE_OF_SIGHT
from flexslew_lab.metrics.platform.keep_out import KEEP_OUT as KEEP_OUT
from flexslew_lab.metrics.vibration import VIBRATION as VIBRATION
# isort: on

METRICS: dict[str, MetricEntry] = table(globals(), MetricEntry)

GROUPS: dict[str, str] = {  # heading of each key
    key: entry.group for entry in METRICS.values() for key in entry.metric.KEYS
}
KEYS: dict[str, Key] = {  # of metrics.json
    key: definition for entry in METRICS.values() for key, definition in entry.metric.KEYS.items()
}
