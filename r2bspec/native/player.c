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
/* A late player never sleeps, so it also looks for commands after so many entries. */
#define ENTRIES_PER_LOOK 64
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
#define MAX_CLOCKS 256
#define NO_TIME (-1)
#define NO_CLOCK INT32_MAX /* which cannot be read */

/* Of size 0 if nothing is mapped: munmap() then only returns an error. */
typedef struct mapping {
  char *data;
  size_t size;
} mapping_t;

/* An input of the plan, or /tf after them. */
typedef struct source {
  rcl_publisher_t publisher;
  bool has_header;
  mapping_t buffer; /* its messages */
} source_t;

/* r2bspec/ipc/playback_file.py: a message of an event, or one more stamp in the message after it.
 * The first three times are relative until an event is played. */
typedef struct entry {
  int64_t due_ns, stamp_ns, published_ns, done_ns;
  int64_t inputs, offset, add_ns;
  int32_t size, place;
  int16_t source, is_published;
  int32_t left; /* entries of the event, from this one on */
  int32_t step, complete;
} entry_t;

/* r2bspec/ipc/playback_file.py: the entries, and after them for each entry the time of each clock. */
typedef struct playback {
  int64_t published;
  char magic[8];
  int64_t count, is_loaded, has_stamps;
  int64_t least_ns; /* the least time of the beginning, or stamp if it has no stamps */
  int64_t begin_ns; /* when the first event is due; 0 for soon */
  int64_t clocks;
  entry_t entries[];
} playback_t;

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the files are little-endian");
_Static_assert(sizeof(playback_t) == 64 && sizeof(entry_t) == 80, "as Python writes them");

typedef struct player {
  channel_t *channel;
  rcl_node_t *node;
  source_t *sources;
  int64_t source_count;
  int64_t spin_ns;
  clockid_t clocks[MAX_CLOCKS]; /* of the processes whose work is measured */
  int64_t clock_count;
  int64_t *times; /* a row of times for each entry of the file that is played */
  int64_t row_size;
} player_t;

/* ---- files ---- */

/* Maps a whole file, which may be empty: `shared` with other processes, or with a copy of each page
 * that is written to. */
