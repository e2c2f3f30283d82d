/* The functions of libtracetools: what happens inside of rcl and rclcpp. */
#include <stddef.h>

#include "anatomy_rows.h"
#include "next_function.h"

#define TRACETOOLS "libtracetools.so"

/* The middleware has stamped the message that this thread publishes. */
#define STAMPS(name, if_traced)                                                                \
  EXPORTED void name(const void *publisher, const void *message, int64_t source_ns)            \
  {                                                                                            \
    typedef void traced_t(const void *, const void *, int64_t);                                \
    NEXT(traced_t, TRACETOOLS, name);                                                          \
    thread_now.source_ns = source_ns;                                                          \
    if (next != NULL && (if_traced)) {                                                         \
      next(publisher, message, source_ns);                                                     \
    }                                                                                          \
  }

static bool is_traced(void)
{
  typedef bool enabled_t(void);
  NEXT(enabled_t, TRACETOOLS, ros_trace_enabled_rmw_publish);
  return next != NULL && next();
}

EXPORTED bool ros_trace_enabled_rmw_publish(void)
{
  return rows_are_open() || is_traced();
}

STAMPS(ros_trace_rmw_publish, true)
STAMPS(ros_trace_do_rmw_publish, is_traced())

/* Callbacks of rclcpp, which may be inside each other. One that an exception has left has no end. */

static _Thread_local struct {
  unsigned count;
  struct {
    const void *callback;
    int64_t began_ns;
    uint32_t object;
  } of[8];
} callbacks;

EXPORTED void ros_trace_callback_start(const void *callback, bool within_process)
{
  typedef void traced_t(const void *, bool);
  NEXT(traced_t, TRACETOOLS, ros_trace_callback_start);
  const unsigned at = callbacks.count % (sizeof(callbacks.of) / sizeof(*callbacks.of));
  if (next != NULL) {
    next(callback, within_process);
  }
  callbacks.count = at + 1;
  callbacks.of[at].callback = callback;
  callbacks.of[at].object = thread_now.taken_from;
  callbacks.of[at].began_ns = now_ns();
}

EXPORTED void ros_trace_callback_end(const void *callback)
{
  typedef void traced_t(const void *);
  NEXT(traced_t, TRACETOOLS, ros_trace_callback_end);
  row_t event = begin_event(NULL);
  unsigned count = callbacks.count;
  while (count > 0 && callbacks.of[count - 1].callback != callback) {
    count--;
  }
  if (count > 0) {
    callbacks.count = count - 1;
    event.object = callbacks.of[count - 1].object;
    event.ended_ns = event.began_ns;
    event.began_ns = callbacks.of[count - 1].began_ns;
    rows_add(CALLBACK, &event);
  }
  if (next != NULL) {
    next(callback);
  }
}

/* What C++ nodes of one process hand to each other. A buffer becomes known by its own address, its
 * owner's and its subscription's, in the order in which these are constructed. */

#define TRACES(name, first, second, action)                                                    \
  EXPORTED void name(const void *first, const void *second)                                    \
  {                                                                                            \
    typedef void traced_t(const void *, const void *);                                         \
    NEXT(traced_t, TRACETOOLS, name);                                                          \
    if (rows_are_open()) {                                                                     \
      action;                                                                                  \
    }                                                                                          \
    if (next != NULL) {                                                                        \
      next(first, second);                                                                     \
    }                                                                                          \
  }

static void publish_within(const void *publisher, const void *message)
{
  row_t event = begin_event(publisher);
  event.flags = WITHIN_PROCESS;
  event.header_ns = read_stamp(publisher, message, STRUCTURE);
  (void)end_event(PUBLISH, &event, 0);
}

TRACES(ros_trace_rclcpp_intra_publish, publisher, message, publish_within(publisher, message))
TRACES(ros_trace_rclcpp_timer_link_node, timer, node,
       object_name(object_find(key_of(timer)), NULL, node_name(node)))
TRACES(ros_trace_rclcpp_buffer_to_ipb, buffer, owner, object_set(owner, object_add(BUFFER, buffer)))
TRACES(ros_trace_rclcpp_ipb_to_subscription, owner, subscription,
       object_set(subscription, object_find(owner)))
TRACES(ros_trace_rclcpp_subscription_init, handle, subscription,
       object_name_like(object_find(subscription), object_find(key_of(handle))))

/* The place in the buffer says which message it was. */
static void pass_buffer(uint16_t kind, const void *buffer, uint64_t place)
{
  row_t event = begin_event(&buffer);
  event.flags = WITHIN_PROCESS;
  event.source_ns = (int64_t)place;
  thread_now.taken_from = kind == DEQUEUE ? event.object : thread_now.taken_from;
  (void)end_event(kind, &event, 0);
}

EXPORTED void ros_trace_rclcpp_ring_buffer_enqueue(
  const void *buffer, uint64_t place, uint64_t size, bool overwritten)
{
  typedef void traced_t(const void *, uint64_t, uint64_t, bool);
  NEXT(traced_t, TRACETOOLS, ros_trace_rclcpp_ring_buffer_enqueue);
  pass_buffer(ENQUEUE, buffer, place);
  if (next != NULL) {
    next(buffer, place, size, overwritten);
  }
}

EXPORTED void ros_trace_rclcpp_ring_buffer_dequeue(
  const void *buffer, uint64_t place, uint64_t size)
{
  typedef void traced_t(const void *, uint64_t, uint64_t);
  NEXT(traced_t, TRACETOOLS, ros_trace_rclcpp_ring_buffer_dequeue);
  pass_buffer(DEQUEUE, buffer, place);
  if (next != NULL) {
    next(buffer, place, size);
  }
}
