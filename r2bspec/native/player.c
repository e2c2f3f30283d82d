/* The player: publishes prepared messages at the times of a file.
 *
 * The load is open-loop: an event is due at its time whether or not the graph has answered the one
 * before. A late one is published at once, and its lateness is recorded. All inputs of a step have
 * the same unique stamp, so that each output can be matched to its input.
 */
#include "harness.h"

#include <stdlib.h>
#include <string.h>

/* From the command to the first due time, so that the first step is not late. */
#define START_DELAY_NS 20000000
/* A late player never sleeps, so it also looks for commands after so many events. */
#define EVENTS_PER_LOOK 64

typedef struct player {
  channel_t *channel;
  rcl_node_t *node;
  source_t *sources;
  int64_t source_count;
  table_t messages;
  int64_t last_stamp_ns;
  pacer_t pacer;
} player_t;

static const message_t *first_message(const player_t *player, const event_t *event)
{
  return (const message_t *)player->messages.items + event->first;
}

/* This happens before waiting: writing to messages that are no longer in the cache takes time,
 * which would delay each publication. */
static void stamp_event(player_t *player, event_t *event, const int64_t *epoch_ns)
{
  if (epoch_ns != NULL) {
    event->stamp_ns += *epoch_ns;
  } else {
    const int64_t early_ns = event->due_ns - monotonic_ns();
    event->stamp_ns = system_ns() + (early_ns > 0 ? early_ns : 0);
    if (event->stamp_ns <= player->last_stamp_ns) {
      event->stamp_ns = player->last_stamp_ns + 1;
    }
  }
  if (event->stamp_ns > player->last_stamp_ns) {
    player->last_stamp_ns = event->stamp_ns;
  }
  const message_t *messages = first_message(player, event);
  for (int64_t i = 0; i < event->count; ++i) {
    message_stamp(&messages[i], player->sources, event->stamp_ns);
  }
}

static int publish_event(player_t *player, event_t *event)
{
  const message_t *messages = first_message(player, event);
  /* What a latency counts from: before the first call that publishes. */
  event->published_ns = monotonic_ns();
  for (int64_t i = 0; i < event->count; ++i) {
    source_t *source = &player->sources[messages[i].source];
    const char *data = source->buffer.data + messages[i].offset;
    if (messages[i].is_published &&
        ros_publish(&source->publisher, data, (size_t)messages[i].size) < 0) {
      return -1;
    }
  }
  event->done_ns = monotonic_ns();
  return 0;
}

/* The system time of the beginning, to which the stamps of a recording are shifted. It is later if
 * a stamp would otherwise repeat, because stamps may be ahead of the clock. */
static int64_t find_epoch(const player_t *player, const table_t *playback, int64_t begin_ns)
{
  const int64_t epoch_ns = system_ns() + begin_ns - monotonic_ns();
  const int64_t least_ns = player->last_stamp_ns + 1 - playback->header->earliest_stamp_ns;
  return epoch_ns > least_ns ? epoch_ns : least_ns;
}

/* Plays until the last event or until a command arrives; returns how many steps are complete. */
static int play_events(player_t *player, table_t *playback)
{
  event_t *events = playback->items;
  const int64_t begin_ns = monotonic_ns() + START_DELAY_NS;
  const int64_t epoch_ns = find_epoch(player, playback, begin_ns);
  int steps = 0;
  for (int64_t i = 0; i < playback->header->items; ++i) {
    events[i].due_ns += begin_ns;
    stamp_event(player, &events[i], playback->header->has_stamps ? &epoch_ns : NULL);
    if (pacer_wait(&player->pacer, events[i].due_ns, player->channel) ||
        (i % EVENTS_PER_LOOK == 0 && channel_wait(player->channel, 0))) {
      break;
    }
    if (publish_event(player, &events[i]) < 0) {
      return -1;
    }
    steps = events[i].complete;
    /* The event before the count: a reader sees complete events only. */
    __atomic_store_n(&playback->header->published, i + 1, __ATOMIC_RELEASE);
  }
  return steps;
}

static int play(player_t *player, const char *path)
{
  table_t playback = {0};
  int steps = playback_open(&playback, path, &player->messages);
  if (steps == 0) {
    steps = play_events(player, &playback);
  }
  table_close(&playback);
  return steps < 0 ? -1 : channel_reply(player->channel, "played %d\n", steps);
}

static int load(player_t *player, const char *path)
{
  table_close(&player->messages);
  for (int64_t i = 0; i < player->source_count; ++i) {
    if (mapping_open(&player->sources[i].buffer, player->sources[i].path, false) < 0) {
      return -1;
    }
  }
  return messages_open(&player->messages, path, player->sources, player->source_count) < 0
           ? -1
           : channel_reply(player->channel, "ready\n");
}

/* player INPUTS {TYPE QOS TOPIC BUFFER} */
static int configure(player_t *player)
{
  channel_t *channel = player->channel;
  const int64_t inputs = next_number(channel);
  player->sources = calloc(inputs < 0 ? 1 : (size_t)inputs + 1, sizeof(source_t));
  if (player->sources == NULL) {
    return fail_memory();
  }
  for (; player->source_count < inputs; ++player->source_count) {
    source_t *source = &player->sources[player->source_count];
    type_t *type = ros_type(next_word(channel));
    const rmw_qos_profile_t qos = next_qos(channel);
    if (type == NULL ||
        ros_publisher(player->node, type, &qos, next_word(channel), &source->publisher) < 0) {
      return -1;
    }
    source->has_header = begins_with_header(type);
    source->path = strdup(next_word(channel));
  }
  return 0;
}

/* Sends a number for each input: whether its type begins with a header, or its subscriptions. */
static int send_numbers(player_t *player, const char *reply, bool headers)
{
  int failed = channel_reply(player->channel, "%s", reply);
  for (int64_t i = 0; i < player->source_count && failed == 0; ++i) {
    size_t number = player->sources[i].has_header;
    if (!headers) {
      ignore_rcl(rcl_publisher_get_subscription_count(&player->sources[i].publisher, &number));
    }
    failed = channel_reply(player->channel, " %zu", number);
  }
  return failed < 0 ? -1 : channel_reply(player->channel, "\n");
}

/* Executes a command; 1 for the one that ends the player. */
static int execute(player_t *player)
{
  const char *command = next_word(player->channel);
  if (strcmp(command, "follow") == 0) {
    return load(player, next_word(player->channel));
  }
  if (strcmp(command, "count") == 0) {
    return send_numbers(player, "matched", false);
  }
  if (strcmp(command, "play") == 0) {
    return play(player, next_word(player->channel));
  }
  /* Others are ignored: a stop that arrived after the last event. */
  return strcmp(command, "shutdown") == 0 || *command == '\0';
}

static void clean_up(player_t *player)
{
  part_ends();
  table_close(&player->messages);
  for (int64_t i = 0; i < player->source_count; ++i) {
    ignore_rcl(rcl_publisher_fini(&player->sources[i].publisher, player->node));
    mapping_close(&player->sources[i].buffer);
    free(player->sources[i].path);
  }
  free(player->sources);
}

int player_serve(channel_t *channel, rcl_node_t *node)
{
  player_t player = {.channel = channel, .node = node};
  int status = configure(&player);
  if (status == 0) {
    pacer_init(&player.pacer);
    status = send_numbers(&player, "ready", true);
  }
  while (status == 0) {
    status = execute(&player);
  }
  clean_up(&player);
  return status < 0 ? -1 : 0;
}
