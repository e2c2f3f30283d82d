/* The parts of a process, and the channel over which the controller commands each. */
#include "harness.h"
#include "hello.h"

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

/* The line for the controller: a code of r2bspec, and the message. */
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

int fail_file(const char *path)
{
  const int reason = errno;
  const bool full =
    reason == ENOSPC || reason == EDQUOT || reason == EFBIG || reason == EROFS;
  return full ? fail(DISK_FAULT, "%s cannot be written: %s", path, strerror(reason))
              : fail(HARNESS_FAULT, "%s: %s", path, strerror(reason));
}

int fail_memory(void)
{
  return fail(HARNESS_FAULT, "there is not enough memory");
}

/* ---- the channel ---- */

int channel_next(channel_t *channel, char **line)
{
  const ssize_t length = getline(&channel->line, &channel->capacity, channel->in);
  if (length <= 0 || channel->line[length - 1] != '\n') {
    return -1;
  }
  channel->line[length - 1] = '\0';
  *line = channel->line;
  return 0;
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
  return sent < 0 ? fail_file("the control channel") : 0;
}

static int hexadecimal(char digit)
{
  const char *digits = "0123456789ABCDEF";
  const char *found = digit == '\0' ? NULL : strchr(digits, digit);
  return found == NULL ? -1 : (int)(found - digits);
}

char *next_word(char **rest)
{
  char *word = strsep(rest, " ");
  if (word == NULL) {
    return "";
  }
  char *out = word;
  for (const char *in = word; *in != '\0'; ++in) {
    if (*in == '%' && hexadecimal(in[1]) >= 0 && hexadecimal(in[2]) >= 0) {
      *out++ = (char)(16 * hexadecimal(in[1]) + hexadecimal(in[2]));
      in += 2;
    } else {
      *out++ = *in;
    }
  }
  *out = '\0';
  return word;
}

int64_t next_number(char **rest)
{
  return strtoll(next_word(rest), NULL, 10);
}

/* ---- the parts ---- */

static pthread_t parts[MAX_PARTS];
static size_t part_count;
static atomic_int failed_parts;

/* A process of its own whose parts have other channels: nothing but its end is commanded here. */
static int host_serve(channel_t *channel)
{
  char *line;
  if (channel_reply(channel, "ready\n") == 0) {
    while (channel_next(channel, &line) == 0 && strcmp(line, "shutdown") != 0) {
    }
  }
  return 0;
}

static int play_role(channel_t *channel)
{
  char *line;
  if (channel_next(channel, &line) < 0) {
    return 0;
  }
  const char *role = next_word(&line);
  if (strcmp(role, "player") == 0) {
    return player_serve(channel, line);
  }
  if (strcmp(role, "monitor") == 0) {
    return monitor_serve(channel, line);
  }
  if (strcmp(role, "harness") == 0) {
    return host_serve(channel);
  }
  return strcmp(role, "shutdown") == 0 ? 0 : fail(HARNESS_FAULT, "there is no role '%s'", role);
}

void part_serve(int fd)
{
  channel_t channel = {.in = fdopen(fd, "r")};
  if (channel.in == NULL) {
    close(fd);
    return;
  }
  /* So that poll() tells of everything that has not been read. */
  setvbuf(channel.in, NULL, _IONBF, 0);
  if (play_role(&channel) < 0) {
    (void)channel_reply(&channel, "failed %s\n", fault);
    fprintf(stderr, "r2bspec harness: %s\n", fault);
    failed_parts += 1;
  }
  free(channel.line);
  fclose(channel.in);
}

static void *serve(void *fd)
{
  part_serve((int)(intptr_t)fd);
  return NULL;
}

int r2bspec_harness_serve(int fd)
{
  sigset_t all, before;
  sigfillset(&all);
  (void)fcntl(fd, F_SETFD, FD_CLOEXEC);
  int status = EAGAIN;
  if (part_count < MAX_PARTS) {
    /* Signals are for the threads of the process; those of the middleware inherit this, too. */
    pthread_sigmask(SIG_SETMASK, &all, &before);
    status = pthread_create(&parts[part_count], NULL, serve, (void *)(intptr_t)fd);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
  }
  if (status != 0) {
    close(fd);
    return -status;
  }
  part_count += 1;
  return 0;
}

int r2bspec_harness_start(const char *socket_path, const char *part)
{
  const int fd = say_hello(socket_path, "part", part);
  return fd < 0 ? fd : r2bspec_harness_serve(fd);
}

int r2bspec_harness_join(void)
{
  struct timespec until;
  clock_gettime(CLOCK_REALTIME, &until);
  until.tv_sec += END_TIMEOUT_S;
  while (part_count > 0) {
    /* A blocked one ends with the process. */
    (void)pthread_timedjoin_np(parts[--part_count], NULL, &until);
  }
  return failed_parts > 0;
}
