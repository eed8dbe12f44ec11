/*
 * Which calibration the products of a session were made with: the session's own, unless “mesorig
 * process -c” was given another one. Stored as the session's values "products_calibration" and
 * "products_mixed", and its text "products_calibration.conf". One thread at a time.
 */
#pragma once

#include "session.h"

struct made_with {
    char *where;    /* "nominal", or the path of the calibration file when it was read */
    char *text;     /* of the calibration */
    gboolean own;   /* it is the one that the session was captured with */
    gboolean mixed; /* making them with this one was not finished: some may be of the one before */
};

/* For a session without products: the calibration that they would be made with. */
gboolean made_with_read(Session *session, struct made_with *ret, GError **error);
void made_with_clear(struct made_with *with);

/* Call while holding SESSION_PROCESS_LOCK, before the first product is replaced, and after the
 * last one. text: NULL for the session's own calibration; where is ignored then. */
gboolean made_with_begin(Session *session, const char *where, const char *text, GError **error);
gboolean made_with_end(Session *session, GError **error);
