/* The player: publishes prepared messages, step by step, on a schedule.
 *
 * The load is open-loop: a step is due at its time whether or not the graph has answered the one
 * before. A late step is published at once, and its lateness is recorded. All inputs of a step have
 * the same unique stamp, so that each output can be matched to its input.
 */
#include "harness.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

/* From the command to the first due time, so that the first step is not late. */
#define START_DELAY_NS 20000000
#define ACKNOWLEDGED_NS (2 * NS_PER_S)
#define CLOCK_PERIOD_NS 10000000
#define CLOCK_TYPE "rosgraph_msgs/msg/Clock"
#define TF_TYPE "tf2_msgs/msg/TFMessage"
#define STAMP_POSITION 4
#define STAMP_END 12
/* A late player never sleeps, so it also looks for commands after so many events. */
#define EVENTS_PER_LOOK 64
/* Room that is made before playing: 10 MB. More is made while playing, by doubling. */
#define MAX_RESERVED_ROWS ((int64_t)1 << 18)

typedef struct input {
  rcl_publisher_t publisher;
  char *topic;
  bool has_header, stamped;
} input_t;

typedef struct mapping {
  char *data;
  size_t size;
} mapping_t;

typedef struct clock_thread {
  rcl_publisher_t publisher;
  pthread_t thread;
  pthread_mutex_t lock;
  pthread_cond_t ended;
  bool runs, end;
} clock_thread_t;

/* The times of a step that has begun and is not in the file yet. */
typedef struct open_step {
  int64_t row[5];
  bool done;
} open_step_t;

typedef struct player {
  channel_t *channel;
  ros_t ros;
  clock_thread_t clock;
  rcl_publisher_t static_publisher;
  bool has_static;
  input_t *inputs; /* those of the plan, then /tf where it is played */
  int64_t input_count, planned;
  playlist_t list;
  mapping_t *files;
  open_step_t *open_steps;
  int64_t next; /* step of a cyclic round */
  int64_t last_stamp_ns;
  pacer_t pacer;
  rows_t rows;
} player_t;

/* ---- stamps ---- */

static uint32_t in_order(uint32_t value, bool little)
{
  return little ? value : __builtin_bswap32(value);
}

static void write_stamp(char *message, int64_t position, int64_t stamp_ns)
{
  const bool little = message[1] & 1;
  int64_t seconds = stamp_ns / NS_PER_S;
  int64_t rest_ns = stamp_ns % NS_PER_S;
  if (rest_ns < 0) {
    seconds -= 1;
    rest_ns += NS_PER_S;
  }
  const uint32_t words[2] = {
    in_order((uint32_t)seconds, little), in_order((uint32_t)rest_ns, little)};
  memcpy(message + position, words, sizeof(words));
}

static char *message_data(const player_t *player, const message_t *message)
{
  return player->files[message->file].data + message->offset;
}

static void stamp_message(const player_t *player, const message_t *message, int64_t stamp_ns,
                          const event_t *event)
{
  char *data = message_data(player, message);
  for (int64_t i = 0; i < message->places; ++i) {
    const stamp_place_t *place = &player->list.places[message->first_place + i];
    write_stamp(data, place->position, place->stamp_ns + stamp_ns - event->origin_ns);
  }
  if (player->inputs[message->source].stamped && message->size >= STAMP_END) {
    write_stamp(data, STAMP_POSITION, stamp_ns);
  }
}

/* This happens before waiting: writing to messages that are no longer in the cache takes time,
 * which would delay each publication. Returns the stamp of the event. */
