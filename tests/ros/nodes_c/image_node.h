// A node on rcl with a subscription and a publisher of sensor_msgs/msg/Image: what the nodes of
// this folder share.
//
// ROS arguments are those of every node: names are remapped, and parameters are set, by rcl. The
// node declares no parameters and has no services.

#ifndef IMAGE_NODE_H_
#define IMAGE_NODE_H_

#include <rcl/rcl.h>
#include <sensor_msgs/msg/image.h>

typedef struct image_node_s
{
  rcl_context_t context;
  rcl_node_t node;
  rcl_subscription_t input;
  rcl_publisher_t output;
  rcl_wait_set_t wait_set;
  /// The last message that was taken.
  sensor_msgs__msg__Image * image;
} image_node_t;

/// Start the node `name`, which exits with status 0 on SIGINT and SIGTERM.
///
/// A function of this file that fails prints the reason and exits with status 1.
void image_node_open(image_node_t * self, int argc, const char * const * argv, const char * name);

/// Subscribe to `input` and advertise `output`, reliable, with queues of `queue_depth` messages.
///
/// `queue_depth` is a parameter, 10 by default.
void image_node_connect(image_node_t * self);

/// Wait for a message and take it; false when the node has been told to exit.
bool image_node_take(image_node_t * self);

/// Publish a message on `output`.
void image_node_publish(image_node_t * self, const sensor_msgs__msg__Image * image);

/// End the node.
void image_node_close(image_node_t * self);

/// Whether the node has been told to exit.
bool image_node_stopped(void);

/// The value of a number among the parameters that were set for the node, or `otherwise`.
double image_node_parameter(image_node_t * self, const char * name, double otherwise);

/// The time of CLOCK_MONOTONIC in nanoseconds.
int64_t monotonic_ns(void);

/// Use the CPU for this time, as a node that computes does.
void compute_ms(double duration_ms);

#endif  // IMAGE_NODE_H_
