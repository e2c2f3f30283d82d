// Relays images, each after `service_time_ms` of computing and a loop of `steps`.

#include <stdlib.h>

#include "image_node.h"

int main(int argc, char ** argv)
{
  image_node_t node;
  image_node_open(&node, argc, (const char * const *)argv, "relay");
  image_node_connect(&node);
  const double service_time_ms = image_node_parameter(&node, "service_time_ms", 0.0);
  const int64_t steps = (int64_t)image_node_parameter(&node, "steps", 0.0);
  while (image_node_take(&node)) {
    for (volatile int64_t step = 0; step < steps; step++) {
    }
    compute_ms(service_time_ms);
    image_node_publish(&node, node.image);
  }
  image_node_close(&node);
  return EXIT_SUCCESS;
}
