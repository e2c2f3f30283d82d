/* What the functions of stub_ros.c take, laid out as in Jazzy. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct { void *members[5]; } allocator_t;
typedef struct { int64_t source_ns, received_ns; uint64_t sequence[2]; uint8_t gid[24]; bool intra; } info_t;
typedef struct { uint8_t client[16]; int64_t number; } request_t;
typedef struct { int64_t source_ns, received_ns; request_t request; } request_info_t;
typedef struct { uint8_t *buffer; size_t length, capacity; allocator_t allocator; } serialized_t;

int rcl_init(int argc, char const *const *argv, const void *options, void *context);
#define DECLARE_OBJECT(what) \
  int rcl_##what##_init(void **handle, const void *node, const void *type, const char *name, const void *options); \
  int rcl_##what##_fini(void **handle, void *node);
DECLARE_OBJECT(publisher)
DECLARE_OBJECT(subscription)
DECLARE_OBJECT(client)
DECLARE_OBJECT(service)
int rcl_timer_init2(void **timer, void *clock, void *context, int64_t period, const void *callback, allocator_t allocator, bool autostart);
int rcl_timer_fini(void **timer);
int rcl_timer_call(void **timer);
int rcl_timer_call_with_info(void **timer, void *info);
int rcl_publish(const void *publisher, const void *message, void *allocation);
int rcl_publish_loaned_message(const void *publisher, const void *message, void *allocation);
int rcl_publish_serialized_message(const void *publisher, const void *message, void *allocation);
int rcl_take(const void *subscription, void *message, info_t *info, void *allocation);
int rcl_take_loaned_message(const void *subscription, const void **message, info_t *info, void *allocation);
int rcl_take_serialized_message(const void *subscription, serialized_t *message, info_t *info, void *allocation);
int rcl_take_request_with_info(const void *service, request_info_t *info, void *message);
int rcl_take_response_with_info(const void *client, request_info_t *info, void *message);
int rcl_send_request(const void *client, const void *message, int64_t *number);
int rcl_send_response(const void *service, void *request, void *message);
int rcl_wait(void *set, int64_t timeout);
int rcl_trigger_guard_condition(void *condition);

bool ros_trace_enabled_rmw_publish(void);
void ros_trace_rmw_publish(const void *publisher, const void *message, int64_t source_ns);
void ros_trace_do_rmw_publish(const void *publisher, const void *message, int64_t source_ns);
void ros_trace_callback_start(const void *callback, bool within_process);
void ros_trace_callback_end(const void *callback);
void ros_trace_rclcpp_intra_publish(const void *publisher, const void *message);
void ros_trace_rclcpp_timer_link_node(const void *timer, const void *node);
void ros_trace_rclcpp_buffer_to_ipb(const void *buffer, const void *owner);
void ros_trace_rclcpp_ipb_to_subscription(const void *owner, const void *subscription);
void ros_trace_rclcpp_subscription_init(const void *handle, const void *subscription);
void ros_trace_rclcpp_ring_buffer_enqueue(const void *buffer, uint64_t place, uint64_t size, bool overwritten);
void ros_trace_rclcpp_ring_buffer_dequeue(const void *buffer, uint64_t place, uint64_t size);
