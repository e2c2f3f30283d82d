/* How a process asks the controller for something: over a socket in the file system. */
#ifndef R2BSPEC_HELLO_H
#define R2BSPEC_HELLO_H

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

/* Connects, and sends the line "WHAT NAME"; returns the connection, or a negative errno. The
 * controller learns from the socket which process it is. */
static inline int say_hello(const char *socket_path, const char *what, const char *name)
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

#endif
