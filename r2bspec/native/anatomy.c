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
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include "next_function.h"

#define FOLDER_VARIABLE "R2BSPEC_ANATOMY_FOLDER"
#define PROCESS_VARIABLE "R2BSPEC_ANATOMY_PROCESS"
#define BYTES_VARIABLE "R2BSPEC_ANATOMY_BYTES"

#define MAGIC "R2BROWS1"
#define OBJECTS 2048
#define SLAB_ROWS 256
#define NAME_BYTES 256
#define NS_PER_S INT64_C(1000000000)

/* `AnatomyKind` of record/run_record.py. */
enum { PUBLISH = 1, TAKE, CALLBACK, TRIGGER, WAIT, TIMER, SEND_REQUEST, TAKE_REQUEST, SEND_RESPONSE,
       TAKE_RESPONSE, ENQUEUE, DEQUEUE };
enum { TOOK_NOTHING = 1, WITHIN_PROCESS = 2 };
enum { PUBLISHER = 1, SUBSCRIPTION, TIMER_OBJECT, CLIENT, SERVICE, BUFFER };

/* `ANATOMY_FIELDS` of record/sample_arrays.py. */
typedef struct {
  uint32_t object, process, thread;
  _Atomic uint16_t kind;
  uint16_t flags;
  int64_t began_ns, ended_ns, source_ns, received_ns, header_ns, clock_ns;
} row_t;
_Static_assert(sizeof(row_t) == 64, "a row is a line of the processor's cache");

typedef struct {
  uint32_t kind;
  char name[NAME_BYTES], node[NAME_BYTES];
} object_t;

typedef struct {
  char magic[8];
  uint32_t pid, slabs;
  char process[NAME_BYTES];
  _Alignas(64) _Atomic uint32_t claimed_slabs;
  _Atomic uint32_t objects;
  _Atomic uint64_t lost;
  _Alignas(4096) object_t object[OBJECTS];
  _Alignas(4096) row_t rows[];
} file_t;

/* NULL: nothing is written. */
static _Atomic(file_t *) opened;

/* What a thread has for itself. */
static _Thread_local struct {
  row_t *row, *end; /* the rest of its slab */
  uint32_t id;
  uint32_t taken_from;   /* the object whose callback is called next */
  int64_t source_ns;     /* of the message that is being published */
  int64_t clock_ns;      /* the system clock less the monotonic one, */
  int64_t compared_ns;   /* which is asked for at most every CLOCK_VALID_NS */
  const void *inside_of; /* the timer or service of the call that this thread is in */
  unsigned callbacks;
  struct {
    const void *callback;
    int64_t began_ns;
    uint32_t object;
  } callback[8];
} me;

#define CLOCK_VALID_NS (10 * 1000 * 1000)
#define CLOSE_NS 500

static int64_t read_clock(clockid_t clock)
{
  struct timespec time;
  clock_gettime(clock, &time);
  return time.tv_sec * NS_PER_S + time.tv_nsec;
}

static int64_t now_ns(void)
{
  return read_clock(CLOCK_MONOTONIC);
}

/* This thread may be interrupted between two clocks: the closest of three readings counts. */
static void compare_clocks(int64_t now)
{
  int64_t closest = INT64_MAX;
  for (int i = 0; i < 3 && closest > CLOSE_NS; i++) {
    const int64_t before = now_ns(), system = read_clock(CLOCK_REALTIME), apart = now_ns() - before;
    if (apart < closest) {
      closest = apart;
      me.clock_ns = system - before - apart / 2;
    }
  }
  me.compared_ns = now;
}

