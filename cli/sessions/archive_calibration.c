/* Describes in words the calibration with which the products of a session were made. */
#include "archive.h"

#include "session/made_with.h"

struct calibration *archive_calibration(Session *session, struct archive_calibration *ret,
                                        GError **error) {
    struct made_with with;
    *ret = (struct archive_calibration){0};
    if (!made_with_read(session, &with, error))
        return NULL;
    struct calibration *calibration = calibration_from_text(with.text, with.where, error);
    if (calibration) {
        g_autofree char *line =
            calibration_line(calibration, with.where, "mesorig process -c FILE gives one");
        *ret =
            (struct archive_calibration){g_steal_pointer(&with.where), NULL, with.own, with.mixed};
        ret->said = g_strdup_printf(
            "%s%s%s", line,
            with.own
                ? ""
                : "; used only for the products, because the session was captured with another "
                  "calibration",
            with.mixed
                ? "; some products may still have been made with another calibration, because "
                  "their processing was not finished: mesorig process makes them again"
                : "");
    }
    made_with_clear(&with);
    return calibration;
}

void archive_calibration_clear(struct archive_calibration *with) {
    g_clear_pointer(&with->where, g_free);
    g_clear_pointer(&with->said, g_free);
}
