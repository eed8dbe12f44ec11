/* A picture of the course of a capture: shots over time, the angles of the axes, the kind of each
 * shot, and events. It is for an operator who returns in the morning. */
#pragma once

#include "session/session.h"

/* Writes a PNG or SVG. Returns FALSE with an error if the session cannot be read, if nothing of it
 * was captured yet, or if the file cannot be written. */
gboolean history_draw(Session *session, const char *path, GError **error);
