/* Writes a log line to standard error: "mesorig-web: ", the text of the format, and a newline. Use
 * it for lines that requests of any client may cause, because at most WEB_LOG_LINES lines are
 * written in a minute. The first line after that minute is preceded by the number of lines that
 * were left out. The function belongs to the main loop's thread. */
#pragma once

#include <glib.h>

#define WEB_LOG_LINES 20

void web_log(const char *format, ...) G_GNUC_PRINTF(1, 2);
