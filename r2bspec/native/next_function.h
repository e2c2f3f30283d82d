/* For objects that are preloaded: the function whose place one of theirs has taken. */
#ifndef R2BSPEC_NEXT_FUNCTION_H
#define R2BSPEC_NEXT_FUNCTION_H

#include <dlfcn.h>
#include <stddef.h>

/* Returns the function that a process would call without the calling object, or NULL. Another
 * preloaded object may have the name, too. rclpy loads the libraries of ROS for itself alone, where
 * RTLD_NEXT does not look: then it is that of the library, which is known by its own name. Its
 * caller would not do, because that may be another preloaded object. */
static inline void *next_function(const char *name, const char *library)
{
  void *found = dlsym(RTLD_NEXT, name);
  void *loaded = found == NULL ? dlopen(library, RTLD_LAZY | RTLD_NOLOAD) : NULL;
  return loaded == NULL ? found : dlsym(loaded, name);
}

#endif
