/* Rows of events: a slab for each thread, in a file that exists before the first event. */
#include "anatomy_rows.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#define MAGIC "R2BROWS1"
#define OBJECTS 2048
#define SLAB_ROWS 256
#define NAME_BYTES 256
#define PAGE_BYTES 4096

_Static_assert(sizeof(row_t) == 64, "a row is a line of the processor's cache");

typedef struct {
  _Atomic uint32_t kind;
  char name[NAME_BYTES], node[NAME_BYTES];
} object_t;

/* `record/anatomy_files.py` has the same. */
typedef struct {
  char magic[8];
  uint32_t pid;
  _Atomic uint32_t slabs;
  char process[NAME_BYTES];
  _Alignas(64) _Atomic uint32_t claimed_slabs;
  _Atomic uint32_t objects;
  _Atomic uint64_t lost;
  _Alignas(PAGE_BYTES) object_t object[OBJECTS];
  _Alignas(PAGE_BYTES) row_t rows[];
} file_t;

_Thread_local struct thread thread_now;

/* NULL: nothing is written. */
static _Atomic(file_t *) opened;

static file_t *file_now(void)
{
  return atomic_load_explicit(&opened, memory_order_acquire);
}

bool rows_are_open(void)
{
  return file_now() != NULL;
}

/* What a thread has for itself. */
static _Thread_local struct {
  row_t *row;  /* the next one, unless it is in the next slab */
  bool waited; /* the last row is a wait */
  uint32_t id;
  int64_t clock_ns;    /* the system clock less the monotonic one, */
  int64_t compared_ns; /* which were compared at this time */
} me;

#define CLOCK_VALID_NS (10 * 1000 * 1000)
#define CLOSE_NS 500

static int64_t read_clock(clockid_t clock)
{
  struct timespec time;
  clock_gettime(clock, &time);
  return time.tv_sec * NS_PER_S + time.tv_nsec;
}

int64_t now_ns(void)
{
  return read_clock(CLOCK_MONOTONIC);
}

/* This thread may be interrupted between two clocks: the closest of three readings counts. */
static void compare_clocks(int64_t now)
{
  int64_t closest = INT64_MAX;
  for (int i = 0; i < 3 && closest > CLOSE_NS; i++) {
    const int64_t before = now_ns(), system = read_clock(CLOCK_REALTIME), apart = now_ns() - before;
    if (apart < closest) {
      closest = apart;
      me.clock_ns = system - before - apart / 2;
    }
  }
  me.compared_ns = now;
}

/* At the end of a slab begins that of another thread. */
static bool begins_slab(const file_t *file, const row_t *row)
{
  return (row - file->rows) % SLAB_ROWS == 0;
}

/* What threads that have ended have left of their slabs: a program may start one for each message. */
static _Atomic(row_t *) remainders[64];
#define REMAINDERS (sizeof(remainders) / sizeof(*remainders))
static pthread_key_t at_end_of_thread;

static void leave_slab(void *file)
{
  row_t *rest = me.row;
  me.row = NULL;
  for (size_t i = 0; i < REMAINDERS && rest != NULL && !begins_slab(file, rest); i++) {
    row_t *none = NULL;
    if (atomic_compare_exchange_strong(&remainders[i], &none, rest)) {
      return;
    }
  }
}

/* Returns a row of this thread and up to the end of its slab, or NULL. */
static row_t *claim_rows(file_t *file)
{
  if (me.id == 0) {
    me.id = (uint32_t)syscall(SYS_gettid);
    (void)pthread_setspecific(at_end_of_thread, file);
  }
  for (size_t i = 0; i < REMAINDERS; i++) {
    row_t *rest = atomic_load_explicit(&remainders[i], memory_order_relaxed);
    if (rest != NULL && atomic_compare_exchange_strong(&remainders[i], &rest, NULL)) {
      return rest;
    }
  }
  /* A file that is full stays so: the number of claims must not start again at zero. */
  uint32_t slab = atomic_load_explicit(&file->claimed_slabs, memory_order_relaxed);
  if (slab < file->slabs) {
    slab = atomic_fetch_add(&file->claimed_slabs, 1);
  }
  if (slab >= file->slabs) {
    atomic_fetch_add_explicit(&file->lost, 1, memory_order_relaxed);
    return NULL;
  }
  return file->rows + (size_t)slab * SLAB_ROWS;
}

