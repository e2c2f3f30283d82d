/* A process of the harness, for a player, a monitor, or both.
 *
 * Its channels are inherited: R2BSPEC_CONTROL_FD, and one more for each part of it.
 */
#include "harness.h"

#include <signal.h>
#include <stdlib.h>
#include <unistd.h>

#define CONTROL_FD "R2BSPEC_CONTROL_FD"
#define USAGE_STATUS 2

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

int main(void)
{
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
