/* Clocks. */
#include "harness.h"

#include <time.h>

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
