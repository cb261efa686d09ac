"""The layout of a packed spacecraft: one float64 vector that the kernels read.

State x = [q, v]:
    q = (R (3), quaternion x y z w (4), driven hinges, wheels, gimbals, modes),
    v = (V (3), w (3), rates of driven hinges, of wheels, angles of gimbals, rates of modes).
R and the attitude are in inertial space, V and w along body axes. A held platform has none of
them; a pivoted one has its angle and rate instead. A gimbal of a control moment gyro turns at
once as fast as demanded, so its angle is a state of first order: it stands in v, and its
integral, which nothing reads, in q. Below, a wheel is one of both.
"""

FREE, HELD, PIVOT = 0, 1, 2  # motion of the platform
FIXED, PRESCRIBED, DRIVEN = 0, 1, 2  # motion of a hinge
SMOOTH, BANG_BANG, TABLE = 0, 1, 2  # profile of a manoeuvre
# actuators
FORCE, TORQUE, POINT_FORCE, TIP_TORQUE, HINGE, WHEEL, MODAL, THRUSTER, GYRO = range(9)

# head
MOTION, HINGES, WHEELS, MODES, APPENDAGES, ACTUATORS = 0, 1, 2, 3, 4, 5
APPENDAGE_TABLE = 6  # where the offsets of the appendages' blocks lie
ACTUATOR_TABLE = 7
WHEEL_TABLE = 8
PIVOT_AXES = 9  # 6: V and w of a unit rate about the pivot
MASS, FIRST, INERTIA = 15, 16, 19  # of everything that is rigid in body axes
HEAD = 25

# a wheel, or a gyro with its gimbal's axis, and momentum and direction of its rotor at angle zero
WHEEL_AXIS, WHEEL_INERTIA, ROTOR_MOMENTUM, ROTOR_AXIS = 0, 3, 4, 5
WHEEL_SIZE = 8

# an appendage's block
KIND, COUNT, START, HINGE_INDEX, SECOND_ORDER, MOTION_AT, MANOEUVRES = 0, 1, 2, 3, 4, 5, 6
PLACE, AXES, AXIS, BODY_MASS, BODY_FIRST, BODY_INERTIA = 7, 10, 19, 22, 23, 26
HINGE_STIFFNESS, HINGE_DAMPING = 32, 33
GEOMETRIC = 34  # whether rows [S (3 n), R (3 n)] of every mode follow the damping
SUMS = 35  # P (3 n), then [J1 (6 n), H (3 n)], T (n, 9 n), mass, stiffness (n), damping (n, n)

# a manoeuvre of a prescribed hinge
BEGIN, LENGTH, ANGLE, PROFILE, TABLE_AT, ROWS, ROTATION_AXIS, FROM_AXES = 0, 1, 2, 3, 4, 5, 6, 9
MANOEUVRE_SIZE = 18

# an actuator: kind, appendage's block, index, place, direction; then Phi (3 n), share (n)
WHAT, OWNER_BLOCK, INDEX, AT, DIRECTION, SHAPES = 0, 1, 2, 3, 6, 9
