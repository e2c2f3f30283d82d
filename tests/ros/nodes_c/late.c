// Relays images, but first computes for `load_time_ms`, as a node that loads a model does.

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "image_node.h"

int main(int argc, char ** argv)
{
  image_node_t node;
  image_node_open(&node, argc, (const char * const *)argv, "late");
  const double load_time_ms = image_node_parameter(&node, "load_time_ms", 2000.0);
  const int64_t end_ns = monotonic_ns() + (int64_t)(load_time_ms * 1e6);
  while (monotonic_ns() < end_ns && !image_node_stopped()) {
    nanosleep(&(struct timespec){.tv_nsec = 10 * 1000 * 1000}, NULL);
  }
  printf("the model is loaded at %" PRId64 " ns\n", monotonic_ns());
  image_node_connect(&node);
  while (image_node_take(&node)) {
    image_node_publish(&node, node.image);
  }
  image_node_close(&node);
  return EXIT_SUCCESS;
}