/* Of waits in a row, the first one stands for all: executors wait again and again, and at once,
 * while callbacks keep each other out, and some trigger a guard condition before each wait.
 *
 * A handler of a signal that adds an event meanwhile may lose that, and never harms others. */
void rows_add(uint16_t kind, const row_t *event)
{
  file_t *file = file_now();
  const bool waits = kind == WAIT || (kind == TRIGGER && me.waited);
  if (file == NULL || (waits && me.waited)) {
    return;
  }
  if (event->ended_ns - me.compared_ns > CLOCK_VALID_NS) {
    compare_clocks(event->ended_ns);
  }
  row_t *row = me.row;
  if (row == NULL || begins_slab(file, row)) {
    row = claim_rows(file);
    if (row == NULL) {
      return;
    }
  }
  me.row = row + 1;
  me.waited = waits;
  row->object = event->object;
  row->thread = me.id;
  row->flags = event->flags;
  row->began_ns = event->began_ns;
  row->ended_ns = event->ended_ns;
  row->source_ns = event->source_ns;
  row->received_ns = event->received_ns;
  row->header_ns = event->header_ns;
  row->clock_ns = me.clock_ns;
  atomic_store_explicit(&row->kind, kind, memory_order_release);
}

/* Objects. A key stays in its place for ever, and leads to the object that has it now. */

#define PLACES 16384
#define MAX_PROBES 64

typedef struct {
  _Atomic(const void *) key;
  _Atomic uint32_t object;
} place_t;

static place_t places[PLACES];

static place_t *find_place(const void *key, bool add)
{
  size_t at = (size_t)(((uintptr_t)key >> 4) * UINT64_C(0x9e3779b97f4a7c15) >> 50);
  for (int probe = 0; key != NULL && probe < MAX_PROBES; probe++, at++) {
    place_t *place = &places[at % PLACES];
    const void *found = atomic_load_explicit(&place->key, memory_order_acquire);
    if (found == NULL && add && atomic_compare_exchange_strong(&place->key, &found, key)) {
      return place;
    }
    if (found == key) {
      return place;
    }
    if (found == NULL) {
      break;
    }
  }
  return NULL;
}

uint32_t object_find(const void *key)
{
  place_t *place = find_place(key, false);
  return place == NULL ? 0 : atomic_load_explicit(&place->object, memory_order_relaxed);
}

void object_set(const void *key, uint32_t object)
{
  place_t *place = find_place(key, object != 0);
  if (place != NULL) {
    atomic_store_explicit(&place->object, object, memory_order_release);
  }
}

uint32_t object_add(uint32_t kind, const void *key)
{
  file_t *file = file_now();
  uint32_t index = file == NULL ? OBJECTS : atomic_load(&file->objects);
  if (index < OBJECTS) {
    index = atomic_fetch_add(&file->objects, 1);
  }
  const uint32_t number = index < OBJECTS ? index + 1 : 0;
  if (number != 0) {
    atomic_store(&file->object[index].kind, kind);
  } else if (file != NULL) {
    atomic_fetch_add(&file->lost, 1);
  }
  object_set(key, number);
  return number;
}

static void copy_name(char *target, const char *name)
{
  snprintf(target, NAME_BYTES, "%s", name);
}

void object_name(uint32_t object, const char *name, const char *node)
{
  file_t *file = file_now();
  if (file != NULL && NUMBER(object) != 0) {
    object_t *named = &file->object[NUMBER(object) - 1];
    if (name != NULL) {
      copy_name(named->name, name);
    }
    if (node != NULL) {
      copy_name(named->node, node);
    }
  }
}