static int64_t stamp_event(player_t *player, const event_t *event, int64_t due_ns, int64_t epoch_ns)
{
  int64_t stamp_ns = epoch_ns + event->stamp_ns;
  if (!event->has_stamp) {
    const int64_t early_ns = due_ns - monotonic_ns();
    stamp_ns = system_ns() + (early_ns > 0 ? early_ns : 0);
    if (event->step != NO_STEP && stamp_ns <= player->last_stamp_ns) {
      stamp_ns = player->last_stamp_ns + 1;
    }
  }
  if (event->step != NO_STEP && stamp_ns > player->last_stamp_ns) {
    player->last_stamp_ns = stamp_ns;
  }
  for (int64_t i = 0; i < event->source->refs; ++i) {
    const message_ref_t *ref = &player->list.refs[event->source->first_ref + i];
    const message_t *message = &player->list.messages[ref->message];
    stamp_message(player, message, stamp_ns + ref->stamp_offset_ns, event);
  }
  return stamp_ns;
}

/* ---- the messages in memory ---- */

static void unload(player_t *player)
{
  const int64_t files = player->list.header == NULL ? 0 : player->list.header->files;
  for (int64_t i = 0; player->files != NULL && i < files; ++i) {
    if (player->files[i].data != NULL) {
      munmap(player->files[i].data, player->files[i].size);
    }
  }
  free(player->files);
  free(player->open_steps);
  player->files = NULL;
  player->open_steps = NULL;
  playlist_close(&player->list);
}

/* Maps a file of messages: what is stamped becomes a page of this process, the rest is shared. */
static int map_file(const char *path, mapping_t *mapping)
{
  struct stat found;
  const int fd = open(path, O_RDONLY | O_CLOEXEC);
  if (fd < 0 || fstat(fd, &found) < 0) {
    const int failed = fail_file(path);
    if (fd >= 0) {
      close(fd);
    }
    return failed;
  }
  mapping->size = (size_t)found.st_size;
  void *data = mmap(NULL, mapping->size, PROT_READ | PROT_WRITE, MAP_PRIVATE, fd, 0);
  const int failed = data == MAP_FAILED ? fail_file(path) : 0;
  close(fd);
  mapping->data = failed == 0 ? data : NULL;
  return failed;
}

/* Reads a message from the disk, and copies the pages that stamps are written to, before playing. */
static int touch_message(const player_t *player, const message_t *message)
{
  if ((size_t)(message->offset + message->size) > player->files[message->file].size) {
    return fail(HARNESS_FAULT, "a file of messages is shorter than its index says");
  }
  volatile char *data = message_data(player, message);
  const int64_t page = sysconf(_SC_PAGESIZE);
  for (int64_t place = 0; place < message->size; place += page) {
    (void)data[place];
  }
  for (int64_t i = 0; i < message->places; ++i) {
    volatile char *stamp = data + player->list.places[message->first_place + i].position;
    stamp[0] = stamp[0];
    stamp[7] = stamp[7];
  }
  if (player->inputs[message->source].stamped && message->size >= STAMP_END) {
    data[STAMP_POSITION] = data[STAMP_POSITION];
    data[STAMP_END - 1] = data[STAMP_END - 1];
  }
  return 0;
}

static int load(player_t *player, const char *path)
{
  unload(player);
  if (playlist_open(&player->list, path, player->input_count) < 0) {
    return -1;
  }
  const playlist_header_t *head = player->list.header;
  player->files = calloc((size_t)head->files + 1, sizeof(mapping_t));
  player->open_steps = calloc((size_t)head->steps, sizeof(open_step_t));
  if (player->files == NULL || player->open_steps == NULL) {
    return fail_memory();
  }
  const char *name = player->list.paths;
  for (int64_t i = 0; i < head->files; ++i, name += strlen(name) + 1) {
    if (map_file(name, &player->files[i]) < 0) {
      return -1;
    }
  }
  for (int64_t i = 0; i < head->messages; ++i) {
    if (touch_message(player, &player->list.messages[i]) < 0) {
      return -1;
    }
  }
  player->next = 0;
  return channel_reply(player->channel, "ready\n");
}

/* ---- playing ---- */

/* Rows are in the order in which steps begin. In a timeline a step may end after the next one has
 * begun; its row is complete only then. */
