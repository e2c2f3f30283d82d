/* Brings the harness into a process of the graph: preloaded, so that the program needs no change.
 *
 * It has the name of rcl's initialisation, which every ROS node calls. Before the first call in a
 * process goes on, it asks the controller over a socket whether this is the process that is meant:
 * a wrapper such as `ros2 run` may have handed the variables on to any number of others. The
 * controller then has the harness loaded and its parts started, and lets the node go on once their
 * publishers exist. All other processes stay as they are.
 *
 * No header of ROS is used, so that it can be loaded wherever libc is. Lines on the socket:
 *
 *   start PART LIBRARY   start a part, which connects to the socket itself, from the library at a
 *                        path; answered by "ready", or "failed" with a code and a message
 *   go                   let the node go on; so does the end of the channel
 */
#include <dlfcn.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

#include "hello.h"

#define SOCKET_VARIABLE "R2BSPEC_JOIN_SOCKET"
#define PROCESS_VARIABLE "R2BSPEC_JOIN_PROCESS"
#define MAX_ANSWER 1024
#define NOT_INITIALISED 1 /* RCL_RET_ERROR */

typedef int init_t(int, char const *const *, const void *, void *);
typedef int start_t(const char *socket_path, const char *part);

/* rclpy loads rcl for itself alone, where RTLD_NEXT does not look: then its caller knows it. */
static init_t *real_init(void *caller)
{
  init_t *found = (init_t *)dlsym(RTLD_NEXT, "rcl_init");
  Dl_info info;
  if (found == NULL && dladdr(caller, &info) != 0) {
    void *library = dlopen(info.dli_fname, RTLD_LAZY | RTLD_NOLOAD);
    found = library == NULL ? NULL : (init_t *)dlsym(library, "rcl_init");
  }
  return found;
}

/* What this process starts is not to be asked: takes this object from the preloaded ones. */
static void leave_environment(void)
{
  Dl_info own;
  char *preloaded = getenv("LD_PRELOAD");
  const int known = dladdr((void *)&leave_environment, &own);
  char *found = preloaded == NULL || known == 0 ? NULL : strstr(preloaded, own.dli_fname);
  if (found != NULL) {
    const char *rest = found + strlen(own.dli_fname);
    /* Its separator, too; one that remains at an end is ignored by the loader. */
    rest += *rest != '\0';
    memmove(found, rest, strlen(rest) + 1);
    if (*preloaded == '\0') {
      unsetenv("LD_PRELOAD");
    }
  }
  unsetenv(SOCKET_VARIABLE);
  unsetenv(PROCESS_VARIABLE);
}

/* Starts a part from a library; returns what failed, or NULL. */
static const char *start_part(const char *socket_path, const char *part, const char *library)
{
  void *loaded = dlopen(library, RTLD_NOW | RTLD_LOCAL);
  start_t *start = loaded == NULL ? NULL : (start_t *)dlsym(loaded, "r2bspec_harness_start");
  if (start == NULL) {
    return dlerror();
  }
  leave_environment();
  const int status = start(socket_path, part);
  return status < 0 ? strerror(-status) : NULL;
}

static void answer(int fd, const char *fault)
{
  char line[MAX_ANSWER] = "ready\n";
  if (fault != NULL) {
    snprintf(line, sizeof(line), "failed R2B674 %.900s\n", fault);
  }
  (void)send(fd, line, strlen(line), MSG_NOSIGNAL);
}

static void serve(FILE *in, const char *socket_path)
{
  char *line = NULL;
  size_t capacity = 0;
  while (getline(&line, &capacity, in) > 0) {
    char *rest = line;
    rest[strcspn(rest, "\n")] = '\0';
    if (strcmp(strsep(&rest, " "), "start") != 0) {
      break;
    }
    const char *part = strsep(&rest, " ");
    answer(fileno(in), start_part(socket_path, part, rest));
  }
  free(line);
}

static void join(void)
{
  const char *variable = getenv(SOCKET_VARIABLE), *process = getenv(PROCESS_VARIABLE);
  char *socket_path = variable == NULL || process == NULL ? NULL : strdup(variable);
  const int fd = socket_path == NULL ? -1 : say_hello(socket_path, "process", process);
  FILE *in = fd < 0 ? NULL : fdopen(fd, "r");
  if (in != NULL) {
    serve(in, socket_path);
    fclose(in);
  }
  free(socket_path);
}

__attribute__((visibility("default"))) int rcl_init(
  int argc, char const *const *argv, const void *options, void *context)
{
  static atomic_flag asked = ATOMIC_FLAG_INIT;
  init_t *init = real_init(__builtin_return_address(0));
  /* Once: the parts of the harness initialise contexts of their own, during the first call. */
  if (init != NULL && !atomic_flag_test_and_set(&asked)) {
    join();
  }
  return init == NULL ? NOT_INITIALISED : init(argc, argv, options, context);
}
