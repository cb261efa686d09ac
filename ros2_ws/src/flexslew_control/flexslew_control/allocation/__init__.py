"""Allocation of a law's torque to the efforts of thrusters, wheels and gyros.

Offers: joint_gains, sharing.
"""

from flexslew_control.allocation.allocated_law import AllocationLaw as AllocationLaw
from flexslew_control.allocation.allocation import Allocation as Allocation
from flexslew_control.allocation.allocation import Allocator as Allocator
from flexslew_control.allocation.allocation import AnyAllocation as AnyAllocation
from flexslew_control.allocation.allocation import GyroAllocation as GyroAllocation
from flexslew_control.allocation.allocation import ThrusterAllocation as ThrusterAllocation
from flexslew_control.allocation.allocation import WheelAllocation as WheelAllocation
from flexslew_control.allocation.allocation import allocator_of as allocator_of
from flexslew_control.allocation.joint_gains import joint_gains as joint_gains