static int record_event(player_t *player, const event_t *event, const int64_t *row, int64_t *count)
{
  if (event->starts_step && event->ends_step && event->step == *count) {
    *count += 1;
    return rows_append(&player->rows, row);
  }
  const int64_t steps = player->list.header->steps;
  open_step_t *open = &player->open_steps[event->step % steps];
  if (event->starts_step) {
    memcpy(open->row, row, sizeof(open->row));
  }
  if (event->ends_step) {
    memcpy(&open->row[3], &row[3], 2 * sizeof(int64_t));
    open->done = true;
  }
  while ((open = &player->open_steps[*count % steps])->done) {
    open->done = false;
    *count += 1;
    if (rows_append(&player->rows, open->row) < 0) {
      return -1;
    }
  }
  return 0;
}

static int publish_event(player_t *player, const event_t *event)
{
  for (int64_t i = 0; i < event->source->refs; ++i) {
    const message_ref_t *ref = &player->list.refs[event->source->first_ref + i];
    const message_t *message = &player->list.messages[ref->message];
    rcl_publisher_t *publisher = &player->inputs[message->source].publisher;
    if (ros_publish(publisher, message_data(player, message), (size_t)message->size) < 0) {
      return -1;
    }
  }
  return 0;
}

/* The system time of the beginning, to which the stamps of a timeline are shifted. It is later if a
 * stamp would otherwise repeat, because stamps may be ahead of the clock. */
static int64_t find_epoch(const player_t *player, int64_t begin_ns)
{
  const int64_t epoch_ns = system_ns() + begin_ns - monotonic_ns();
  const playlist_header_t *head = player->list.header;
  const int64_t least_ns = player->last_stamp_ns + 1 - head->earliest_stamp_ns;
  return head->cyclic || epoch_ns > least_ns ? epoch_ns : least_ns;
}

/* Plays until the last step or until a command arrives; counts the steps. */
static int play_events(player_t *player, cursor_t *cursor, int64_t *count)
{
  const int64_t begin_ns = monotonic_ns() + START_DELAY_NS;
  const int64_t epoch_ns = find_epoch(player, begin_ns);
  event_t event;
  for (int64_t number = 0; cursor_next(cursor, &event); ++number) {
    const int64_t due_ns = begin_ns + event.offset_ns;
    const int64_t stamp_ns = stamp_event(player, &event, due_ns, epoch_ns);
    if (pacer_wait(&player->pacer, due_ns, player->channel) ||
        (number % EVENTS_PER_LOOK == 0 && channel_wait(player->channel, 0))) {
      return 0;
    }
    /* What a latency counts from: before the first call that publishes. */
    const int64_t published_ns = monotonic_ns();
    if (publish_event(player, &event) < 0) {
      return -1;
    }
    const int64_t row[5] = {stamp_ns, due_ns, published_ns, monotonic_ns(), event.source->inputs};
    if (event.step != NO_STEP && record_event(player, &event, row, count) < 0) {
      return -1;
    }
  }
  return 0;
}

static int play(player_t *player, double rate_hz, int64_t steps)
{
  int64_t count = 0;
  if (player->list.header != NULL) {
    const playlist_header_t *head = player->list.header;
    if (player->has_static) {
      /* A subscription that does not answer delays nothing further. */
      ignore_rcl(rcl_publisher_wait_for_all_acked(&player->static_publisher, ACKNOWLEDGED_NS));
    }
    memset(player->open_steps, 0, (size_t)head->steps * sizeof(open_step_t));
    cursor_t cursor;
    const int64_t rows = steps < MAX_RESERVED_ROWS ? steps : MAX_RESERVED_ROWS;
    if (rows_reserve(&player->rows, (size_t)rows) < 0 ||
        cursor_init(&cursor, &player->list, rate_hz, steps, player->next) < 0) {
      return -1;
    }
    const int failed = play_events(player, &cursor, &count);
    cursor_fini(&cursor);
    if (failed < 0) {
      return -1;
    }
    player->next = head->cyclic ? (player->next + count) % head->steps : 0;
  }
  return channel_reply(player->channel, "played %lld\n", (long long)count);
}

