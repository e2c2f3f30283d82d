/* The monitor: records the arrival time of each message on its topics, without deserialising it.
 *
 * The arrival time is the one that the middleware records when the sample reaches the subscription,
 * so it does not include the copy that is made here. It is on the system clock, and is converted.
 */
#include "harness.h"

#include <errno.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

#include <rcl/wait.h>
#include <rmw/rmw.h>

#define IDLE_NS 50000000
/* While a topic waits for its publisher, whose quality of service it copies. */
#define DISCOVERY_NS 20000000
/* A round of the loop that takes this much longer than it waits and computes is a stall: the
 * arrivals in it are late by themselves. Even a busy machine wakes a process earlier. */
#define MIN_STALL_NS 100000000
#define STALL_FILE "monitor.held"
#define STAMP_END 12
#define CONTENT_BUFFER (1 << 20)

typedef struct watched {
  char *name, *topic, *type_name;
  rmw_qos_profile_t qos;
  bool has_qos, has_header, subscribed, temporary;
  rcl_subscription_t subscription;
  rows_t rows;
  FILE *content; /* whole messages, where they are wanted */
  char *content_path;
} watched_t;

typedef struct monitor {
  channel_t *channel;
  ros_t ros;
  char *rows_dir;
  rows_t stalls;
  watched_t **watched;
  size_t count;
  bool subscribing;
  clock_offset_t clocks;
  rcl_serialized_message_t message; /* reused; rcl grows it to the largest one */
  rcl_wait_set_t waiting;
  rcl_guard_condition_t wake;
  pthread_t reader;
  bool reads;
  /* One command is handed from the reader to the loop at a time. */
  pthread_mutex_t lock;
  pthread_cond_t handled;
  char *command;
  bool closed;
} monitor_t;

/* ---- recording ---- */

static int64_t read_stamp(const uint8_t *message, size_t size)
{
  uint32_t words[2];
  if (size < STAMP_END) {
    return 0;
  }
  memcpy(words, message + 4, sizeof(words));
  if ((message[1] & 1) == 0) {
    words[0] = __builtin_bswap32(words[0]);
    words[1] = __builtin_bswap32(words[1]);
  }
  return (int32_t)words[0] * NS_PER_S + words[1];
}

static int record_message(monitor_t *monitor, watched_t *each, int64_t received_system_ns)
{
  const rcl_serialized_message_t *message = &monitor->message;
  int64_t received_ns;
  const int64_t taken_ns =
    clock_offset_arrival(&monitor->clocks, received_system_ns, &received_ns);
  const int64_t size = (int64_t)message->buffer_length;
  if (each->content != NULL && /* before its row: each row has a message */
      (fwrite(&size, sizeof(size), 1, each->content) != 1 ||
       fwrite(message->buffer, 1, message->buffer_length, each->content) !=
         message->buffer_length)) {
    return fail_file(each->content_path);
  }
  const int64_t stamp_ns =
    each->has_header ? read_stamp(message->buffer, message->buffer_length) : 0;
  const int64_t row[4] = {stamp_ns, received_ns, taken_ns, size};
  return rows_append(&each->rows, row);
}

/* Records every message that has arrived. */
static int drain(monitor_t *monitor, watched_t *each)
{
  for (;;) {
    rmw_message_info_t info = rmw_get_zero_initialized_message_info();
    const rcl_ret_t status =
      rcl_take_serialized_message(&each->subscription, &monitor->message, &info, NULL);
    if (status == RCL_RET_SUBSCRIPTION_TAKE_FAILED) {
      rcl_reset_error();
      return 0;
    }
    if (status != RCL_RET_OK) {
      return fail_rcl("taking a message");
    }
    if (record_message(monitor, each, info.received_timestamp) < 0) {
      return -1;
    }
  }
}

/* ---- topics ---- */

