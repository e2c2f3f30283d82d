/* Clocks, and waiting for due times. */
#include "harness.h"

#include <sys/prctl.h>
#include <time.h>

/* More than the lateness of most sleeps. */
#define INITIAL_SPIN_NS 150000
#define MIN_SPIN_NS 30000
/* A larger lateness comes from other work on the core; spinning does not help against it. */
#define MAX_SPIN_NS 300000
/* The share of sleeps that may end late is 4 %: these two are in balance there. */
#define LATE_STEP_NS 3840
#define EARLY_STEP_NS 160

/* Clocks are read one after the other, and again if the reads were interrupted. */
#define MAX_READ_NS 20000
#define MAX_READS 5
/* Smaller changes are no steps: the jitter of reading, and slewing by up to 10 %. */
#define MIN_STEP_NS 2000000
#define MAX_SLEW_DIVISOR 10

static int64_t read_clock(clockid_t clock)
{
  struct timespec now;
  clock_gettime(clock, &now);
  return now.tv_sec * NS_PER_S + now.tv_nsec;
}

int64_t monotonic_ns(void) { return read_clock(CLOCK_MONOTONIC); }
int64_t system_ns(void) { return read_clock(CLOCK_REALTIME); }
int64_t thread_cpu_ns(void) { return read_clock(CLOCK_THREAD_CPUTIME_ID); }

void pacer_init(pacer_t *pacer)
{
  pacer->spin_ns = INITIAL_SPIN_NS;
  /* The slack of timers is 50 us by default; without this call sleeps just end later. */
  (void)prctl(PR_SET_TIMERSLACK, 1UL, 0UL, 0UL, 0UL);
}

static void pacer_learn(pacer_t *pacer, bool late)
{
  pacer->spin_ns += late ? LATE_STEP_NS : -EARLY_STEP_NS;
  if (pacer->spin_ns < MIN_SPIN_NS) {
    pacer->spin_ns = MIN_SPIN_NS;
  } else if (pacer->spin_ns > MAX_SPIN_NS) {
    pacer->spin_ns = MAX_SPIN_NS;
  }
}

bool pacer_wait(pacer_t *pacer, int64_t due_ns, channel_t *channel)
{
  bool slept = false;
  int64_t left_ns;
  while ((left_ns = due_ns - monotonic_ns()) > pacer->spin_ns) {
    if (channel_wait(channel, left_ns - pacer->spin_ns)) {
      return true;
    }
    slept = true;
  }
  if (slept) {
    pacer_learn(pacer, left_ns <= 0);
  }
  while (monotonic_ns() < due_ns) {
  }
  return false;
}

/* Reads the system time minus the monotonic time; returns the latter. */
static int64_t read_difference(int64_t *difference_ns)
{
  int64_t closest_ns = -1;
  int64_t now_ns = 0;
  for (int reads = 0; reads < MAX_READS; ++reads) {
    const int64_t before_ns = monotonic_ns();
    const int64_t there_ns = system_ns();
    const int64_t took_ns = monotonic_ns() - before_ns;
    if (closest_ns < 0 || took_ns < closest_ns) {
      closest_ns = took_ns;
      now_ns = before_ns + took_ns;
      *difference_ns = there_ns - before_ns - took_ns / 2;
    }
    if (closest_ns <= MAX_READ_NS) {
      break;
    }
  }
  return now_ns;
}

void clock_offset_init(clock_offset_t *offset)
{
  offset->last_read_ns = read_difference(&offset->difference_ns);
  offset->difference_before_ns = offset->difference_ns;
  offset->no_step_until_ns = offset->last_read_ns;
}

int64_t clock_offset_update(clock_offset_t *offset)
{
  int64_t difference_ns = 0;
  const int64_t now_ns = read_difference(&difference_ns);
  const int64_t moved_ns = difference_ns - offset->difference_ns;
  const int64_t slew_ns = (now_ns - offset->last_read_ns) / MAX_SLEW_DIVISOR;
  if ((moved_ns < 0 ? -moved_ns : moved_ns) > MIN_STEP_NS + slew_ns) {
    offset->difference_before_ns = offset->difference_ns;
    offset->no_step_until_ns = offset->last_read_ns;
  }
  offset->last_read_ns = now_ns;
  offset->difference_ns = difference_ns;
  return now_ns;
}

int64_t clock_offset_arrival(clock_offset_t *offset, int64_t arrived_system_ns, int64_t *arrived)
{
  const int64_t taken_ns = clock_offset_update(offset);
  int64_t arrived_ns = taken_ns;
  if (arrived_system_ns > 0) {
    arrived_ns = arrived_system_ns - offset->difference_ns;
    /* One that arrived before a step of the clock and is taken after it seems to come from the
     * future, or from before the last look without a step. */
    if (arrived_ns < offset->no_step_until_ns || arrived_ns > taken_ns) {
      arrived_ns = arrived_system_ns - offset->difference_before_ns;
    }
  }
  *arrived = arrived_ns < taken_ns ? arrived_ns : taken_ns;
  return taken_ns;
}
