"""A law of your own: PD about the plan. See docs/own_controller.md."""


class MyLaw:
    """u = u_ff + kp (q_d - q) + kd (q_d' - q')."""

    def __init__(self, settings, period, effort_limit):
        self.kp, self.kd = settings.get("kp", 460.0), settings.get("kd", 920.0)

    def update(self, measurement, estimate, reference):
        """Return the efforts, one per joint [N m]."""
        position_error = reference.position - measurement.joint_position
        velocity_error = reference.velocity - measurement.joint_velocity
        return reference.effort + self.kp * position_error + self.kd * velocity_error
