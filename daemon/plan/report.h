/* Reports of a plan, as text and as data. Pure functions. */
#pragma once

#include "plan.h"

/* Returns "a{sv}" with session, poses, shots, frames, mounts, bytes, predicted_s, lower_bound_s,
 * nested_s, notes, and the numbers of views, lights and laser positions. The variant is
 * floating. */
GVariant *report_plan(const struct session_conf *conf, const struct plan *plan);

/* Returns the report of report_plan() as text of a few lines; g_free(). */
char *report_text(GVariant *report);

/* Returns a text such as "2 h 05 min" or "48 s"; g_free(). */
char *report_duration(double seconds);
