"""Where in the flat array of a group of members everything stands, row after row.

One array holds it all: the offsets are constants of the compiler, which then knows what does not
overlap, and loops over members become vector instructions without a look.
"""

from typing import NamedTuple

from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH


class Sizes(NamedTuple):
    """What the compiler builds in."""

    joints: int
    modes: int
    outputs: int  # that the law reads: joints, rates, the first of the tips
    appendages: int
    measured: int  # the first of them: the others bend as one of these, to either side
    axes: int  # that the law has efforts for: joints, or body axes
    quadratic: bool  # the law has products of rates
    shared: bool  # its torque is shared out among the joints' drives
    has_pulse: bool  # drives are on or off
    has_slew_rate: bool  # torques of motors ramp
    lagged: bool  # torques of motors lag
    discrete_effort: bool  # they are multiples of a quantum
    quantised: bool  # readings are
    needs_previous: bool  # observers ask for the readings of the tick before, and for demands
    checks_joints: bool  # joint readings are compared
    monitored: int  # innovations that a monitor tests
    taken: bool  # the law took over from another one
    has_faults: bool  # there are faults
    per_member: bool  # each member has disturbances of its own
    wheel_rates: tuple[
        int, ...
    ]  # entries of the state with the speed of each joint's wheel; -1: none

    recorded: bool  # the truth is, and measured afterwards
    reads_attitude: bool  # the joints do
    has_instruments: bool

    @property
    def doubtful(self) -> bool:
        """Whether a last digit may turn into a whole quantum, a pulse, or a finding."""
        return (
            self.quantised
            or self.discrete_effort
            or self.has_pulse
            or self.checks_joints
            or self.monitored > 0
        )


class Rows(NamedTuple):
    """Where each begins, behind what the kernel placed."""

    applied: int  # effort of the drives
    own: int  # demand of the law within their limits
    request: int  # demand that faults may hold
    reading: int  # of this tick
    previous: int  # reading of the one before
    seen: int  # what a law on body axes takes for its joints, then rates
    demand: int  # torque that it demands
    products: int  # of rates
    held: int  # efforts that were applied when it took over
    offset: int  # of them from its own, which is blended out
    residual_impulse: int  # impulse that drives owe which are on or off
    ramp: int  # torque of motors at the end of the last tick
    torque: int  # the same behind their lag
    integral: int
    kp: int
    ki: int
    kd: int
    tip: int  # share of each mode in each tip
    goal: int
    sign: int  # of the displacement
    band: int  # of settling
    law_limit: int  # of the law itself
    limit: int  # of the drives
    least: int  # effort of the drives
    pulse: int  # impulse of their shortest pulse
    motor: int  # quantum, slew rate, lag, rise, mean rise; see motor_step.MotorNumbers
    spin: int  # inertia over a tick of each joint's wheel, then its largest speed
    bias: int  # of each reading
    quantum: int  # of each reading; 0: none
    doubt: int  # 1: something was too near to an edge, see readings; 2: see judge and watch
    squares: int  # of innovations over their variances, added up in a window
    deflection: int  # a tip's deflection at this tick
    full: int  # last time at which a drive was at its limit
    residual_tip: int  # from here on: what the metrics accumulate, see flexslew_lab/metrics
    residual: int
    limit_excess: int
    outside: int  # last time outside of the band
    peak_tip: int
    terminal: int
    peak_effort: int
    square_sum: int
    saturated: int
    tip_rate: int  # what each mode's rate adds to each tip's reading
    end: int


def rows_of(kernel_size: int, sizes: Sizes) -> Rows:
    """Return where everything begins in the array of such a group."""
    m, read, tip, n = sizes.joints, sizes.outputs, sizes.appendages * sizes.modes, sizes.axes
    seen, products, taken = n * sizes.shared, n * n * sizes.quadratic, m * sizes.taken
    law = (read, read, 2 * seen, seen, products, taken, taken, m, m, m, n, n, n, n)  # to kd
    check_rows = read * sizes.quantised, int(sizes.doubtful), sizes.monitored
    drives = (tip, m, m, m, n, m, m, m, 5, 2 * m, read, *check_rows)  # to squares
    measured = (1, 1, 1, m, m, m, 1, 1, m, m, 1)  # to saturated
    counts = (m, m, m * sizes.has_faults, *law, *drives, *measured, tip)
    return Rows(*(kernel_size + BATCH_WIDTH * sum(counts[:k]) for k in range(len(counts) + 1)))
