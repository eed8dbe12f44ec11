/* Reports of a plan, as text and as data. Pure functions. */
#pragma once

#include "plan.h"

/* "a{sv}": session, poses, shots, frames, mounts, bytes, predicted_s, lower_bound_s, nested_s,
 * notes, and how many views, lights and laser positions there are. Floating. */
GVariant *report_plan(const struct session_conf *conf, const struct plan *plan);

/* The same in a few lines, from what report_plan() said; g_free(). */
char *report_text(GVariant *report);

/* "2 h 05 min", "48 s"; g_free(). */
char *report_duration(double seconds);
