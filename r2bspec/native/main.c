/* A process of the harness, for a player, a monitor, or both.
 *
 * Its channels are inherited: R2BSPEC_CONTROL_FD, and one more for each part of it.
 */
#include "harness.h"

#include <inttypes.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define CONTROL_FD "R2BSPEC_CONTROL_FD"
#define USAGE_STATUS 2

/* Prints the events of a playlist, so that tests can compare them with those of Python. */
static int dump(char **words)
{
  playlist_t list;
  if (playlist_open(&list, words[0], strtoll(words[1], NULL, 10)) < 0) {
    return 1;
  }
  cursor_t at;
  event_t event;
  const int64_t steps = strtoll(words[3], NULL, 10);
  if (cursor_init(&at, &list, strtod(words[2], NULL), steps, strtoll(words[4], NULL, 10)) == 0) {
    while (cursor_next(&at, &event)) {
      printf("%" PRId64 " %" PRId64 " %d %" PRId64 " %" PRId64 " %d %d %" PRId64, event.offset_ns,
             event.step, event.has_stamp, event.stamp_ns, event.origin_ns, event.starts_step,
             event.ends_step, event.source->inputs);
      for (int64_t i = 0; i < event.source->refs; ++i) {
        const message_ref_t *ref = &list.refs[event.source->first_ref + i];
        const message_t *message = &list.messages[ref->message];
        printf(" %" PRId64 ":%" PRId64 ":%" PRId64, message->source, message->offset,
               ref->stamp_offset_ns);
      }
      printf("\n");
    }
    cursor_fini(&at);
  }
  playlist_close(&list);
  return 0;
}

/* Serves an inherited channel; the variable is not for programs that this one might start. */
static bool serve_variable(const char *name)
{
  const char *value = getenv(name);
  if (value == NULL) {
    return false;
  }
  const int fd = atoi(value);
  unsetenv(name);
  return r2bspec_harness_serve(fd) == 0;
}

int main(int count, char **words)
{
  if (count == 7 && strcmp(words[1], "dump") == 0) {
    return dump(&words[2]);
  }
  /* Ctrl-C goes to the controller, which ends its children in order. */
  signal(SIGINT, SIG_IGN);
  (void)serve_variable(CONTROL_FD "_PLAYER");
  (void)serve_variable(CONTROL_FD "_MONITOR");
  if (!serve_variable(CONTROL_FD)) {
    fputs("this program is started by 'r2bspec run' and cannot be run alone\n", stderr);
    return USAGE_STATUS;
  }
  const int status = r2bspec_harness_join();
  fflush(NULL);
  /* Threads of the middleware may still run; destructors at exit can then hang or crash after all
   * work is done. */
  _exit(status);
}
