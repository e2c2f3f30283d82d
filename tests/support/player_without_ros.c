/* The player without ROS: what it publishes is read, byte by byte, and counted.
 *
 * Each line of the input is PLAYLIST PLAYBACK BUFFER...; the answer is what the player replies to
 * both, or the reason for which a file was refused, and how many bytes were published. With
 * LIBFUZZER, an input is the size of a playlist, the playlist, and a playback file.
 */
#include "player.c"

#include <stdarg.h>
#include <sys/mman.h>

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

int fail_errno(const char *what) { return fail("", "%s cannot be used", what); }
int fail_rcl(const char *what) { return fail("", "%s failed", what); }
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

/* A damaged time may be years ahead: a player that waits for it is told to stop. */
bool channel_wait(channel_t *channel, int64_t timeout_ns)
{
  (void)channel;
  return timeout_ns > 2 * START_DELAY_NS;
}

char *next_word(channel_t *channel)
{
  (void)channel;
  return "";
}

int64_t next_number(channel_t *channel) { return channel == NULL; }
bool begins_with_header(type_t *type) { return type != NULL; }
rmw_qos_profile_t next_qos(channel_t *channel) { (void)channel; return rmw_qos_profile_default; }

type_t *next_type(channel_t *channel)
{
  (void)channel;
  return NULL;
}

rcl_ret_t rcl_publish_serialized_message(
  const rcl_publisher_t *publisher, const rcl_serialized_message_t *message,
  rmw_publisher_allocation_t *allocation)
{
  (void)publisher, (void)allocation;
  const volatile uint8_t *bytes = message->buffer;
  for (size_t i = 0; i < message->buffer_length; ++i, ++published) {
    (void)bytes[i];
  }
  return RCL_RET_OK;
}

static void answer(char *line)
{
  channel_t channel = {0};
  player_t player = {.channel = &channel, .spin_ns = MIN_SPIN_NS};
  const char *playlist = strsep(&line, " "), *playback = strsep(&line, " ");
  player.sources = calloc(MOST_BUFFERS, sizeof(source_t));
  int failed = 0;
  for (char *word; failed == 0 && *(word = strsep(&line, " \n")) != '\0';) {
    failed = map_file(&player.sources[player.source_count++].buffer, word, false);
  }
  published = 0;
  if (failed == 0 && play(&player, playlist) == 0) {
    (void)play(&player, playback);
  }
  printf("%s: %zu bytes\n", text, published);
  fflush(stdout);
  for (int64_t i = 0; i < player.source_count; ++i) {
    (void)munmap(player.sources[i].buffer.data, player.sources[i].buffer.size);
  }
  free(player.sources);
}

#ifdef LIBFUZZER
static void fill(int fd, const uint8_t *data, size_t size)
{
  if (ftruncate(fd, 0) < 0 || pwrite(fd, data, size, 0) != (ssize_t)size) {
    abort();
  }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
  static const uint8_t buffer[48];
  static int files[3];
  uint32_t length;
  if (size < sizeof(length)) {
    return 0;
  }
  for (int i = 0; i < 3 && files[i] == 0; ++i) {
    files[i] = memfd_create("input", 0);
  }
  memcpy(&length, data, sizeof(length));
  data += sizeof(length);
  size -= sizeof(length);
  length = length > size ? (uint32_t)size : length;
  fill(files[0], data, length);
  fill(files[1], data + length, size - length);
  fill(files[2], buffer, sizeof(buffer));
  char line[256];
  snprintf(line, sizeof(line), "/proc/self/fd/%d /proc/self/fd/%d /proc/self/fd/%d /proc/self/fd/%d\n",
    files[0], files[1], files[2], files[2]);
  answer(line);
  return 0;
}
#else
int main(void)
{
  char line[8192];
  (void)player_serve;
  while (fgets(line, sizeof(line), stdin) != NULL) {
    answer(line);
  }
  return 0;
}
#endif
