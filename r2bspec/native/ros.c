/* What player and monitor need of rcl. */
#include "harness.h"

#include <dlfcn.h>
#include <pthread.h>
#include <string.h>

#define NOT_INSTALLED "R2B681"
#define HEADER_TYPE "std_msgs/msg/Header"

/* rcl_init is not documented to be safe against itself. */
static pthread_mutex_t init_lock = PTHREAD_MUTEX_INITIALIZER;

int ros_init(ros_t *ros, const char *node_name)
{
  const char *arguments[] = {"--ros-args", "--disable-external-lib-logs"};
  const rcl_allocator_t allocator = rcl_get_default_allocator();
  rcl_init_options_t options = rcl_get_zero_initialized_init_options();
  /* No part of the graph under test: nothing but the node, and no arguments of the process. */
  rcl_node_options_t node_options = rcl_node_get_default_options();
  node_options.use_global_arguments = false;
  node_options.enable_rosout = false;
  ros->context = rcl_get_zero_initialized_context();
  ros->node = rcl_get_zero_initialized_node();
  pthread_mutex_lock(&init_lock);
  const bool made =
    rcl_init_options_init(&options, allocator) == RCL_RET_OK &&
    rcl_init(2, arguments, &options, &ros->context) == RCL_RET_OK &&
    rcl_parse_arguments(0, NULL, allocator, &node_options.arguments) == RCL_RET_OK &&
    rcl_node_init(&ros->node, node_name, "/r2bspec", &ros->context, &node_options) == RCL_RET_OK;
  const int failed = made ? 0 : fail_rcl("initialising ROS");
  ignore_rcl(rcl_node_options_fini(&node_options));
  ignore_rcl(rcl_init_options_fini(&options));
  pthread_mutex_unlock(&init_lock);
  return failed;
}

void ros_fini(ros_t *ros)
{
  pthread_mutex_lock(&init_lock);
  ignore_rcl(rcl_node_fini(&ros->node));
  ignore_rcl(rcl_shutdown(&ros->context));
  ignore_rcl(rcl_context_fini(&ros->context));
  pthread_mutex_unlock(&init_lock);
}

type_t *next_type(channel_t *channel)
{
  /* Kept open: publishers and subscriptions refer to it. */
  void *library = dlopen(next_word(channel), RTLD_LAZY | RTLD_LOCAL);
  const char *symbol = next_word(channel);
  type_t *(*handle)(void) = NULL;
  if (library != NULL) {
    *(void **)&handle = dlsym(library, symbol);
  }
  const char *name = next_word(channel);
  if (handle == NULL) {
    (void)fail(NOT_INSTALLED, "message type %s is not installed", name);
  }
  return handle == NULL ? NULL : handle();
}

bool begins_with_header(type_t *type)
{
  const rosidl_runtime_c__type_description__TypeDescription *described =
    type->get_type_description_func == NULL ? NULL : type->get_type_description_func(type);
  if (described == NULL || described->type_description.fields.size == 0) {
    return false;
  }
  const rosidl_runtime_c__type_description__FieldType *first =
    &described->type_description.fields.data[0].type;
  return first->type_id == rosidl_runtime_c__type_description__FieldType__FIELD_TYPE_NESTED_TYPE &&
         strcmp(first->nested_type_name.data, HEADER_TYPE) == 0;
}

/* A limit in ns; 0, which rmw takes for none, stays 0. */
static rmw_time_t next_limit(channel_t *channel)
{
  const int64_t limit_ns = next_number(channel);
  return (rmw_time_t){
    .sec = (uint64_t)(limit_ns / NS_PER_S), .nsec = (uint64_t)(limit_ns % NS_PER_S)};
}

rmw_qos_profile_t next_qos(channel_t *channel)
{
  rmw_qos_profile_t qos = rmw_qos_profile_default;
  qos.reliability = (rmw_qos_reliability_policy_t)next_number(channel);
  qos.durability = (rmw_qos_durability_policy_t)next_number(channel);
  qos.history = (rmw_qos_history_policy_t)next_number(channel);
  qos.depth = (size_t)next_number(channel);
  qos.deadline = next_limit(channel);
  qos.lifespan = next_limit(channel);
  qos.liveliness = (rmw_qos_liveliness_policy_t)next_number(channel);
  qos.liveliness_lease_duration = next_limit(channel);
  return qos;
}