/* ---- /clock and /tf_static ---- */

static void *publish_clock(void *argument)
{
  clock_thread_t *clock = argument;
  int64_t due_ns = monotonic_ns();
  pthread_mutex_lock(&clock->lock);
  while (!clock->end) {
    due_ns += CLOCK_PERIOD_NS;
    const struct timespec until = {.tv_sec = due_ns / NS_PER_S, .tv_nsec = due_ns % NS_PER_S};
    if (pthread_cond_timedwait(&clock->ended, &clock->lock, &until) == ETIMEDOUT) {
      char message[STAMP_END] = {0, 1};
      write_stamp(message, STAMP_POSITION, system_ns());
      (void)ros_publish(&clock->publisher, message, sizeof(message));
    }
  }
  pthread_mutex_unlock(&clock->lock);
  return NULL;
}

static int start_clock(player_t *player)
{
  clock_thread_t *clock = &player->clock;
  rmw_qos_profile_t qos = rmw_qos_profile_default;
  qos.depth = 1;
  type_t *type = ros_type(CLOCK_TYPE);
  if (type == NULL || ros_publisher(&player->ros, type, "/clock", &qos, &clock->publisher) < 0) {
    return -1;
  }
  pthread_condattr_t monotonic;
  pthread_mutex_init(&clock->lock, NULL);
  pthread_condattr_init(&monotonic);
  pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
  pthread_cond_init(&clock->ended, &monotonic);
  pthread_condattr_destroy(&monotonic);
  errno = pthread_create(&clock->thread, NULL, publish_clock, clock);
  clock->runs = errno == 0;
  return clock->runs ? 0 : fail_file("a thread for /clock");
}

static void end_clock(clock_thread_t *clock)
{
  if (clock->runs) {
    pthread_mutex_lock(&clock->lock);
    clock->end = true;
    pthread_cond_signal(&clock->ended);
    pthread_mutex_unlock(&clock->lock);
    pthread_join(clock->thread, NULL);
  }
}

/* Latched, so that late subscriptions receive them. */
static int publish_static(player_t *player, const char *path, int64_t size)
{
  rmw_qos_profile_t qos = rmw_qos_profile_default;
  qos.depth = 1;
  qos.durability = RMW_QOS_POLICY_DURABILITY_TRANSIENT_LOCAL;
  type_t *type = ros_type(TF_TYPE);
  mapping_t file = {0};
  if (type == NULL ||
      ros_publisher(&player->ros, type, "/tf_static", &qos, &player->static_publisher) < 0 ||
      map_file(path, &file) < 0) {
    return -1;
  }
  player->has_static = true;
  const int failed = size < 0 || (size_t)size > file.size
                       ? fail(HARNESS_FAULT, "%s is shorter than its index says", path)
                       : ros_publish(&player->static_publisher, file.data, (size_t)size);
  munmap(file.data, file.size);
  return failed;
}

/* ---- commands ---- */

static int add_input(player_t *player, char **rest)
{
  input_t *input = &player->inputs[player->input_count];
  input->topic = strdup(next_word(rest));
  type_t *type = ros_type(next_word(rest));
  rmw_qos_profile_t qos;
  if (input->topic == NULL || type == NULL || parse_qos(next_word(rest), &qos) < 0 ||
      ros_publisher(&player->ros, type, input->topic, &qos, &input->publisher) < 0) {
    return input->topic == NULL ? fail_memory() : -1;
  }
  input->has_header = begins_with_header(type);
  input->stamped = next_number(rest) != 0 && input->has_header;
  player->input_count += 1;
  return 0;
}

