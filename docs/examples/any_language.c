/* A controller of the bench in C, with rcl alone; docs/any_language.md says how to build it.
 *
 * It holds the joints at zero by a proportional and derivative law. For a law of your own, change
 * law() and the names below. One thread waits for messages and timers and calls one function for
 * each. The rules in the comments are those of docs/any_language.md.
 */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>

#include <rcl/error_handling.h>
#include <rcl/rcl.h>
#include <rcutils/time.h>
#include <rosidl_runtime_c/primitives_sequence_functions.h>
#include <rosidl_runtime_c/string_functions.h>

#include <flexslew_msgs/msg/alive.h>
#include <flexslew_msgs/msg/controller_status.h>
#include <flexslew_msgs/msg/effort_command.h>
#include <flexslew_msgs/msg/measurement.h>
#include <flexslew_msgs/msg/testbed.h>

#define NAME "any_language_c" /* unless the command line remaps __node */
#define LAW "docs/examples/any_language.c"

enum { LOOP_DEPTH = 4000, HEARTBEAT_MS = 250, STATUS_MS = 100, STATUS_TICKS = 400 };

static const double stiffness = 400.0, damping = 1500.0; /* [N m/rad], [N m s/rad] */

typedef struct {
  rcl_context_t context;
  rcl_node_t node;
  rcl_clock_t clock;
  rcl_wait_set_t wait_set;
  rcl_timer_t heartbeat_timer, status_timer;
  rcl_subscription_t testbed_subscription, measurement_subscription;
  rcl_publisher_t effort_publisher, status_publisher, alive_publisher;
  flexslew_msgs__msg__Testbed testbed;
  flexslew_msgs__msg__Measurement measurement;
  flexslew_msgs__msg__EffortCommand command;
  flexslew_msgs__msg__ControllerStatus status;
  flexslew_msgs__msg__Alive alive;
  int ticks_since_status;
} Controller;

static volatile sig_atomic_t ending = 0;

static void on_signal(int number) {
  (void)number;
  ending = 1;
}

/* End the process with a message if a step has failed. */
static void check(bool succeeded, const char *step) {
  if (succeeded) return;
  fprintf(stderr, "%s: %s: %s\n", NAME, step,
          rcl_error_is_set() ? rcl_get_error_string().str : "failed");
  exit(EXIT_FAILURE);
}

static void assign(rosidl_runtime_c__String *string, const char *value) {
  check(rosidl_runtime_c__String__assign(string, value), "assign a string");
}

/* Compute the efforts u = -Kp q - Kd dq/dt, each within the limit of its actuator [N m or N]. */
static void law(const flexslew_msgs__msg__Measurement *measurement, const double *limit,
                rosidl_runtime_c__double__Sequence *effort) {
  for (size_t i = 0; i < effort->size; i++) {
    double u = -stiffness * measurement->joint_position.data[i] -
               damping * measurement->joint_velocity.data[i];
    effort->data[i] = u > limit[i] ? limit[i] : u < -limit[i] ? -limit[i] : u;
  }
}

static void publish_status(Controller *c) {
  check(rcl_publish(&c->status_publisher, &c->status, NULL) == RCL_RET_OK, "controller_status");
  c->ticks_since_status = 0;
}

/* Rule 1: the controller is ready as soon as it has the limits of the actuators. */
static void on_testbed(Controller *c) {
  size_t actuators = c->testbed.effort_limit.size;
  c->status.ready = actuators == c->testbed.joint_names.size;
  assign(&c->status.reason, c->status.ready ? "" : "the law needs one actuator per joint");
  if (c->command.effort.size != actuators) {
    rosidl_runtime_c__double__Sequence__fini(&c->command.effort);
    check(rosidl_runtime_c__double__Sequence__init(&c->command.effort, actuators), "efforts");
  }
  publish_status(c);
}

static void on_measurement(Controller *c) {
  const flexslew_msgs__msg__Measurement *m = &c->measurement;
  /* Rules 5, 6, 10 and 11: an estimator is updated here, by the measurements for other controllers
   * too; once per tick, and from its initial state if the epoch has changed. */
  c->status.stamp = m->header.stamp;
  c->status.last_tick = m->tick;
  c->status.epoch = m->epoch;
  if (++c->ticks_since_status >= STATUS_TICKS) publish_status(c); /* rule 4 */

  size_t joints = c->command.effort.size;
  bool named = strcmp(m->controller.data, c->status.controller.data) == 0;
  bool fits = m->joint_position.size == joints && m->joint_velocity.size == joints;
  if (!named || !c->status.ready || !fits) return;
  law(m, c->testbed.effort_limit.data, &c->command.effort);
  c->command.stamp = m->header.stamp; /* rule 3 */
  c->command.tick = m->tick;
  c->command.epoch = m->epoch;
  check(rcl_publish(&c->effort_publisher, &c->command, NULL) == RCL_RET_OK, "effort_command");
}

