/* Rows of events of this process, in a mapped file; `anatomy.c` says what they are for. */
#ifndef R2BSPEC_ANATOMY_ROWS_H
#define R2BSPEC_ANATOMY_ROWS_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define NS_PER_S INT64_C(1000000000)

/* `AnatomyKind` of record/run_record.py. */
enum {
  PUBLISH = 1, TAKE, CALLBACK, TRIGGER, WAIT, TIMER, SEND_REQUEST, TAKE_REQUEST, SEND_RESPONSE,
  TAKE_RESPONSE, ENQUEUE, DEQUEUE
};
enum { TOOK_NOTHING = 1, WITHIN_PROCESS = 2 };

/* `ANATOMY_FIELDS` of record/sample_arrays.py. */
typedef struct {
  uint32_t object, process, thread;
  _Atomic uint16_t kind;
  uint16_t flags;
  int64_t began_ns, ended_ns, source_ns, received_ns, header_ns, clock_ns;
} row_t;

/* Opens the file that the environment names, in the first call. */
void rows_open(void);

bool rows_are_open(void);

/* The monotonic clock. */
int64_t now_ns(void);

/* Adds a row with the object, flags, times and stamps of an event. */
void rows_add(uint16_t kind, const row_t *event);

/* What events belong to has a number, from 1 on, and is found by an address. */
enum { PUBLISHER = 1, SUBSCRIPTION, TIMER_OBJECT, CLIENT, SERVICE, BUFFER };
#define HAS_HEADER (UINT32_C(1) << 31)
#define HAS_GOAL (UINT32_C(1) << 30)
#define NUMBER(object) ((object) & ~(HAS_HEADER | HAS_GOAL))

/* Adds an object without names; returns its number, or 0 if there is no room or no file. */
uint32_t object_add(uint32_t kind, const void *key);

/* Names an object; NULL leaves a name as it is. */
void object_name(uint32_t object, const char *name, const char *node);

/* Gives one object the names of another. */
void object_name_like(uint32_t object, uint32_t other);

/* The object of an address, with what its messages or requests begin with: HAS_HEADER, or HAS_GOAL
 * for the id of one; 0 if none is known. */
uint32_t object_find(const void *key);

/* Makes an address lead to an object; 0 makes it lead nowhere. */
void object_set(const void *key, uint32_t object);

/* What a thread does now. */
extern _Thread_local struct thread {
  uint32_t taken_from; /* the object whose callback is called next */
  int64_t source_ns;   /* of the message that it publishes */
} thread_now;

/* Handles of rcl are known by what they point to, because a program may copy them. */
static inline const void *key_of(const void *handle)
{
  return handle == NULL ? NULL : *(void *const *)handle;
}

static inline row_t begin_event(const void *handle)
{
  return (row_t){.object = NUMBER(object_find(key_of(handle))), .began_ns = now_ns()};
}

/* Returns the status. */
static inline int end_event(uint16_t kind, row_t *event, int status)
{
  event->ended_ns = now_ns();
  rows_add(kind, event);
  return status;
}

enum form { STRUCTURE, LOANED, SERIALIZED };

/* The header stamp of a message in ns, a number of the goal of an action that it is about, or 0. */
int64_t read_stamp(const void *handle, const void *message, enum form form);

/* The full name of a node, or NULL. */
const char *node_name(const void *node);

#endif
