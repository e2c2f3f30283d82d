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

int64_t clock_difference(int64_t *difference_ns)
{
  int64_t before_ns, there_ns, after_ns;
  int reads = 0;
  do {
    before_ns = monotonic_ns();
    there_ns = system_ns();
    after_ns = monotonic_ns();
  } while (after_ns - before_ns > MAX_READ_NS && ++reads < MAX_READS);
  *difference_ns = there_ns - before_ns - (after_ns - before_ns) / 2;
  return after_ns;
}
