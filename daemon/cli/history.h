/*
 * A picture of how a capture went: shots over time, the axes' angles, what each shot was, and what
 * happened. For an operator who comes back in the morning.
 */
#pragma once

#include "session/session.h"

/* Writes a PNG or SVG. A session of which nothing was captured yet is an error. */
gboolean history_draw(Session *session, const char *path, GError **error);
