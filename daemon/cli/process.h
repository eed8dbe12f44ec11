#pragma once

#include <glib.h>

/* The products of a session, with progress; an exit code. */
int process_run(const char *directory, gboolean follow);
