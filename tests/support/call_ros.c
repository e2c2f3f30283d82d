/* Calls the functions of stub_ros.c as nodes do: `WHAT [NUMBER [NUMBER]]`. */
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "stub_ros.h"

extern _Atomic int traced;

typedef struct { const char *data; size_t size, capacity; } string_t;
typedef struct { string_t name; uint8_t id; uint64_t capacity, string_capacity; string_t nested, value; } field_t;
typedef struct { string_t name; field_t *fields; size_t size, capacity; } description_t;
typedef struct type { const char *id; const void *data, *f[2]; const description_t *(*describe)(const struct type *); } type_t;

static field_t header = {.id = 1, .nested = {"std_msgs/msg/Header", 19, 20}};
static field_t other = {.id = 1, .nested = {"std_msgs/msg/Time", 17, 18}};
static field_t headers = {.id = 145, .nested = {"std_msgs/msg/Header", 19, 20}}; /* a sequence */
static description_t described[] = {{.fields = &header, .size = 1}, {.fields = &other, .size = 1}, {.fields = &headers, .size = 1}, {.size = 0}};
static const description_t *describe(const type_t *type) { return type->data; }
static const type_t stamped = {.data = &described[0], .describe = describe};
static const type_t unstamped = {.data = &described[1], .describe = describe};
static const type_t several = {.data = &described[2], .describe = describe};
static const type_t empty = {.data = &described[3], .describe = describe};

static char node[] = "/space/node";
static const int32_t message[2] = {1, 2};

static void *new_publisher(const char *name, const type_t *type)
{
  void *publisher = NULL;
  if (rcl_publisher_init(&publisher, node, type, name, NULL) != 0) { abort(); }
  return publisher;
}

/* One of each. A handle that is copied stays the same object. */
static void call_each(void)
{
  void *publisher = new_publisher("out", &stamped), *bare = new_publisher("bare", &unstamped);
  void *without = new_publisher("empty", &empty), *sequence = new_publisher("several", &several);
  void *subscription, *client, *service, *timer, *copy = publisher;
  rcl_subscription_init(&subscription, node, &stamped, "in", NULL);
  rcl_client_init(&client, node, NULL, "ask", NULL);
  rcl_service_init(&service, node, NULL, "answer", NULL);
  const allocator_t allocator = {{&timer, NULL, NULL, NULL, &timer}};
  if (rcl_timer_init2(&timer, NULL, NULL, 7, NULL, allocator, true) != 0) { abort(); }
  ros_trace_rclcpp_timer_link_node(&timer, node);
  ros_trace_rclcpp_buffer_to_ipb(&described[0], &described[1]);
  ros_trace_rclcpp_ipb_to_subscription(&described[1], &described[2]);
  ros_trace_rclcpp_subscription_init(&subscription, &described[2]);
  ros_trace_rclcpp_subscription_init(&subscription, &header); /* of another subscription */

  uint8_t data[] = {0, 1, 0, 0, 5, 0, 0, 0, 6, 0, 0, 0}; /* little-endian */
  serialized_t serialized = {.buffer = data, .length = sizeof(data)}, shorter = {.buffer = data, .length = 8};
  rcl_publish(&copy, message, NULL);
  rcl_publish(&bare, message, NULL);
  rcl_publish(&without, message, NULL);
  rcl_publish(&sequence, message, NULL);
  rcl_publish_loaned_message(&publisher, message, NULL);
  rcl_publish_serialized_message(&publisher, &serialized, NULL);
  rcl_publish_serialized_message(&publisher, &shorter, NULL);

  int32_t taken[2];
  const void *loaned;
  info_t info;
  rcl_wait(NULL, 5);
  rcl_take(&subscription, NULL, &info, NULL);
  rcl_take(&subscription, taken, NULL, NULL);
  ros_trace_callback_start(&copy, false);
  rcl_timer_call(&timer);
  ros_trace_callback_start(&bare, false);
  ros_trace_callback_start(&without, false); /* an exception ends it */
  ros_trace_callback_end(&bare);
  ros_trace_callback_end(&copy);
  ros_trace_callback_end(&copy); /* of a callback that began before */
  rcl_take_loaned_message(&subscription, &loaned, &info, NULL);
  rcl_take_serialized_message(&subscription, &serialized, &info, NULL);
  rcl_trigger_guard_condition(NULL);

  int64_t number = 0;
  request_info_t asked;
  rcl_send_request(&client, message, &number);
  rcl_take_request_with_info(&service, &asked, NULL);
  rcl_take_request_with_info(&service, &asked, taken);
  rcl_send_response(&service, &asked.request, taken);
  rcl_take_response_with_info(&client, &asked, taken);

  ros_trace_rclcpp_intra_publish(&publisher, message);
  ros_trace_rclcpp_ring_buffer_enqueue(&described[0], 3, 4, true);
  ros_trace_rclcpp_ring_buffer_dequeue(&described[0], 3, 4);
  ros_trace_callback_start(&copy, true);
  ros_trace_callback_end(&copy);

  rcl_publisher_fini(&publisher, node);
  rcl_publish(&copy, message, NULL); /* nobody knows it any more */
  rcl_timer_fini(&timer);
  printf("%d traced\n", traced);
}

