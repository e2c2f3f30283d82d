/* The parts of a process, and the channel over which the controller commands each. */
#include "harness.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#define MAX_PARTS 16
#define MAX_LINE ((size_t)16 << 20)
#define END_TIMEOUT_NS (2 * NS_PER_S)
#define HARNESS_FAULT "R2B630"
#define DISK_FAULT "R2B651"
#define DISK_HINT "Make room on that disk, or choose another folder with --output."

/* ---- what failed ---- */

static _Thread_local struct {
  char code[16], message[1024], hint[256];
} fault;

int fail(const char *code, const char *hint, const char *format, ...)
{
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(fault.message, sizeof(fault.message), format, arguments);
  va_end(arguments);
  snprintf(fault.code, sizeof(fault.code), "%s", code);
  snprintf(fault.hint, sizeof(fault.hint), "%s", hint);
  return -1;
}

int fail_rcl(const char *what)
{
  (void)fail(HARNESS_FAULT, "", "%s failed: %s", what, rcl_get_error_string().str);
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
  return full ? fail(DISK_FAULT, DISK_HINT, "%s cannot be written: %s", path, strerror(reason))
              : fail(HARNESS_FAULT, "", "%s: %s", path, strerror(reason));
}

int fail_memory(void)
{
  return fail(HARNESS_FAULT, "", "there is not enough memory");
}

/* ---- the channel ---- */

static int receive(channel_t *channel)
{
  if (channel->consumed > 0) {
    channel->length -= channel->consumed;
    memmove(channel->data, channel->data + channel->consumed, channel->length);
    channel->consumed = 0;
  }
  if (channel->length == channel->capacity) {
    const size_t capacity = channel->capacity == 0 ? 4096 : 2 * channel->capacity;
    char *data = capacity > MAX_LINE ? NULL : realloc(channel->data, capacity);
    if (data == NULL) {
      return -1;
    }
    channel->data = data;
    channel->capacity = capacity;
  }
  ssize_t received;
  do {
    received = recv(
      channel->fd, channel->data + channel->length, channel->capacity - channel->length, 0);
  } while (received < 0 && errno == EINTR);
  if (received <= 0) {
    return -1;
  }
  channel->length += (size_t)received;
  return 0;
}

static char *pending_line(channel_t *channel)
{
  const size_t size = channel->length - channel->consumed;
  return size == 0 ? NULL : memchr(channel->data + channel->consumed, '\n', size);
}

int channel_next(channel_t *channel, char **line)
{
  char *end;
  while ((end = pending_line(channel)) == NULL) {
    if (receive(channel) < 0) {
      return -1;
    }
  }
  *end = '\0';
  *line = channel->data + channel->consumed;
  channel->consumed = (size_t)(end - channel->data) + 1;
  return 0;
}

bool channel_wait(channel_t *channel, int64_t timeout_ns)
{
  if (pending_line(channel) != NULL) {
    return true;
  }
  struct pollfd readable = {.fd = channel->fd, .events = POLLIN};
  const struct timespec timeout = {
    .tv_sec = timeout_ns / NS_PER_S, .tv_nsec = timeout_ns % NS_PER_S};
  return ppoll(&readable, 1, &timeout, NULL) > 0;
}

int channel_send(channel_t *channel, const char *text, size_t size)
{
  while (size > 0) {
    const ssize_t sent = send(channel->fd, text, size, MSG_NOSIGNAL);
    if (sent < 0 && errno != EINTR) {
      return -1;
    }
    if (sent > 0) {
      text += sent;
      size -= (size_t)sent;
    }
  }
  return 0;
}

int channel_reply(channel_t *channel, const char *format, ...)
{
  char *text = NULL;
  va_list arguments;
  va_start(arguments, format);
  const int size = vasprintf(&text, format, arguments);
  va_end(arguments);
  if (size < 0) {
    return fail_memory();
  }
  const int failed = channel_send(channel, text, (size_t)size);
  free(text);
  return failed;
}

void json_string(FILE *out, const char *text)
{
  fputc('"', out);
  for (const unsigned char *at = (const unsigned char *)text; *at != '\0'; ++at) {
    if (*at == '"' || *at == '\\') {
      fprintf(out, "\\%c", *at);
    } else if (*at < 0x20 || *at > 0x7e) {
      /* What the system says is ASCII; another byte need not be UTF-8, and only its look is lost. */
      fprintf(out, "\\u%04x", *at < 0x20 ? *at : '?');
    } else {
      fputc(*at, out);
    }
  }
  fputc('"', out);
}

