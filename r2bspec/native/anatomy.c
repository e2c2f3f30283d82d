/* Writes down what a process of the graph does with each message: preloaded, so that the program
 * needs no change.
 *
 * It has the names of functions of rcl and of libtracetools. Each calls the function whose place it
 * has taken, so that tracers and other preloaded objects still get theirs, and adds a row to a
 * mapped file: what was called, for which object, when, and the stamps of the message.
 *
 * A row costs no lock, no allocation and no call of the kernel. A thread claims a slab of rows by
 * one atomic addition and fills it alone; the kind of a row is written last, so that a reader knows
 * the finished ones, also those of a process that was killed. The whole file exists before the
 * first event. What has no room is counted. A forked child writes nothing.
 *
 * No header of ROS is used, so that it can be loaded wherever libc is: the structures are those of
 * Jazzy, of which only the first fields are read. `record/anatomy_files.py` reads the files.
 */
#include <stddef.h>
#include <string.h>

#include "anatomy_rows.h"
#include "next_function.h"

/* Objects begin and end. */

EXPORTED int rcl_init(int argc, char const *const *argv, const void *options, void *context)
{
  typedef int init_t(int, char const *const *, const void *, void *);
  NEXT(init_t, RCL, rcl_init);
  rows_open();
  return next == NULL ? NOT_FOUND : next(argc, argv, options, context);
}

typedef struct {
  const char *data;
  size_t size, capacity;
} string_t;

typedef struct {
  string_t name;
  uint8_t type_id;
  uint64_t capacity, string_capacity;
  string_t nested_type_name;
} field_t;

typedef struct {
  string_t type_name;
  const field_t *fields;
  size_t number_of_fields;
} description_t;

typedef struct type_support {
  const char *identifier;
  const void *data, *functions[2];
  const description_t *(*describe)(const struct type_support *);
} type_support_t;

#define ONE_MESSAGE 1 /* of another type, and no array of them */

/* Before types described themselves, type supports were shorter, and rcl had not this function. It
 * has described the type already, when its publisher or subscription was made. */
static bool begins_with_header(const type_support_t *type)
{
  NEXT(void, RCL, rcl_node_type_cache_register_type);
  const description_t *described =
    next == NULL || type->describe == NULL ? NULL : type->describe(type);
  return described != NULL && described->number_of_fields != 0 &&
         described->fields->type_id == ONE_MESSAGE &&
         described->fields->nested_type_name.data != NULL &&
         strcmp(described->fields->nested_type_name.data, "std_msgs/msg/Header") == 0;
}

typedef const char *name_t(const void *);

const char *node_name(const void *node)
{
  NEXT(name_t, RCL, rcl_node_get_fully_qualified_name);
  return next == NULL ? NULL : next(node);
}

/* Of an action: what begins with the id of a goal. Status and responses do not. */
static bool begins_with_goal(const char *name)
{
  const char *of_action = name == NULL ? NULL : strstr(name, "/_action/");
  return of_action != NULL && (strcmp(of_action, "/_action/send_goal") == 0 ||
                               strcmp(of_action, "/_action/get_result") == 0 ||
                               strcmp(of_action, "/_action/feedback") == 0);
}

