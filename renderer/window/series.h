/* A series of pictures of a session while it is captured, each from more views than the last. */
#pragma once

#include "live.h"

#define SERIES_ERROR series_error_quark()
GQuark series_error_quark(void);
enum series_error {
    SERIES_ERROR_ENDED,   /* the capture ended and is processed, and views are still missing */
    SERIES_ERROR_TIMEOUT, /* nothing new for too long */
};

#define SERIES_MAX 100

/* "20,40,100": rising percentages, 1 … 100. Returns their number; 0 if text is not such a list. */
int series_parse(const char *text, int ret_percent[SERIES_MAX]);

/* Waits until this share of the planned views is there; returns struct planned_view for all of
 * them. The session need not exist at first. wait_s: time without a new view after which it is an
 * error. */
GArray *series_wait(const char *session, int percent, double wait_s, GError **error);

int series_count(const GArray *views); /* number of measured views */
