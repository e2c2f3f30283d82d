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
 *   library PATH   load the library of the harness; answered by Ready or Failed
 *   part NAME      start a part, which connects to the socket itself; answered likewise
 *   go             let the node go on; so does the end of the channel
 */
#include <dlfcn.h>
#include <errno.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define SOCKET_VARIABLE "R2BSPEC_JOIN_SOCKET"
#define PROCESS_VARIABLE "R2BSPEC_JOIN_PROCESS"
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

static int connect_to(const char *path)
{
  struct sockaddr_un address = {.sun_family = AF_UNIX};
  if (strlen(path) >= sizeof(address.sun_path)) {
    return -1;
  }
  strcpy(address.sun_path, path);
  const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd >= 0 && connect(fd, (const struct sockaddr *)&address, sizeof(address)) < 0) {
    close(fd);
    return -1;
  }
  return fd;
}

static void json_bytes(FILE *out, const char *text, size_t size)
{
  fputc('"', out);
  for (size_t i = 0; i < size; ++i) {
    const unsigned char byte = (unsigned char)text[i];
    if (byte < 0x20 || byte > 0x7e || byte == '"' || byte == '\\') {
      /* Only names are compared; those of ROS are ASCII. */
      fprintf(out, "\\u%04x", byte);
    } else {
      fputc(byte, out);
    }
  }
  fputc('"', out);
}

static void json_arguments(FILE *out)
{
  FILE *in = fopen("/proc/self/cmdline", "re");
  char *word = NULL;
  size_t capacity = 0;
  ssize_t size;
  fputc('[', out);
  for (int i = 0; in != NULL && (size = getdelim(&word, &capacity, '\0', in)) > 0; ++i) {
    fputs(i == 0 ? "" : ",", out);
    json_bytes(out, word, strnlen(word, (size_t)size));
  }
  fputc(']', out);
  free(word);
  if (in != NULL) {
    fclose(in);
  }
}

static void send_text(int fd, const char *text, size_t size)
{
  while (size > 0) {
    const ssize_t sent = send(fd, text, size, MSG_NOSIGNAL);
    if (sent < 0 && errno != EINTR) {
      return;
    }
    if (sent > 0) {
      text += sent;
      size -= (size_t)sent;
    }
  }
}

static void say_hello(int fd)
{
  char executable[4096];
  const ssize_t length = readlink("/proc/self/exe", executable, sizeof(executable));
  const char *process = getenv(PROCESS_VARIABLE);
  char *text = NULL;
  size_t size = 0;
  FILE *out = open_memstream(&text, &size);
  if (out == NULL) {
    return;
  }
  fprintf(out, "{\"say\":\"Hello\",\"part\":\"\",\"pid\":%ld,\"executable\":", (long)getpid());
  json_bytes(out, executable, length < 0 ? 0 : (size_t)length);
  fputs(",\"process\":", out);
  json_bytes(out, process == NULL ? "" : process, process == NULL ? 0 : strlen(process));
  fputs(",\"arguments\":", out);
  json_arguments(out);
  fputs("}\n", out);
  if (fclose(out) == 0) {
    send_text(fd, text, size);
  }
  free(text);
}

static void answer(int fd, const char *fault)
{
  char *text = NULL;
  size_t size = 0;
  FILE *out = open_memstream(&text, &size);
  if (out == NULL) {
    return;
  }
  if (fault == NULL) {
    fputs("{\"say\":\"Ready\"}\n", out);
  } else {
    fputs("{\"say\":\"Failed\",\"code\":\"R2B674\",\"message\":", out);
    json_bytes(out, fault, strlen(fault));
    fputs("}\n", out);
  }
  if (fclose(out) == 0) {
    send_text(fd, text, size);
  }
  free(text);
}

/* What this process starts is not to be asked: takes this object from the preloaded ones. */
static void leave_environment(void)
{
  Dl_info own;
  const char *preloaded = getenv("LD_PRELOAD");
  char *words = preloaded == NULL ? NULL : strdup(preloaded);
  char *left = words == NULL ? NULL : calloc(1, strlen(words) + 1);
  if (left != NULL && dladdr((void *)&leave_environment, &own) != 0) {
    char *rest = words;
    for (char *word = strsep(&rest, ": "); word != NULL; word = strsep(&rest, ": ")) {
      if (*word != '\0' && strcmp(word, own.dli_fname) != 0) {
        strcat(left, *left == '\0' ? "" : ":");
        strcat(left, word);
      }
    }
    if (*left == '\0') {
      unsetenv("LD_PRELOAD");
    } else {
      setenv("LD_PRELOAD", left, 1);
    }
  }
  free(left);
  free(words);
  unsetenv(SOCKET_VARIABLE);
  unsetenv(PROCESS_VARIABLE);
}

static start_t *load(const char *path, const char **fault)
{
  void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
  start_t *start = library == NULL ? NULL : (start_t *)dlsym(library, "r2bspec_harness_start");
  *fault = start == NULL ? dlerror() : NULL;
  if (start != NULL) {
    leave_environment();
  }
  return start;
}

static void serve(int fd, const char *path)
{
  FILE *in = fdopen(fd, "r");
  start_t *start = NULL;
  char *line = NULL;
  size_t capacity = 0;
  while (in != NULL && getline(&line, &capacity, in) > 0) {
    line[strcspn(line, "\n")] = '\0';
    const char *fault = "the controller sent an unknown command";
    if (strcmp(line, "go") == 0) {
      break;
    }
    if (strncmp(line, "library ", 8) == 0) {
      start = load(line + 8, &fault);
    } else if (strncmp(line, "part ", 5) == 0 && start != NULL) {
      const int status = start(path, line + 5);
      fault = status < 0 ? strerror(-status) : NULL;
    }
    answer(fd, fault);
  }
  free(line);
  if (in != NULL) {
    fclose(in);
  } else {
    close(fd);
  }
}

static void join(void)
{
  const char *variable = getenv(SOCKET_VARIABLE);
  char *path = variable == NULL ? NULL : strdup(variable);
  const int fd = path == NULL ? -1 : connect_to(path);
  if (fd >= 0) {
    say_hello(fd);
    serve(fd, path);
  }
  free(path);
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