static void publish(void *publisher, long count)
{
  for (long i = 0; i < count; i++) {
    rcl_publish(&publisher, message, NULL);
  }
}

static long each_publishes;
static void *publish_in_thread(void *publisher)
{
  publish(publisher, each_publishes);
  return NULL;
}

static void publish_in_threads(long count, long each)
{
  pthread_t threads[64];
  each_publishes = each;
  void *publisher = new_publisher("out", &stamped);
  for (long i = 0; i < count; i++) { pthread_create(&threads[i], NULL, publish_in_thread, publisher); }
  for (long i = 0; i < count; i++) { pthread_join(threads[i], NULL); }
}

/* One after another: each thread publishes once. */
static void publish_in_brief_threads(long count)
{
  for (long i = 0; i < count; i++) { publish_in_threads(1, 1); }
}

/* With `again`, the child then executes this program. */
static void publish_in_child(bool again)
{
  void *publisher = new_publisher("out", &stamped);
  publish(publisher, 1);
  const pid_t child = fork();
  if (child == 0) {
    rcl_init(0, NULL, NULL, NULL);
    publish(new_publisher("child", &stamped), 10);
    publish(publisher, 10);
    if (again) { execl("/proc/self/exe", "call_ros", "threads", "1", "5", NULL); }
    _exit(0);
  }
  int status = 1;
  waitpid(child, &status, 0);
  publish(publisher, status == 0 ? 2 : 0);
}

/* As an executor does whose callbacks keep each other out. */
static void wait_between_publications(long count)
{
  void *publisher = new_publisher("out", &stamped);
  for (int message = 0; message < 2; message++) {
    for (long i = 0; i < count; i++) {
      rcl_wait(NULL, 0);
      rcl_trigger_guard_condition(NULL);
    }
    publish(publisher, 1);
    rcl_trigger_guard_condition(NULL);
  }
}

static void make_publishers(long count)
{
  for (long i = 0; i < count; i++) {
    void *publisher = new_publisher("out", &stamped);
    publish(publisher, 1);
    rcl_publisher_fini(&publisher, node);
  }
}

/* Prints the time that each of so many publications takes, in nanoseconds. */
static void measure(long count)
{
  void *publisher = new_publisher("out", &stamped);
  publish(publisher, count / 10);
  struct timespec began, ended;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &began);
  publish(publisher, count);
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &ended);
  printf("%.2f\n", (1e9 * (double)(ended.tv_sec - began.tv_sec) + (double)(ended.tv_nsec - began.tv_nsec)) / (double)count);
}

__attribute__((visibility("default"))) int call_ros(const char *what, long first, long second)
{
  if (rcl_init(0, NULL, NULL, NULL) != 0) { return 1; }
  if (strcmp(what, "each") == 0) { call_each(); }
  if (strcmp(what, "threads") == 0) { publish_in_threads(first, second); }
  if (strcmp(what, "brief") == 0) { publish_in_brief_threads(first); }
  if (strcmp(what, "fork") == 0) { publish_in_child(first != 0); }
  if (strcmp(what, "waits") == 0) { wait_between_publications(first); }
  if (strcmp(what, "objects") == 0) { make_publishers(first); }
  if (strcmp(what, "measure") == 0) { measure(first); }
  if (strcmp(what, "killed") == 0) { publish(new_publisher("out", &stamped), first); kill(getpid(), SIGKILL); }
  return fflush(stdout);
}

int main(int argc, char **argv)
{
  return argc < 2 ? 2 : call_ros(argv[1], argc < 3 ? 0 : atol(argv[2]), argc < 4 ? 0 : atol(argv[3]));
}
