"""Rights of each node on the graph, as SROS 2 policies: no more than each node needs."""

from collections.abc import Iterable
from importlib.util import find_spec
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

from flexslew_plant.graph import topics as t

HIDDEN = "_"  # ROS hides nodes with such names; `_x` listens on behalf of the node `x`


class RoleAccess(NamedTuple):
    """What nodes of one role may do."""

    publish: tuple[str, ...]
    subscribe: tuple[str, ...]
    reply: tuple[str, ...] = ()  # services offered
    execute: tuple[str, ...] = ()  # actions offered
    request: tuple[str, ...] = ()  # services called
    call: tuple[str, ...] = ()  # actions called
    tunes: bool = False  # whether it may tune every controller


def _with(package: str, *names: str) -> tuple[str, ...]:
    """Return names that are on the graph where this package is installed."""
    return names if find_spec(package) is not None else ()


_OPERATOR_SERVICES = (
    t.START, t.PAUSE, t.RESET, t.BRAKE, t.RELEASE_BRAKE, t.OPERATE, t.STEP, t.SET_RATE, t.NOTE,
    t.SWITCH_CONTROLLER, t.LIST_CONTROLLERS, t.INJECT_FAULT, t.END_FAULT, t.RETARGET,
)  # fmt: skip
_PLAN_ACTIONS = (t.PLAN_SLEW, t.DRAFT_PLAN)
_RECORDED = tuple(name for name in t.TOPICS if name not in t.NOT_RECORDED)

ROLES: dict[str, RoleAccess] = {
    "plant": RoleAccess(
        publish=(t.MEASUREMENT, t.TRUTH, t.EVENTS, t.TESTBED, t.ALIVE, t.BENCH_STATE,
                 t.DIAGNOSTICS, *t.DISPLAYED, t.TF_STATIC, t.ROBOT_DESCRIPTION,
                 t.SENSORS_IMU, t.SENSORS_ATTITUDE),
        subscribe=(t.EFFORT_COMMAND, t.CONTROLLER_STATUS, t.RECORDER_STATUS, t.ALIVE),
        reply=(*_OPERATOR_SERVICES, *(f"~/{name}" for name in t.OFFERED_PRIVATELY),
               *_with("simulation_interfaces", t.GET_SIMULATOR_FEATURES, t.GET_SIMULATION_STATE,
                      t.SET_SIMULATION_STATE, t.RESET_SIMULATION, t.STEP_SIMULATION)),
        execute=_with("simulation_interfaces", t.SIMULATE_STEPS),
    ),
    "controller": RoleAccess(
        publish=(t.EFFORT_COMMAND, t.CONTROLLER_STATE, t.CONTROLLER_STATUS, t.EVENTS, t.ALIVE),
        subscribe=(t.MEASUREMENT, t.TESTBED, t.PLAN, t.BENCH_STATE, t.ALIVE),
        reply=(t.TUNE,),
    ),
    "planner": RoleAccess(
        publish=(t.PLAN, t.PLANNED_TRAJECTORY, t.EVENTS, t.ALIVE),
        subscribe=(t.JOINT_TRAJECTORY, t.TESTBED, t.BENCH_STATE, t.CONTROLLER_STATUS, t.EVENTS,
                   t.ALIVE, t.APPENDAGE_STATES, t.JOINT_STATES),  # the last two for a while
        execute=(*_PLAN_ACTIONS, *_with("control_msgs", t.FOLLOW_JOINT_TRAJECTORY)),
        reply=(t.DECIDE_PLAN,),
    ),
    "recorder": RoleAccess(
        publish=(t.EVENTS, t.RECORDER_STATUS, t.RECORDED, t.ALIVE), subscribe=(t.ALIVE,),
    ),
    "listener": RoleAccess(publish=(), subscribe=(*_RECORDED, t.ALIVE)),  # hidden, of the recorder
    "operator": RoleAccess(
        publish=(), subscribe=(t.EVENTS, t.BENCH_STATE, t.TRUTH, t.PLAN),
        request=(*_OPERATOR_SERVICES, t.DECIDE_PLAN), call=_PLAN_ACTIONS,
    ),
    "console": RoleAccess(
        publish=(t.ALIVE,), subscribe=(t.ALIVE,), call=_PLAN_ACTIONS,
        request=(*_OPERATOR_SERVICES, t.DECIDE_PLAN), tunes=True,
    ),
    "watcher": RoleAccess(  # hidden, of the console
        publish=(), subscribe=(t.TESTBED, t.BENCH_STATE, t.CONTROLLER_STATUS, t.EVENTS, t.PLAN,
                               t.RECORDED, t.TRUTH, t.CONTROLLER_STATE),
    ),
}  # fmt: skip

# What rclpy gives every node.
NODE_TOPICS = ("/rosout", "/parameter_events")
NODE_SERVICES = (
    "~/describe_parameters", "~/get_parameter_types", "~/get_parameters", "~/list_parameters",
    "~/set_parameters", "~/set_parameters_atomically", "~/get_type_description",
)  # fmt: skip

NODES: dict[str, str] = {  # besides the controllers
    "plant": "plant",
    "planner": "planner",
    "recorder": "recorder",
    "_recorder": "listener",
    "operator": "operator",
    "console": "console",
    "_console": "watcher",
}


def policies(controllers: Iterable[str], namespace: str = "/") -> str:
    """Return a policy file of SROS 2 for the nodes of a bench.

    An enclave is one process, so a hidden node shares that of the node for which it listens.

    Args:
        controllers: names of the nodes that run a law.
        namespace: namespace of all of them.
    """
    laws = tuple(controllers)
    tuning_services = tuple(t.TUNE.replace("~", law) for law in laws)
    enclaves: dict[str, list[str]] = {}  # profiles by place
    for node, role in (NODES | dict.fromkeys(laws, "controller")).items():
        access = ROLES[role]
        node_services = [f"{node}/{name.removeprefix('~/')}" for name in NODE_SERVICES]
        reply = [f"{node}/{n[2:]}" if n.startswith("~/") else n for n in access.reply]
        parts = [
            _part("topic", "publish", (*access.publish, *NODE_TOPICS)),
            _part("topic", "subscribe", access.subscribe),
            _part("service", "reply", (*reply, *node_services)),
            _part("service", "request", access.request + tuning_services * access.tunes),
            _part("action", "execute", access.execute),
            _part("action", "call", access.call),
        ]
        place = f"{namespace.rstrip('/')}/{node.removeprefix(HIDDEN)}"
        enclaves.setdefault(place, []).append(
            f"        <profile ns={quoteattr(namespace)} node={quoteattr(node)}>\n"
            + "".join(parts)
            + "        </profile>\n"
        )
    body = "".join(
        f"    <enclave path={quoteattr(place)}>\n      <profiles>\n"
        + "".join(profiles)
        + "      </profiles>\n    </enclave>\n"
        for place, profiles in enclaves.items()
    )
    head = '<?xml version="1.0" encoding="UTF-8"?>\n<policy version="0.2.0">\n  <enclaves>\n'
    return f"{head}{body}  </enclaves>\n</policy>\n"


def _part(kind: str, right: str, names: tuple[str, ...] | list[str]) -> str:
    if not names:
        return ""
    lines = "".join(f"            <{kind}>{name}</{kind}>\n" for name in names)
    return f'          <{kind}s {right}="ALLOW">\n{lines}          </{kind}s>\n'