static char *join(const char *folder, const char *name, const char *suffix)
{
  char *path = NULL;
  return asprintf(&path, "%s/%s%s", folder, name, suffix) < 0 ? NULL : path;
}

static int build_wait_set(monitor_t *monitor)
{
  size_t subscribed = 0;
  for (size_t i = 0; i < monitor->count; ++i) {
    subscribed += monitor->watched[i]->subscribed;
  }
  if (rcl_wait_set_is_valid(&monitor->waiting) &&
      rcl_wait_set_fini(&monitor->waiting) != RCL_RET_OK) {
    return fail_rcl("ending a wait set");
  }
  monitor->waiting = rcl_get_zero_initialized_wait_set();
  return rcl_wait_set_init(
           &monitor->waiting, subscribed, 1, 0, 0, 0, 0, &monitor->ros.context,
           rcl_get_default_allocator()) == RCL_RET_OK
           ? 0
           : fail_rcl("making a wait set");
}

static int close_content(watched_t *each)
{
  FILE *content = each->content;
  each->content = NULL;
  return content == NULL || fclose(content) == 0 ? 0 : fail_file(each->content_path);
}

/* Unsubscribes; the rows stay in their file. */
static int free_watched(monitor_t *monitor, watched_t *each)
{
  if (each->subscribed) {
    ignore_rcl(rcl_subscription_fini(&each->subscription, &monitor->ros.node));
  }
  const int failed = close_content(each);
  rows_close(&each->rows);
  free(each->content_path);
  free(each->type_name);
  free(each->topic);
  free(each->name);
  free(each);
  return failed;
}

/* Reads {NAME TOPIC TYPE QOS}; a QOS of "-" is that of the publisher. */
static watched_t *parse_watched(char **rest)
{
  watched_t *each = calloc(1, sizeof(*each));
  if (each == NULL) {
    (void)fail_memory();
    return NULL;
  }
  each->rows.fd = -1;
  each->name = strdup(next_word(rest));
  each->topic = strdup(next_word(rest));
  each->type_name = strdup(next_word(rest));
  char *qos = next_word(rest);
  each->has_qos = strcmp(qos, "-") != 0;
  const bool complete = each->name != NULL && each->topic != NULL && each->type_name != NULL;
  if (!complete || (each->has_qos && parse_qos(qos, &each->qos) < 0)) {
    (void)(complete ? 0 : fail_memory());
    free(each->name);
    free(each->topic);
    free(each->type_name);
    free(each);
    return NULL;
  }
  return each;
}

static int add_watched(monitor_t *monitor, watched_t *each)
{
  watched_t **grown = realloc(monitor->watched, (monitor->count + 1) * sizeof(*grown));
  if (grown == NULL) {
    return fail_memory();
  }
  monitor->watched = grown;
  monitor->watched[monitor->count++] = each;
  return 0;
}

static int open_rows(monitor_t *monitor, watched_t *each)
{
  char *path = join(monitor->rows_dir, each->name, ".rows");
  const int failed = path == NULL ? fail_memory() : rows_open(&each->rows, path, 4);
  free(path);
  return failed;
}

/* Subscribes, if the quality of service is known: 1, or 0. */
static int subscribe(monitor_t *monitor, watched_t *each)
{
  if (!each->has_qos) {
    const int known = qos_of_publishers(&monitor->ros, each->topic, &each->qos);
    if (known <= 0) {
      return known;
    }
  }
  type_t *type = ros_type(each->type_name);
  if (type == NULL) {
    return -1;
  }
  rcl_subscription_options_t options = rcl_subscription_get_default_options();
  options.qos = each->qos;
  each->subscription = rcl_get_zero_initialized_subscription();
  const rcl_ret_t status = rcl_subscription_init(
    &each->subscription, &monitor->ros.node, type, each->topic, &options);
  if (status != RCL_RET_OK) {
    return fail_rcl("creating a subscription");
  }
  each->has_header = begins_with_header(type);
  each->subscribed = true;
  return 1;
}

