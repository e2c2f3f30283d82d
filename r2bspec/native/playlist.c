/* The files of a player: r2bspec/ipc/playlist.py writes its messages, and playback_file.py what it
 * publishes when, into which it writes what it has done.
 *
 * Both are checked when they are opened: nothing of a damaged one reaches beyond the files. Their
 * arithmetic wraps around (-fwrapv), so that wrong times are nothing but wrong times.
 */
#include "harness.h"

#include <fcntl.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the files are little-endian");
_Static_assert(sizeof(event_t) == 56 && sizeof(message_t) == 48, "as Python writes them");

#define STAMP_BYTES 8
#define PAGE_BYTES 4096 /* or a multiple of it */

static int refuse(const char *path, const char *why)
{
  return fail(HARNESS_FAULT, "%s cannot be played: %s", path, why);
}

static bool within(int64_t first, int64_t count, int64_t total)
{
  return first >= 0 && count >= 0 && first <= total && count <= total - first;
}

int mapping_open(mapping_t *mapping, const char *path, bool shared)
{
  mapping_close(mapping);
  struct stat found;
  const int fd = open(path, (shared ? O_RDWR : O_RDONLY) | O_CLOEXEC);
  int failed = fd < 0 || fstat(fd, &found) < 0 ? fail_file(path) : 0;
  if (failed == 0 && found.st_size > 0) {
    const int kind = shared ? MAP_SHARED : MAP_PRIVATE;
    void *data = mmap(NULL, (size_t)found.st_size, PROT_READ | PROT_WRITE, kind, fd, 0);
    failed = data == MAP_FAILED ? fail_file(path) : 0;
    if (failed == 0) {
      *mapping = (mapping_t){.data = data, .size = (size_t)found.st_size};
    }
  }
  if (fd >= 0) {
    close(fd);
  }
  return failed;
}

void mapping_close(mapping_t *mapping)
{
  if (mapping->data != NULL) {
    munmap(mapping->data, mapping->size);
  }
  *mapping = (mapping_t){0};
}

/* Maps a file that begins with a header, and has nothing but so many items after it. */
static int table_open(table_t *table, const char *path, const char *magic, size_t item_bytes)
{
  if (mapping_open(&table->file, path, true) < 0) {
    return -1;
  }
  table_header_t *head = (void *)table->file.data;
  if (table->file.size < sizeof(*head) || memcmp(head->magic, magic, sizeof(head->magic)) != 0) {
    return refuse(path, "it begins otherwise");
  }
  const size_t bytes = table->file.size - sizeof(*head);
  if (bytes % item_bytes != 0 || head->items != (int64_t)(bytes / item_bytes)) {
    return refuse(path, "it is truncated");
  }
  table->header = head;
  table->items = head + 1;
  return 0;
}

static uint32_t in_order(uint32_t value, bool little)
{
  return little ? value : __builtin_bswap32(value);
}

void message_stamp(const message_t *message, const source_t *sources, int64_t stamp_ns)
{
  if (message->place == NO_PLACE) {
    return;
  }
  char *data = sources[message->source].buffer.data + message->offset;
  const bool little = data[1] & 1;
  const int64_t whole_ns = message->add_ns + stamp_ns;
  const int64_t rest_ns = (whole_ns % NS_PER_S + NS_PER_S) % NS_PER_S;
  const uint32_t words[2] = {in_order((uint32_t)((whole_ns - rest_ns) / NS_PER_S), little),
                             in_order((uint32_t)rest_ns, little)};
  memcpy(data + message->place, words, STAMP_BYTES);
}

/* Reads a message from the disk, and copies the page that its stamp is written to. */
static void touch(const message_t *message, const source_t *sources)
{
  const volatile char *data = sources[message->source].buffer.data + message->offset;
  for (int64_t place = 0; place < message->size; place += PAGE_BYTES) {
    (void)data[place];
  }
  message_stamp(message, sources, 0);
}

int messages_open(table_t *table, const char *path, const source_t *sources, int64_t source_count)
{
  if (table_open(table, path, "R2BMSGS2", sizeof(message_t)) < 0) {
    return -1;
  }
  const message_t *messages = table->items;
  for (int64_t i = 0; i < table->header->items; ++i) {
    const message_t *each = &messages[i];
    if (!within(each->source, 1, source_count)) {
      return refuse(path, "a message has no input");
    }
    if (!within(each->offset, each->size, (int64_t)sources[each->source].buffer.size)) {
      return refuse(path, "a file of messages is shorter than its index says");
    }
    if (each->place != NO_PLACE && !within(each->place, STAMP_BYTES, each->size)) {
      return refuse(path, "a stamp is outside of its message");
    }
    touch(each, sources);
  }
  return 0;
}

int playback_open(table_t *table, const char *path, const table_t *messages)
{
  if (table_open(table, path, "R2BPLAY2", sizeof(event_t)) < 0) {
    return -1;
  }
  event_t *events = table->items;
  const int64_t known = messages->header == NULL ? 0 : messages->header->items;
  for (int64_t i = 0; i < table->header->items; ++i) {
    if (!within(events[i].first, events[i].count, known)) {
      return refuse(path, "an event has a message that does not exist");
    }
    /* Its page is made writable before it is needed. */
    events[i].published_ns = 0;
  }
  return 0;
}

void table_close(table_t *table)
{
  mapping_close(&table->file);
  *table = (table_t){0};
}
