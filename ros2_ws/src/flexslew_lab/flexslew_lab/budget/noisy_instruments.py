"""An attitude estimator whose instruments read the true attitude and errors of their own."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from flexslew_control.analysis.lti import Lti
from flexslew_control.estimators.attitude_estimator import AttitudeEstimator
from flexslew_control.estimators.instrument_readings import InstrumentSimulator, with_sensors
from flexslew_plant.arrays import EMPTY, Vector
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds.instruments.instrument import Instrument, channels
from flexslew_plant.testbeds.orientation.attitude import product, quaternion


@dataclass
class NoisyInstruments(InstrumentSimulator):
    """An InstrumentSimulator with errors: its channels of a measurement less those at the reset.

    Errors of a gyro are rates [rad/s], those of a star tracker small turns in body axes [rad], in
    the first three of its channels; those of other instruments are left out.
    """

    _rest: Vector = field(init=False, default_factory=lambda: EMPTY)

    @classmethod
    def of(cls, estimator: AttitudeEstimator) -> "NoisyInstruments":
        """Return it for an estimator."""
        return cls(with_sensors(estimator).inner)

    def with_errors_alone(self, plant: Lti, tips: Sequence[str]) -> Lti:
        """Return a plant whose instruments show their errors alone, as this makes the readings.

        Args:
            plant: with a signal `tip.NAME` of each channel.
            tips: names of the channels of tips.
        """
        it = self.inner
        sensors: list[Instrument] = [it.gyro, *it.trackers, *it.sun_sensors]
        c = plant.c.copy()
        for sensor in sensors:
            for name in tips[channels(sensor)]:
                c[plant.outputs.index(f"tip.{name}")] = 0.0
        return replace(plant, c=c)

    def reset(self, measurement: Measurement) -> None:
        """Start at the attitude of this measurement, at rest and without errors."""
        self._rest = measurement.tip_deflection.copy()
        super().reset(measurement)

    def _read(self, measurement: Measurement) -> Measurement:
        found, error = super()._read(measurement), measurement.tip_deflection - self._rest
        tips = found.tip_deflection
        tips[channels(self.inner.gyro)] += error[channels(self.inner.gyro)]
        for tracker in self.inner.trackers:
            turn = error[channels(tracker)][:3]
            if turn.any():
                tips[channels(tracker)] = product(tips[channels(tracker)], quaternion(turn))
        return found
