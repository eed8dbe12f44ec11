#include "nearest.h"

#include <string.h>

#define LONGEST 63

struct nearest nearest_new(const char *key) {
    const int n = (int)strlen(key), most = n <= 3 ? 1 : MIN(n / 3 + 1, 3);
    return (struct nearest){.key = key, .distance = most + 1};
}

void nearest_consider(struct nearest *nearest, const char *name) {
    const char *key = nearest->key;
    const int n = (int)strlen(name);
    int row[LONGEST + 1];
    if (n > LONGEST || strlen(key) > LONGEST)
        return;
    for (int j = 0; j <= n; j++)
        row[j] = j;
    for (int i = 1; key[i - 1]; i++) {
        int diagonal = row[0];
        row[0] = i;
        for (int j = 1; j <= n; j++) {
            const int here =
                MIN(diagonal + (key[i - 1] != name[j - 1]), MIN(row[j], row[j - 1]) + 1);
            diagonal = row[j];
            row[j] = here;
        }
    }
    if (row[n] < nearest->distance) {
        nearest->distance = row[n];
        nearest->name = name;
    }
}

/* Returns a text with the options that may have been meant. For an unknown letter "-s", these are
 * all options that begin with "s" and have no short form. For "--sise=3", it is the option that is
 * spelt most like "sise". The text is empty if there is none. Free it with g_free(). */
static char *options(const char *wrong, const GOptionEntry *const *tables) {
    const gboolean letter = wrong[1] != '-';
    g_autofree char *name = g_strndup(wrong + 2, strcspn(wrong + 2, "="));
    struct nearest nearest = nearest_new(name);
    GString *begin = g_string_new(NULL);
    for (; *tables; tables++)
        for (const GOptionEntry *entry = *tables; entry->long_name; entry++) {
            if (!*entry->long_name || (entry->flags & G_OPTION_FLAG_HIDDEN))
                continue;
            nearest_consider(&nearest, entry->long_name);
            if (letter && !entry->short_name && *entry->long_name == wrong[1])
                g_string_append_printf(begin, "%s--%s", begin->len ? " or " : "", entry->long_name);
        }
    if (!letter && nearest.name)
        g_string_printf(begin, "--%s", nearest.name);
    return g_string_free(begin, FALSE);
}

void nearest_add_option(GError *error, const GOptionEntry *const *tables) {
    const char *wrong = strstr(error->message, " -");
    if (!wrong || !wrong[2] ||
        !g_error_matches(error, G_OPTION_ERROR, G_OPTION_ERROR_UNKNOWN_OPTION))
        return;
    g_autofree char *meant = options(wrong + 1, tables);
    if (!*meant)
        return;
    char *message = g_strdup_printf("%s; did you mean %s?", error->message, meant);
    g_free(error->message);
    error->message = message;
}
