#include "image_node.h"
#include "program.h"

#include <time.h>

#include <rcl_yaml_param_parser/parser.h>
#include <rosidl_runtime_c/message_type_support_struct.h>

// How often a node that receives nothing looks whether it has been told to exit.
static const int64_t WAIT_NS = 50 * 1000 * 1000;

void image_node_open(image_node_t * self, int argc, const char * const * argv, const char * name)
{
  struct sigaction action = {.sa_handler = stop};
  sigaction(SIGINT, &action, NULL);
  sigaction(SIGTERM, &action, NULL);
  // What is printed is in the log at once.
  setvbuf(stdout, NULL, _IOLBF, 0);

  rcl_init_options_t options = rcl_get_zero_initialized_init_options();
  require(rcl_init_options_init(&options, rcl_get_default_allocator()), "options");
  self->context = rcl_get_zero_initialized_context();
  require(rcl_init(argc, argv, &options, &self->context), "rcl_init");
  require(rcl_init_options_fini(&options), "options");

  const rcl_node_options_t node_options = rcl_node_get_default_options();
  self->node = rcl_get_zero_initialized_node();
  require(rcl_node_init(&self->node, name, "", &self->context, &node_options), "node");
}

void image_node_connect(image_node_t * self)
{
  const rosidl_message_type_support_t * type =
    ROSIDL_GET_MSG_TYPE_SUPPORT(sensor_msgs, msg, Image);
  const size_t depth = (size_t)image_node_parameter(self, "queue_depth", 10.0);

  rcl_publisher_options_t publisher = rcl_publisher_get_default_options();
  publisher.qos.depth = depth;
  self->output = rcl_get_zero_initialized_publisher();
  require(rcl_publisher_init(&self->output, &self->node, type, "output", &publisher), "publisher");

  rcl_subscription_options_t subscription = rcl_subscription_get_default_options();
  subscription.qos.depth = depth;
  self->input = rcl_get_zero_initialized_subscription();
  require(
    rcl_subscription_init(&self->input, &self->node, type, "input", &subscription),
    "subscription");

  self->wait_set = rcl_get_zero_initialized_wait_set();
  require(
    rcl_wait_set_init(
      &self->wait_set, 1, 0, 0, 0, 0, 0, &self->context, rcl_get_default_allocator()),
    "wait set");
  self->image = sensor_msgs__msg__Image__create();
  if (self->image == NULL) {
    require(RCL_RET_BAD_ALLOC, "image");
  }
}

bool image_node_take(image_node_t * self)
{
  while (!stopped) {
    require(rcl_wait_set_clear(&self->wait_set), "wait set");
    require(rcl_wait_set_add_subscription(&self->wait_set, &self->input, NULL), "wait set");
    rcl_ret_t result = rcl_wait(&self->wait_set, WAIT_NS);
    if (result == RCL_RET_TIMEOUT) {
      continue;
    }
    require(result, "wait");
    result = rcl_take(&self->input, self->image, NULL, NULL);
    if (result == RCL_RET_OK) {
      return true;
    }
    if (result != RCL_RET_SUBSCRIPTION_TAKE_FAILED) {
      require(result, "take");
    }
    rcl_reset_error();
  }
  return false;
}

void image_node_publish(image_node_t * self, const sensor_msgs__msg__Image * image)
{
  require(rcl_publish(&self->output, image, NULL), "publish");
}

void image_node_close(image_node_t * self)
{
  sensor_msgs__msg__Image__destroy(self->image);
  require(rcl_wait_set_fini(&self->wait_set), "wait set");
  require(rcl_subscription_fini(&self->input, &self->node), "subscription");
  require(rcl_publisher_fini(&self->output, &self->node), "publisher");
  require(rcl_node_fini(&self->node), "node");
  require(rcl_shutdown(&self->context), "shutdown");
  require(rcl_context_fini(&self->context), "context");
}

bool image_node_stopped(void)
{
  return stopped;
}

double image_node_parameter(image_node_t * self, const char * name, double otherwise)
{
  rcl_params_t * overrides = NULL;
  require(
    rcl_arguments_get_param_overrides(&self->context.global_arguments, &overrides), "parameters");
  if (overrides == NULL) {
    return otherwise;
  }
  // Those of the command line are for all nodes of the process.
  const rcl_variant_t * value = rcl_yaml_node_struct_get("/**", name, overrides);
  double found = otherwise;
  if (value != NULL && value->double_value != NULL) {
    found = *value->double_value;
  } else if (value != NULL && value->integer_value != NULL) {
    found = (double)*value->integer_value;
  }
  rcl_yaml_node_struct_fini(overrides);
  return found;
}

int64_t monotonic_ns(void)
{
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * INT64_C(1000000000) + now.tv_nsec;
}

void compute_ms(double duration_ms)
{
  const int64_t end_ns = monotonic_ns() + (int64_t)(duration_ms * 1e6);
  while (monotonic_ns() < end_ns) {
  }
}
