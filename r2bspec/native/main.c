/* A process of the harness, for a player, a monitor, or both.
 *
 * Its channels are inherited: R2BSPEC_CONTROL_FD, and one more for each part of it.
 */
#include "harness.h"

#include <signal.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <unistd.h>

#define CONTROL_FD "R2BSPEC_CONTROL_FD"
#define USAGE_STATUS 2

/* The descriptor in a variable, or -1; the variable is not for programs that this one starts. */
static int take_variable(const char *name)
{
  const char *value = getenv(name);
  const int fd = value == NULL ? -1 : atoi(value);
  unsetenv(name);
  return fd;
}

static void exit_now(int signal)
{
  (void)signal;
  _exit(0);
}

int main(void)
{
  /* It is started by a descriptor, whose number would be its name. */
  (void)prctl(PR_SET_NAME, "r2bspec_harness");
  const int player = take_variable(CONTROL_FD "_PLAYER");
  const int monitor = take_variable(CONTROL_FD "_MONITOR");
  const int own = take_variable(CONTROL_FD);
  if (own < 0) {
    fputs("this program is started by 'r2bspec run' and cannot be run alone\n", stderr);
    return USAGE_STATUS;
  }
  /* Ctrl-C goes to the controller, which ends its children in order. */
  signal(SIGINT, SIG_IGN);
  signal(SIGPIPE, SIG_IGN);
  /* This goes to a process that has been told to end, and hangs in its middleware. */
  signal(SIGTERM, exit_now);
  if (player >= 0) {
    (void)r2bspec_harness_serve(player);
  }
  if (monitor >= 0) {
    (void)r2bspec_harness_serve(monitor);
  }
  (void)part_serve((void *)(intptr_t)own);
  const int status = r2bspec_harness_join();
  fflush(NULL);
  /* Threads of the middleware may still run; destructors at exit can then hang or crash after all
   * work is done. */
  _exit(status);
}