/* player ROWS CLOCK STATIC-FILE STATIC-BYTES PLANNED INPUTS {TOPIC TYPE QOS STAMPED} */
static int configure(player_t *player, char *rest)
{
  const char *rows = next_word(&rest);
  const bool clock = next_number(&rest) != 0;
  const char *static_file = next_word(&rest);
  const int64_t static_bytes = next_number(&rest);
  player->planned = next_number(&rest);
  const int64_t inputs = next_number(&rest);
  if (player->planned < 0 || inputs < player->planned) {
    return fail(HARNESS_FAULT, "a player has fewer inputs than are planned");
  }
  player->inputs = calloc((size_t)inputs + 1, sizeof(input_t));
  if (player->inputs == NULL) {
    return fail_memory();
  }
  /* Before anything else, so that all nodes, which are started later, receive them. */
  if ((clock && start_clock(player) < 0) ||
      (static_file[0] != '\0' && publish_static(player, static_file, static_bytes) < 0)) {
    return -1;
  }
  while (player->input_count < inputs) {
    if (add_input(player, &rest) < 0) {
      return -1;
    }
  }
  return rows_open(&player->rows, rows, 5, 4096);
}

/* Which of the planned inputs have a header. */
static int send_headers(player_t *player)
{
  int failed = channel_reply(player->channel, "ready");
  for (int64_t i = 0; i < player->planned && failed == 0; ++i) {
    failed = channel_reply(player->channel, " %d", player->inputs[i].has_header);
  }
  return failed < 0 ? -1 : channel_reply(player->channel, "\n");
}

/* The subscriptions of each input, and of what is latched. */
static int send_matches(player_t *player)
{
  int failed = channel_reply(player->channel, "matched");
  for (int64_t i = 0; i < player->input_count + player->has_static && failed == 0; ++i) {
    size_t count = 0;
    ignore_rcl(rcl_publisher_get_subscription_count(
      i == player->input_count ? &player->static_publisher : &player->inputs[i].publisher,
      &count));
    failed = channel_reply(player->channel, " %zu", count);
  }
  return failed < 0 ? -1 : channel_reply(player->channel, "\n");
}

/* Executes a command; 1 for the one that ends the player. */
static int execute(player_t *player, char *line)
{
  const char *command = next_word(&line);
  if (strcmp(command, "follow") == 0) {
    return load(player, next_word(&line));
  }
  if (strcmp(command, "count") == 0) {
    return send_matches(player);
  }
  if (strcmp(command, "play") == 0) {
    const double rate_hz = strtod(next_word(&line), NULL);
    return play(player, rate_hz, next_number(&line));
  }
  /* Others are ignored: a stop that arrived after the last step. */
  return strcmp(command, "shutdown") == 0;
}

static void clean_up(player_t *player)
{
  if (harness_on_end != NULL) {
    harness_on_end();
  }
  end_clock(&player->clock);
  rcl_node_t *node = &player->ros.node;
  for (int64_t i = 0; i < player->input_count; ++i) {
    ignore_rcl(rcl_publisher_fini(&player->inputs[i].publisher, node));
    free(player->inputs[i].topic);
  }
  if (player->has_static) {
    ignore_rcl(rcl_publisher_fini(&player->static_publisher, node));
  }
  if (player->clock.runs) {
    ignore_rcl(rcl_publisher_fini(&player->clock.publisher, node));
  }
  unload(player);
  free(player->inputs);
  rows_close(&player->rows);
  ros_fini(&player->ros);
}

int player_serve(channel_t *channel, char *rest)
{
  player_t player = {.channel = channel, .rows.fd = -1};
  int status = ros_init(&player.ros, "player");
  if (status == 0) {
    status = configure(&player, rest);
  }
  if (status == 0) {
    pacer_init(&player.pacer);
    status = send_headers(&player);
  }
  char *line;
  while (status == 0 && channel_next(channel, &line) == 0) {
    status = execute(&player, line);
  }
  clean_up(&player);
  return status < 0 ? -1 : 0;
}
