// What every program of this folder has: it ends on a signal, and says what failed.

#ifndef PROGRAM_H_
#define PROGRAM_H_

#include <rcl/error_handling.h>
#include <rcl/types.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>

/// Whether the program has been told to exit.
static volatile sig_atomic_t stopped = 0;

static void stop(int signal_number)
{
  (void)signal_number;
  stopped = 1;
}

/// Exit with status 1, and say why, unless an action has succeeded.
static void require(rcl_ret_t result, const char * action)
{
  if (result != RCL_RET_OK) {
    fprintf(stderr, "%s: %s\n", action, rcl_get_error_string().str);
    exit(EXIT_FAILURE);
  }
}

#endif  // PROGRAM_H_
