#pragma once

#include "common/record.h"

/* Reports the contents of a session directory. */
gboolean info_session(const char *directory, Record *to, GError **error);