static int subscribe_pending(monitor_t *monitor)
{
  bool changed = false;
  for (size_t i = 0; i < monitor->count; ++i) {
    if (!monitor->watched[i]->subscribed && !monitor->watched[i]->temporary) {
      const int status = subscribe(monitor, monitor->watched[i]);
      if (status < 0) {
        return -1;
      }
      changed |= status > 0;
    }
  }
  return changed ? build_wait_set(monitor) : 0;
}

static bool has_pending(const monitor_t *monitor)
{
  for (size_t i = 0; monitor->subscribing && i < monitor->count; ++i) {
    if (!monitor->watched[i]->subscribed && !monitor->watched[i]->temporary) {
      return true;
    }
  }
  return false;
}

/* ---- commands ---- */

/* The publishers of each topic, or "-" where it has no subscription. */
static int send_matches(monitor_t *monitor)
{
  int failed = channel_reply(monitor->channel, "matched");
  for (size_t i = 0; i < monitor->count && failed == 0; ++i) {
    const watched_t *each = monitor->watched[i];
    size_t count = 0;
    if (each->subscribed) {
      ignore_rcl(rcl_subscription_get_publisher_count(&each->subscription, &count));
      failed = channel_reply(monitor->channel, " %zu", count);
    } else {
      failed = channel_reply(monitor->channel, " -");
    }
  }
  return failed < 0 ? -1 : channel_reply(monitor->channel, "\n");
}

static int open_content(monitor_t *monitor, watched_t *each)
{
  each->content_path = join(monitor->rows_dir, each->name, ".messages");
  if (each->content_path == NULL) {
    return fail_memory();
  }
  each->content = fopen(each->content_path, "wbxe");
  if (each->content == NULL) {
    return fail_file(each->content_path);
  }
  setvbuf(each->content, NULL, _IOFBF, CONTENT_BUFFER);
  return 0;
}

/* watch CONTENT TOPICS {NAME TOPIC TYPE QOS}: until unwatch; without what has no publisher now,
 * or a type that is not installed. */
static int watch(monitor_t *monitor, char *rest)
{
  const bool content = next_number(&rest) != 0;
  for (int64_t left = next_number(&rest); left > 0; --left) {
    watched_t *each = parse_watched(&rest);
    if (each == NULL) {
      return -1;
    }
    each->temporary = true;
    if (add_watched(monitor, each) < 0) {
      return free_watched(monitor, each) < 0 ? -1 : fail_memory();
    }
    const int status = ros_type(each->type_name) == NULL ? 0 : subscribe(monitor, each);
    if (status < 0 || (status > 0 && open_rows(monitor, each) < 0) ||
        (status > 0 && content && open_content(monitor, each) < 0)) {
      return -1;
    }
  }
  return build_wait_set(monitor) < 0 ? -1 : send_matches(monitor);
}

static int unwatch(monitor_t *monitor)
{
  size_t kept = 0;
  int failed = 0;
  for (size_t i = 0; i < monitor->count; ++i) {
    watched_t *each = monitor->watched[i];
    if (each->temporary) {
      failed |= free_watched(monitor, each);
    } else {
      monitor->watched[kept++] = each;
    }
  }
  monitor->count = kept;
  return failed < 0 || build_wait_set(monitor) < 0 ? -1 : send_matches(monitor);
}

/* Executes a command; 1 for the one that ends the monitor. */
static int execute(monitor_t *monitor, char *line)
{
  const char *command = next_word(&line);
  if (strcmp(command, "subscribe") == 0) {
    monitor->subscribing = true;
    return subscribe_pending(monitor) < 0 ? -1 : send_matches(monitor);
  }
  if (strcmp(command, "watch") == 0) {
    return watch(monitor, line);
  }
  if (strcmp(command, "unwatch") == 0) {
    return unwatch(monitor);
  }
  if (strcmp(command, "count") == 0) {
    return send_matches(monitor);
  }
  return strcmp(command, "shutdown") == 0;
}

