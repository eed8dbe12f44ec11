#include "made_with.h"

#include "session_private.h"

#include <string.h>

#define WHERE "products_calibration"
#define MIXED "products_mixed"
#define TEXT  "products_calibration.conf"

gboolean made_with_read(Session *session, struct made_with *ret, GError **error) {
    g_autofree char *mixed = NULL, *where = NULL, *begun_with = NULL;
    *ret = (struct made_with){0};
    /* If these values are not set, the products were made with the session's own calibration.
     * Values that cannot be read must therefore be an error. */
    if (!session_read_value(session, MIXED, &mixed, error) ||
        !session_read_value(session, WHERE, &where, error) ||
        !session_read_value(session, "calibration", &begun_with, error))
        return FALSE;
    ret->text = session_text(session, where ? TEXT : "calibration.conf", error);
    if (!ret->text)
        return FALSE;
    ret->own = where == NULL;
    ret->mixed = mixed != NULL;
    ret->where = where        ? g_steal_pointer(&where)
                 : begun_with ? g_steal_pointer(&begun_with)
                              /* only imported sessions and those of tests have no such value */
                              : g_strdup("nominal");
    return TRUE;
}

void made_with_clear(struct made_with *with) {
    g_clear_pointer(&with->where, g_free);
    g_clear_pointer(&with->text, g_free);
}

static gboolean store(Session *session, const char *where, const char *text, gboolean mixed,
                      GError **error) {
    const gboolean ok =
        session_begin(session, error) && session_set_value(session, WHERE, where, error) &&
        session_set_value(session, MIXED, mixed ? "1" : NULL, error) &&
        (text ? session_db_run(session, error, "INSERT OR REPLACE INTO text VALUES (?1, ?2)", "ss",
                               TEXT, text)
              : session_db_run(session, error, "DELETE FROM text WHERE name = ?1", "s", TEXT));
    if (ok)
        return session_commit(session, error);
    session_rollback(session);
    return FALSE;
}

gboolean made_with_begin(Session *session, const char *where, const char *text, GError **error) {
    g_autofree char *own = session_text(session, "calibration.conf", error);
    g_autoptr(GHashTable) products = own ? session_products(session, error) : NULL;
    struct made_with before;
    if (!products || !made_with_read(session, &before, error))
        return FALSE;
    const gboolean is_own = !text || strcmp(text, own) == 0;
    const gboolean same = strcmp(before.text, is_own ? own : text) == 0;
    const gboolean mixed = before.mixed || (!same && g_hash_table_size(products) > 0);
    made_with_clear(&before);
    return store(session, is_own ? NULL : where, is_own ? NULL : text, mixed, error);
}

gboolean made_with_end(Session *session, GError **error) {
    return session_set_value(session, MIXED, NULL, error);
}
