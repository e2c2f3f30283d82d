#include "hello.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define MAX_HELLO 1024

int say_hello(const char *socket_path, const char *what, const char *name)
{
  struct sockaddr_un address = {.sun_family = AF_UNIX};
  char line[MAX_HELLO];
  const int size = snprintf(line, sizeof(line), "%s %s\n", what, name);
  if (strlen(socket_path) >= sizeof(address.sun_path) || size >= MAX_HELLO) {
    return -ENAMETOOLONG;
  }
  strcpy(address.sun_path, socket_path);
  const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd < 0) {
    return -errno;
  }
  /* A new socket has room for the whole line. */
  if (connect(fd, (const struct sockaddr *)&address, sizeof(address)) < 0 ||
      send(fd, line, (size_t)size, MSG_NOSIGNAL) != size) {
    const int reason = errno;
    close(fd);
    return -reason;
  }
  return fd;
}
