/* The parts of a process, and the channel over which the controller commands each. */
#include "harness.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define MAX_PARTS 16
#define END_TIMEOUT_S 2

/* ---- what failed ---- */

/* The line for the controller: a code of r2bspec, or "errno" and its number, and the message. */
static _Thread_local char fault[1024];

int fail(const char *code, const char *format, ...)
{
  va_list arguments;
  va_start(arguments, format);
  const int length = snprintf(fault, sizeof(fault), "%s ", code);
  vsnprintf(fault + length, sizeof(fault) - (size_t)length, format, arguments);
  va_end(arguments);
  for (char *end = fault; (end = strchr(end, '\n')) != NULL;) {
    *end = ' ';
  }
  return -1;
}

int fail_rcl(const char *what)
{
  (void)fail(HARNESS_FAULT, "%s failed: %s", what, rcl_get_error_string().str);
  rcl_reset_error();
  return -1;
}

void ignore_rcl(rcl_ret_t status)
{
  if (status != RCL_RET_OK) {
    rcl_reset_error();
  }
}

int fail_errno(const char *what)
{
  const int reason = errno;
  return fail("errno", "%d %s: %s", reason, what, strerror(reason));
}

/* ---- the channel ---- */

char *next_word(channel_t *channel)
{
  const ssize_t length = getdelim(&channel->word, &channel->capacity, '\0', channel->in);
  return length > 0 && channel->word[length - 1] == '\0' ? channel->word : "";
}

int64_t next_number(channel_t *channel)
{
  return strtoll(next_word(channel), NULL, 10);
}

bool channel_wait(channel_t *channel, int64_t timeout_ns)
{
  struct pollfd readable = {.fd = fileno(channel->in), .events = POLLIN};
  const struct timespec timeout = {
    .tv_sec = timeout_ns / NS_PER_S, .tv_nsec = timeout_ns % NS_PER_S};
  return ppoll(&readable, 1, &timeout, NULL) > 0;
}

int channel_reply(channel_t *channel, const char *format, ...)
{
  va_list arguments;
  va_start(arguments, format);
  const int sent = vdprintf(fileno(channel->in), format, arguments);
  va_end(arguments);
  return sent < 0 ? fail_errno("the control channel") : 0;
}

/* ---- the parts ---- */

static pthread_t parts[MAX_PARTS];
static size_t part_count;
static atomic_int failed_parts;

static int play_role(channel_t *channel)
{
  const char *role = next_word(channel);
  if (strcmp(role, "harness") == 0) {
    /* A process whose parts have other channels: nothing but its end is commanded here. */
    const int failed = channel_reply(channel, "ready\n");
    (void)next_word(channel);
    return failed;
  }
  const bool player = strcmp(role, "player") == 0;
  if (!player && strcmp(role, "monitor") != 0) {
    return 0;
  }
  ros_t ros;
  int status = ros_init(&ros, role);
  if (status == 0) {
    status = (player ? player_serve : monitor_serve)(channel, &ros.node);
  }
  ros_fini(&ros);
  return status;
}

void *part_serve(void *descriptor)
{
  const int fd = (int)(intptr_t)descriptor;
  channel_t channel = {.in = fdopen(fd, "r")};
  if (channel.in == NULL) {
    close(fd);
    return NULL;
  }
  (void)fcntl(fd, F_SETFD, FD_CLOEXEC);
  /* So that poll() tells of everything that has not been read. */
  setvbuf(channel.in, NULL, _IONBF, 0);
  if (play_role(&channel) < 0) {
    (void)channel_reply(&channel, "failed %s\n", fault);
    fprintf(stderr, "r2bspec harness: %s\n", fault);
    failed_parts += 1;
  }
  free(channel.word);
  fclose(channel.in);
  return NULL;
}

int r2bspec_harness_serve(int fd)
{
  sigset_t all, before;
  sigfillset(&all);
  int status = EAGAIN;
  if (part_count < MAX_PARTS) {
    /* Signals are for the threads of the process; those of the middleware inherit this, too. */
    pthread_sigmask(SIG_SETMASK, &all, &before);
    status = pthread_create(&parts[part_count], NULL, part_serve, (void *)(intptr_t)fd);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
  }
  if (status != 0) {
    close(fd);
    return -status;
  }
  part_count += 1;
  return 0;
}

int r2bspec_harness_join(void)
{
  struct timespec until;
  clock_gettime(CLOCK_MONOTONIC, &until);
  until.tv_sec += END_TIMEOUT_S;
  while (part_count > 0) {
    /* A blocked one ends with the process. */
    (void)pthread_clockjoin_np(parts[--part_count], NULL, CLOCK_MONOTONIC, &until);
  }
  return failed_parts > 0;
}
