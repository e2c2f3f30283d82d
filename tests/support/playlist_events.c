/* Prints the events of playlists as schedule.c reads and repeats them, for comparison with Python.
 *
 * Each line of the input is SOURCES RATE-HZ STEPS FIRST MOST PATH: at most MOST events of a playback
 * are printed, one a line, and a line with the reason, or "end", after them.
 */
#include <inttypes.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "harness.h"

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

static void print_event(const playlist_t *list, const event_t *event)
{
  printf("%" PRId64 " %" PRId64 " %d %" PRId64 " %" PRId64 " %d %d %" PRId64, event->offset_ns,
         event->step, event->has_stamp, event->stamp_ns, event->origin_ns, event->starts_step,
         event->ends_step, event->source->inputs);
  for (int64_t i = 0; i < event->source->refs; ++i) {
    const message_ref_t *ref = &list->refs[event->source->first_ref + i];
    const message_t *message = &list->messages[ref->message];
    printf(" %" PRId64 ":%" PRId64 ":%" PRId64, message->source, message->offset,
           ref->stamp_offset_ns);
  }
  printf("\n");
}

static int print_playback(char *line)
{
  const int64_t sources = strtoll(line, &line, 10);
  const double rate_hz = strtod(line, &line);
  const int64_t steps = strtoll(line, &line, 10);
  const int64_t first = strtoll(line, &line, 10);
  int64_t most = strtoll(line, &line, 10);
  line[strcspn(line, "\n")] = '\0';
  playlist_t list;
  if (playlist_open(&list, line + 1, sources) < 0) {
    return -1;
  }
  cursor_t at;
  int failed = cursor_init(&at, &list, rate_hz, steps, first);
  if (failed == 0) {
    event_t event;
    for (; most > 0 && cursor_next(&at, &event); --most) {
      print_event(&list, &event);
    }
    cursor_fini(&at);
  }
  playlist_close(&list);
  return failed;
}

int main(void)
{
  char line[4096];
  while (fgets(line, sizeof(line), stdin) != NULL) {
    printf("%s\n", print_playback(line) < 0 ? reason : "end");
    fflush(stdout);
  }
  return 0;
}
