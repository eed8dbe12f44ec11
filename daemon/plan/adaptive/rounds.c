#include "rounds.h"

#include "base/data_error.h"

void rounds_init(struct rounds *rounds, Session *session, const GPtrArray *shots,
                 enum session_shot_kind kind, const char *key) {
    *rounds = (struct rounds){.session = session,
                              .shots = shots,
                              .kind = kind,
                              .key = key,
                              .of = g_new0(int, shots->len + 1)};
}

void rounds_clear(struct rounds *rounds) {
    g_clear_pointer(&rounds->of, g_free);
}

static gboolean load_one(struct rounds *rounds, const char *text, GError **error) {
    g_auto(GStrv) words = g_strsplit(text, " ", -1);
    rounds->n++;
    rounds->over = !*text;
    for (char **word = words; *text && *word; word++) {
        guint64 number;
        if (!g_ascii_string_to_unsigned(*word, 10, 1, rounds->shots->len, &number, NULL))
            return data_error_fail(
                session_path(rounds->session), 0, error,
                "the session's value %s%d names the shot “%s”, but the session has the shots 1 to "
                "%u: session.db is damaged; begin a new session",
                rounds->key, rounds->n, *word, rounds->shots->len);
        rounds->of[number - 1] = rounds->n;
    }
    return TRUE;
}

gboolean rounds_load(struct rounds *rounds, GError **error) {
    while (!rounds->over) {
        g_autofree char *key = g_strdup_printf("%s%d", rounds->key, rounds->n + 1);
        g_autofree char *text = NULL;
        /* An error must not be taken for a missing value, which means that the round was not chosen
         * yet. */
        if (!session_read_value(rounds->session, key, &text, error))
            return FALSE;
        if (!text)
            break;
        if (!load_one(rounds, text, error))
            return FALSE;
    }
    return TRUE;
}

char *rounds_to_text(const GArray *shots) {
    GString *text = g_string_new(NULL);
    for (guint i = 0; i < shots->len; i++)
        g_string_append_printf(text, "%s%d", i ? " " : "", g_array_index(shots, int, i) + 1);
    return g_string_free(text, FALSE);
}

gboolean rounds_store(struct rounds *rounds, const GArray *shots, GError **error) {
    g_autofree char *key = g_strdup_printf("%s%d", rounds->key, rounds->n + 1);
    g_autofree char *text = rounds_to_text(shots);
    if (!session_set_value(rounds->session, key, text, error))
        return FALSE;
    rounds->n++;
    for (guint i = 0; i < shots->len; i++)
        rounds->of[g_array_index(shots, int, i)] = rounds->n;
    rounds->over = shots->len == 0;
    return TRUE;
}

gboolean rounds_leave_out(struct rounds *rounds, const char *note, GError **error) {
    for (guint i = 0; i < rounds->shots->len; i++) {
        struct session_shot *shot = rounds->shots->pdata[i];
        if (shot->state != SHOT_PLANNED || rounds_have(rounds, shot))
            continue;
        if (!session_commit_shot(rounds->session, shot->id, SHOT_SKIPPED, NULL, 0, note, error))
            return FALSE;
        shot->state = SHOT_SKIPPED;
        g_free(shot->note);
        shot->note = g_strdup(note);
    }
    return TRUE;
}