/* The thread that reads commands, and wakes the loop for each. */
static void *read_commands(void *argument)
{
  monitor_t *monitor = argument;
  char *line;
  while (channel_next(monitor->channel, &line) == 0) {
    pthread_mutex_lock(&monitor->lock);
    monitor->command = line;
    ignore_rcl(rcl_trigger_guard_condition(&monitor->wake));
    while (monitor->command != NULL && !monitor->closed) {
      pthread_cond_wait(&monitor->handled, &monitor->lock);
    }
    pthread_mutex_unlock(&monitor->lock);
  }
  pthread_mutex_lock(&monitor->lock);
  monitor->closed = true;
  ignore_rcl(rcl_trigger_guard_condition(&monitor->wake));
  pthread_mutex_unlock(&monitor->lock);
  return NULL;
}

/* ---- the loop ---- */

static int wait_for_messages(monitor_t *monitor, int64_t timeout_ns)
{
  if (rcl_wait_set_clear(&monitor->waiting) != RCL_RET_OK ||
      rcl_wait_set_add_guard_condition(&monitor->waiting, &monitor->wake, NULL) != RCL_RET_OK) {
    return fail_rcl("preparing to wait");
  }
  for (size_t i = 0; i < monitor->count; ++i) {
    const watched_t *each = monitor->watched[i];
    if (each->subscribed && rcl_wait_set_add_subscription(
                              &monitor->waiting, &each->subscription, NULL) != RCL_RET_OK) {
      return fail_rcl("preparing to wait");
    }
  }
  const rcl_ret_t status = rcl_wait(&monitor->waiting, timeout_ns);
  if (status == RCL_RET_TIMEOUT) {
    rcl_reset_error();
    return 0;
  }
  return status == RCL_RET_OK ? 0 : fail_rcl("waiting for messages");
}

static int drain_ready(monitor_t *monitor)
{
  /* Those that are not ready have become NULL; the others are in the order in which they were
   * added, which is that of the topics. */
  for (size_t i = 0, place = 0; i < monitor->count; ++i) {
    watched_t *each = monitor->watched[i];
    if (each->subscribed && monitor->waiting.subscriptions[place++] != NULL &&
        drain(monitor, each) < 0) {
      return -1;
    }
  }
  return 0;
}

static int handle_command(monitor_t *monitor)
{
  pthread_mutex_lock(&monitor->lock);
  char *command = monitor->command;
  int status = command == NULL && monitor->closed;
  pthread_mutex_unlock(&monitor->lock);
  if (command != NULL) {
    status = execute(monitor, command);
    pthread_mutex_lock(&monitor->lock);
    monitor->command = NULL;
    pthread_cond_signal(&monitor->handled);
    pthread_mutex_unlock(&monitor->lock);
  }
  return status;
}

static int record_stall(monitor_t *monitor, int64_t began_ns, int64_t ended_ns, int64_t active_ns)
{
  const int64_t row[2] = {began_ns, ended_ns};
  return ended_ns - began_ns > active_ns + MIN_STALL_NS ? rows_append(&monitor->stalls, row) : 0;
}

static int run_loop(monitor_t *monitor)
{
  clock_offset_init(&monitor->clocks);
  int64_t began_ns = clock_offset_update(&monitor->clocks);
  int64_t cpu_ns = thread_cpu_ns();
  int status = 0;
  while (status == 0) {
    const int64_t timeout_ns = has_pending(monitor) ? DISCOVERY_NS : IDLE_NS;
    status = wait_for_messages(monitor, timeout_ns);
    /* From wait to wait, since the process can be stopped in any part of a round. */
    const int64_t last_ns = began_ns, last_cpu_ns = cpu_ns;
    began_ns = clock_offset_update(&monitor->clocks);
    cpu_ns = thread_cpu_ns();
    if (status < 0 ||
        record_stall(monitor, last_ns, began_ns, timeout_ns + cpu_ns - last_cpu_ns) < 0 ||
        drain_ready(monitor) < 0 || (has_pending(monitor) && subscribe_pending(monitor) < 0)) {
      return -1;
    }
    status = handle_command(monitor);
  }
  return status;
}