static int map_file(mapping_t *mapping, const char *path, bool shared)
{
  const int fd = open(path, (shared ? O_RDWR : O_RDONLY) | O_CLOEXEC);
  if (fd < 0) {
    return fail_errno(path);
  }
  struct stat found;
  void *data = fstat(fd, &found) < 0 ? MAP_FAILED : NULL;
  if (data == NULL && found.st_size > 0) {
    data = mmap(NULL, (size_t)found.st_size, PROT_READ | PROT_WRITE,
                shared ? MAP_SHARED : MAP_PRIVATE, fd, 0);
  }
  const int failed = data == MAP_FAILED ? fail_errno(path) : 0;
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

/* Copies an entry, and checks that all it refers to exists. Another process can write to the mapped
 * file at any time, so only the copy is used. */
static int take_entry(
  const player_t *player, const playback_t *playback, int64_t i, int64_t count, entry_t *entry)
{
  memcpy(entry, &playback->entries[i], sizeof(*entry));
  /* Nothing of it is read again. */
  __asm__ volatile("" : : "r"(entry) : "memory");
  const bool whole = within(entry->source, 1, player->source_count) &&
    within(entry->offset, entry->size, (int64_t)player->sources[entry->source].buffer.size) &&
    (entry->place == NO_PLACE || within(entry->place, STAMP_BYTES, entry->size)) &&
    within(i, entry->left, count) && entry->left > 0;
  return whole ? 0 : fail(HARNESS_FAULT, "the playback file is damaged in entry %lld", (long long)i);
}

/* To be unmapped in any case. */
static int open_playback(player_t *player, mapping_t *file, const char *path)
{
  if (map_file(file, path, true) < 0) {
    return -1;
  }
  playback_t *playback = (void *)file->data;
  bool whole = file->size >= sizeof(*playback) && memcmp(playback->magic, "R2BPLAY5", 8) == 0 &&
               within(playback->clocks, 0, player->clock_count);
  player->row_size = whole ? playback->clocks : 0;
  const size_t size = sizeof(entry_t) + (size_t)player->row_size * sizeof(int64_t);
  const int64_t entries = whole ? (int64_t)((file->size - sizeof(*playback)) / size) : 0;
  whole = whole && playback->count == entries &&
          file->size == sizeof(*playback) + (size_t)entries * size;
  player->times = whole ? (int64_t *)&playback->entries[entries] : NULL;
  entry_t entry;
  for (int64_t i = 0; whole && i < entries; ++i) {
    whole = take_entry(player, playback, i, entries, &entry) == 0;
    /* Its page is made writable before it is needed. */
    playback->entries[i].published_ns = 0;
  }
  return whole ? 0
               : fail(HARNESS_FAULT, "%s is damaged, or a buffer shorter than its index", path);
}

/* ---- stamps ---- */

static char *data_of(const player_t *player, const entry_t *entry)
{
  return player->sources[entry->source].buffer.data + entry->offset;
}

static void write_stamp(const player_t *player, const entry_t *entry, int64_t stamp_ns)
{
  if (entry->place == NO_PLACE) {
    return;
  }
  char *data = data_of(player, entry);
  const int64_t whole_ns = stamp_ns + entry->add_ns;
  const int64_t rest_ns = (whole_ns % NS_PER_S + NS_PER_S) % NS_PER_S;
  uint32_t words[2] = {(uint32_t)((whole_ns - rest_ns) / NS_PER_S), (uint32_t)rest_ns};
  if ((data[1] & 1) == 0) { /* big-endian */
    words[0] = __builtin_bswap32(words[0]);
    words[1] = __builtin_bswap32(words[1]);
  }
  memcpy(data + entry->place, words, STAMP_BYTES);
}

static int64_t later(int64_t one_ns, int64_t other_ns)
{
  return one_ns > other_ns ? one_ns : other_ns;
}

/* ---- work ---- */

/* Reads the processor time of each process; one that has ended has none. */
static void read_work(const player_t *player, int64_t entry)
{
  for (int64_t i = 0; i < player->row_size; ++i) {
    struct timespec used;
    player->times[entry * player->row_size + i] =
      clock_gettime(player->clocks[i], &used) == 0 ? used.tv_sec * NS_PER_S + used.tv_nsec
                                                   : NO_TIME;
  }
}

/* ---- playing ---- */

/* Sleeps, reads the clocks, then spins; learns for how long it must spin. True, perhaps earlier,
 * for a command. The clocks are read while it would spin, so that they delay no publication. */
static bool wait_until(player_t *player, int64_t due_ns, int64_t entry)
{
  const bool looks = entry % ENTRIES_PER_LOOK == 0;
  const int64_t sleep_ns = due_ns - monotonic_ns() - player->spin_ns;
  if ((sleep_ns > 0 || looks) && channel_wait(player->channel, sleep_ns > 0 ? sleep_ns : 0)) {
    return true;
  }
  const bool is_late = monotonic_ns() >= due_ns;
  if (sleep_ns > 0 && is_late && player->spin_ns < MAX_SPIN_NS) {
    player->spin_ns += LATE_STEP_NS;
  } else if (sleep_ns > 0 && !is_late && player->spin_ns > MIN_SPIN_NS) {
    player->spin_ns -= EARLY_STEP_NS;
  }
  read_work(player, entry);
  while (monotonic_ns() < due_ns) {
  }
  return false;
}

static int publish_event(player_t *player, playback_t *playback, int64_t first, int64_t end)
{
  /* What a latency counts from: before the first call that publishes. */
  playback->entries[first].published_ns = monotonic_ns();
  rcl_serialized_message_t message = {.allocator = rcl_get_default_allocator()};
  entry_t entry;
  for (int64_t i = first; i < end; ++i) {
    if (take_entry(player, playback, i, end, &entry) < 0) {
      return -1;
    }
    message.buffer = (uint8_t *)data_of(player, &entry);
    message.buffer_length = message.buffer_capacity = (size_t)entry.size;
    if (entry.is_published &&
        rcl_publish_serialized_message(
          &player->sources[entry.source].publisher, &message, NULL) != RCL_RET_OK) {
      return fail_rcl("publishing a message");
    }
  }
  playback->entries[end - 1].done_ns = monotonic_ns();
  return 0;
}

/* Plays until the last event or until a command arrives; returns how many steps are complete. */
static int play_events(player_t *player, playback_t *playback, int64_t count)
{
  const int64_t begin_ns =
    playback->begin_ns != 0 ? playback->begin_ns : monotonic_ns() + START_DELAY_NS;
  /* To which the stamps of a recording are shifted. */
  const int64_t epoch_ns = later(
    system_ns() + later(begin_ns - monotonic_ns(), START_DELAY_NS), playback->least_ns);
  int64_t least_stamp_ns = playback->least_ns;
  int steps = 0;
  entry_t entry;
  for (int64_t first = 0, end; first < count; first = end) {
    entry_t *event = &playback->entries[first];
    if (take_entry(player, playback, first, count, &entry) < 0) {
      return -1;
    }
    end = first + entry.left;
    const int64_t due_ns = event->due_ns = entry.due_ns + begin_ns;
    /* Otherwise it is the time of publication, which is unique. */
    const int64_t early_ns = later(due_ns - monotonic_ns(), 0);
    const int64_t stamp_ns = playback->has_stamps ? entry.stamp_ns + epoch_ns
                                                  : later(system_ns() + early_ns, least_stamp_ns);
    event->stamp_ns = stamp_ns;
    least_stamp_ns = stamp_ns + 1;
    const int complete = entry.complete;
    /* Before waiting: writing to messages that have left the cache would delay a publication. */
    for (int64_t i = first; i < end; ++i) {
      if (take_entry(player, playback, i, end, &entry) < 0) {
        return -1;
      }
      write_stamp(player, &entry, stamp_ns);
    }
    if (wait_until(player, due_ns, first)) {
      break;
    }
    if (publish_event(player, playback, first, end) < 0) {
      return -1;
    }
    steps = complete;
    /* The event before the count: a reader sees complete events only. */
    __atomic_store_n(&playback->published, end, __ATOMIC_RELEASE);
  }
  return steps;
}

/* Reads all messages from the disk, and copies the pages that stamps are written to, before any of
 * them is played. */
static int touch(const player_t *player, const playback_t *playback, int64_t count)
{
  entry_t entry;
  for (int64_t i = 0; i < count; ++i) {
    if (take_entry(player, playback, i, count, &entry) < 0) {
      return -1;
    }
    const volatile char *data = data_of(player, &entry);
    for (int64_t place = 0; place < entry.size; place += PAGE_BYTES) {
      (void)data[place];
    }
    write_stamp(player, &entry, 0);
  }
  return 0;
}

static int play(player_t *player, const char *path)
{
  mapping_t file = {0};
  int steps = open_playback(player, &file, path);
  if (steps == 0) {
    playback_t *playback = (void *)file.data;
    const int64_t count = (entry_t *)player->times - playback->entries;
    steps = playback->is_loaded ? play_events(player, playback, count)
                                : touch(player, playback, count);
  }
  (void)munmap(file.data, file.size);
  return steps < 0 ? -1 : channel_reply(player->channel, "played %d\n", steps);
}

/* ---- commands ---- */

/* Makes the input {TYPE QOS TOPIC BUFFER}. */
static int add_source(player_t *player, channel_t *channel)
{
  source_t *source = &player->sources[player->source_count];
  type_t *type = next_type(channel);
  rcl_publisher_options_t options = rcl_publisher_get_default_options();
  options.qos = next_qos(channel);
  source->publisher = rcl_get_zero_initialized_publisher();
  if (type == NULL) {
    return -1;
  }
  if (rcl_publisher_init(&source->publisher, player->node, type, next_word(channel), &options) !=
      RCL_RET_OK) {
    return fail_rcl("creating a publisher");
  }
  player->source_count += 1;
  source->has_header = begins_with_header(type);
  return map_file(&source->buffer, next_word(channel), false);
}

/* player INPUTS {TYPE QOS TOPIC BUFFER} */
static int configure(player_t *player)
{
  const int64_t inputs = next_number(player->channel);
  player->sources = calloc(inputs < 0 ? 1 : (size_t)inputs + 1, sizeof(source_t));
  int failed = player->sources == NULL ? fail_errno("memory") : 0;
  while (failed == 0 && player->source_count < inputs) {
    failed = add_source(player, player->channel);
  }
  return failed;
}

/* watch PROCESSES {PID}: whose work is measured from now on */
static int watch(player_t *player)
{
  const int64_t processes = next_number(player->channel);
  player->clock_count = 0;
  for (int64_t i = 0; i < processes; ++i) {
    clockid_t clock;
    const pid_t process = (pid_t)next_number(player->channel);
    if (player->clock_count < MAX_CLOCKS) {
      /* A process that has ended keeps its place. */
      player->clocks[player->clock_count++] =
        clock_getcpuclockid(process, &clock) == 0 ? clock : NO_CLOCK;
    }
  }
  return channel_reply(player->channel, "watched %lld\n", (long long)player->clock_count);
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
  if (strcmp(command, "play") == 0) {
    return play(player, next_word(player->channel));
  }
  if (strcmp(command, "watch") == 0) {
    return watch(player);
  }
  if (strcmp(command, "count") == 0) {
    return send_numbers(player, "matched", false);
  }
  /* A stop that arrived after the last event has nothing to stop. */
  return strcmp(command, "stop") != 0;
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
  for (int64_t i = 0; i < player.source_count; ++i) {
    ignore_rcl(rcl_publisher_fini(&player.sources[i].publisher, node));
    (void)munmap(player.sources[i].buffer.data, player.sources[i].buffer.size);
  }
  free(player.sources);
  return status < 0 ? -1 : 0;
}
