/* A process of the harness, for a player, a monitor, or both.
 *
 * Its channels are inherited: R2BSPEC_CONTROL_FD, and one more for each part of it.
 */
#include "harness.h"

#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <unistd.h>

#define CONTROL_FD "R2BSPEC_CONTROL_FD"
#define USAGE_STATUS 2
/* How long shutting ROS down may take: less than the controller waits before it sends SIGTERM. */
#define MAX_END_S 8

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

static void *exit_late(void *unused)
{
  (void)unused;
  sleep(MAX_END_S);
  _exit(0);
}

static void start_exit_timer(void)
{
  pthread_t timer;
  if (pthread_create(&timer, NULL, exit_late, NULL) == 0) {
    pthread_detach(timer);
  }
}

int main(void)
{
  harness_on_end = start_exit_timer;
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
