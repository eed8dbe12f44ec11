/* Sessions that were captured by different drivers, in one folder: how far they are from each
 * other, and what they say of themselves. */
#pragma once

#include "session/session.h"
#include "session_difference.h"

extern char *twin_folder;

char *twin_path(const char *name);
struct difference twin_compare(const char *a, const char *b, const char *folder, gboolean holes);
double twin_value(const char *name, const char *key);
