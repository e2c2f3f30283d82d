/* How a process asks the controller for something: over a socket in the file system. */
#ifndef R2BSPEC_HELLO_H
#define R2BSPEC_HELLO_H

/* Connects, and sends the line "WHAT NAME"; returns the connection, or a negative errno. The
 * controller learns from the socket which process it is. */
int say_hello(const char *socket_path, const char *what, const char *name);

#endif
