/* The timed part of the harness: players, which publish prepared messages on a schedule, and
 * monitors, which record when messages arrive. Each has a control channel, a thread and a ROS
 * context of its own, so that any number of them can live in any process.
 *
 * Functions that can fail return 0 or a negative number; what failed is then kept for the thread
 * and reported on its channel by control.c. Times are in nanoseconds; on the monotonic clock unless
 * a name says otherwise. The files that are shared with the controller are described where Python
 * reads or writes them: r2bspec/ipc/{sample_files,playback_file,native_protocol}.py.
 */
#ifndef R2BSPEC_HARNESS_H
#define R2BSPEC_HARNESS_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <time.h>

#include <rcl/error_handling.h>
#include <rcl/rcl.h>

#define NS_PER_S INT64_C(1000000000)
#define PUBLIC __attribute__((visibility("default")))

/* control.c: the parts of a process; not for several threads at once. */

/* Starts a part that is controlled over a connected socket, which it will close; returns 0, or a
 * negative errno. */
PUBLIC int r2bspec_harness_serve(int fd);
/* Waits for the end of all parts, for at most two seconds; 1 if one of them has failed, else 0. */
PUBLIC int r2bspec_harness_join(void);
/* Serves a channel, of which this is the descriptor, in this thread until it is told to end. */
void *part_serve(void *fd);

/* control.c: the channel of a part. */

typedef struct channel {
  FILE *in; /* without a buffer */
  char *word;
  size_t capacity;
} channel_t;

/* The next word of a command, of which each ends with a zero byte; it is valid until the next call.
 * Empty when the channel is closed. */
char *next_word(channel_t *channel);
int64_t next_number(channel_t *channel);
/* Sleeps until a command can be read or the time is over; true for a command. */
bool channel_wait(channel_t *channel, int64_t timeout_ns);
/* Sends a part of a reply, which is a line of words. */
int channel_reply(channel_t *channel, const char *format, ...)
  __attribute__((format(printf, 2, 3)));

#define HARNESS_FAULT "R2B630"

/* Keeps what failed, for the report; returns -1, as those below. */
int fail(const char *code, const char *format, ...) __attribute__((format(printf, 2, 3)));
int fail_rcl(const char *what);
/* For calls whose failure changes nothing: forgets the error that rcl has kept. */
void ignore_rcl(rcl_ret_t status);
/* errno says why this, which may be a file, cannot be used; the controller knows its code. */
int fail_errno(const char *what);

static inline int64_t read_clock(clockid_t clock)
{
  struct timespec now;
  clock_gettime(clock, &now);
  return now.tv_sec * NS_PER_S + now.tv_nsec;
}

static inline int64_t monotonic_ns(void) { return read_clock(CLOCK_MONOTONIC); }
static inline int64_t system_ns(void) { return read_clock(CLOCK_REALTIME); }

/* ros.c */

typedef struct ros {
  rcl_context_t context;
  rcl_node_t node;
} ros_t;

typedef const rosidl_message_type_support_t type_t;

int ros_init(ros_t *ros, const char *node_name);
void ros_fini(ros_t *ros);
/* The type support of the next TYPE of a command; NULL if it is not installed. */
type_t *next_type(channel_t *channel);
bool begins_with_header(type_t *type);
rmw_qos_profile_t next_qos(channel_t *channel);

/* player.c, monitor.c: each is configured over a channel, and serves it until told to end. */
int player_serve(channel_t *channel, rcl_node_t *node);
int monitor_serve(channel_t *channel, rcl_node_t *node);

#endif
