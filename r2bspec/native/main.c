/* A process of the harness, for a player, a monitor, or both.
 *
 * Its channels are inherited: R2BSPEC_CONTROL_FD, and one more for each part of it.
 */
#include "harness.h"

#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <unistd.h>

#define CONTROL_FD "R2BSPEC_CONTROL_FD"
#define USAGE_STATUS 2
/* How long shutting ROS down may take: less than the controller waits before it sends SIGTERM. */
#define MAX_END_S 8

/* The descriptor in a variable, or -1; the variable is not for programs that this one might start. */
static int take_variable(const char *name)
{
  const char *value = getenv(name);
  const int fd = value == NULL ? -1 : atoi(value);
  unsetenv(name);
  return fd;
}

static void exit_late(int signal)
{
  (void)signal;
  _exit(0);
}

static void start_exit_timer(void) { alarm(MAX_END_S); }

int main(void)
{
  const char *parts[] = {CONTROL_FD "_PLAYER", CONTROL_FD "_MONITOR"};
  harness_on_end = start_exit_timer;
  signal(SIGALRM, exit_late);
  signal(SIGPIPE, SIG_IGN);
  /* Ctrl-C goes to the controller, which ends its children in order. */
  signal(SIGINT, SIG_IGN);
  for (size_t i = 0; i < 2; ++i) {
    const int fd = take_variable(parts[i]);
    if (fd >= 0) {
      (void)r2bspec_harness_serve(fd);
    }
  }
  const int fd = take_variable(CONTROL_FD);
  if (fd < 0) {
    fputs("this program is started by 'r2bspec run' and cannot be run alone\n", stderr);
    return USAGE_STATUS;
  }
  (void)fcntl(fd, F_SETFD, FD_CLOEXEC);
  part_serve(fd);
  const int status = r2bspec_harness_join();
  fflush(NULL);
  /* Threads of the middleware may still run; destructors at exit can then hang or crash after all
   * work is done. */
  _exit(status);
}
