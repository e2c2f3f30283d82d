/* The player: publishes prepared messages at the times of a file, and writes into it what it did.
 *
 * The load is open-loop: an event is due at its time whether or not the graph has answered the one
 * before. A late one is published at once, and its lateness is recorded. All inputs of a step have
 * the same unique stamp, so that each output can be matched to its input.
 *
 * Files are checked when they are opened: nothing of a damaged one reaches beyond the files. Their
 * arithmetic wraps around (-fwrapv), so that wrong times are nothing but wrong times.
 */
#include "harness.h"

#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <unistd.h>

/* From the command to the first due time, so that the first step is not late. */
#define START_DELAY_NS 20000000
/* A late player never sleeps, so it also looks for commands after so many events. */
#define EVENTS_PER_LOOK 64
/* More than the lateness of most sleeps. */
#define INITIAL_SPIN_NS 150000
#define MIN_SPIN_NS 30000
/* A larger lateness comes from other work on the core; spinning does not help against it. */
#define MAX_SPIN_NS 300000
/* The share of sleeps that may end late is 4 %: these two are in balance there. */
#define LATE_STEP_NS 3840
#define EARLY_STEP_NS 160
#define STAMP_BYTES 8
#define NO_PLACE (-1)
#define PAGE_BYTES 4096 /* or a multiple of it */

typedef struct mapping {
  char *data;
  size_t size;
} mapping_t;

/* An input of the plan, or /tf after them. */
typedef struct source {
  rcl_publisher_t publisher;
  bool has_header;
  char *path;
  mapping_t buffer; /* its messages */
} source_t;

/* r2bspec/ipc/playback_events.py: a message of an event, or one more stamp in the message after it.
 * The first three times are relative until an event is played. */
typedef struct entry {
  int64_t due_ns, stamp_ns, published_ns, done_ns;
  int64_t inputs, offset, add_ns;
  int32_t size, place, source;
  int32_t left; /* entries of the event, from this one on */
  int32_t step, complete;
} entry_t;

/* r2bspec/ipc/playback_file.py */
typedef struct playback {
  int64_t published;
  char magic[8];
  int64_t count, has_stamps, earliest_stamp_ns;
  entry_t entries[];
} playback_t;

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the files are little-endian");
_Static_assert(sizeof(playback_t) == 40 && sizeof(entry_t) == 80, "as Python writes them");

typedef struct player {
  channel_t *channel;
  rcl_node_t *node;
  source_t *sources;
  int64_t source_count;
  int64_t last_stamp_ns;
  int64_t spin_ns;
} player_t;

/* ---- files ---- */

static void unmap(mapping_t *mapping)
{
  if (mapping->data != NULL) {
    munmap(mapping->data, mapping->size);
  }
  *mapping = (mapping_t){0};
}

/* Maps a whole file, which may be empty, in place of what was mapped: `shared` with other
 * processes, or with a copy of each page that is written to. */
static int map_file(mapping_t *mapping, const char *path, bool shared)
{
  unmap(mapping);
  const int fd = open(path, (shared ? O_RDWR : O_RDONLY) | O_CLOEXEC);
  if (fd < 0) {
    return fail_file(path);
  }
  struct stat found;
  void *data = fstat(fd, &found) < 0 ? MAP_FAILED : NULL;
  if (data == NULL && found.st_size > 0) {
    data = mmap(NULL, (size_t)found.st_size, PROT_READ | PROT_WRITE,
                shared ? MAP_SHARED : MAP_PRIVATE, fd, 0);
  }
  const int failed = data == MAP_FAILED ? fail_file(path) : 0;
  close(fd);
  if (failed == 0 && data != NULL) {
    *mapping = (mapping_t){.data = data, .size = (size_t)found.st_size};
  }
  return failed;
}

static bool within(int64_t first, int64_t count, int64_t total)
{
  return first >= 0 && count >= 0 && first <= total && count <= total - first;
}

/* Why a playback cannot be played, or NULL. */
static const char *check(const player_t *player, const mapping_t *file)
{
  playback_t *playback = (void *)file->data;
  if (file->size < sizeof(*playback) || memcmp(playback->magic, "R2BPLAY3", 8) != 0) {
    return "it begins otherwise";
  }
  const size_t bytes = file->size - sizeof(*playback);
  if (bytes % sizeof(entry_t) != 0 || playback->count != (int64_t)(bytes / sizeof(entry_t))) {
    return "it is truncated";
  }
  for (int64_t i = 0; i < playback->count; ++i) {
    entry_t *each = &playback->entries[i];
    if (!within(each->source, 1, player->source_count) || each->left < 1 ||
        !within(i, each->left, playback->count)) {
      return "an entry is damaged";
    }
    const mapping_t *buffer = &player->sources[each->source].buffer;
    if (!within(each->offset, each->size, (int64_t)buffer->size)) {
      return "a file of messages is shorter than its index says";
    }
    if (each->place != NO_PLACE && !within(each->place, STAMP_BYTES, each->size)) {
      return "a stamp is outside of its message";
    }
    /* Its page is made writable before it is needed. */
    each->published_ns = 0;
  }
  return NULL;
}

