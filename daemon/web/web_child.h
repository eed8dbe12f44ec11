/*
 * A child process `mesorig` that computes something for the web server: a report, an export, or a
 * step of a calibration. It has a lower priority. There is one at a time, so that the memory of the
 * service suffices. All functions belong to the main loop's thread.
 */
#pragma once

#include <glib.h>

#define WEB_CHILD_LIMIT_S 1800 /* maximum duration; the process is then ended */

typedef struct WebChild WebChild;

/* Called when a process has ended. If `ok` is TRUE, text is what mesorig printed to standard
 * output, at most 64 KiB. If `ok` is FALSE, text is the error message. The callee does not own
 * text. */
typedef void (*WebChildDone)(gboolean ok, const char *text, gpointer data);

WebChild *web_child_new(void);
/* Ends the process if one runs, and calls its WebChildDone with `ok` FALSE. NULL is ignored. */
void web_child_free(WebChild *child);

/* Starts mesorig with these arguments, which end with NULL. `done` is called once, never within
 * this function. Returns FALSE with an error if another process runs, or if mesorig is not found or
 * cannot be started. */
gboolean web_child_start(WebChild *child, const char *const *arguments, WebChildDone done,
                         gpointer data, GError **error);
