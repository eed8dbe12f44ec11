/* Shots that are taken with patterns of several lamps: kept as a value, since they are shots of
 * single lamps for everything but the capture. */
#include "session_private.h"

#include "multiplex/multiplex.h"

#include <math.h>

#define MOST_LAMPS 128 /* bits of struct session_multiplex */

void session_light_multiplexed(struct session_shot *const *shots, int n) {
    for (int k = 0; k < n; k++) {
        guint64 *lit = shots[k]->multiplex.lit;
        guint64 *all = shots[k]->multiplex.all;
        lit[0] = lit[1] = all[0] = all[1] = 0;
        for (int j = 0; j < n; j++) {
            const guint64 bit = (guint64)1 << shots[j]->device % 64;
            all[shots[j]->device / 64] |= bit;
            if (multiplex_lit(n, k, j))
                lit[shots[j]->device / 64] |= bit;
        }
    }
}

void session_plan_multiplexed(const GPtrArray *shots, GArray *replanned) {
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        if (shot->state != SHOT_PLANNED || shot->multiplex.group == 0)
            continue;
        struct session_shot *const *group =
            (struct session_shot *const *)shots->pdata + i - shot->multiplex.k;
        for (int k = 0; k < shot->multiplex.n; k++) {
            if (group[k]->state == SHOT_DONE)
                g_array_append_val(replanned, group[k]->id);
            group[k]->state = SHOT_PLANNED;
        }
    }
}

char *session_multiplex_text(const struct session_shot *shots, int n) {
    g_autoptr(GString) text = g_string_new(NULL);
    char part[G_ASCII_DTOSTR_BUF_SIZE];
    for (int i = 0; i < n; i++) {
        const struct session_multiplex *t = &shots[i].multiplex;
        if (t->group == 0 || t->k != 0)
            continue;
        if (text->len == 0)
            g_string_append(text, g_ascii_dtostr(part, sizeof part, t->part));
        g_string_append_printf(text, ";%" G_GINT64_FORMAT ":%d", shots[i].id, t->n);
    }
    return text->len ? g_string_free(g_steal_pointer(&text), FALSE) : NULL;
}

static gboolean session_multiplex_wrong(GError **error, const char *text, const char *what) {
    return session_fail(error, SESSION_ERROR_FORMAT,
                        "the session's value " SESSION_MULTIPLEX " is not valid: %s: %.60s", what,
                        text);
}

/* Whether shots can be taken together: different lamps, one pose, the same cameras. */
static gboolean session_may_be_multiplexed(const struct session_shot *const *shots, int n) {
    guint64 seen[2] = {0};
    for (int k = 0; k < n; k++) {
        const struct session_shot *shot = shots[k];
        if (shot->kind != SHOT_LAMP || shot->device < 0 || shot->device >= MOST_LAMPS ||
            shot->cameras != shots[0]->cameras || shot->turntable_deg != shots[0]->turntable_deg ||
            shot->arc_deg != shots[0]->arc_deg || shot->multiplex.group != 0 ||
            seen[shot->device / 64] & (guint64)1 << shot->device % 64)
            return FALSE;
        seen[shot->device / 64] |= (guint64)1 << shot->device % 64;
    }
    return TRUE;
}

gboolean session_multiplex_read(const char *text, const GPtrArray *shots, GError **error) {
    g_auto(GStrv) items = g_strsplit(text, ";", -1);
    char *end = items[0];
    const double part = items[0] ? g_ascii_strtod(items[0], &end) : 0;
    if (!items[0] || end == items[0] || *end || !(part > 0) || !(part <= 1))
        return session_multiplex_wrong(
            error, text, "it begins with a part of the exposures, above 0, at most 1");
    for (int i = 1; items[i]; i++) {
        const guint64 first = g_ascii_strtoull(items[i], &end, 10);
        const guint64 n = *end == ':' ? g_ascii_strtoull(end + 1, &end, 10) : 0;
        if (*end || n < MULTIPLEX_LEAST || n > MULTIPLEX_MOST ||
            multiplex_order((int)n) != (int)n || first < 1 || first > shots->len ||
            n > shots->len - first + 1)
            return session_multiplex_wrong(error, text,
                                           "a group is FIRST:N, of shots of the session");
        struct session_shot **group = (struct session_shot **)shots->pdata + (first - 1);
        if (!session_may_be_multiplexed((const struct session_shot *const *)group, (int)n))
            return session_multiplex_wrong(error, text,
                                           "shots of a group are of different lamps in one pose");
        for (int k = 0; k < (int)n; k++)
            group[k]->multiplex =
                (struct session_multiplex){.group = i, .n = (int)n, .k = k, .part = part};
        session_light_multiplexed(group, (int)n);
    }
    for (guint i = 0; i < shots->len; i++) {
        struct session_shot *shot = shots->pdata[i];
        if (shot->kind == SHOT_DARK)
            shot->multiplex.part = part;
    }
    return TRUE;
}
