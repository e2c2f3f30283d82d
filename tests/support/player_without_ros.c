/* The player without ROS: what it publishes is read, byte by byte, and counted.
 *
 * Each line of the input is PLAYLIST PLAYBACK BUFFER...; the answer is what the player replies to
 * both, or the reason for which a file was refused, and how many bytes were published.
 */
#include "player.c"

#include <stdarg.h>

#define MOST_BUFFERS 8

static char text[1024];
static size_t published;

int fail(const char *code, const char *format, ...)
{
  (void)code;
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(text, sizeof(text), format, arguments);
  va_end(arguments);
  return -1;
}

int fail_file(const char *path) { return fail("", "%s cannot be read", path); }
int fail_memory(void) { return fail("", "no memory"); }
void ignore_rcl(rcl_ret_t status) { (void)status; }

int channel_reply(channel_t *channel, const char *format, ...)
{
  (void)channel;
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(text, sizeof(text), format, arguments);
  va_end(arguments);
  text[strcspn(text, "\n")] = '\0';
  return 0;
}

/* A damaged time may be years ahead: whoever waits for it is told to stop. */
bool channel_wait(channel_t *channel, int64_t timeout_ns)
{
  (void)channel;
  return timeout_ns > NS_PER_S;
}

char *next_word(channel_t *channel)
{
  (void)channel;
  return "";
}

int64_t next_number(channel_t *channel) { return channel == NULL; }
void part_ends(void) {}
bool begins_with_header(type_t *type) { return type != NULL; }
rmw_qos_profile_t next_qos(channel_t *channel) { (void)channel; return rmw_qos_profile_default; }

type_t *ros_type(const char *name)
{
  (void)name;
  return NULL;
}

int ros_publisher(
  rcl_node_t *node, type_t *type, const rmw_qos_profile_t *qos, const char *topic,
  rcl_publisher_t *made)
{
  (void)node, (void)type, (void)qos, (void)topic, (void)made;
  return 0;
}

int ros_publish(rcl_publisher_t *publisher, const void *data, size_t size)
{
  (void)publisher;
  const volatile char *bytes = data;
  for (size_t i = 0; i < size; ++i, ++published) {
    (void)bytes[i];
  }
  return 0;
}

static void answer(char *line)
{
  channel_t channel = {0};
  player_t player = {.channel = &channel, .spin_ns = MIN_SPIN_NS};
  const char *playlist = strsep(&line, " "), *playback = strsep(&line, " ");
  player.sources = calloc(MOST_BUFFERS, sizeof(source_t));
  for (char *word; *(word = strsep(&line, " \n")) != '\0';) {
    player.sources[player.source_count++].path = strdup(word);
  }
  published = 0;
  if (load(&player, playlist) == 0) {
    (void)play(&player, playback);
  }
  printf("%s: %zu bytes\n", text, published);
  fflush(stdout);
  clean_up(&player);
}

int main(void)
{
  char line[8192];
  (void)player_serve;
  while (fgets(line, sizeof(line), stdin) != NULL) {
    answer(line);
  }
  return 0;
}