static bool claim_slab(file_t *file)
{
  /* A file that is full stays so: the number of claims must not start again at zero. */
  const bool full =
    atomic_load_explicit(&file->claimed_slabs, memory_order_relaxed) >= file->slabs;
  const uint32_t slab =
    full ? file->slabs : atomic_fetch_add_explicit(&file->claimed_slabs, 1, memory_order_relaxed);
  if (slab >= file->slabs) {
    atomic_fetch_add_explicit(&file->lost, 1, memory_order_relaxed);
    return false;
  }
  me.id = me.id != 0 ? me.id : (uint32_t)syscall(SYS_gettid);
  me.row = file->rows + (size_t)slab * SLAB_ROWS;
  me.end = me.row + SLAB_ROWS;
  return true;
}

/* Adds a row; its times are those of `event`. */
static void write_row(uint16_t kind, const row_t *event)
{
  file_t *file = atomic_load_explicit(&opened, memory_order_relaxed);
  if (file == NULL || (me.row == me.end && !claim_slab(file))) {
    return;
  }
  if (event->ended_ns - me.compared_ns > CLOCK_VALID_NS) {
    compare_clocks(event->ended_ns);
  }
  row_t *row = me.row++;
  row->object = event->object;
  row->thread = me.id;
  row->flags = event->flags;
  row->began_ns = event->began_ns;
  row->ended_ns = event->ended_ns;
  row->source_ns = event->source_ns;
  row->received_ns = event->received_ns;
  row->header_ns = event->header_ns;
  row->clock_ns = me.clock_ns;
  atomic_store_explicit(&row->kind, kind, memory_order_release);
}

static bool is_open(void)
{
  return atomic_load_explicit(&opened, memory_order_relaxed) != NULL;
}

/* An event without a duration. */
static void write_moment(uint16_t kind, uint32_t object, uint16_t flags, int64_t source_ns)
{
  const int64_t now = now_ns();
  write_row(kind, &(row_t){.object = object, .flags = flags, .began_ns = now, .ended_ns = now,
                           .source_ns = source_ns});
}

/* Functions that are called on. */

typedef struct {
  const char *name, *library;
  _Atomic(void *) function;
} next_t;

#define RCL "librcl.so"
#define TRACETOOLS "libtracetools.so"
#define NOT_FOUND 1 /* RCL_RET_ERROR */
#define EXPORTED __attribute__((visibility("default")))

static void *next_of(next_t *next)
{
  void *function = atomic_load_explicit(&next->function, memory_order_relaxed);
  if (__builtin_expect(function == NULL, 0)) {
    function = next_function(next->name, next->library);
    atomic_store_explicit(&next->function, function, memory_order_relaxed);
  }
  return function;
}