static int open_playback(const player_t *player, mapping_t *file, const char *path)
{
  if (map_file(file, path, true) < 0) {
    return -1;
  }
  const char *why = check(player, file);
  return why == NULL ? 0 : fail(HARNESS_FAULT, "%s cannot be played: %s", path, why);
}

/* ---- stamps ---- */

static char *data_of(const player_t *player, const entry_t *entry)
{
  return player->sources[entry->source].buffer.data + entry->offset;
}

static uint32_t in_order(uint32_t value, bool little)
{
  return little ? value : __builtin_bswap32(value);
}

static void write_stamp(const player_t *player, const entry_t *entry, int64_t stamp_ns)
{
  if (entry->place == NO_PLACE) {
    return;
  }
  char *data = data_of(player, entry);
  const bool little = data[1] & 1;
  const int64_t whole_ns = stamp_ns + entry->add_ns;
  const int64_t rest_ns = (whole_ns % NS_PER_S + NS_PER_S) % NS_PER_S;
  const uint32_t words[2] = {in_order((uint32_t)((whole_ns - rest_ns) / NS_PER_S), little),
                             in_order((uint32_t)rest_ns, little)};
  memcpy(data + entry->place, words, STAMP_BYTES);
}

/* This happens before waiting: writing to messages that are no longer in the cache takes time,
 * which would delay each publication. */
static void stamp_event(player_t *player, entry_t *event, const int64_t *epoch_ns)
{
  if (epoch_ns != NULL) {
    event->stamp_ns += *epoch_ns;
  } else {
    const int64_t early_ns = event->due_ns - monotonic_ns();
    event->stamp_ns = system_ns() + (early_ns > 0 ? early_ns : 0);
    if (event->stamp_ns <= player->last_stamp_ns) {
      event->stamp_ns = player->last_stamp_ns + 1;
    }
  }
  if (event->stamp_ns > player->last_stamp_ns) {
    player->last_stamp_ns = event->stamp_ns;
  }
  for (int32_t i = 0; i < event->left; ++i) {
    write_stamp(player, &event[i], event->stamp_ns);
  }
}

/* The system time of the beginning, to which the stamps of a recording are shifted. It is later if
 * a stamp would otherwise repeat, because stamps may be ahead of the clock. */
static int64_t find_epoch(const player_t *player, const playback_t *playback, int64_t begin_ns)
{
  const int64_t epoch_ns = system_ns() + begin_ns - monotonic_ns();
  const int64_t least_ns = player->last_stamp_ns + 1 - playback->earliest_stamp_ns;
  return epoch_ns > least_ns ? epoch_ns : least_ns;
}

/* ---- playing ---- */

/* Sleeps, then spins; learns for how long it must spin. True, perhaps earlier, for a command. */
static bool wait_until(player_t *player, int64_t due_ns)
{
  bool slept = false;
  int64_t left_ns;
  while ((left_ns = due_ns - monotonic_ns()) > player->spin_ns) {
    if (channel_wait(player->channel, left_ns - player->spin_ns)) {
      return true;
    }
    slept = true;
  }
  if (slept && left_ns <= 0 && player->spin_ns < MAX_SPIN_NS) {
    player->spin_ns += LATE_STEP_NS;
  } else if (slept && left_ns > 0 && player->spin_ns > MIN_SPIN_NS) {
    player->spin_ns -= EARLY_STEP_NS;
  }
  while (monotonic_ns() < due_ns) {
  }
  return false;
}

static int publish_event(player_t *player, entry_t *event)
{
  const entry_t *last = event + event->left - 1;
  /* What a latency counts from: before the first call that publishes. */
  event->published_ns = monotonic_ns();
  for (const entry_t *each = event; each <= last; ++each) {
    /* What is before the same message is only a stamp. */
    const bool is_stamp = each < last && each[1].source == each->source &&
                          each[1].offset == each->offset;
    if (!is_stamp && ros_publish(&player->sources[each->source].publisher, data_of(player, each),
                                 (size_t)each->size) < 0) {
      return -1;
    }
  }
  event[event->left - 1].done_ns = monotonic_ns();
  return 0;
}