static void report_fault(channel_t *channel)
{
  char *text = NULL;
  size_t size = 0;
  FILE *out = open_memstream(&text, &size);
  if (out == NULL) {
    return;
  }
  fputs("{\"say\":\"Failed\",\"code\":", out);
  json_string(out, fault.code);
  fputs(",\"message\":", out);
  json_string(out, fault.message);
  fputs(",\"hint\":", out);
  json_string(out, fault.hint);
  fputs("}\n", out);
  if (fclose(out) == 0) {
    (void)channel_send(channel, text, size);
  }
  free(text);
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

typedef struct part {
  pthread_t thread;
  int fd;
  bool serves; /* its channel is open */
  bool joined;
  int status;
} part_t;

static pthread_mutex_t parts_lock = PTHREAD_MUTEX_INITIALIZER;
static part_t parts[MAX_PARTS];
static size_t part_count;

/* A process of its own whose parts have other channels: nothing but its end is commanded here. */
static int host_serve(channel_t *channel)
{
  char *line;
  if (channel_reply(channel, "{\"say\":\"Ready\"}\n") == 0) {
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
  return strcmp(role, "shutdown") == 0 ? 0
                                       : fail(HARNESS_FAULT, "", "there is no role '%s'", role);
}

static void *serve(void *argument)
{
  part_t *part = argument;
  channel_t channel = {.fd = part->fd};
  if (play_role(&channel) < 0) {
    report_fault(&channel);
    fprintf(stderr, "r2bspec harness: %s\n", fault.message);
    part->status = 1;
  }
  free(channel.data);
  pthread_mutex_lock(&parts_lock);
  part->serves = false;
  close(part->fd);
  pthread_mutex_unlock(&parts_lock);
  return NULL;
}

int r2bspec_harness_serve(int fd)
{
  sigset_t all, before;
  sigfillset(&all);
  (void)fcntl(fd, F_SETFD, FD_CLOEXEC);
  pthread_mutex_lock(&parts_lock);
  int status = part_count == MAX_PARTS ? EAGAIN : 0;
  if (status == 0) {
    part_t *part = &parts[part_count];
    *part = (part_t){.fd = fd, .serves = true};
    /* Signals are for the threads of the process; those of the middleware inherit this, too. */
    pthread_sigmask(SIG_SETMASK, &all, &before);
    status = pthread_create(&part->thread, NULL, serve, part);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    part_count += status == 0;
  }
  pthread_mutex_unlock(&parts_lock);
  if (status != 0) {
    close(fd);
  }
  return -status;
}

static void say_hello(int fd, const char *part)
{
  char executable[4096] = "";
  if (readlink("/proc/self/exe", executable, sizeof(executable) - 1) < 0) {
    executable[0] = '\0';
  }
  channel_t channel = {.fd = fd};
  char *text = NULL;
  size_t size = 0;
  FILE *out = open_memstream(&text, &size);
  if (out == NULL) {
    return;
  }
  fprintf(out, "{\"say\":\"Hello\",\"pid\":%ld,\"executable\":", (long)getpid());
  json_string(out, executable);
  fputs(",\"part\":", out);
  json_string(out, part);
  fputs("}\n", out);
  if (fclose(out) == 0) {
    (void)channel_send(&channel, text, size);
  }
  free(text);
}

int r2bspec_harness_start(const char *socket_path, const char *part)
{
  struct sockaddr_un address = {.sun_family = AF_UNIX};
  if (strlen(socket_path) >= sizeof(address.sun_path)) {
    return -ENAMETOOLONG;
  }
  strcpy(address.sun_path, socket_path);
  const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd < 0) {
    return -errno;
  }
  if (connect(fd, (const struct sockaddr *)&address, sizeof(address)) < 0) {
    const int reason = errno;
    close(fd);
    return -reason;
  }
  say_hello(fd, part);
  return r2bspec_harness_serve(fd);
}

int r2bspec_harness_join(void)
{
  if (part_count > 0) {
    pthread_join(parts[part_count - 1].thread, NULL);
    parts[part_count - 1].joined = true;
  }
  return r2bspec_harness_stop(END_TIMEOUT_NS);
}

int r2bspec_harness_stop(int64_t timeout_ns)
{
  pthread_mutex_lock(&parts_lock);
  for (size_t i = 0; i < part_count; ++i) {
    if (parts[i].serves) {
      shutdown(parts[i].fd, SHUT_RDWR);
    }
  }
  pthread_mutex_unlock(&parts_lock);
  const int64_t until_ns = system_ns() + timeout_ns;
  const struct timespec until = {.tv_sec = until_ns / NS_PER_S, .tv_nsec = until_ns % NS_PER_S};
  int status = 0;
  for (size_t i = 0; i < part_count; ++i) {
    /* A blocked one ends with the process. */
    if (!parts[i].joined) {
      (void)pthread_timedjoin_np(parts[i].thread, NULL, &until);
    }
    status = status != 0 ? status : parts[i].status;
  }
  part_count = 0;
  return status;
}
