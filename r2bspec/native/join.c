/* Brings the harness into a process of the graph: preloaded, so that the program needs no change.
 *
 * It has the name of rcl's initialisation, which every ROS node calls. Before the first call in a
 * process goes on, it asks the controller over a socket whether this is the process that is meant:
 * a wrapper such as `ros2 run` may have handed the variables on to any number of others. The
 * controller then has the harness loaded and its parts started, and lets the node go on once their
 * publishers exist. All other processes stay as they are.
 *
 * No header of ROS is used, so that it can be loaded wherever libc is. For the process that is
 * meant, the controller sends the line "PART,PART LIBRARY": the parts, of which each gets a connection to
 * the socket as its channel, and the path of the library that has them. The answer is "ready", or
 * "failed" with a code and a message. The node goes on when the controller closes the connection.
 */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "next_function.h"

#define SOCKET_VARIABLE "R2BSPEC_JOIN_SOCKET"
#define PROCESS_VARIABLE "R2BSPEC_JOIN_PROCESS"
#define MAX_LINE 8192

typedef int init_t(int, char const *const *, const void *, void *);
typedef int serve_t(int fd);

/* What this process starts is not to be asked: takes this object from the preloaded ones. */
static void leave_environment(void)
{
  Dl_info own;
  char *preloaded = getenv("LD_PRELOAD");
  const int known = preloaded == NULL ? 0 : dladdr((void *)&leave_environment, &own);
  for (char *entry = preloaded; known != 0 && *entry != '\0';) {
    const size_t length = strcspn(entry, ": ");
    /* Its separator, too; one that remains at an end is ignored by the loader. */
    char *rest = entry + length + (entry[length] != '\0');
    if (length == strlen(own.dli_fname) && memcmp(entry, own.dli_fname, length) == 0) {
      memmove(entry, rest, strlen(rest) + 1);
    } else {
      entry = rest;
    }
  }
  if (known != 0 && *preloaded == '\0') {
    unsetenv("LD_PRELOAD");
  }
  unsetenv(SOCKET_VARIABLE);
  unsetenv(PROCESS_VARIABLE);
}

/* Connects, and sends the line "WHAT NAME"; returns the connection, or a negative errno. The
 * controller learns from the socket which process it is. */
static int say_hello(const char *socket_path, const char *what, const char *name)
{
  struct sockaddr_un address = {.sun_family = AF_UNIX};
  char line[1024];
  const int size = snprintf(line, sizeof(line), "%s %s\n", what, name);
  if (strlen(socket_path) >= sizeof(address.sun_path) || size >= (int)sizeof(line)) {
    return -ENAMETOOLONG;
  }
  strcpy(address.sun_path, socket_path);
  const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  /* A new socket has room for the whole line. */
  if (fd < 0 || connect(fd, (const struct sockaddr *)&address, sizeof(address)) < 0 ||
      send(fd, line, (size_t)size, MSG_NOSIGNAL) != size) {
    const int reason = errno;
    close(fd);
    return -reason;
  }
  return fd;
}

/* Reads a line, of which any number of bytes may arrive at once, without its end; false if it does
 * not end, or not within the size. */
static int read_line(int fd, char *line, size_t size)
{
  size_t length = 0;
  while (length < size) {
    const ssize_t received = recv(fd, line + length, size - length, 0);
    if (received <= 0) {
      return 0;
    }
    length += (size_t)received;
    if (line[length - 1] == '\n') {
      line[length - 1] = '\0';
      return 1;
    }
  }
  return 0;
}

/* Starts what a command says; returns what failed, or NULL. */
static const char *start_parts(const char *socket_path, char *command)
{
  char *parts = strsep(&command, " ");
  void *library = command == NULL ? NULL : dlopen(command, RTLD_NOW | RTLD_LOCAL);
  serve_t *serve = library == NULL ? NULL : (serve_t *)dlsym(library, "r2bspec_harness_serve");
  if (serve == NULL) {
    return dlerror();
  }
  leave_environment();
  int status = 0;
  for (char *part = strsep(&parts, ","); part != NULL && status == 0; part = strsep(&parts, ",")) {
    const int fd = say_hello(socket_path, "part", part);
    status = fd < 0 ? fd : serve(fd);
  }
  return status < 0 ? strerror(-status) : NULL;
}

static void join(const char *socket_path, const char *process)
{
  char line[MAX_LINE] = "";
  const int fd = say_hello(socket_path, "process", process);
  /* It is in the environment, which will be changed. */
  char *path = strdup(socket_path);
  if (fd >= 0 && path != NULL && read_line(fd, line, sizeof(line))) {
    const char *fault = start_parts(path, line);
    snprintf(line, sizeof(line), fault == NULL ? "ready\n" : "failed R2B674 %s\n", fault);
    (void)send(fd, line, strlen(line), MSG_NOSIGNAL);
    (void)recv(fd, line, sizeof(line), 0);
  }
  free(path);
  close(fd);
}

EXPORTED int rcl_init(
  int argc, char const *const *argv, const void *options, void *context)
{
  static atomic_flag asked = ATOMIC_FLAG_INIT;
  NEXT(init_t, RCL, rcl_init);
  const char *socket_path = getenv(SOCKET_VARIABLE), *process = getenv(PROCESS_VARIABLE);
  /* Once: the parts of the harness initialise contexts of their own, during the first call. */
  if (next != NULL && !atomic_flag_test_and_set(&asked)) {
    if (socket_path != NULL && process != NULL) {
      join(socket_path, process);
    }
  }
  return next == NULL ? NOT_FOUND : next(argc, argv, options, context);
}
