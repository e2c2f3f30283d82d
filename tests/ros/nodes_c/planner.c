// An action server in C, of one thread: it executes a goal as soon as it has accepted it.
#include "program.h"

#include <rcl/rcl.h>
#include <rcl_action/rcl_action.h>
#include <test_msgs/action/fibonacci.h>
#include <unistd.h>

enum { EXECUTION_US = 60000 };

static void execute_goal(rcl_action_server_t * server)
{
  rmw_request_id_t id;
  test_msgs__action__Fibonacci_SendGoal_Request goal;
  test_msgs__action__Fibonacci_SendGoal_Request__init(&goal);
  require(rcl_action_take_goal_request(server, &id, &goal), "goal");
  rcl_action_goal_info_t info = rcl_action_get_zero_initialized_goal_info();
  info.goal_id = goal.goal_id;
  rcl_action_goal_handle_t * handle = rcl_action_accept_new_goal(server, &info);
  test_msgs__action__Fibonacci_SendGoal_Response response = {.accepted = handle != NULL};
  require(rcl_action_send_goal_response(server, &id, &response), "acceptance");
  require(rcl_action_update_goal_state(handle, GOAL_EVENT_EXECUTE), "execute");
  usleep(EXECUTION_US);
  require(rcl_action_update_goal_state(handle, GOAL_EVENT_SUCCEED), "succeed");
  test_msgs__action__Fibonacci_SendGoal_Request__fini(&goal);
}

static void send_result(rcl_action_server_t * server)
{
  rmw_request_id_t id;
  test_msgs__action__Fibonacci_GetResult_Request request;
  require(rcl_action_take_result_request(server, &id, &request), "request for a result");
  test_msgs__action__Fibonacci_GetResult_Response response;
  test_msgs__action__Fibonacci_GetResult_Response__init(&response);
  response.status = GOAL_STATE_SUCCEEDED;
  require(rcl_action_send_result_response(server, &id, &response), "result");
  test_msgs__action__Fibonacci_GetResult_Response__fini(&response);
}

int main(int argc, const char ** argv)
{
  signal(SIGINT, stop);
  signal(SIGTERM, stop);
  rcl_allocator_t allocator = rcl_get_default_allocator();
  rcl_init_options_t options = rcl_get_zero_initialized_init_options();
  require(rcl_init_options_init(&options, allocator), "options");
  rcl_context_t context = rcl_get_zero_initialized_context();
  require(rcl_init(argc, argv, &options, &context), "init");
  rcl_node_options_t node_options = rcl_node_get_default_options();
  rcl_node_t node = rcl_get_zero_initialized_node();
  require(rcl_node_init(&node, "planner", "", &context, &node_options), "node");
  rcl_clock_t clock;
  require(rcl_clock_init(RCL_STEADY_TIME, &clock, &allocator), "clock");
  rcl_action_server_t server = rcl_action_get_zero_initialized_server();
  rcl_action_server_options_t server_options = rcl_action_server_get_default_options();
  require(
    rcl_action_server_init(
      &server, &node, &clock, ROSIDL_GET_ACTION_TYPE_SUPPORT(test_msgs, Fibonacci), "plan",
      &server_options),
    "server");
  size_t entities[5];
  require(
    rcl_action_server_wait_set_get_num_entities(
      &server, &entities[0], &entities[1], &entities[2], &entities[3], &entities[4]),
    "entities");
  rcl_wait_set_t wait_set = rcl_get_zero_initialized_wait_set();
  require(
    rcl_wait_set_init(
      &wait_set, entities[0], entities[1], entities[2], entities[3], entities[4], 0, &context,
      allocator),
    "wait set");
  while (!stopped) {
    require(rcl_wait_set_clear(&wait_set), "wait set");
    require(rcl_action_wait_set_add_action_server(&wait_set, &server, NULL), "wait set");
    const rcl_ret_t result = rcl_wait(&wait_set, 100000000);
    if (result == RCL_RET_TIMEOUT) {
      continue;
    }
    require(result, "wait");
    bool has_goal = false, has_cancel = false, has_request = false, has_expired = false;
    require(
      rcl_action_server_wait_set_get_entities_ready(
        &wait_set, &server, &has_goal, &has_cancel, &has_request, &has_expired),
      "ready");
    if (has_request) {
      send_result(&server);
    }
    if (has_goal) {
      execute_goal(&server);
    }
  }
  require(rcl_wait_set_fini(&wait_set), "wait set");
  require(rcl_action_server_fini(&server, &node), "server");
  require(rcl_node_fini(&node), "node");
  require(rcl_shutdown(&context), "shutdown");
  require(rcl_context_fini(&context), "context");
  return 0;
}
