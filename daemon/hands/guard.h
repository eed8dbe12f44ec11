/* Test shots before a long capture, which show mistakes that would spoil all of it. */
#pragma once

#include "command/link.h"
#include "plan/plan.h"

/* Whether a session takes so many pictures that a few test shots hardly prolong it. */
gboolean guard_is_worth_it(const struct session_conf *conf);

/* Homes turntable and arc, turns the arc to a planned light away from the cameras, and takes a dark
 * frame and one picture under each lamp with each camera, at the session's shortest and longest
 * exposures. Returns sentences (char *), each with what was measured and which key or device to
 * change: a camera that saturates or stays dark, one that sees no lamp, a lamp that no camera sees.
 * NULL: a device failed. */
GPtrArray *guard_try(Link *link, const struct session_conf *conf, const struct rig *rig,
                     GError **error);
