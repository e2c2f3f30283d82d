/* Files of rows, which the controller reads while they grow: r2bspec/ipc/sample_files.py. */
#include "harness.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

int rows_open(rows_t *rows, const char *path, size_t width)
{
  *rows = (rows_t){.fd = -1, .row_bytes = width * sizeof(int64_t), .path = strdup(path)};
  if (rows->path == NULL) {
    return fail_memory();
  }
  rows->fd = open(path, O_WRONLY | O_CREAT | O_EXCL | O_APPEND | O_CLOEXEC, 0600);
  return rows->fd < 0 ? fail_file(path) : 0;
}

int rows_append(rows_t *rows, const int64_t *values)
{
  const ssize_t written = write(rows->fd, values, rows->row_bytes);
  if (written >= 0 && (size_t)written < rows->row_bytes) {
    errno = ENOSPC;
  }
  return written == (ssize_t)rows->row_bytes ? 0 : fail_file(rows->path);
}

void rows_close(rows_t *rows)
{
  if (rows->fd >= 0) {
    close(rows->fd);
  }
  free(rows->path);
  *rows = (rows_t){.fd = -1};
}
