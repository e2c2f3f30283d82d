/* The monitor: records when each message on its topics arrives, without deserialising it; of some
 * topics also the beginning of the message, which is read when nothing is timed.
 *
 * The middleware notes when a sample reaches a subscription, so the time does not include the copy
 * that is made here. It is on the system clock; the difference of the clocks, which is recorded,
 * tells the reader the time on the monotonic one.
 */
#include "harness.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <rmw/rmw.h>

#define IDLE_MS 50
/* A round of the loop that takes this much longer than it waits and computes is a stall: the
 * arrivals in it are late by themselves. Even a busy machine wakes a process earlier. */
#define MIN_STALL_NS 100000000
#define STAMP_END 12
#define MESSAGES_PER_ROUND 1000
/* Clocks are read one after the other, and again if the reads were interrupted. */
#define MAX_READ_NS 20000
#define MAX_READS 5

/* A file of rows of int64, to which one is appended in one write: r2bspec/ipc/sample_files.py. */
typedef struct rows {
  char *path;
  int fd;
  size_t row_bytes;
} rows_t;

typedef struct watched {
  struct watched *next;
  rcl_subscription_t subscription;
  bool subscribed, temporary, has_header;
  rows_t rows;
  atomic_bool has_messages; /* perhaps; set by threads of the middleware */
  int wake_fd;
} watched_t;

typedef struct monitor {
  channel_t *channel;
  rcl_node_t *node;
  rows_t stalls;
  watched_t *watched; /* the latest one first */
  rcl_serialized_message_t message; /* reused; rcl grows it to the largest one */
  int wake_fd;
} monitor_t;

/* ---- files ---- */

static int rows_open(rows_t *rows, const char *path, size_t row_bytes)
{
  rows->row_bytes = row_bytes;
  rows->path = strdup(path);
  if (rows->path == NULL) {
    return fail_errno("memory");
  }
  rows->fd = open(rows->path, O_WRONLY | O_CREAT | O_EXCL | O_APPEND | O_CLOEXEC, 0600);
  return rows->fd < 0 ? fail_errno(rows->path) : 0;
}

static int check_written(const rows_t *rows, ssize_t written, size_t bytes)
{
  if (written >= 0 && (size_t)written < bytes) {
    errno = ENOSPC;
  }
  return written == (ssize_t)bytes ? 0 : fail_errno(rows->path);
}

static int rows_append(rows_t *rows, const int64_t *values)
{
  return check_written(rows, write(rows->fd, values, rows->row_bytes), rows->row_bytes);
}

static void rows_close(rows_t *rows)
{
  close(rows->fd); /* -1 if it could not be opened */
  free(rows->path);
}

/* ---- recording ---- */

/* Reads the system time minus the monotonic time; returns the latter. */
static int64_t clock_difference(int64_t *difference_ns)
{
  int64_t before_ns, there_ns, after_ns;
  int reads = 0;
  do {
    before_ns = monotonic_ns();
    there_ns = system_ns();
    after_ns = monotonic_ns();
  } while (after_ns - before_ns > MAX_READ_NS && ++reads < MAX_READS);
  *difference_ns = there_ns - before_ns - (after_ns - before_ns) / 2;
  return after_ns;
}

static int64_t read_stamp(const rcl_serialized_message_t *message)
{
  uint32_t words[2];
  if (message->buffer_length < STAMP_END) {
    return 0;
  }
  memcpy(words, message->buffer + 4, sizeof(words));
  if ((message->buffer[1] & 1) == 0) {
    words[0] = __builtin_bswap32(words[0]);
    words[1] = __builtin_bswap32(words[1]);
  }
  return (int32_t)words[0] * NS_PER_S + words[1];
}

/* Called by the middleware, on a thread of its own or on that of a publisher in this process. */
static void on_messages(const void *subject, size_t count)
{
  (void)count;
  watched_t *each = (watched_t *)subject;
  if (!atomic_exchange(&each->has_messages, true)) {
    (void)eventfd_write(each->wake_fd, 1);
  }
}

/* Records the messages that have arrived. After many it leaves the rest to the next round, so that
 * commands are read while messages keep coming. */
static int drain(watched_t *each, rcl_serialized_message_t *message)
{
  for (int left = MESSAGES_PER_ROUND; left > 0; --left) {
    rmw_message_info_t info = rmw_get_zero_initialized_message_info();
    const rcl_ret_t status = rcl_take_serialized_message(&each->subscription, message, &info, NULL);
    if (status == RCL_RET_SUBSCRIPTION_TAKE_FAILED) {
      rcl_reset_error();
      return 0;
    }
    if (status != RCL_RET_OK) {
      return fail_rcl("taking a message");
    }
    int64_t difference_ns;
    const int64_t taken_ns = clock_difference(&difference_ns);
    const int64_t row[5] = {
      each->has_header ? read_stamp(message) : 0, info.received_timestamp, taken_ns,
      (int64_t)message->buffer_length, difference_ns};
    if (rows_append(&each->rows, row) < 0) {
      return -1;
    }
  }
  on_messages(each, 0);
  return 0;
}

static int drain_all(monitor_t *monitor)
{
  eventfd_t wakes;
  (void)eventfd_read(monitor->wake_fd, &wakes);
  for (watched_t *each = monitor->watched; each != NULL; each = each->next) {
    if (atomic_exchange(&each->has_messages, false) && drain(each, &monitor->message) < 0) {
      return -1;
    }
  }
  return 0;
}

/* ---- topics ---- */

