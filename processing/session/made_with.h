/* The calibration with which the products of a session were made. This is the session's own
 * calibration, unless “mesorig process -c” was given another one. The other calibration is stored
 * in the session: its path as the value "products_calibration", and its text as
 * "products_calibration.conf". The value "products_mixed" is set while the member `mixed` is TRUE.
 * One thread at a time. */
#pragma once

#include "session.h"

struct made_with {
    char *where;  /* "nominal", or the path that the calibration file had when it was read */
    char *text;   /* text of the calibration file */
    gboolean own; /* whether the session was captured with this calibration */
    /* processing with this calibration was not finished, so that some products may have been made
     * with the previous calibration */
    gboolean mixed;
};

/* Reads the calibration of the products. If the session has no products, it is the calibration with
 * which they would be made. Fails if the database cannot be read. */
gboolean made_with_read(Session *session, struct made_with *ret, GError **error);
void made_with_clear(struct made_with *with);

/* made_with_begin() records the calibration with which products are made from now on. If the
 * session has products of another calibration, it also sets mixed. Call it before the first product
 * is replaced. `text` is NULL for the session's own calibration. `where` is ignored if `text` is
 * NULL or equal to the session's own.
 *
 * made_with_end() clears mixed. Call it after the last product was replaced. The caller of both
 * functions must have SESSION_PROCESS_LOCK locked. */
gboolean made_with_begin(Session *session, const char *where, const char *text, GError **error);
gboolean made_with_end(Session *session, GError **error);
