/* What strangers can cause to be written to the log: at most WEB_LOG_LINES lines a minute, and then
 * how many were left out. Main loop's thread. */
#pragma once

#include <glib.h>

#define WEB_LOG_LINES 20

void web_log(const char *format, ...) G_GNUC_PRINTF(1, 2);