void object_name_like(uint32_t object, uint32_t other)
{
  file_t *file = file_now();
  if (file != NULL && NUMBER(other) != 0) {
    const object_t *named = &file->object[NUMBER(other) - 1];
    object_name(object, named->name, named->node);
  }
}

/* The file. */

static void stop_writing(void)
{
  atomic_store(&opened, NULL);
}

static char path[PATH_MAX];

/* A process that ends leaves no room unused: a node may start one for each message. Other threads
 * still run: what they claim from now on is beyond the number of slabs, what they had is kept. */
__attribute__((destructor)) static void give_back_room(void)
{
  file_t *file = file_now();
  if (file != NULL) {
    stop_writing();
    const uint32_t slabs = atomic_exchange(&file->slabs, 0);
    const uint32_t claimed = atomic_load(&file->claimed_slabs);
    const uint32_t used = claimed < slabs ? claimed : slabs;
    atomic_store(&file->slabs, used);
    (void)!truncate(path, (off_t)(sizeof(file_t) + (size_t)used * SLAB_ROWS * sizeof(row_t)));
  }
}

static file_t *map_file(size_t bytes)
{
  const int flags = O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC;
  const int fd = open(path, flags, 0600);
  if (fd < 0) {
    return NULL;
  }
  void *mapped = MAP_FAILED;
  do {
    errno = posix_fallocate(fd, 0, (off_t)bytes);
  } while (errno == EINTR);
  if (errno == 0) {
    mapped = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, fd, 0);
  }
  const int reason = errno;
  close(fd);
  if (mapped == MAP_FAILED) {
    unlink(path);
    errno = reason;
    return NULL;
  }
  /* No row is the first to write to its page. */
  for (size_t at = 0; at < bytes; at += PAGE_BYTES) {
    ((volatile char *)mapped)[at] = 0;
  }
  return (file_t *)mapped;
}

static void open_file(const char *folder, const char *process, const char *size)
{
  char name[NAME_BYTES];
  const uint64_t bytes = strtoull(size, NULL, 10);
  const uint64_t slabs =
    bytes < sizeof(file_t) ? 0 : (bytes - sizeof(file_t)) / (SLAB_ROWS * sizeof(row_t));
  copy_name(name, process);
  for (char *at = name; (at = strchr(at, '/')) != NULL;) {
    *at = '%';
  }
  const int length = snprintf(path, sizeof(path), "%s/%s.%d.rows", folder, name, (int)getpid());
  errno = length >= (int)sizeof(path) ? ENAMETOOLONG : slabs > UINT32_MAX ? EFBIG : ENOSPC;
  file_t *file =
    slabs == 0 || slabs > UINT32_MAX || length >= (int)sizeof(path) ? NULL : map_file(bytes);
  if (file == NULL || pthread_atfork(NULL, NULL, stop_writing) != 0 ||
      pthread_key_create(&at_end_of_thread, leave_slab) != 0) {
    fprintf(stderr, "r2bspec cannot observe this process: %s: %s\n", path, strerror(errno));
    return;
  }
  file->pid = (uint32_t)getpid();
  file->slabs = (uint32_t)slabs;
  copy_name(file->process, process);
  memcpy(file->magic, MAGIC, sizeof(file->magic));
  atomic_store(&opened, file);
}

void rows_open(void)
{
  static atomic_flag asked = ATOMIC_FLAG_INIT;
  const char *folder = getenv("R2BSPEC_ANATOMY_FOLDER");
  const char *process = getenv("R2BSPEC_ANATOMY_PROCESS");
  const char *size = getenv("R2BSPEC_ANATOMY_BYTES");
  if (folder != NULL && process != NULL && size != NULL && !atomic_flag_test_and_set(&asked)) {
    open_file(folder, process, size);
  }
}
