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

static size_t play(const messages_t *list, const playback_t *playback)
{
  size_t bytes = 0;
  for (int64_t i = 0; i < playback->header->events; ++i) {
    const event_t *event = &playback->events[i];
    for (int64_t number = 0; number < event->count; ++number) {
      const message_t *message = &list->messages[event->first + number];
      message_stamp(list, message, event->stamp_ns);
      const volatile char *data = message_data(list, message);
      for (int64_t place = 0; place < message->size; ++place, ++bytes) {
        (void)data[place];
      }
    }
  }
  return bytes;
}

static void answer(char *line)
{
  char *words[MOST_BUFFERS + 2] = {NULL};
  int64_t count = 0;
  for (char *word; count < MOST_BUFFERS + 2 && (word = strsep(&line, " \n")) != NULL;) {
    if (*word != '\0') {
      words[count++] = word;
    }
  }
  messages_t list = {0};
  playback_t playback = {0};
  if (messages_open(&list, words[0], words + 2, count - 2) == 0 &&
      playback_open(&playback, words[1], &list) == 0) {
    printf("played %zu\n", play(&list, &playback));
  } else {
    printf("%s\n", reason);
  }
  playback_close(&playback);
  messages_close(&list);
  fflush(stdout);
}

int main(void)
{
  char line[8192];
  while (fgets(line, sizeof(line), stdin) != NULL) {
    answer(line);
  }
  return 0;
}
