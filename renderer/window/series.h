/* A series of pictures of a session while it is captured. Each picture is made from more views than
 * the one before. */
#pragma once

#include "live.h"

#define SERIES_ERROR series_error_quark()
GQuark series_error_quark(void);
enum series_error {
    SERIES_ERROR_ENDED,   /* the capture has ended and was processed, and views are still missing */
    SERIES_ERROR_TIMEOUT, /* no new view for too long */
};

#define SERIES_MAX 100

/* Parses rising percentages from 1 to 100, such as "20,40,100", into ret_percent. Returns how many
 * there are, or 0 if text is not such a list or has more than SERIES_MAX numbers. */
int series_parse(const char *text, int ret_percent[SERIES_MAX]);

/* Waits until at least `percent` percent of the planned views, and at least one view, are measured.
 * Returns all planned views, an array of struct planned_view. Free the array with g_array_unref().
 * The session need not exist at first.
 *
 * Returns NULL with SERIES_ERROR_TIMEOUT if no new view comes for wait_s seconds. If the views
 * cannot even be read after this time, the error is that of live_views() instead. Returns NULL with
 * SERIES_ERROR_ENDED if the session has been captured and processed, and too few views are
 * measured. */
GArray *series_wait(const char *session, int percent, double wait_s, GError **error);

int series_count(const GArray *views); /* number of measured views */
