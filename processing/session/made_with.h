/* The calibration that the products of a session were made with. This is the session's own
 * calibration, unless “mesorig process -c” was given another one. Another calibration is stored as
 * the session's value "products_calibration" (where) and text "products_calibration.conf". The
 * value "products_mixed" is set while the member `mixed` is TRUE. One thread at a time. */
#pragma once

#include "session.h"

struct made_with {
    char *where;  /* "nominal", or the path of the calibration file when it was read */
    char *text;   /* text of the calibration file */
    gboolean own; /* whether the session was captured with this calibration */
    /* processing with this calibration was not finished; some products may be of the previous
     * calibration */
    gboolean mixed;
};

/* Reads the calibration of the products. For a session without products, gives the calibration with
 * which products would be made. Fails if the database cannot be read. */
gboolean made_with_read(Session *session, struct made_with *ret, GError **error);
void made_with_clear(struct made_with *with);

/* made_with_begin() records the calibration with which products are made from now on, and sets
 * mixed if the session has products of another calibration. Call made_with_begin() before the first
 * product is replaced. made_with_end() clears mixed. Call made_with_end() after the last product is
 * replaced. The caller holds SESSION_PROCESS_LOCK. `text` is NULL for the session's own
 * calibration. `where` is ignored if `text` is NULL or equal to the session's own. */
gboolean made_with_begin(Session *session, const char *where, const char *text, GError **error);
gboolean made_with_end(Session *session, GError **error);
