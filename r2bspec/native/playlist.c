/* The files of a player: r2bspec/ipc/playlist.py writes its messages, and playback_file.py what it
 * publishes when, into which it writes what it has done.
 *
 * Both are checked when they are opened: nothing of a damaged one reaches beyond the files. Their
 * arithmetic wraps around (-fwrapv), so that wrong times are nothing but wrong times.
 */
#include "harness.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the files are little-endian");
_Static_assert(sizeof(playback_header_t) == 64 && sizeof(event_t) == 56, "as Python writes them");

#define MESSAGES_MAGIC "R2BMSGS1"
#define PLAYBACK_MAGIC "R2BPLAY2"
#define PAGE_BYTES 4096 /* or a multiple of it */

typedef struct messages_header {
  char magic[8];
  int64_t messages, places;
} messages_header_t;

static int refuse(const char *path, const char *why)
{
  return fail(HARNESS_FAULT, "%s cannot be played: %s", path, why);
}

static bool within(int64_t first, int64_t count, int64_t total)
{
  return first >= 0 && count >= 0 && first <= total && count <= total - first;
}

/* Maps a whole file, which may be empty: `shared` with other processes, or a copy of each page that
 * is written to. */
static int map_file(mapping_t *mapping, const char *path, bool shared)
{
  struct stat found;
  const int fd = open(path, (shared ? O_RDWR : O_RDONLY) | O_CLOEXEC);
  int failed = fd < 0 || fstat(fd, &found) < 0 ? fail_file(path) : 0;
  if (failed == 0 && found.st_size > 0) {
    const int kind = shared ? MAP_SHARED : MAP_PRIVATE;
    void *data = mmap(NULL, (size_t)found.st_size, PROT_READ | PROT_WRITE, kind, fd, 0);
    if (data == MAP_FAILED) {
      failed = fail_file(path);
    } else {
      *mapping = (mapping_t){.data = data, .size = (size_t)found.st_size};
    }
  }
  if (fd >= 0) {
    close(fd);
  }
  return failed;
}

static void unmap(mapping_t *mapping)
{
  if (mapping->data != NULL) {
    munmap(mapping->data, mapping->size);
  }
  *mapping = (mapping_t){0};
}

char *message_data(const messages_t *list, const message_t *message)
{
  return list->buffers[message->source].data + message->offset;
}

static uint32_t in_order(uint32_t value, bool little)
{
  return little ? value : __builtin_bswap32(value);
}

void message_stamp(const messages_t *list, const message_t *message, int64_t stamp_ns)
{
  char *data = message_data(list, message);
  for (int64_t i = 0; i < message->places; ++i) {
    const stamp_place_t *place = &list->places[message->first_place + i];
    const int64_t shifted_ns = place->stamp_ns + message->shift_ns + stamp_ns;
    const int64_t rest_ns = (shifted_ns % NS_PER_S + NS_PER_S) % NS_PER_S;
    const bool little = data[1] & 1;
    const uint32_t words[2] = {in_order((uint32_t)((shifted_ns - rest_ns) / NS_PER_S), little),
                               in_order((uint32_t)rest_ns, little)};
    memcpy(data + place->position, words, sizeof(words));
  }
}

static int check_messages(const messages_t *list, const char *path, int64_t sources, int64_t places)
{
  for (int64_t i = 0; i < list->count; ++i) {
    const message_t *each = &list->messages[i];
    if (!within(each->source, 1, sources) || each->size < 1 ||
        !within(each->first_place, each->places, places)) {
      return refuse(path, "a message is not where it can be");
    }
    if (!within(each->offset, each->size, (int64_t)list->buffers[each->source].size)) {
      return refuse(path, "a file of messages is shorter than its index says");
    }
    for (int64_t place = 0; place < each->places; ++place) {
      if (!within(list->places[each->first_place + place].position, 8, each->size)) {
        return refuse(path, "a stamp is outside of its message");
      }
    }
  }
  return 0;
}

/* Reads the messages from the disk, and copies the pages that stamps are written to. */
static void touch_messages(const messages_t *list)
{
  for (int64_t i = 0; i < list->count; ++i) {
    const volatile char *data = message_data(list, &list->messages[i]);
    for (int64_t place = 0; place < list->messages[i].size; place += PAGE_BYTES) {
      (void)data[place];
    }
    message_stamp(list, &list->messages[i], 0);
  }
}

int messages_open(messages_t *list, const char *path, char *const *buffers, int64_t sources)
{
  *list = (messages_t){.buffers = calloc((size_t)sources + 1, sizeof(mapping_t))};
  if (list->buffers == NULL) {
    return fail_memory();
  }
  for (; list->sources < sources; ++list->sources) {
    if (map_file(&list->buffers[list->sources], buffers[list->sources], false) < 0) {
      return -1;
    }
  }
  if (map_file(&list->index, path, false) < 0) {
    return -1;
  }
  const messages_header_t *head = (const void *)list->index.data;
  if (list->index.size < sizeof(*head) || memcmp(head->magic, MESSAGES_MAGIC, 8) != 0) {
    return refuse(path, "it does not begin like a list of messages");
  }
  const int64_t left = (int64_t)(list->index.size - sizeof(*head));
  if (!within(0, head->messages, left / (int64_t)sizeof(message_t)) ||
      !within(0, head->places, left / (int64_t)sizeof(stamp_place_t)) ||
      head->messages * (int64_t)sizeof(message_t) +
          head->places * (int64_t)sizeof(stamp_place_t) != left) {
    return refuse(path, "it is truncated");
  }
  list->count = head->messages;
  list->messages = (const void *)(head + 1);
  list->places = (const void *)(list->messages + head->messages);
  if (check_messages(list, path, sources, head->places) < 0) {
    return -1;
  }
  touch_messages(list);
  return 0;
}

void messages_close(messages_t *list)
{
  for (int64_t i = 0; i < list->sources; ++i) {
    unmap(&list->buffers[i]);
  }
  unmap(&list->index);
  free(list->buffers);
  *list = (messages_t){0};
}

int playback_open(playback_t *playback, const char *path, const messages_t *list)
{
  *playback = (playback_t){0};
  if (map_file(&playback->file, path, true) < 0) {
    return -1;
  }
  playback_header_t *head = (void *)playback->file.data;
  if (playback->file.size < sizeof(*head) || memcmp(head->magic, PLAYBACK_MAGIC, 8) != 0) {
    return refuse(path, "it does not begin like a playback");
  }
  const size_t left = playback->file.size - sizeof(*head);
  if (left % sizeof(event_t) != 0 || head->events != (int64_t)(left / sizeof(event_t))) {
    return refuse(path, "it is truncated");
  }
  playback->header = head;
  playback->events = (void *)(head + 1);
  for (int64_t i = 0; i < head->events; ++i) {
    event_t *each = &playback->events[i];
    if (!within(each->first, each->count, list->count)) {
      return refuse(path, "an event has a message that does not exist");
    }
    /* Its page is made writable before it is needed. */
    each->published_ns = 0;
  }
  return 0;
}

void playback_close(playback_t *playback)
{
  unmap(&playback->file);
}
