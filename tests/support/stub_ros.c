/* Functions with the names of rcl and of libtracetools, to be called through a preloaded object.
 * Handles are pointers to a pointer, as those of rcl; the middleware stamps messages 1, 2, 3, ... */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "stub_ros.h"

#pragma GCC visibility push(default)

#ifdef STUB_TRACETOOLS

/* Whether all tracepoints have been called on, each as often as rcl or rclcpp calls it. */
_Atomic int traced;

void ros_trace_rmw_publish(const void *a, const void *b, int64_t c) { (void)a; (void)b; traced += c != 0; }
void ros_trace_do_rmw_publish(const void *a, const void *b, int64_t c) { (void)a; (void)b; traced += c != 0; }
bool ros_trace_enabled_rmw_publish(void) { return getenv("STUB_TRACED") != NULL; }
void ros_trace_callback_start(const void *a, bool b) { (void)b; traced += a != NULL; }
void ros_trace_callback_end(const void *a) { traced += a != NULL; }
#define PAIR(name) void ros_trace_##name(const void *a, const void *b) { traced += a != NULL && b != NULL; }
PAIR(rclcpp_intra_publish)
PAIR(rclcpp_timer_link_node)
PAIR(rclcpp_buffer_to_ipb)
PAIR(rclcpp_ipb_to_subscription)
PAIR(rclcpp_subscription_init)
void ros_trace_rclcpp_ring_buffer_enqueue(const void *a, uint64_t b, uint64_t c, bool d) { traced += a != NULL && b < c && d; }
void ros_trace_rclcpp_ring_buffer_dequeue(const void *a, uint64_t b, uint64_t c) { traced += a != NULL && b < c; }

#else

static _Atomic int64_t stamps;

int rcl_init(int a, char const *const *b, const void *c, void *d) { (void)a; (void)b; (void)c; (void)d; return 0; }
int rcl_node_type_cache_register_type(void) { return 0; }
const char *rcl_node_get_fully_qualified_name(const void *node) { return node; }

typedef struct { char name[64]; } implementation_t;
static int make(void **handle, const char *name)
{
  implementation_t *made = calloc(1, sizeof(implementation_t));
  snprintf(made->name, sizeof(made->name), "/resolved/%s", name);
  *handle = made;
  return 0;
}
static int end(void **handle) { free(*handle); *handle = NULL; return 0; }

#define OBJECT(what, name_function)                                                             \
  int rcl_##what##_init(void **h, const void *n, const void *t, const char *name, const void *o) \
  { (void)n; (void)t; (void)o; return make(h, name); }                                           \
  int rcl_##what##_fini(void **h, void *n) { (void)n; return end(h); }                           \
  const char *name_function(void **h) { return ((implementation_t *)*h)->name; }
OBJECT(publisher, rcl_publisher_get_topic_name)
OBJECT(subscription, rcl_subscription_get_topic_name)
OBJECT(client, rcl_client_get_service_name)
OBJECT(service, rcl_service_get_service_name)

int rcl_timer_init2(void **t, void *c, void *x, int64_t p, const void *f, allocator_t a, bool s)
{
  (void)c; (void)x; (void)f;
  return a.members[0] == t && a.members[4] == t && p == 7 && s ? make(t, "") : 1;
}
int rcl_timer_fini(void **t) { return end(t); }
int rcl_timer_call_with_info(void **t, void *i) { (void)i; return *t == NULL; }
int rcl_timer_call(void **t) { int info; return rcl_timer_call_with_info(t, &info); }

#define PUBLISH(name) int name(const void *p, const void *m, void *a) { (void)a; ros_trace_rmw_publish(p, m, ++stamps); return 0; }
PUBLISH(rcl_publish)
PUBLISH(rcl_publish_loaned_message)
int rcl_publish_serialized_message(const void *p, const void *m, void *a)
{
  (void)a;
  if (ros_trace_enabled_rmw_publish()) {
    ros_trace_do_rmw_publish(p, m, ++stamps);
  }
  return 0;
}

static int fill(info_t *info, int status)
{
  *info = (info_t){.source_ns = 1000, .received_ns = 2000, .sequence = {3, 4}, .intra = true};
  return status;
}
static const int32_t loaned[2] = {5, 6};
int rcl_take(const void *s, void *m, info_t *i, void *a)
{
  (void)s; (void)a;
  if (m == NULL) { return fill(i, 401); }
  memcpy(m, (int32_t[2]){3, 4}, 8);
  return fill(i, 0);
}
int rcl_take_loaned_message(const void *s, const void **m, info_t *i, void *a) { (void)s; (void)a; *m = loaned; return fill(i, 0); }
int rcl_take_serialized_message(const void *s, serialized_t *m, info_t *i, void *a)
{
  static uint8_t data[] = {0, 0, 0, 0, 0, 0, 0, 7, 0, 0, 0, 8}; /* big-endian */
  (void)s; (void)a;
  m->buffer = data;
  m->length = sizeof(data);
  return fill(i, 0);
}

#define TAKE_REQUEST(name) int name(const void *s, request_info_t *i, void *m) { (void)s; *i = (request_info_t){1, 2, {{0}, 42}}; return m == NULL ? 601 : 0; }
TAKE_REQUEST(rcl_take_request_with_info)
TAKE_REQUEST(rcl_take_response_with_info)
int rcl_send_request(const void *c, const void *m, int64_t *n) { (void)c; (void)m; *n = 42; return 0; }
int rcl_send_response(const void *c, void *i, void *m) { (void)c; (void)i; (void)m; return 0; }
int rcl_wait(void *s, int64_t t) { (void)s; return t == 5 ? 2 : 0; }
int rcl_trigger_guard_condition(void *c) { (void)c; return 0; }

#endif
