#include "series.h"

#include "session/session.h"

#include <gio/gio.h>
#include <stdlib.h>

G_DEFINE_QUARK(series - error, series_error)

#define POLL_US (200 * 1000)

int series_parse(const char *text, int ret_percent[SERIES_MAX]) {
    g_auto(GStrv) parts = g_strsplit(text, ",", -1);
    const guint n = g_strv_length(parts);
    for (guint k = 0; k < n; k++) {
        guint64 value = 0;
        if (k >= SERIES_MAX ||
            !g_ascii_string_to_unsigned(parts[k], 10, k > 0 ? (guint64)ret_percent[k - 1] + 1 : 1,
                                        100, &value, NULL))
            return 0;
        ret_percent[k] = (int)value;
    }
    return (int)n;
}

int series_count(const GArray *views) {
    int n = 0;
    for (guint k = 0; k < views->len; k++)
        n += g_array_index(views, struct planned_view, k).measured;
    return n;
}

/* Returns whether no more views will come. This is so when the file of eigen-maps exists after the
 * end of the capture, because processing makes this file last. */
static gboolean has_ended(const char *session) {
    g_autoptr(Session) opened = session_open(session, SESSION_READ, NULL);
    g_autofree char *state = opened != NULL ? session_value(opened, "state") : NULL;
    g_autofree char *last = g_build_filename(session, "products", "eigenmaps.exr", NULL);
    return (g_strcmp0(state, "done") == 0 || g_strcmp0(state, "aborted") == 0) &&
           g_file_test(last, G_FILE_TEST_EXISTS);
}

static GArray *series_give_up(enum series_error code, const char *session, GArray *views,
                              double wait_s, GError **error) {
    const int n = series_count(views);
    if (code == SERIES_ERROR_ENDED)
        g_set_error(
            error, SERIES_ERROR, code,
            "%s: its capture has ended with %d of %u views; give --series only percentages that "
            "the capture reached, or leave --series out",
            session, n, views->len);
    else
        g_set_error(
            error, SERIES_ERROR, code,
            "%s: no new view has come for %g s, and %d of %u are measured; check that the capture "
            "goes on and that “mesorig process --follow” runs, or give a larger --wait-s",
            session, wait_s, n, views->len);
    g_array_unref(views);
    return NULL;
}

GArray *series_wait(const char *session, int percent, double wait_s, GError **error) {
    gint64 news_us = g_get_monotonic_time();
    int before = -1;
    for (;;) {
        g_autoptr(GError) why = NULL;
        /* Check this before reading the views, so that no view is missed. */
        const gboolean ended = has_ended(session);
        GArray *views = live_views(session, &why);
        const int n = views != NULL ? series_count(views) : 0;
        const gint64 now_us = g_get_monotonic_time();
        if (views != NULL && n > 0 && n * 100 >= percent * (int)views->len)
            return views;
        if (views != NULL && ended)
            return series_give_up(SERIES_ERROR_ENDED, session, views, wait_s, error);
        if (n > before)
            news_us = now_us;
        before = MAX(n, before);
        if ((double)(now_us - news_us) * 1e-6 > wait_s) {
            if (views != NULL)
                return series_give_up(SERIES_ERROR_TIMEOUT, session, views, wait_s, error);
            g_propagate_error(error, g_steal_pointer(&why));
            return NULL;
        }
        g_clear_pointer(&views, g_array_unref);
        g_usleep(POLL_US);
    }
}
