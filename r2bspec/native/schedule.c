/* Schedules: r2bspec/ipc/playlist.py writes one round of events, which is repeated here.
 *
 * The arithmetic is that of r2bspec/ipc/schedule.py, including the rounding of products of floating
 * point. It wraps around (-fwrapv), so that wrong times in a file are nothing but wrong times.
 */
#include "harness.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "playlists are little-endian");

#define MAGIC "R2BPLAY1"

static int refuse(const char *path, const char *why)
{
  return fail(HARNESS_FAULT, "%s is not a playlist: %s", path, why);
}

static bool within(int64_t first, int64_t count, int64_t total)
{
  return first >= 0 && count >= 0 && first <= total && count <= total - first;
}

/* Takes an array of the file, if there is as much left of it. */
static const void *take(const char **place, size_t *left, int64_t count, size_t item)
{
  const char *begin = *place;
  if (count < 0 || (size_t)count > *left / item) {
    return NULL;
  }
  *place += (size_t)count * item;
  *left -= (size_t)count * item;
  return begin;
}

static int split(playlist_t *list, const char *path)
{
  const char *place = list->map;
  size_t left = list->size;
  list->header = take(&place, &left, 1, sizeof(playlist_header_t));
  const playlist_header_t *head = list->header;
  if (head == NULL || memcmp(head->magic, MAGIC, sizeof(head->magic)) != 0) {
    return refuse(path, "it does not begin like one");
  }
  if (head->path_bytes < 0 || head->path_bytes % 8 != 0) {
    return refuse(path, "its paths are not aligned");
  }
  if ((list->paths = take(&place, &left, head->path_bytes, 1)) == NULL ||
      (list->messages = take(&place, &left, head->messages, sizeof(message_t))) == NULL ||
      (list->places = take(&place, &left, head->places, sizeof(stamp_place_t))) == NULL ||
      (list->refs = take(&place, &left, head->refs, sizeof(message_ref_t))) == NULL ||
      (list->events = take(&place, &left, head->events, sizeof(round_event_t))) == NULL ||
      left != 0) {
    return refuse(path, "it is truncated");
  }
  int64_t names = 0;
  for (int64_t i = 0; i < head->path_bytes; ++i) {
    names += list->paths[i] == '\0';
  }
  if (head->files < 0 || names < head->files ||
      (head->path_bytes > 0 && list->paths[head->path_bytes - 1] != '\0')) {
    return refuse(path, "paths are missing");
  }
  return 0;
}

static int check_messages(const playlist_t *list, const char *path, int64_t sources)
{
  const playlist_header_t *head = list->header;
  for (int64_t i = 0; i < head->messages; ++i) {
    const message_t *each = &list->messages[i];
    if (!within(each->source, 1, sources) || !within(each->file, 1, head->files) ||
        each->offset < 0 || each->size <= 0 || each->size > INT64_MAX - each->offset ||
        !within(each->first_place, each->places, head->places)) {
      return refuse(path, "a message is not where it can be");
    }
    for (int64_t place = 0; place < each->places; ++place) {
      if (!within(list->places[each->first_place + place].position, 8, each->size)) {
        return refuse(path, "a stamp is outside of its message");
      }
    }
  }
  for (int64_t i = 0; i < head->refs; ++i) {
    if (!within(list->refs[i].message, 1, head->messages)) {
      return refuse(path, "an event has a message that does not exist");
    }
  }
  return 0;
}

/* Every step has an event, or a playback would not end; those of a cyclic round are in order. */
static int check_events(playlist_t *list, const char *path)
{
  const playlist_header_t *head = list->header;
  if (head->steps < 1 || head->steps > head->events) {
    return refuse(path, "it has steps without events");
  }
  list->step_events = calloc((size_t)head->steps, sizeof(int64_t));
  list->step_sizes = calloc((size_t)head->steps, sizeof(int64_t));
  if (list->step_events == NULL || list->step_sizes == NULL) {
    return fail_memory();
  }
  int64_t found = 0;
  for (int64_t i = 0; i < head->events; ++i) {
    const round_event_t *each = &list->events[i];
    if (each->step < NO_STEP || each->step >= head->steps ||
        !within(each->first_ref, each->refs, head->refs)) {
      return refuse(path, "an event is not of the round");
    }
    if (each->step != NO_STEP && list->step_sizes[each->step]++ == 0) {
      list->step_events[each->step] = i;
      found += 1;
    }
    if (head->cyclic && (found == 0 || (each->step != NO_STEP && each->step != found - 1) ||
                         (each->step != NO_STEP && list->step_sizes[each->step] > 1))) {
      return refuse(path, "the steps are not in order");
    }
  }
  return found == head->steps ? 0 : refuse(path, "a step has no event");
}

