/* Files of samples, which the controller reads while they grow: r2bspec/ipc/sample_files.py. */
#include "harness.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#define HEADER_BYTES 64

static size_t file_size(const rows_t *rows, size_t capacity)
{
  return HEADER_BYTES + capacity * rows->width * sizeof(int64_t);
}

static int grow(rows_t *rows, size_t capacity)
{
  const size_t size = file_size(rows, capacity);
  /* Without the allocation, a full disk would be a SIGBUS at a later row. */
  if ((errno = posix_fallocate(rows->fd, 0, (off_t)size)) != 0) {
    return fail_file(rows->path);
  }
  void *map = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, rows->fd, 0);
  if (map == MAP_FAILED) {
    return fail_file(rows->path);
  }
  if (rows->map != NULL) {
    munmap(rows->map, file_size(rows, rows->capacity));
  }
  rows->map = map;
  rows->capacity = capacity;
  return 0;
}

int rows_open(rows_t *rows, const char *path, size_t width, size_t capacity)
{
  *rows = (rows_t){.fd = -1, .width = width};
  rows->path = strdup(path);
  if (rows->path == NULL) {
    return fail_memory();
  }
  rows->fd = open(path, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (rows->fd < 0) {
    return fail_file(path);
  }
  return grow(rows, capacity);
}

int rows_append(rows_t *rows, const int64_t *values)
{
  if (rows->count == rows->capacity && grow(rows, 2 * rows->capacity) < 0) {
    return -1;
  }
  int64_t *row = rows->map + HEADER_BYTES / sizeof(int64_t) + rows->count * rows->width;
  memcpy(row, values, rows->width * sizeof(int64_t));
  rows->count += 1;
  /* The row before the count: a reader sees complete rows only. */
  __atomic_store_n(rows->map, (int64_t)rows->count, __ATOMIC_RELEASE);
  return 0;
}

void rows_close(rows_t *rows)
{
  if (rows->map != NULL) {
    munmap(rows->map, file_size(rows, rows->capacity));
  }
  if (rows->fd >= 0) {
    close(rows->fd);
  }
  free(rows->path);
  *rows = (rows_t){.fd = -1};
}
