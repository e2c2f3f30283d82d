/* Converts arrivals as timing.c does, by clocks that say what the input tells them.
 *
 * A line of the input is MONOTONIC-NS SYSTEM-NS ARRIVED-SYSTEM-NS; the first one starts the clocks.
 * The answer is the arrival and the time of taking, on the monotonic clock.
 */
#include <inttypes.h>
#include <time.h>

#include "harness.h"

static int64_t monotonic, there;

int clock_gettime(clockid_t clock, struct timespec *now)
{
  const int64_t ns = clock == CLOCK_REALTIME ? there : monotonic;
  now->tv_sec = ns / NS_PER_S;
  now->tv_nsec = ns % NS_PER_S;
  return 0;
}

bool channel_wait(channel_t *channel, int64_t timeout_ns)
{
  (void)channel;
  (void)timeout_ns;
  return true;
}

int main(void)
{
  int64_t arrived_system;
  clock_offset_t offset;
  bool begun = false;
  while (scanf("%" SCNd64 " %" SCNd64 " %" SCNd64, &monotonic, &there, &arrived_system) == 3) {
    if (!begun) {
      clock_offset_init(&offset);
      begun = true;
    }
    int64_t arrived;
    const int64_t taken = clock_offset_arrival(&offset, arrived_system, &arrived);
    printf("%" PRId64 " %" PRId64 "\n", arrived, taken);
  }
  return 0;
}