/* Plays until the last event or until a command arrives; returns how many steps are complete. */
static int play_events(player_t *player, playback_t *playback)
{
  const int64_t begin_ns = monotonic_ns() + START_DELAY_NS;
  const int64_t epoch_ns = find_epoch(player, playback, begin_ns);
  int steps = 0;
  for (int64_t i = 0, events = 0; i < playback->count; i += playback->entries[i].left, ++events) {
    entry_t *event = &playback->entries[i];
    event->due_ns += begin_ns;
    stamp_event(player, event, playback->has_stamps ? &epoch_ns : NULL);
    if (wait_until(player, event->due_ns) ||
        (events % EVENTS_PER_LOOK == 0 && channel_wait(player->channel, 0))) {
      break;
    }
    if (publish_event(player, event) < 0) {
      return -1;
    }
    steps = event->complete;
    /* The event before the count: a reader sees complete events only. */
    __atomic_store_n(&playback->published, i + event->left, __ATOMIC_RELEASE);
  }
  return steps;
}

static int play(player_t *player, const char *path)
{
  mapping_t file = {0};
  int steps = open_playback(player, &file, path);
  if (steps == 0) {
    steps = play_events(player, (void *)file.data);
  }
  unmap(&file);
  return steps < 0 ? -1 : channel_reply(player->channel, "played %d\n", steps);
}

/* ---- commands ---- */

/* Reads all messages of a playback from the disk, and copies the pages that stamps are written to,
 * before any of them is played. */
static int load(player_t *player, const char *path)
{
  for (int64_t i = 0; i < player->source_count; ++i) {
    if (map_file(&player->sources[i].buffer, player->sources[i].path, false) < 0) {
      return -1;
    }
  }
  mapping_t file = {0};
  const int failed = open_playback(player, &file, path);
  const playback_t *playback = (const void *)file.data;
  for (int64_t i = 0; failed == 0 && i < playback->count; ++i) {
    const volatile char *data = data_of(player, &playback->entries[i]);
    for (int32_t place = 0; place < playback->entries[i].size; place += PAGE_BYTES) {
      (void)data[place];
    }
    write_stamp(player, &playback->entries[i], 0);
  }
  unmap(&file);
  return failed < 0 ? -1 : channel_reply(player->channel, "ready\n");
}

/* player INPUTS {TYPE QOS TOPIC BUFFER} */
static int configure(player_t *player)
{
  channel_t *channel = player->channel;
  const int64_t inputs = next_number(channel);
  player->sources = calloc(inputs < 0 ? 1 : (size_t)inputs + 1, sizeof(source_t));
  if (player->sources == NULL) {
    return fail_memory();
  }
  for (; player->source_count < inputs; ++player->source_count) {
    source_t *source = &player->sources[player->source_count];
    type_t *type = ros_type(next_word(channel));
    const rmw_qos_profile_t qos = next_qos(channel);
    if (type == NULL ||
        ros_publisher(player->node, type, &qos, next_word(channel), &source->publisher) < 0) {
      return -1;
    }
    source->has_header = begins_with_header(type);
    source->path = strdup(next_word(channel));
  }
  return 0;
}

/* Sends a number for each input: whether its type begins with a header, or its subscriptions. */
static int send_numbers(player_t *player, const char *reply, bool headers)
{
  int failed = channel_reply(player->channel, "%s", reply);
  for (int64_t i = 0; i < player->source_count && failed == 0; ++i) {
    size_t number = player->sources[i].has_header;
    if (!headers) {
      ignore_rcl(rcl_publisher_get_subscription_count(&player->sources[i].publisher, &number));
    }
    failed = channel_reply(player->channel, " %zu", number);
  }
  return failed < 0 ? -1 : channel_reply(player->channel, "\n");
}

/* Executes a command; 1 for the one that ends the player. */
static int execute(player_t *player)
{
  const char *command = next_word(player->channel);
  if (strcmp(command, "follow") == 0) {
    return load(player, next_word(player->channel));
  }
  if (strcmp(command, "count") == 0) {
    return send_numbers(player, "matched", false);
  }
  if (strcmp(command, "play") == 0) {
    return play(player, next_word(player->channel));
  }
  /* Others are ignored: a stop that arrived after the last event. */
  return strcmp(command, "shutdown") == 0 || *command == '\0';
}

static void clean_up(player_t *player)
{
  for (int64_t i = 0; i < player->source_count; ++i) {
    ignore_rcl(rcl_publisher_fini(&player->sources[i].publisher, player->node));
    unmap(&player->sources[i].buffer);
    free(player->sources[i].path);
  }
  free(player->sources);
}

int player_serve(channel_t *channel, rcl_node_t *node)
{
  player_t player = {.channel = channel, .node = node, .spin_ns = INITIAL_SPIN_NS};
  int status = configure(&player);
  if (status == 0) {
    status = send_numbers(&player, "ready", true);
  }
  /* The slack of timers is 50 us by default; without this call sleeps just end later. */
  (void)prctl(PR_SET_TIMERSLACK, 1UL, 0UL, 0UL, 0UL);
  while (status == 0) {
    status = execute(&player);
  }
  clean_up(&player);
  return status < 0 ? -1 : 0;
}
