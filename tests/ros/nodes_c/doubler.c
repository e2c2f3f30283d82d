// A service in C: it answers with twice the number, and with false every fourth time.
#include "program.h"

#include <rcl/rcl.h>
#include <test_msgs/srv/basic_types.h>

int main(int argc, const char ** argv)
{
  signal(SIGINT, stop);
  signal(SIGTERM, stop);
  const rcl_allocator_t allocator = rcl_get_default_allocator();
  rcl_init_options_t options = rcl_get_zero_initialized_init_options();
  require(rcl_init_options_init(&options, allocator), "options");
  rcl_context_t context = rcl_get_zero_initialized_context();
  require(rcl_init(argc, argv, &options, &context), "init");
  rcl_node_options_t node_options = rcl_node_get_default_options();
  rcl_node_t node = rcl_get_zero_initialized_node();
  require(rcl_node_init(&node, "doubler", "", &context, &node_options), "node");
  rcl_service_t service = rcl_get_zero_initialized_service();
  rcl_service_options_t service_options = rcl_service_get_default_options();
  require(
    rcl_service_init(
      &service, &node, ROSIDL_GET_SRV_TYPE_SUPPORT(test_msgs, srv, BasicTypes), "double",
      &service_options),
    "service");
  rcl_wait_set_t wait_set = rcl_get_zero_initialized_wait_set();
  require(rcl_wait_set_init(&wait_set, 0, 0, 0, 0, 1, 0, &context, allocator), "wait set");
  test_msgs__srv__BasicTypes_Request * request = test_msgs__srv__BasicTypes_Request__create();
  test_msgs__srv__BasicTypes_Response * response = test_msgs__srv__BasicTypes_Response__create();
  for (int answers = 0; !stopped;) {
    require(rcl_wait_set_clear(&wait_set), "wait set");
    require(rcl_wait_set_add_service(&wait_set, &service, NULL), "wait set");
    const rcl_ret_t result = rcl_wait(&wait_set, 100000000);
    if (result == RCL_RET_TIMEOUT) {
      continue;
    }
    require(result, "wait");
    rmw_request_id_t id;
    if (rcl_take_request(&service, &id, request) != RCL_RET_OK) {
      rcl_reset_error();
      continue;
    }
    response->int32_value = 2 * request->int32_value;
    response->bool_value = ++answers % 4 != 0;
    require(rcl_send_response(&service, &id, response), "response");
  }
  test_msgs__srv__BasicTypes_Request__destroy(request);
  test_msgs__srv__BasicTypes_Response__destroy(response);
  require(rcl_wait_set_fini(&wait_set), "wait set");
  require(rcl_service_fini(&service, &node), "service");
  require(rcl_node_fini(&node), "node");
  require(rcl_shutdown(&context), "shutdown");
  require(rcl_context_fini(&context), "context");
  return 0;
}
