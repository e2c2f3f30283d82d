/* For objects that are preloaded: the function whose place one of theirs has taken. */
#ifndef R2BSPEC_NEXT_FUNCTION_H
#define R2BSPEC_NEXT_FUNCTION_H

#include <dlfcn.h>
#include <stdatomic.h>
#include <stddef.h>

#define EXPORTED __attribute__((visibility("default")))
#define RCL "librcl.so"
#define NOT_FOUND 1 /* RCL_RET_ERROR */

typedef struct {
  const char *name, *library;
  _Atomic(void *) function;
} next_t;

/* Returns the function that a process would call without the calling object, or NULL. Another
 * preloaded object may have the name, too. rclpy loads the libraries of ROS for itself alone, where
 * RTLD_NEXT does not look: then it is that of the library, which is known by its own name. Its
 * caller would not do, because that may be another preloaded object. */
static inline void *find_next(next_t *next)
{
  void *found = atomic_load_explicit(&next->function, memory_order_relaxed);
  if (__builtin_expect(found == NULL, 0)) {
    found = dlsym(RTLD_NEXT, next->name);
    void *library = found == NULL ? dlopen(next->library, RTLD_LAZY | RTLD_NOLOAD) : NULL;
    found = library == NULL ? found : dlsym(library, next->name);
    atomic_store_explicit(&next->function, found, memory_order_relaxed);
  }
  return found;
}

/* Makes `next` the function of this name; it is looked for once. */
#define NEXT(type, from, called)                           \
  static next_t kept = {.name = #called, .library = from}; \
  type *const next = (type *)find_next(&kept)

#endif
