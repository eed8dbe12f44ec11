#include "exposure_advice.h"

#define KEY "saturated_retakes"
/* Maximum share of values whose longest exposure is saturated. If it is larger, there is advice. */
#define MAX_LACKING 0.5
/* Number of repetitions per picture. If it is reached, the advice names the exposure to use. */
#define MAX_RETAKEN 0.5

void exposure_advice_count(struct exposure_retakes *retakes, gint64 shortened_us) {
    if (shortened_us <= 0)
        return;
    retakes->n++;
    if (retakes->shortest_us == 0 || shortened_us < retakes->shortest_us)
        retakes->shortest_us = shortened_us;
}

gboolean exposure_advice_load(struct exposure_retakes *ret, Session *session, GError **error) {
    g_autofree char *text = NULL;
    const gboolean ok = session_read_value(session, KEY, &text, error);
    g_auto(GStrv) words = g_strsplit(text ? text : "", " ", 2);
    *ret = (struct exposure_retakes){0};
    if (g_strv_length(words) == 2) {
        ret->n = (int)CLAMP(g_ascii_strtoll(words[0], NULL, 10), 0, G_MAXINT);
        ret->shortest_us = MAX(g_ascii_strtoll(words[1], NULL, 10), 0);
    }
    return ok;
}

void exposure_advice_save(const struct exposure_retakes *retakes, Session *session) {
    g_autofree char *text =
        g_strdup_printf("%d %" G_GINT64_FORMAT, retakes->n, retakes->shortest_us);
    if (retakes->n > 0)
        session_set_value(session, KEY, text, NULL);
}

static int count_lit_pictures(Session *session) {
    g_autoptr(GPtrArray) shots = session_shots(session, NULL);
    int n = 0;
    for (guint i = 0; shots && i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        if (shot->kind == SHOT_LAMP && shot->state == SHOT_DONE)
            n += camera_set_count(shot->cameras);
    }
    return n;
}

char *exposure_advice(Session *session, double lacking) {
    struct exposure_retakes retakes;
    exposure_advice_load(&retakes, session, NULL);
    const int n = count_lit_pictures(session);
    if (n == 0 || retakes.n < MAX_RETAKEN * n)
        return lacking > MAX_LACKING
                   ? g_strdup("too long: the longest one saturates more than half of the values; "
                              "leave it out of [capture] exposures_us, or write “auto”")
                   : NULL;
    return g_strdup_printf("too long: saturated pictures under lamps were repeated %d times, for "
                           "%d that were kept, with exposures down to %" G_GINT64_FORMAT
                           " µs; for the next session shorten the first of [capture] "
                           "exposures_us to about that, or write “auto”",
                           retakes.n, n, retakes.shortest_us);
}