/* Fill in what stays the same: the names, the number of this process and when it started. */
static void init_messages(Controller *c, const char *name) {
  check(flexslew_msgs__msg__Testbed__init(&c->testbed) &&
            flexslew_msgs__msg__Measurement__init(&c->measurement) &&
            flexslew_msgs__msg__EffortCommand__init(&c->command) &&
            flexslew_msgs__msg__ControllerStatus__init(&c->status) &&
            flexslew_msgs__msg__Alive__init(&c->alive), "messages");
  uint64_t instance;
  check(getrandom(&instance, sizeof instance, 0) == (ssize_t)sizeof instance, "getrandom");
  c->alive.instance = c->command.instance = c->status.instance = instance;
  check(rcutils_system_time_now(&c->alive.since) == RCUTILS_RET_OK, "time");
  assign(&c->alive.node, name);
  assign(&c->alive.role, "controller");
  assign(&c->command.controller, name);
  assign(&c->status.controller, name);
  assign(&c->status.law, LAW);
  assign(&c->status.reason, "no testbed yet");
}

static void add_publisher(Controller *c, rcl_publisher_t *publisher, const char *topic,
                          const rosidl_message_type_support_t *type, rmw_qos_profile_t qos) {
  rcl_publisher_options_t options = rcl_publisher_get_default_options();
  options.qos = qos;
  *publisher = rcl_get_zero_initialized_publisher();
  check(rcl_publisher_init(publisher, &c->node, type, topic, &options) == RCL_RET_OK, topic);
}

static void add_subscription(Controller *c, rcl_subscription_t *subscription, const char *topic,
                             const rosidl_message_type_support_t *type, rmw_qos_profile_t qos) {
  rcl_subscription_options_t options = rcl_subscription_get_default_options();
  options.qos = qos;
  *subscription = rcl_get_zero_initialized_subscription();
  check(rcl_subscription_init(subscription, &c->node, type, topic, &options) == RCL_RET_OK, topic);
}

static void add_timer(Controller *c, rcl_timer_t *timer, int64_t milliseconds) {
  *timer = rcl_get_zero_initialized_timer();
  check(rcl_timer_init2(timer, &c->clock, &c->context, RCL_MS_TO_NS(milliseconds), NULL,
                        rcl_get_default_allocator(), true) == RCL_RET_OK, "timer");
}

static void init_node(Controller *c, int count, char **arguments) {
  rcl_allocator_t allocator = rcl_get_default_allocator();
  rcl_init_options_t options = rcl_get_zero_initialized_init_options();
  check(rcl_init_options_init(&options, allocator) == RCL_RET_OK, "options");
  c->context = rcl_get_zero_initialized_context();
  check(rcl_init(count, (const char *const *)arguments, &options, &c->context) == RCL_RET_OK,
        "rcl_init");
  check(rcl_init_options_fini(&options) == RCL_RET_OK, "options");

  rcl_node_options_t node_options = rcl_node_get_default_options();
  c->node = rcl_get_zero_initialized_node();
  check(rcl_node_init(&c->node, NAME, "", &c->context, &node_options) == RCL_RET_OK, "node");
  check(rcl_node_options_fini(&node_options) == RCL_RET_OK, "node options");
  check(rcl_clock_init(RCL_STEADY_TIME, &c->clock, &allocator) == RCL_RET_OK, "clock");
  c->wait_set = rcl_get_zero_initialized_wait_set();
  check(rcl_wait_set_init(&c->wait_set, 2, 0, 2, 0, 0, 0, &c->context, allocator) == RCL_RET_OK,
        "wait set");
}

/* Add the topics with the QoS of the table in docs/any_language.md, and the timers. */
static void init_topics(Controller *c) {
  rmw_qos_profile_t loop, latched, best_effort;
  loop = latched = best_effort = rmw_qos_profile_default; /* reliable, volatile */
  loop.depth = LOOP_DEPTH;
  latched.depth = 1;
  latched.durability = RMW_QOS_POLICY_DURABILITY_TRANSIENT_LOCAL;
  best_effort.depth = 20;
  best_effort.reliability = RMW_QOS_POLICY_RELIABILITY_BEST_EFFORT;

  add_publisher(c, &c->effort_publisher, "effort_command",
                ROSIDL_GET_MSG_TYPE_SUPPORT(flexslew_msgs, msg, EffortCommand), loop);
  add_publisher(c, &c->status_publisher, "controller_status",
                ROSIDL_GET_MSG_TYPE_SUPPORT(flexslew_msgs, msg, ControllerStatus), latched);
  add_publisher(c, &c->alive_publisher, "alive",
                ROSIDL_GET_MSG_TYPE_SUPPORT(flexslew_msgs, msg, Alive), best_effort);
  add_subscription(c, &c->testbed_subscription, "testbed",
                   ROSIDL_GET_MSG_TYPE_SUPPORT(flexslew_msgs, msg, Testbed), latched);
  add_subscription(c, &c->measurement_subscription, "measurement",
                   ROSIDL_GET_MSG_TYPE_SUPPORT(flexslew_msgs, msg, Measurement), loop);
  add_timer(c, &c->heartbeat_timer, HEARTBEAT_MS);
  add_timer(c, &c->status_timer, STATUS_MS);
}

