/* Draws the course of a capture over time: shots, the angles of the axes, the kind of each shot,
 * and events. The picture is for an operator who returns in the morning. */
#pragma once

#include "session/session.h"

/* Writes the picture as PNG or SVG. Returns FALSE with an error if the session cannot be read, if
 * it has no captured shot, or if the file cannot be written. */
gboolean history_draw(Session *session, const char *path, GError **error);