#define OBJECT(what, kind, name_function, type_of_messages)                                    \
  EXPORTED int rcl_##what##_init(                                                              \
    void *handle, const void *node, const type_support_t *type, const char *name,              \
    const void *options)                                                                       \
  {                                                                                            \
    typedef int init_t(void *, const void *, const void *, const char *, const void *);        \
    NEXT(init_t, RCL, rcl_##what##_init);                                                      \
    const int status = next == NULL ? NOT_FOUND : next(handle, node, type, name, options);     \
    if (status == 0 && rows_are_open()) {                                                      \
      NEXT(name_t, RCL, name_function);                                                        \
      const uint32_t object = object_add(kind, key_of(handle));                                \
      const char *full_name = next == NULL ? name : next(handle);                              \
      object_name(object, full_name, node_name(node));                                         \
      if (object != 0 && begins_with_goal(full_name)) {                                        \
        object_set(key_of(handle), object | HAS_GOAL);                                         \
      } else if (object != 0 && (type_of_messages) && begins_with_header(type)) {              \
        object_set(key_of(handle), object | HAS_HEADER);                                       \
      }                                                                                        \
    }                                                                                          \
    return status;                                                                             \
  }                                                                                            \
  EXPORTED int rcl_##what##_fini(void *handle, void *node)                                     \
  {                                                                                            \
    typedef int fini_t(void *, void *);                                                        \
    NEXT(fini_t, RCL, rcl_##what##_fini);                                                      \
    object_set(key_of(handle), 0);                                                             \
    return next == NULL ? NOT_FOUND : next(handle, node);                                      \
  }

OBJECT(publisher, PUBLISHER, rcl_publisher_get_topic_name, true)
OBJECT(subscription, SUBSCRIPTION, rcl_subscription_get_topic_name, true)
OBJECT(client, CLIENT, rcl_client_get_service_name, false)
OBJECT(service, SERVICE, rcl_service_get_service_name, false)

/* It is passed by value. */
typedef struct {
  void *members[5];
} allocator_t;

/* rcl_timer_init calls it, too. */
EXPORTED int rcl_timer_init2(
  void *timer, void *clock, void *context, int64_t period, const void *callback,
  allocator_t allocator, bool autostart)
{
  typedef int init_t(void *, void *, void *, int64_t, const void *, allocator_t, bool);
  NEXT(init_t, RCL, rcl_timer_init2);
  const int status =
    next == NULL ? NOT_FOUND : next(timer, clock, context, period, callback, allocator, autostart);
  if (status == 0) {
    (void)object_add(TIMER_OBJECT, key_of(timer));
  }
  return status;
}

EXPORTED int rcl_timer_fini(void *timer)
{
  typedef int fini_t(void *);
  NEXT(fini_t, RCL, rcl_timer_fini);
  object_set(key_of(timer), 0);
  return next == NULL ? NOT_FOUND : next(timer);
}

/* Messages. */

typedef struct {
  const uint8_t *buffer;
  size_t length;
} serialized_t;

/* A header begins with its stamp, in C, in C++, and after the four bytes that say how the fields of
 * a serialized message are encoded. */
int64_t read_stamp(const void *handle, const void *message, enum form form)
{
  uint32_t words[2] = {0, 0};
  const serialized_t *serialized = (const serialized_t *)message;
  const uint32_t object = message == NULL ? 0 : object_find(key_of(handle));
  const bool is_goal = (object & HAS_GOAL) != 0;
  if (!is_goal && (object & HAS_HEADER) == 0) {
    return 0;
  }
  if (form != SERIALIZED) {
    memcpy(words, form == LOANED ? key_of(message) : message, sizeof(words));
  } else if (serialized->length >= 4 + sizeof(words)) {
    memcpy(words, serialized->buffer + 4, sizeof(words));
    if (!is_goal && (serialized->buffer[1] & 1) == 0) {
      words[0] = __builtin_bswap32(words[0]);
      words[1] = __builtin_bswap32(words[1]);
    }
  }
  if (is_goal) {
    /* Half of a random UUID, and no longer than times are. */
    return (int64_t)(words[1] & UINT32_C(0x3fffffff)) << 32 | words[0];
  }
  return words[1] < NS_PER_S ? (int32_t)words[0] * NS_PER_S + words[1] : 0;
}

#define PUBLISHES(name, form)                                                                  \
  EXPORTED int name(const void *publisher, const void *message, void *allocation)              \
  {                                                                                            \
    typedef int publish_t(const void *, const void *, void *);                                 \
    NEXT(publish_t, RCL, name);                                                                \
    row_t event = begin_event(publisher);                                                      \
    event.header_ns = read_stamp(publisher, message, form);                                    \
    thread_now.source_ns = 0;                                                                  \
    const int status = next == NULL ? NOT_FOUND : next(publisher, message, allocation);        \
    event.source_ns = thread_now.source_ns;                                                    \
    return end_event(PUBLISH, &event, status);                                                 \
  }

PUBLISHES(rcl_publish, STRUCTURE)
PUBLISHES(rcl_publish_loaned_message, STRUCTURE)
PUBLISHES(rcl_publish_serialized_message, SERIALIZED)

/* The first fields of rmw_message_info_t, and room for the others. */
typedef struct {
  int64_t source_ns, received_ns;
  char others[240];
} message_info_t;

#define TAKES(name, form)                                                                      \
  EXPORTED int name(                                                                           \
    const void *subscription, void *message, message_info_t *info, void *allocation)           \
  {                                                                                            \
    typedef int take_t(const void *, void *, message_info_t *, void *);                        \
    NEXT(take_t, RCL, name);                                                                   \
    message_info_t own;                                                                        \
    info = info == NULL ? &own : info;                                                         \
    row_t event = begin_event(subscription);                                                   \
    const int status = next == NULL ? NOT_FOUND : next(subscription, message, info, allocation); \
    if (status != 0) {                                                                         \
      event.flags = TOOK_NOTHING;                                                              \
      return end_event(TAKE, &event, status);                                                  \
    }                                                                                          \
    thread_now.taken_from = event.object;                                                      \
    event.source_ns = info->source_ns;                                                         \
    event.received_ns = info->received_ns;                                                     \
    event.header_ns = read_stamp(subscription, message, form);                                 \
    return end_event(TAKE, &event, status);                                                    \
  }

TAKES(rcl_take, STRUCTURE)
TAKES(rcl_take_loaned_message, LOANED)
TAKES(rcl_take_serialized_message, SERIALIZED)

/* Services. A request has a number, after the id of its client. */

typedef struct {
  uint8_t client[16];
  int64_t number;
} request_t;

typedef struct {
  int64_t source_ns, received_ns;
  request_t request;
} request_info_t;

/* The functions without the information call these, too. */
#define TAKES_REQUESTS(name, kind)                                                             \
  EXPORTED int name(const void *from, request_info_t *info, void *message)                     \
  {                                                                                            \
    typedef int take_t(const void *, request_info_t *, void *);                                \
    NEXT(take_t, RCL, name);                                                                   \
    row_t event = begin_event(from);                                                           \
    const int status = next == NULL ? NOT_FOUND : next(from, info, message);                   \
    if (status != 0) {                                                                         \
      event.flags = TOOK_NOTHING;                                                              \
      return end_event(kind, &event, status);                                                  \
    }                                                                                          \
    thread_now.taken_from = event.object;                                                      \
    event.source_ns = info->request.number;                                                    \
    event.received_ns = info->received_ns;                                                     \
    event.header_ns = kind == TAKE_REQUEST ? read_stamp(from, message, STRUCTURE) : 0;         \
    return end_event(kind, &event, status);                                                    \
  }

TAKES_REQUESTS(rcl_take_request_with_info, TAKE_REQUEST)
TAKES_REQUESTS(rcl_take_response_with_info, TAKE_RESPONSE)

EXPORTED int rcl_send_request(const void *client, const void *request, int64_t *number)
{
  typedef int send_t(const void *, const void *, int64_t *);
  NEXT(send_t, RCL, rcl_send_request);
  row_t event = begin_event(client);
  event.header_ns = read_stamp(client, request, STRUCTURE);
  const int status = next == NULL ? NOT_FOUND : next(client, request, number);
  event.source_ns = status == 0 ? *number : 0;
  return end_event(SEND_REQUEST, &event, status);
}

EXPORTED int rcl_send_response(const void *service, request_t *request, void *response)
{
  typedef int send_t(const void *, request_t *, void *);
  NEXT(send_t, RCL, rcl_send_response);
  row_t event = begin_event(service);
  const int status = next == NULL ? NOT_FOUND : next(service, request, response);
  event.source_ns = status == 0 ? request->number : 0;
  return end_event(SEND_RESPONSE, &event, status);
}

/* Executors. */

EXPORTED int rcl_wait(void *wait_set, int64_t timeout)
{
  typedef int wait_t(void *, int64_t);
  NEXT(wait_t, RCL, rcl_wait);
  row_t event = begin_event(NULL);
  return end_event(WAIT, &event, next == NULL ? NOT_FOUND : next(wait_set, timeout));
}

EXPORTED int rcl_trigger_guard_condition(void *condition)
{
  typedef int trigger_t(void *);
  NEXT(trigger_t, RCL, rcl_trigger_guard_condition);
  row_t event = begin_event(NULL);
  return end_event(TRIGGER, &event, next == NULL ? NOT_FOUND : next(condition));
}

/* rcl_timer_call calls it, too. */
EXPORTED int rcl_timer_call_with_info(void *timer, void *info)
{
  typedef int call_t(void *, void *);
  NEXT(call_t, RCL, rcl_timer_call_with_info);
  row_t event = begin_event(timer);
  thread_now.taken_from = event.object;
  return end_event(TIMER, &event, next == NULL ? NOT_FOUND : next(timer, info));
}
