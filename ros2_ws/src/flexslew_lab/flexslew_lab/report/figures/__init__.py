"""The figures of a report: groups of panels from what `read_run` thinned, for any testbed."""

from flexslew_lab.report.figures.controller import effort_terms as effort_terms
from flexslew_lab.report.figures.controller import estimation as estimation
from flexslew_lab.report.figures.course import feedforward_comparison as feedforward_comparison
from flexslew_lab.report.figures.course import manoeuvre as manoeuvre
from flexslew_lab.report.figures.course import plan_profile as plan_profile
from flexslew_lab.report.figures.momentum import jitter as jitter
from flexslew_lab.report.figures.momentum import momentum as momentum
from flexslew_lab.report.figures.pointing import platform as platform
from flexslew_lab.report.figures.vibration import modes as modes
from flexslew_lab.report.figures.vibration import residual as residual
