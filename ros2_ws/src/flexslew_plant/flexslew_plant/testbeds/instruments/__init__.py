"""Sensors with a memory of their own: attitude, rates, wheels, gimbals, the Sun."""

from flexslew_plant.testbeds.instruments.gyro import Gyro as Gyro
from flexslew_plant.testbeds.instruments.gyro import GyroSettings as GyroSettings
from flexslew_plant.testbeds.instruments.instrument import BodyState as BodyState
from flexslew_plant.testbeds.instruments.instrument import Instrument as Instrument
from flexslew_plant.testbeds.instruments.instrument import Reader as Reader
from flexslew_plant.testbeds.instruments.instrument import channels as channels
from flexslew_plant.testbeds.instruments.rotor_sensors import Resolver as Resolver
from flexslew_plant.testbeds.instruments.rotor_sensors import ResolverSettings as ResolverSettings
from flexslew_plant.testbeds.instruments.rotor_sensors import Tachometer as Tachometer
from flexslew_plant.testbeds.instruments.rotor_sensors import (
    TachometerSettings as TachometerSettings,
)
from flexslew_plant.testbeds.instruments.star_tracker import StarTracker as StarTracker
from flexslew_plant.testbeds.instruments.star_tracker import (
    StarTrackerSettings as StarTrackerSettings,
)
from flexslew_plant.testbeds.instruments.sun_sensor import SunSensor as SunSensor
from flexslew_plant.testbeds.instruments.sun_sensor import SunSensorSettings as SunSensorSettings