/* monitor ROWS-DIR TOPICS {NAME TOPIC TYPE QOS} */
static int configure(monitor_t *monitor, char *rest)
{
  monitor->rows_dir = strdup(next_word(&rest));
  for (int64_t left = next_number(&rest); left > 0; --left) {
    watched_t *each = parse_watched(&rest);
    if (each == NULL) {
      return -1;
    }
    if (add_watched(monitor, each) < 0) {
      return free_watched(monitor, each) < 0 ? -1 : fail_memory();
    }
    if (ros_type(each->type_name) == NULL || open_rows(monitor, each) < 0) {
      return -1;
    }
  }
  char *stalls = join(monitor->rows_dir, STALL_FILE, "");
  int failed = stalls == NULL ? fail_memory() : rows_open(&monitor->stalls, stalls, 2);
  free(stalls);
  const rcl_guard_condition_options_t options = rcl_guard_condition_get_default_options();
  if (failed == 0 && rcl_guard_condition_init(&monitor->wake, &monitor->ros.context, options) !=
                       RCL_RET_OK) {
    failed = fail_rcl("creating a guard condition");
  }
  return failed < 0 ? -1 : build_wait_set(monitor);
}

static int start_reader(monitor_t *monitor)
{
  errno = pthread_create(&monitor->reader, NULL, read_commands, monitor);
  monitor->reads = errno == 0;
  return monitor->reads ? 0 : fail_file("a thread for commands");
}

static void clean_up(monitor_t *monitor)
{
  if (harness_on_end != NULL) {
    harness_on_end();
  }
  if (monitor->reads) {
    pthread_mutex_lock(&monitor->lock);
    monitor->closed = true;
    pthread_cond_signal(&monitor->handled);
    pthread_mutex_unlock(&monitor->lock);
    shutdown(fileno(monitor->channel->in), SHUT_RD);
    pthread_join(monitor->reader, NULL);
  }
  ignore_rcl(rcl_wait_set_fini(&monitor->waiting));
  ignore_rcl(rcl_guard_condition_fini(&monitor->wake));
  ignore_rcl(rmw_serialized_message_fini(&monitor->message));
  for (size_t i = 0; i < monitor->count; ++i) {
    (void)free_watched(monitor, monitor->watched[i]);
  }
  free(monitor->watched);
  free(monitor->rows_dir);
  rows_close(&monitor->stalls);
  ros_fini(&monitor->ros);
}

int monitor_serve(channel_t *channel, char *rest)
{
  monitor_t monitor = {
    .channel = channel,
    .stalls.fd = -1,
    .message = rmw_get_zero_initialized_serialized_message(),
    .waiting = rcl_get_zero_initialized_wait_set(),
    .wake = rcl_get_zero_initialized_guard_condition(),
    .lock = PTHREAD_MUTEX_INITIALIZER,
    .handled = PTHREAD_COND_INITIALIZER,
  };
  monitor.message.allocator = rcl_get_default_allocator();
  int status = ros_init(&monitor.ros, "monitor");
  if (status == 0) {
    status = configure(&monitor, rest);
  }
  if (status == 0) {
    const rmw_node_t *node = rcl_node_get_rmw_handle(&monitor.ros.node);
    status = channel_reply(
      channel, "ready %s\n", node->implementation_identifier);
  }
  if (status == 0) {
    status = start_reader(&monitor);
  }
  if (status == 0) {
    status = run_loop(&monitor);
  }
  clean_up(&monitor);
  return status < 0 ? -1 : 0;
}
