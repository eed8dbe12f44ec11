/*
 * `mesorig process DIR --follow` as a child of lower priority, which makes the products while
 * frames come in. It ends with the process that started it, whatever ends that. Main loop's thread.
 */
#pragma once

#include <gio/gio.h>

typedef struct Follower Follower;

/* The program is looked for beside this executable, then in PATH. */
Follower *follower_start(const char *directory, GError **error);

/* Asks the child to end, waits a moment for it, then makes it. NULL is ignored. */
void follower_free(Follower *follower);
