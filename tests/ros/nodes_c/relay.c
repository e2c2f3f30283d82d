// Relays images, each after `service_time_ms` of computing.

#include <stdlib.h>

#include "image_node.h"

int main(int argc, char ** argv)
{
  image_node_t node;
  image_node_open(&node, argc, (const char * const *)argv, "relay");
  image_node_connect(&node);
  const double service_time_ms = image_node_parameter(&node, "service_time_ms", 0.0);
  while (image_node_take(&node)) {
    compute_ms(service_time_ms);
    image_node_publish(&node, node.image);
  }
  image_node_close(&node);
  return EXIT_SUCCESS;
}