int playlist_open(playlist_t *list, const char *path, int64_t sources)
{
  *list = (playlist_t){0};
  const int fd = open(path, O_RDONLY | O_CLOEXEC);
  struct stat found;
  if (fd < 0 || fstat(fd, &found) < 0) {
    const int failed = fail_file(path);
    if (fd >= 0) {
      close(fd);
    }
    return failed;
  }
  if (found.st_size < (off_t)sizeof(playlist_header_t)) {
    close(fd);
    return refuse(path, "it is too short");
  }
  list->size = (size_t)found.st_size;
  list->map = mmap(NULL, list->size, PROT_READ, MAP_PRIVATE | MAP_POPULATE, fd, 0);
  const int reason = errno;
  close(fd);
  if (list->map == MAP_FAILED) {
    list->map = NULL;
    errno = reason;
    return fail_file(path);
  }
  if (split(list, path) < 0 || check_messages(list, path, sources) < 0 ||
      check_events(list, path) < 0) {
    playlist_close(list);
    return -1;
  }
  return 0;
}

void playlist_close(playlist_t *list)
{
  if (list->map != NULL) {
    munmap(list->map, list->size);
  }
  free(list->step_events);
  free(list->step_sizes);
  *list = (playlist_t){0};
}

int cursor_init(cursor_t *at, const playlist_t *list, double rate_hz, int64_t steps, int64_t first)
{
  const playlist_header_t *head = list->header;
  *at = (cursor_t){.list = list, .steps = steps, .period_ns = 1e9 / rate_hz};
  if (head->cyclic) {
    at->next = list->step_events[first % head->steps];
    return 0;
  }
  at->left = calloc((size_t)head->steps, sizeof(int64_t));
  return at->left == NULL ? fail_memory() : 0;
}

void cursor_fini(cursor_t *at)
{
  free(at->left);
  at->left = NULL;
}

static bool next_cyclic(cursor_t *at, event_t *event)
{
  const playlist_t *list = at->list;
  if (at->next == list->header->events) {
    at->next = 0;
  }
  const round_event_t *each = &list->events[at->next];
  *event = (event_t){.step = NO_STEP, .origin_ns = each->origin_ns, .source = each};
  if (each->step != NO_STEP) {
    if (at->next_step >= at->steps) {
      return false;
    }
    event->step = at->next_step++;
    event->starts_step = event->ends_step = true;
    at->turn = each->step;
    /* From the first due time, so that rounding errors do not add up. */
    event->offset_ns = llrint((double)event->step * at->period_ns);
  } else {
    const double since = (double)(at->next_step - 1) + each->at.steps - (double)at->turn;
    event->offset_ns = llrint(since * at->period_ns);
  }
  at->next += 1;
  return true;
}

static bool next_of_timeline(cursor_t *at, event_t *event)
{
  const playlist_t *list = at->list;
  const playlist_header_t *head = list->header;
  while (at->closed < at->steps) {
    if (at->next == head->events) {
      at->next = 0;
      at->turn += 1;
      memset(at->left, 0, (size_t)head->steps * sizeof(int64_t));
    }
    const round_event_t *each = &list->events[at->next++];
    const int64_t stamps_ns = at->turn * head->stamp_period_ns - head->origin_ns;
    *event = (event_t){
      .offset_ns = at->turn * head->period_ns + each->at.ns,
      .step = NO_STEP,
      .stamp_ns = stamps_ns,
      .has_stamp = true,
      .source = each,
    };
    if (each->step == NO_STEP) {
      return true;
    }
    event->step = at->turn * head->steps + each->step;
    if (event->step >= at->steps) {
      continue;
    }
    event->stamp_ns = each->stamp_ns + stamps_ns;
    event->starts_step = at->left[each->step] == 0;
    event->ends_step = ++at->left[each->step] == list->step_sizes[each->step];
    at->closed += event->ends_step;
    return true;
  }
  return false;
}

bool cursor_next(cursor_t *at, event_t *event)
{
  return at->list->header->cyclic ? next_cyclic(at, event) : next_of_timeline(at, event);
}
