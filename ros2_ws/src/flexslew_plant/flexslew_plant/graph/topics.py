"""The names, types and QoS of everything on the graph, in one place.

Names are relative, so a namespace holds a whole bench; only what ROS keeps global is not.
"""

from typing import NamedTuple


class Topic(NamedTuple):
    """A topic's message type and quality of service; reliable by default."""

    name: str  # relative to the namespace; absolute what ROS keeps global
    type: str
    depth: int
    latched: bool = False  # a late subscriber gets the last `depth` samples
    reliable: bool = True


# Nothing on the loop may be lost: reliable, and deeper than the 1,000 ticks by which the plant lets
# anyone fall behind (Backlog). Keeping all in DDS would stop every writer when a reader dies.
LOOP_DEPTH = 4000

MEASUREMENT = "measurement"
EFFORT_COMMAND = "effort_command"
TRUTH = "truth"
CONTROLLER_STATE = "controller_state"
CONTROLLER_STATUS = "controller_status"
RECORDER_STATUS = "recorder_status"
RECORDED = "recorded"
ALIVE = "alive"
BENCH_STATE = "bench_state"
TESTBED = "testbed"
PLAN = "plan"
EVENTS = "events"
JOINT_STATES = "joint_states"
APPENDAGE_STATES = "appendage_states"
MARKERS = "markers"
IMU, ODOMETRY, WRENCH = "imu", "odometry", "wrench"  # of a platform that floats freely
JOINT_TRAJECTORY = "joint_trajectory"  # a manoeuvre requested from the planner node
PLANNED_TRAJECTORY = "planned_trajectory"  # a plan as those without flexslew_msgs read it
SENSORS_IMU, SENSORS_ATTITUDE = "sensors/imu", "sensors/attitude"  # gyros, star trackers
ROBOT_DESCRIPTION = "robot_description"
TF = "/tf"
TF_STATIC = "/tf_static"
CLOCK = "/clock"
ROSOUT = "/rosout"
DIAGNOSTICS = "/diagnostics"

TOPICS: dict[str, Topic] = {
    topic.name: topic
    for topic in (
        Topic(MEASUREMENT, "flexslew_msgs/msg/Measurement", LOOP_DEPTH),
        Topic(EFFORT_COMMAND, "flexslew_msgs/msg/EffortCommand", LOOP_DEPTH),
        Topic(TRUTH, "flexslew_msgs/msg/PlantState", LOOP_DEPTH),
        Topic(CONTROLLER_STATE, "flexslew_msgs/msg/ControllerState", LOOP_DEPTH),
        Topic(CONTROLLER_STATUS, "flexslew_msgs/msg/ControllerStatus", 1, latched=True),
        Topic(RECORDER_STATUS, "flexslew_msgs/msg/RecorderStatus", 1, latched=True),
        Topic(RECORDED, "flexslew_msgs/msg/Recorded", 200),
        Topic(ALIVE, "flexslew_msgs/msg/Alive", 20, reliable=False),
        Topic(BENCH_STATE, "flexslew_msgs/msg/BenchState", 1, latched=True),
        Topic(PLAN, "flexslew_msgs/msg/Plan", 20, latched=True),  # a newcomer receives those before
        Topic(TESTBED, "flexslew_msgs/msg/Testbed", 1, latched=True),
        Topic(EVENTS, "flexslew_msgs/msg/Event", 1000, latched=True),
        Topic(JOINT_STATES, "sensor_msgs/msg/JointState", LOOP_DEPTH),
        Topic(APPENDAGE_STATES, "flexslew_msgs/msg/AppendageState", LOOP_DEPTH),
        Topic(TF, "tf2_msgs/msg/TFMessage", LOOP_DEPTH),
        Topic(TF_STATIC, "tf2_msgs/msg/TFMessage", 1, latched=True),
        Topic(ROBOT_DESCRIPTION, "std_msgs/msg/String", 1, latched=True),
        Topic(MARKERS, "visualization_msgs/msg/MarkerArray", LOOP_DEPTH),
        Topic(IMU, "sensor_msgs/msg/Imu", LOOP_DEPTH),
        Topic(ODOMETRY, "nav_msgs/msg/Odometry", LOOP_DEPTH),
        Topic(WRENCH, "geometry_msgs/msg/WrenchStamped", LOOP_DEPTH),
        Topic(JOINT_TRAJECTORY, "trajectory_msgs/msg/JointTrajectory", 10),
        Topic(PLANNED_TRAJECTORY, "trajectory_msgs/msg/JointTrajectory", 1, latched=True),
        Topic(SENSORS_IMU, "sensor_msgs/msg/Imu", LOOP_DEPTH),
        Topic(SENSORS_ATTITUDE, "geometry_msgs/msg/QuaternionStamped", LOOP_DEPTH),
        Topic(CLOCK, "rosgraph_msgs/msg/Clock", LOOP_DEPTH),
        Topic(DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray", 10),
        Topic(ROSOUT, "rcl_interfaces/msg/Log", 1000, latched=True),
    )
}

# The displayed state: at the display rate, without an epoch.
DISPLAYED = (
    *(CLOCK, JOINT_STATES, APPENDAGE_STATES, TF, MARKERS),
    *(IMU, ODOMETRY, WRENCH),
)
# Wall-clock status (what affects a run is an event, too), or copies of other topics; a requested
# trajectory becomes a plan.
NOT_RECORDED = (
    *(ALIVE, BENCH_STATE, RECORDER_STATUS, RECORDED, DIAGNOSTICS, JOINT_TRAJECTORY),
    *(SENSORS_IMU, SENSORS_ATTITUDE),
)

START, PAUSE, STEP, RESET = "start", "pause", "step", "reset"
BRAKE, RELEASE_BRAKE = "brake", "release_brake"
OPERATE = "operate"
SET_RATE = "set_rate"
NOTE = "note"
OFFERED_PRIVATELY = (START, PAUSE, NOTE)  # as plant/start, too: these are anybody's words
SWITCH_CONTROLLER = "switch_controller"
LIST_CONTROLLERS = "list_controllers"
INJECT_FAULT, END_FAULT, RETARGET = "inject_fault", "end_fault", "retarget"
TUNE = "~/tune"  # of each controller
PLAN_SLEW, DRAFT_PLAN = "plan_slew", "draft_plan"  # actions: published, kept as a draft
DECIDE_PLAN = "decide_plan"
FOLLOW_JOINT_TRAJECTORY = "follow_joint_trajectory"  # an action, where control_msgs is installed
GET_SIMULATOR_FEATURES, RESET_SIMULATION = "get_simulator_features", "reset_simulation"
GET_SIMULATION_STATE, SET_SIMULATION_STATE = "get_simulation_state", "set_simulation_state"
STEP_SIMULATION = "step_simulation"
SIMULATE_STEPS = "simulate_steps"  # an action; where simulation_interfaces is installed, as these