/* The function of this name, as one of a type. */
#define NEXT(type, from, called)                              \
  static next_t called##_next = {.name = #called, .library = from}; \
  type *const next = (type *)next_of(&called##_next)

/* The objects of this process: which number and type has a handle? Handles of rcl are known by what
 * they point to, because a program may copy them. A slot keeps its key for ever. */

#define SLOTS 16384
#define MAX_PROBES 64
#define HAS_HEADER (UINT32_C(1) << 31)

typedef struct {
  _Atomic(const void *) key;
  _Atomic uint32_t object; /* and HAS_HEADER; 0 after its end */
} slot_t;

static slot_t slots[SLOTS];

static slot_t *find_slot(const void *key, bool add)
{
  size_t at = (size_t)(((uintptr_t)key >> 4) * UINT64_C(0x9e3779b97f4a7c15) >> 50);
  for (int probe = 0; key != NULL && probe < MAX_PROBES; probe++, at++) {
    slot_t *slot = &slots[at % SLOTS];
    const void *found = atomic_load_explicit(&slot->key, memory_order_acquire);
    if (found == key ||
        (found == NULL && add &&
         (atomic_compare_exchange_strong(&slot->key, &found, key) || found == key))) {
      return slot;
    }
    if (found == NULL && !add) {
      break;
    }
  }
  return NULL;
}

static const void *key_of(const void *handle)
{
  return handle == NULL ? NULL : *(void *const *)handle;
}

static uint32_t find_object(const void *key)
{
  slot_t *slot = find_slot(key, false);
  return slot == NULL ? 0 : atomic_load_explicit(&slot->object, memory_order_relaxed);
}

static void set_object(const void *key, uint32_t object)
{
  slot_t *slot = find_slot(key, true);
  if (slot != NULL) {
    atomic_store_explicit(&slot->object, object, memory_order_release);
  }
}

static void copy_name(char *target, const char *name)
{
  snprintf(target, NAME_BYTES, "%s", name == NULL ? "" : name);
}

static const char *node_name(const void *node)
{
  typedef const char *name_t(const void *);
  NEXT(name_t, RCL, rcl_node_get_fully_qualified_name);
  return next == NULL || node == NULL ? NULL : next(node);
}

static void add_object(uint32_t kind, const void *key, const char *name, const void *node, bool has_header)
{
  file_t *file = atomic_load_explicit(&opened, memory_order_relaxed);
  if (file == NULL || key == NULL) {
    return;
  }
  const bool full = atomic_load_explicit(&file->objects, memory_order_relaxed) >= OBJECTS;
  const uint32_t index = full ? OBJECTS : atomic_fetch_add(&file->objects, 1);
  if (index >= OBJECTS) {
    /* Its events remain, of an object that nobody knows. */
    atomic_fetch_add(&file->lost, 1);
    set_object(key, has_header ? HAS_HEADER : 0);
    return;
  }
  object_t *object = &file->object[index];
  copy_name(object->name, name);
  copy_name(object->node, node_name(node));
  object->kind = kind;
  set_object(key, (index + 1) | (has_header ? HAS_HEADER : 0));
}

static object_t *known_object(const void *key, uint32_t kind)
{
  file_t *file = atomic_load_explicit(&opened, memory_order_relaxed);
  const uint32_t number = find_object(key) & ~HAS_HEADER;
  object_t *object = file == NULL || number == 0 ? NULL : &file->object[number - 1];
  return object == NULL || object->kind != kind ? NULL : object;
}

/* Header stamps. */

typedef struct {
  const char *data;
  size_t size, capacity;
} string_t;

typedef struct {
  string_t name;
  struct {
    uint8_t type_id;
    uint64_t capacity, string_capacity;
    string_t nested_type_name;
  } type;
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

/* Other distributions have shorter type supports. rcl has this function since there are types that
 * describe themselves, and has described this one when its publisher or subscription was made. */
static bool begins_with_header(const type_support_t *type)
{
  NEXT(void, RCL, rcl_node_type_cache_register_type);
  const description_t *described =
    next == NULL || type == NULL || type->describe == NULL ? NULL : type->describe(type);
  return described != NULL && described->number_of_fields != 0 &&
         described->fields[0].type.nested_type_name.data != NULL &&
         strcmp(described->fields[0].type.nested_type_name.data, "std_msgs/msg/Header") == 0;
}

enum form { STRUCTURE, LOANED, SERIALIZED, OPAQUE };

typedef struct {
  const uint8_t *buffer;
  size_t length;
} serialized_t;

/* A header begins with its stamp, in C, in C++, and after the four bytes that say how the fields of
 * a serialized message are encoded. Another type that an intra-process publisher may have has none. */
static int64_t read_header(uint32_t object, const void *message, enum form form)
{
  const serialized_t *serialized = (const serialized_t *)message;
  uint32_t words[2] = {0, 0};
  if ((object & HAS_HEADER) == 0 || message == NULL || form == OPAQUE) {
    return 0;
  }
  if (form != SERIALIZED) {
    memcpy(words, form == LOANED ? key_of(message) : message, sizeof(words));
  } else if (serialized->length >= 4 + sizeof(words)) {
    memcpy(words, serialized->buffer + 4, sizeof(words));
    if ((serialized->buffer[1] & 1) == 0) {
      words[0] = __builtin_bswap32(words[0]);
      words[1] = __builtin_bswap32(words[1]);
    }
  }
  return words[1] < NS_PER_S ? (int32_t)words[0] * NS_PER_S + words[1] : 0;
}

/* The file. */

static void stop_writing(void)
{
  atomic_store(&opened, NULL);
}

static file_t *map_file(const char *path, size_t bytes)
{
  const int flags = O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC;
  const int fd = open(path, flags, 0600);
  if (fd < 0) {
    return NULL;
  }
  void *mapped = MAP_FAILED;
  errno = posix_fallocate(fd, 0, (off_t)bytes);
  if (errno == 0) {
    mapped = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, fd, 0);
  }
  const int reason = errno;
  close(fd);
  if (mapped == MAP_FAILED) {
    unlink(path);
    errno = reason;
    return NULL;
  }
  /* No row is the first to write to its page. */
  for (size_t at = 0; at < bytes; at += 4096) {
    ((volatile char *)mapped)[at] = 0;
  }
  return (file_t *)mapped;
}

static void open_file(const char *folder, const char *process, const char *size)
{
  char path[PATH_MAX], name[NAME_BYTES];
  const uint64_t bytes = strtoull(size, NULL, 10);
  const uint64_t slabs =
    bytes < sizeof(file_t) ? 0 : (bytes - sizeof(file_t)) / (SLAB_ROWS * sizeof(row_t));
  copy_name(name, process);
  for (char *at = name; (at = strchr(at, '/')) != NULL;) {
    *at = '%';
  }
  const int length = snprintf(path, sizeof(path), "%s/%s.%d.rows", folder, name, (int)getpid());
  errno = length >= (int)sizeof(path) ? ENAMETOOLONG : slabs > UINT32_MAX ? EFBIG : ENOSPC;
  file_t *file =
    slabs == 0 || slabs > UINT32_MAX || length >= (int)sizeof(path) ? NULL : map_file(path, bytes);
  if (file == NULL || pthread_atfork(NULL, NULL, stop_writing) != 0) {
    fprintf(stderr, "r2bspec cannot observe this process: %s: %s\n", path, strerror(errno));
    return;
  }
  file->pid = (uint32_t)getpid();
  file->slabs = (uint32_t)slabs;
  copy_name(file->process, process);
  memcpy(file->magic, MAGIC, sizeof(file->magic));
  atomic_store(&opened, file);
}

EXPORTED int rcl_init(int argc, char const *const *argv, const void *options, void *context)
{
  typedef int init_t(int, char const *const *, const void *, void *);
  NEXT(init_t, RCL, rcl_init);
  static atomic_flag asked = ATOMIC_FLAG_INIT;
  const char *folder = getenv(FOLDER_VARIABLE), *process = getenv(PROCESS_VARIABLE);
  const char *size = getenv(BYTES_VARIABLE);
  if (folder != NULL && process != NULL && size != NULL && !atomic_flag_test_and_set(&asked)) {
    open_file(folder, process, size);
  }
  return next == NULL ? NOT_FOUND : next(argc, argv, options, context);
}

/* Objects begin and end. */

typedef int init_object_t(void *, const void *, const type_support_t *, const char *, const void *);
typedef int end_object_t(void *, void *);
typedef const char *object_name_t(const void *);

#define OBJECT(what, object_kind, name_function, of_messages)                                     \
  EXPORTED int rcl_##what##_init(                                                                 \
    void *handle, const void *node, const type_support_t *type, const char *name,                 \
    const void *options)                                                                          \
  {                                                                                               \
    NEXT(init_object_t, RCL, rcl_##what##_init);                                                  \
    const int status = next == NULL ? NOT_FOUND : next(handle, node, type, name, options);        \
    if (status == 0 && is_open()) {                                                               \
      NEXT(object_name_t, RCL, name_function);                                                    \
      add_object(                                                                                 \
        object_kind, key_of(handle), next == NULL ? name : next(handle), node,                    \
        of_messages && begins_with_header(type));                                                 \
    }                                                                                             \
    return status;                                                                                \
  }                                                                                               \
  EXPORTED int rcl_##what##_fini(void *handle, void *node)                                        \
  {                                                                                               \
    NEXT(end_object_t, RCL, rcl_##what##_fini);                                                   \
    forget_object(handle);                                                                        \
    return next == NULL ? NOT_FOUND : next(handle, node);                                         \
  }

static void forget_object(const void *handle)
{
  slot_t *slot = is_open() ? find_slot(key_of(handle), false) : NULL;
  if (slot != NULL) {
    atomic_store_explicit(&slot->object, 0, memory_order_release);
  }
}

OBJECT(publisher, PUBLISHER, rcl_publisher_get_topic_name, true)
OBJECT(subscription, SUBSCRIPTION, rcl_subscription_get_topic_name, true)
OBJECT(client, CLIENT, rcl_client_get_service_name, false)
OBJECT(service, SERVICE, rcl_service_get_service_name, false)

/* Of five pointers; it is passed by value. */
typedef struct {
  void *members[5];
} allocator_t;
typedef int init_timer_t(void *, void *, void *, int64_t, const void *, allocator_t, bool);

/* rcl_timer_init calls it, too. */
EXPORTED int rcl_timer_init2(
  void *timer, void *clock, void *context, int64_t period, const void *callback,
  allocator_t allocator, bool autostart)
{
  NEXT(init_timer_t, RCL, rcl_timer_init2);
  const int status =
    next == NULL ? NOT_FOUND : next(timer, clock, context, period, callback, allocator, autostart);
  if (status == 0) {
    add_object(TIMER_OBJECT, key_of(timer), "", NULL, false);
  }
  return status;
}

EXPORTED int rcl_timer_fini(void *timer)
{
  typedef int end_timer_t(void *);
  NEXT(end_timer_t, RCL, rcl_timer_fini);
  forget_object(timer);
  return next == NULL ? NOT_FOUND : next(timer);
}

/* Messages. */

typedef int publish_t(const void *, const void *, void *);

static int publish(
  publish_t *next, const void *publisher, const void *message, void *allocation, enum form form)
{
  if (next == NULL || !is_open()) {
    return next == NULL ? NOT_FOUND : next(publisher, message, allocation);
  }
  const uint32_t object = find_object(key_of(publisher));
  row_t event = {.object = object & ~HAS_HEADER, .header_ns = read_header(object, message, form)};
  me.source_ns = 0;
  event.began_ns = now_ns();
  const int status = next(publisher, message, allocation);
  event.ended_ns = now_ns();
  event.source_ns = me.source_ns;
  write_row(PUBLISH, &event);
  return status;
}

#define PUBLISHES(name, form)                                                                     \
  EXPORTED int name(const void *publisher, const void *message, void *allocation)                 \
  {                                                                                               \
    NEXT(publish_t, RCL, name);                                                                   \
    return publish(next, publisher, message, allocation, form);                                   \
  }

PUBLISHES(rcl_publish, STRUCTURE)
PUBLISHES(rcl_publish_loaned_message, STRUCTURE)
PUBLISHES(rcl_publish_serialized_message, SERIALIZED)

/* The first fields of rmw_message_info_t, and room for all. */
typedef struct {
  int64_t source_ns, received_ns;
  char others[240];
} message_info_t;
typedef int take_t(const void *, void *, message_info_t *, void *);

static int take(
  take_t *next, const void *subscription, void *message, message_info_t *info, void *allocation,
  enum form form)
{
  if (next == NULL || !is_open()) {
    return next == NULL ? NOT_FOUND : next(subscription, message, info, allocation);
  }
  message_info_t own;
  message_info_t *filled = info == NULL ? &own : info;
  const uint32_t object = find_object(key_of(subscription));
  row_t event = {.object = object & ~HAS_HEADER, .flags = TOOK_NOTHING, .began_ns = now_ns()};
  const int status = next(subscription, message, filled, allocation);
  event.ended_ns = now_ns();
  if (status == 0) {
    event.flags = 0;
    event.source_ns = filled->source_ns;
    event.received_ns = filled->received_ns;
    event.header_ns = read_header(object, message, form);
    me.taken_from = event.object;
  }
  write_row(TAKE, &event);
  return status;
}

#define TAKES(name, form)                                                                         \
  EXPORTED int name(                                                                              \
    const void *subscription, void *message, message_info_t *info, void *allocation)              \
  {                                                                                               \
    NEXT(take_t, RCL, name);                                                                      \
    return take(next, subscription, message, info, allocation, form);                             \
  }

TAKES(rcl_take, STRUCTURE)
TAKES(rcl_take_serialized_message, SERIALIZED)
TAKES(rcl_take_loaned_message, LOANED)
TAKES(rcl_take_dynamic_message, OPAQUE)

/* Where the middleware has stamped a message, in the thread that publishes it. */

EXPORTED void ros_trace_rmw_publish(const void *publisher, const void *message, int64_t source_ns)
{
  typedef void traced_t(const void *, const void *, int64_t);
  NEXT(traced_t, TRACETOOLS, ros_trace_rmw_publish);
  me.source_ns = source_ns;
  if (next != NULL) {
    next(publisher, message, source_ns);
  }
}

typedef bool enabled_t(void);

static bool is_traced(void)
{
  NEXT(enabled_t, TRACETOOLS, ros_trace_enabled_rmw_publish);
  return next != NULL && next();
}

EXPORTED bool ros_trace_enabled_rmw_publish(void)
{
  return is_open() || is_traced();
}

EXPORTED void ros_trace_do_rmw_publish(
  const void *publisher, const void *message, int64_t source_ns)
{
  typedef void traced_t(const void *, const void *, int64_t);
  NEXT(traced_t, TRACETOOLS, ros_trace_do_rmw_publish);
  me.source_ns = source_ns;
  if (next != NULL && is_traced()) {
    next(publisher, message, source_ns);
  }
}

/* Services. A request is known by its number, which follows the id of its client. */

typedef struct {
  uint8_t client[16];
  int64_t number;
} request_t;
typedef struct {
  int64_t source_ns, received_ns;
  request_t request;
} request_info_t;
typedef int take_request_t(const void *, void *, void *);

static int take_request(
  take_request_t *next, const void *from, void *info, void *message, uint16_t kind, bool has_times)
{
  /* The older functions call the newer ones. */
  if (next == NULL || !is_open() || me.inside_of == from) {
    return next == NULL ? NOT_FOUND : next(from, info, message);
  }
  const void *outer = me.inside_of;
  me.inside_of = from;
  row_t event = {
    .object = find_object(key_of(from)), .flags = TOOK_NOTHING, .began_ns = now_ns()};
  const int status = next(from, info, message);
  event.ended_ns = now_ns();
  me.inside_of = outer;
  if (status == 0) {
    const request_info_t *filled = (const request_info_t *)info;
    event.flags = 0;
    event.source_ns = has_times ? filled->request.number : ((const request_t *)info)->number;
    event.received_ns = has_times ? filled->received_ns : 0;
    me.taken_from = event.object;
  }
  write_row(kind, &event);
  return status;
}

#define TAKES_REQUESTS(name, kind, has_times)                                                     \
  EXPORTED int name(const void *from, void *info, void *message)                                  \
  {                                                                                               \
    NEXT(take_request_t, RCL, name);                                                              \
    return take_request(next, from, info, message, kind, has_times);                              \
  }

TAKES_REQUESTS(rcl_take_request, TAKE_REQUEST, false)
TAKES_REQUESTS(rcl_take_request_with_info, TAKE_REQUEST, true)
TAKES_REQUESTS(rcl_take_response, TAKE_RESPONSE, false)
TAKES_REQUESTS(rcl_take_response_with_info, TAKE_RESPONSE, true)

EXPORTED int rcl_send_request(const void *client, const void *request, int64_t *number)
{
  typedef int send_t(const void *, const void *, int64_t *);
  NEXT(send_t, RCL, rcl_send_request);
  row_t event = {.object = find_object(key_of(client)), .began_ns = now_ns()};
  const int status = next == NULL ? NOT_FOUND : next(client, request, number);
  event.ended_ns = now_ns();
  event.source_ns = status == 0 ? *number : 0;
  write_row(SEND_REQUEST, &event);
  return status;
}

EXPORTED int rcl_send_response(const void *service, request_t *request, void *response)
{
  typedef int send_t(const void *, request_t *, void *);
  NEXT(send_t, RCL, rcl_send_response);
  row_t event = {.object = find_object(key_of(service)), .began_ns = now_ns()};
  const int status = next == NULL ? NOT_FOUND : next(service, request, response);
  event.ended_ns = now_ns();
  event.source_ns = status == 0 ? request->number : 0;
  write_row(SEND_RESPONSE, &event);
  return status;
}

/* Executors. */

EXPORTED int rcl_wait(void *wait_set, int64_t timeout)
{
  typedef int wait_t(void *, int64_t);
  NEXT(wait_t, RCL, rcl_wait);
  row_t event = {.began_ns = now_ns()};
  const int status = next == NULL ? NOT_FOUND : next(wait_set, timeout);
  event.ended_ns = now_ns();
  write_row(WAIT, &event);
  return status;
}

EXPORTED int rcl_trigger_guard_condition(void *condition)
{
  typedef int trigger_t(void *);
  NEXT(trigger_t, RCL, rcl_trigger_guard_condition);
  row_t event = {.began_ns = now_ns()};
  const int status = next == NULL ? NOT_FOUND : next(condition);
  event.ended_ns = now_ns();
  write_row(TRIGGER, &event);
  return status;
}

typedef int call_timer_t(void *);
typedef int call_timer_with_info_t(void *, void *);

/* The older function calls the newer one. */
static int call_timer(call_timer_t *call, call_timer_with_info_t *other, void *timer, void *info)
{
  const bool again = me.inside_of == timer;
  const void *outer = me.inside_of;
  me.inside_of = timer;
  row_t event = {.object = find_object(key_of(timer)), .began_ns = now_ns()};
  const int status =
    call != NULL ? call(timer) : other != NULL ? other(timer, info) : NOT_FOUND;
  event.ended_ns = now_ns();
  me.inside_of = outer;
  if (!again) {
    event.flags = status == 0 ? 0 : TOOK_NOTHING;
    me.taken_from = event.object;
    write_row(TIMER, &event);
  }
  return status;
}

EXPORTED int rcl_timer_call(void *timer)
{
  NEXT(call_timer_t, RCL, rcl_timer_call);
  return call_timer(next, NULL, timer, NULL);
}

EXPORTED int rcl_timer_call_with_info(void *timer, void *info)
{
  NEXT(call_timer_with_info_t, RCL, rcl_timer_call_with_info);
  return call_timer(NULL, next, timer, info);
}

/* Callbacks of rclcpp, which may be inside each other. One that an exception has ended has no end. */

#define MAX_CALLBACKS (sizeof(me.callback) / sizeof(*me.callback))

EXPORTED void ros_trace_callback_start(const void *callback, bool within_process)
{
  typedef void traced_t(const void *, bool);
  NEXT(traced_t, TRACETOOLS, ros_trace_callback_start);
  if (next != NULL) {
    next(callback, within_process);
  }
  if (is_open()) {
    const unsigned at = me.callbacks % MAX_CALLBACKS;
    me.callbacks = at + 1;
    me.callback[at].callback = callback;
    me.callback[at].object = me.taken_from;
    me.callback[at].began_ns = now_ns();
  }
}

EXPORTED void ros_trace_callback_end(const void *callback)
{
  typedef void traced_t(const void *);
  NEXT(traced_t, TRACETOOLS, ros_trace_callback_end);
  const int64_t now = is_open() ? now_ns() : 0;
  unsigned at = me.callbacks;
  while (at > 0 && me.callback[at - 1].callback != callback) {
    at--;
  }
  if (now != 0 && at > 0) {
    me.callbacks = at - 1;
    write_row(CALLBACK, &(row_t){.object = me.callback[at - 1].object, .ended_ns = now,
                                 .began_ns = me.callback[at - 1].began_ns});
  }
  if (next != NULL) {
    next(callback);
  }
}

/* What C++ nodes of one process hand to each other. A buffer becomes known by its own address, its
 * owner's and its subscription's, in the order in which these are constructed. */

typedef void traced_pair_t(const void *, const void *);

#define TRACES_PAIR(name, first, second, action)                                                  \
  EXPORTED void name(const void *first, const void *second)                                       \
  {                                                                                               \
    NEXT(traced_pair_t, TRACETOOLS, name);                                                        \
    if (is_open()) {                                                                              \
      action;                                                                                     \
    }                                                                                             \
    if (next != NULL) {                                                                           \
      next(first, second);                                                                        \
    }                                                                                             \
  }

static void name_buffer(const void *subscription, const object_t *named)
{
  object_t *buffer = known_object(subscription, BUFFER);
  if (buffer != NULL && named != NULL) {
    copy_name(buffer->name, named->name);
    copy_name(buffer->node, named->node);
  }
}

static void name_timer(const void *timer, const void *node)
{
  object_t *object = known_object(key_of(timer), TIMER_OBJECT);
  if (object != NULL) {
    copy_name(object->node, node_name(node));
  }
}

static void publish_within(const void *publisher, const void *message)
{
  const uint32_t object = find_object(key_of(publisher));
  row_t event = {.object = object & ~HAS_HEADER, .flags = WITHIN_PROCESS, .began_ns = now_ns(),
                 .header_ns = read_header(object, message, STRUCTURE)};
  event.ended_ns = event.began_ns;
  write_row(PUBLISH, &event);
}

TRACES_PAIR(ros_trace_rclcpp_timer_link_node, timer, node, name_timer(timer, node))
TRACES_PAIR(ros_trace_rclcpp_buffer_to_ipb, buffer, owner,
            (add_object(BUFFER, buffer, "", NULL, false), set_object(owner, find_object(buffer))))
TRACES_PAIR(ros_trace_rclcpp_ipb_to_subscription, owner, subscription,
            set_object(subscription, find_object(owner)))
TRACES_PAIR(ros_trace_rclcpp_subscription_init, handle, subscription,
            name_buffer(subscription, known_object(key_of(handle), SUBSCRIPTION)))
TRACES_PAIR(ros_trace_rclcpp_intra_publish, publisher, message, publish_within(publisher, message))

EXPORTED void ros_trace_rclcpp_ring_buffer_enqueue(
  const void *buffer, uint64_t index, uint64_t size, bool overwritten)
{
  typedef void traced_t(const void *, uint64_t, uint64_t, bool);
  NEXT(traced_t, TRACETOOLS, ros_trace_rclcpp_ring_buffer_enqueue);
  write_moment(ENQUEUE, find_object(buffer), WITHIN_PROCESS, (int64_t)index);
  if (next != NULL) {
    next(buffer, index, size, overwritten);
  }
}

EXPORTED void ros_trace_rclcpp_ring_buffer_dequeue(
  const void *buffer, uint64_t index, uint64_t size)
{
  typedef void traced_t(const void *, uint64_t, uint64_t);
  NEXT(traced_t, TRACETOOLS, ros_trace_rclcpp_ring_buffer_dequeue);
  me.taken_from = find_object(buffer);
  write_moment(DEQUEUE, me.taken_from, WITHIN_PROCESS, (int64_t)index);
  if (next != NULL) {
    next(buffer, index, size);
  }
}
