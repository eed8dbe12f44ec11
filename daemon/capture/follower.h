/* Runs `mesorig process DIR --follow` as a child process of lower priority, which processes the
 * session while it is captured. The child ends with the process that started it, even if that
 * process is killed. Main loop's thread. */
#pragma once

#include <gio/gio.h>

typedef struct Follower Follower;

/* Starts the child. The program is found by program_find(). */
Follower *follower_start(const char *directory, GError **error);

/* Asks the child to end, waits up to 3 s, and then kills the child if it has not ended. NULL is
 * ignored. */
void follower_free(Follower *follower);
