"""An attitude estimator whose instruments read the true attitude and errors of their own."""

from dataclasses import dataclass, field

from flexslew_control.estimators.attitude_estimator import AttitudeEstimator
from flexslew_control.estimators.instrument_readings import InstrumentSimulator, with_sensors
from flexslew_plant.arrays import EMPTY, Vector
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds.instruments.instrument import channels
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
