// Takes images in one thread and publishes them in another.
//
// Between both is room for one image: the first thread waits until the second has published it.

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>

#include "image_node.h"

typedef struct handover_s
{
  pthread_mutex_t mutex;
  pthread_cond_t changed;
  image_node_t * node;
  bool has_image;
  bool ended;
} handover_t;

static void * publish_images(void * argument)
{
  handover_t * handover = argument;
  pthread_mutex_lock(&handover->mutex);
  while (true) {
    while (!handover->has_image && !handover->ended) {
      pthread_cond_wait(&handover->changed, &handover->mutex);
    }
    if (!handover->has_image) {
      break;
    }
    image_node_publish(handover->node, handover->node->image);
    handover->has_image = false;
    pthread_cond_signal(&handover->changed);
  }
  pthread_mutex_unlock(&handover->mutex);
  return NULL;
}

static void hand_over(handover_t * handover)
{
  pthread_mutex_lock(&handover->mutex);
  handover->has_image = true;
  pthread_cond_signal(&handover->changed);
  while (handover->has_image) {
    pthread_cond_wait(&handover->changed, &handover->mutex);
  }
  pthread_mutex_unlock(&handover->mutex);
}

int main(int argc, char ** argv)
{
  image_node_t node;
  image_node_open(&node, argc, (const char * const *)argv, "two_threads");
  image_node_connect(&node);

  handover_t handover = {
    .mutex = PTHREAD_MUTEX_INITIALIZER, .changed = PTHREAD_COND_INITIALIZER, .node = &node};
  pthread_t publisher;
  if (pthread_create(&publisher, NULL, publish_images, &handover) != 0) {
    perror("pthread_create");
    return EXIT_FAILURE;
  }
  while (image_node_take(&node)) {
    hand_over(&handover);
  }

  pthread_mutex_lock(&handover.mutex);
  handover.ended = true;
  pthread_cond_signal(&handover.changed);
  pthread_mutex_unlock(&handover.mutex);
  pthread_join(publisher, NULL);
  image_node_close(&node);
  return EXIT_SUCCESS;
}
