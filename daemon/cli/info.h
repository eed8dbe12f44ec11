#pragma once

#include "command/record.h"

/* Tells what is in a session directory. */
gboolean info_session(const char *directory, Record *to, GError **error);