/* Wait for messages or timers. Their places in the wait set follow the order of the additions. */
static void wait_for_events(Controller *c) {
  rcl_wait_set_t *set = &c->wait_set;
  check(rcl_wait_set_clear(set) == RCL_RET_OK &&
            rcl_wait_set_add_subscription(set, &c->testbed_subscription, NULL) == RCL_RET_OK &&
            rcl_wait_set_add_subscription(set, &c->measurement_subscription, NULL) == RCL_RET_OK &&
            rcl_wait_set_add_timer(set, &c->heartbeat_timer, NULL) == RCL_RET_OK &&
            rcl_wait_set_add_timer(set, &c->status_timer, NULL) == RCL_RET_OK, "wait set");
  rcl_ret_t result = rcl_wait(set, RCL_MS_TO_NS(STATUS_MS));
  check(result == RCL_RET_OK || result == RCL_RET_TIMEOUT, "wait");
}

/* Take one message; return whether there was one. */
static bool take(const rcl_subscription_t *subscription, void *message) {
  rcl_ret_t result = rcl_take(subscription, message, NULL, NULL);
  if (result == RCL_RET_SUBSCRIPTION_TAKE_FAILED) return false;
  check(result == RCL_RET_OK, "take");
  return true;
}

static void spin(Controller *c) {
  const rcl_wait_set_t *set = &c->wait_set; /* it has NULL where nothing is ready */
  while (!ending) {
    wait_for_events(c);
    if (set->subscriptions[0] && take(&c->testbed_subscription, &c->testbed)) on_testbed(c);
    if (set->subscriptions[1] && take(&c->measurement_subscription, &c->measurement))
      on_measurement(c);
    if (set->timers[0]) { /* rule 2 */
      check(rcl_timer_call(&c->heartbeat_timer) == RCL_RET_OK, "timer");
      check(rcl_publish(&c->alive_publisher, &c->alive, NULL) == RCL_RET_OK, "alive");
    }
    if (set->timers[1]) {
      check(rcl_timer_call(&c->status_timer) == RCL_RET_OK, "timer");
      publish_status(c);
    }
  }
}

/* Leave the graph, so that the other nodes do not wait for a timeout. */
static void close_node(Controller *c) {
  check(rcl_subscription_fini(&c->testbed_subscription, &c->node) == RCL_RET_OK &&
            rcl_subscription_fini(&c->measurement_subscription, &c->node) == RCL_RET_OK &&
            rcl_publisher_fini(&c->effort_publisher, &c->node) == RCL_RET_OK &&
            rcl_publisher_fini(&c->status_publisher, &c->node) == RCL_RET_OK &&
            rcl_publisher_fini(&c->alive_publisher, &c->node) == RCL_RET_OK, "topics");
  check(rcl_timer_fini(&c->heartbeat_timer) == RCL_RET_OK &&
            rcl_timer_fini(&c->status_timer) == RCL_RET_OK &&
            rcl_wait_set_fini(&c->wait_set) == RCL_RET_OK &&
            rcl_clock_fini(&c->clock) == RCL_RET_OK, "timers");
  check(rcl_node_fini(&c->node) == RCL_RET_OK && rcl_shutdown(&c->context) == RCL_RET_OK &&
            rcl_context_fini(&c->context) == RCL_RET_OK, "node");
  flexslew_msgs__msg__Testbed__fini(&c->testbed);
  flexslew_msgs__msg__Measurement__fini(&c->measurement);
  flexslew_msgs__msg__EffortCommand__fini(&c->command);
  flexslew_msgs__msg__ControllerStatus__fini(&c->status);
  flexslew_msgs__msg__Alive__fini(&c->alive);
}

int main(int count, char **arguments) {
  Controller controller = {0};
  signal(SIGTERM, on_signal); /* rule 12 */
  signal(SIGINT, on_signal);
  init_node(&controller, count, arguments);
  init_messages(&controller, rcl_node_get_name(&controller.node));
  init_topics(&controller);
  spin(&controller);
  close_node(&controller);
  return EXIT_SUCCESS;
}
