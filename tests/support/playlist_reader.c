/* Opens the files of players as playlist.c checks them, and does with their messages what a player
 * does, except for publishing.
 *
 * Each line of the input is PLAYLIST PLAYBACK BUFFER...; the answer is how many bytes were stamped
 * and read, or the reason for which a file was refused.
 */
#include <stdarg.h>
#include <string.h>

#include "harness.h"

#define MOST_BUFFERS 8

static char reason[1024];

int fail(const char *code, const char *format, ...)
{
  (void)code;
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(reason, sizeof(reason), format, arguments);
  va_end(arguments);
  return -1;
}

int fail_file(const char *path) { return fail("", "%s cannot be read", path); }
int fail_memory(void) { return fail("", "no memory"); }

static size_t play(const table_t *list, const table_t *playback, const source_t *sources)
{
  size_t bytes = 0;
  const message_t *messages = list->items;
  const event_t *events = playback->items;
  for (int64_t i = 0; i < playback->header->items; ++i) {
    for (int64_t number = 0; number < events[i].count; ++number) {
      const message_t *message = &messages[events[i].first + number];
      message_stamp(message, sources, events[i].stamp_ns);
      const volatile char *data = sources[message->source].buffer.data + message->offset;
      for (int64_t place = 0; place < message->size; ++place, ++bytes) {
        (void)data[place];
      }
    }
  }
  return bytes;
}

static void answer(char *line)
{
  const char *playlist = strsep(&line, " "), *path = strsep(&line, " ");
  source_t sources[MOST_BUFFERS] = {0};
  int64_t count = 0;
  int failed = 0;
  for (char *word; failed == 0 && (word = strsep(&line, " \n")) != NULL && *word != '\0';) {
    failed = mapping_open(&sources[count++].buffer, word, false);
  }
  table_t list = {0}, playback = {0};
  if (failed == 0 && messages_open(&list, playlist, sources, count) == 0 &&
      playback_open(&playback, path, &list) == 0) {
    printf("played %zu\n", play(&list, &playback, sources));
  } else {
    printf("%s\n", reason);
  }
  fflush(stdout);
  table_close(&playback);
  table_close(&list);
  while (count > 0) {
    mapping_close(&sources[--count].buffer);
  }
}

int main(void)
{
  char line[8192];
  while (fgets(line, sizeof(line), stdin) != NULL) {
    answer(line);
  }
  return 0;
}