/* Unsubscribes from all topics, or from those that are tapped for a while; their rows stay. */
static void remove_watched(monitor_t *monitor, bool all)
{
  for (watched_t **at = &monitor->watched; *at != NULL;) {
    watched_t *each = *at;
    if (!all && !each->temporary) {
      at = &each->next;
      continue;
    }
    *at = each->next;
    if (each->subscribed) {
      ignore_rcl(rcl_subscription_set_on_new_message_callback(&each->subscription, NULL, NULL));
      ignore_rcl(rcl_subscription_fini(&each->subscription, monitor->node));
    }
    rows_close(&each->rows);
    free(each);
  }
}

/* Subscribes to {TYPE ROWS QOS TOPIC}. A topic that is tapped for a while is left out
 * if its type is not installed. */
static int subscribe_to(monitor_t *monitor, bool temporary)
{
  channel_t *channel = monitor->channel;
  watched_t *each = calloc(1, sizeof(*each));
  if (each == NULL) {
    return fail_errno("memory");
  }
  *each = (watched_t){
    .next = monitor->watched, .temporary = temporary, .rows.fd = -1,
    .wake_fd = monitor->wake_fd};
  monitor->watched = each;
  type_t *type = next_type(channel);
  const char *rows = next_word(channel);
  if (type != NULL && rows_open(&each->rows, rows, 5 * sizeof(int64_t)) < 0) {
    return -1;
  }
  rcl_subscription_options_t options = rcl_subscription_get_default_options();
  options.qos = next_qos(channel);
  const char *topic = next_word(channel);
  if (type == NULL) {
    return temporary ? 0 : -1;
  }
  each->has_header = begins_with_header(type);
  each->subscription = rcl_get_zero_initialized_subscription();
  if (rcl_subscription_init(&each->subscription, monitor->node, type, topic, &options) !=
      RCL_RET_OK) {
    return fail_rcl("creating a subscription");
  }
  each->subscribed = true;
  if (rcl_subscription_set_on_new_message_callback(&each->subscription, on_messages, each) !=
      RCL_RET_OK) {
    return fail_rcl("waiting for messages");
  }
  /* Some may have arrived before. */
  on_messages(each, 0);
  return 0;
}

/* ---- commands ---- */

/* The publishers of each topic, or -1 where it has no subscription; the latest one first. */
static int send_matches(monitor_t *monitor)
{
  (void)channel_reply(monitor->channel, "matched");
  for (watched_t *each = monitor->watched; each != NULL; each = each->next) {
    size_t count = 0;
    if (each->subscribed) {
      ignore_rcl(rcl_subscription_get_publisher_count(&each->subscription, &count));
    }
    (void)channel_reply(monitor->channel, " %zd", each->subscribed ? (ssize_t)count : -1);
  }
  return channel_reply(monitor->channel, "\n");
}

/* Executes the next command; 1 for the one that ends the monitor. */
static int execute(monitor_t *monitor)
{
  const char *command = next_word(monitor->channel);
  const bool temporary = strcmp(command, "start_tap") == 0;
  if (temporary || strcmp(command, "subscribe") == 0) {
    for (int64_t left = next_number(monitor->channel); left > 0; --left) {
      if (subscribe_to(monitor, temporary) < 0) {
        return -1;
      }
    }
  } else if (strcmp(command, "stop_tap") == 0) {
    remove_watched(monitor, false);
  } else if (strcmp(command, "count") != 0) {
    return 1;
  }
  return send_matches(monitor);
}

static int run_loop(monitor_t *monitor)
{
  struct pollfd ready[2] = {
    {.fd = fileno(monitor->channel->in), .events = POLLIN},
    {.fd = monitor->wake_fd, .events = POLLIN},
  };
  int64_t began_ns = monotonic_ns(), cpu_ns = read_clock(CLOCK_THREAD_CPUTIME_ID);
  int status = 0;
  while (status == 0) {
    (void)poll(ready, 2, IDLE_MS);
    /* From wait to wait, since the process can be stopped in any part of a round. */
    const int64_t row[2] = {began_ns, monotonic_ns()};
    const int64_t active_ns = read_clock(CLOCK_THREAD_CPUTIME_ID) - cpu_ns;
    if (row[1] - row[0] > IDLE_MS * INT64_C(1000000) + active_ns + MIN_STALL_NS) {
      status = rows_append(&monitor->stalls, row);
    }
    began_ns = row[1];
    cpu_ns += active_ns;
    if (status == 0 && ready[1].revents != 0) {
      status = drain_all(monitor);
    }
    if (status == 0 && ready[0].revents != 0) {
      status = execute(monitor);
    }
  }
  return status;
}

/* monitor STALLS TYPES {TYPE}: of the topics to which it will subscribe. */
static int configure(monitor_t *monitor)
{
  monitor->wake_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
  if (monitor->wake_fd < 0) {
    return fail_errno("a descriptor for events");
  }
  if (rows_open(&monitor->stalls, next_word(monitor->channel), 2 * sizeof(int64_t)) < 0) {
    return -1;
  }
  for (int64_t left = next_number(monitor->channel); left > 0; --left) {
    if (next_type(monitor->channel) == NULL) {
      return -1;
    }
  }
  const rmw_node_t *node = rcl_node_get_rmw_handle(monitor->node);
  return channel_reply(monitor->channel, "ready %s\n", node->implementation_identifier);
}

int monitor_serve(channel_t *channel, rcl_node_t *node)
{
  monitor_t monitor = {
    .channel = channel,
    .node = node,
    .stalls.fd = -1,
    .message = rmw_get_zero_initialized_serialized_message(),
    .wake_fd = -1,
  };
  monitor.message.allocator = rcl_get_default_allocator();
  int status = configure(&monitor);
  if (status == 0) {
    status = run_loop(&monitor);
  }
  remove_watched(&monitor, true);
  ignore_rcl(rmw_serialized_message_fini(&monitor.message));
  rows_close(&monitor.stalls);
  close(monitor.wake_fd);
  return status < 0 ? -1 : 0;
}
