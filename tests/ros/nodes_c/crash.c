// Relays images; the one after `messages` further ones is written to where no memory is.

#include <stdlib.h>

#include "image_node.h"

int main(int argc, char ** argv)
{
  image_node_t node;
  image_node_open(&node, argc, (const char * const *)argv, "crash");
  image_node_connect(&node);
  double messages = image_node_parameter(&node, "messages", 0.0);
  volatile uint32_t * width = &node.image->width;
  while (image_node_take(&node)) {
    if (messages-- < 1.0) {
      width = NULL;
    }
    *width = node.image->width;
    image_node_publish(&node, node.image);
  }
  image_node_close(&node);
  return EXIT_SUCCESS;
}
