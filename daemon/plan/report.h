/* Reports of a plan, as text and as data. All functions are pure. */
#pragma once

#include "plan.h"

/* Returns the values of a plan as a floating variant "a{sv}". The method Validate returns the same
 * dictionary (etc/org.mesorig.Rig1.xml). */
GVariant *report_plan(const struct session_conf *conf, const struct plan *plan);

/* Returns the report of report_plan() as text of a few lines; g_free(). */
char *report_text(GVariant *report);

/* Returns a text such as "2 h 05 min" or "48 s", or "?" if seconds is negative, not finite or
 * more than 1e9; g_free(). */
char *report_duration(double seconds);
