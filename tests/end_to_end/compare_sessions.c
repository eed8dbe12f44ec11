/* Prints the differences between frames and products of two captures of the same session, the
 * number of frames of each, and the number of pictures that were taken again. */
#include "lib/session_difference.h"
#include "session/session.h"

#include <stdio.h>

static gboolean print_counts(const char *a, const char *b, GError **error) {
    const char *const paths[] = {a, b};
    char *values[2][2] = {{NULL}};
    gboolean ok = TRUE;
    for (int i = 0; i < 2 && ok; i++) {
        g_autoptr(Session) session = session_open(paths[i], SESSION_READ, error);
        ok = session != NULL;
        values[i][0] = ok ? session_value(session, "frames") : NULL;
        values[i][1] = ok ? session_value(session, "retakes") : NULL;
    }
    if (ok)
        printf("{\"frames\":[%s,%s],\"retakes\":[%s,%s]", values[0][0], values[1][0], values[0][1],
               values[1][1]);
    for (int i = 0; i < 4; i++)
        g_free(values[i / 2][i % 2]);
    return ok;
}

int main(int argc, char **argv) {
    static const struct {
        const char *name, *folder;
        gboolean holes;
    } kinds[] = {
        {"frames", "frames", FALSE}, {"btf", "products/btf", FALSE}, {"mdf", "products", TRUE}};
    if (argc != 3) {
        fprintf(stderr, "usage: compare_sessions A.session B.session\n");
        return 2;
    }
    g_autoptr(GError) error = NULL;
    if (!print_counts(argv[1], argv[2], &error)) {
        fprintf(stderr, "compare_sessions: %s\n", error->message);
        return 1;
    }
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++) {
        struct difference d;
        if (!difference_folder(argv[1], argv[2], kinds[i].folder, kinds[i].holes, &d, &error)) {
            fprintf(stderr, "compare_sessions: %s\n", error->message);
            return 1;
        }
        printf(",\"%s\":{\"files\":%d,\"rms\":%.6f,\"mean\":%.6f,\"seen_differently\":%.6f}%s",
               kinds[i].name, d.n_files, d.rms, d.systematic, d.seen_differently,
               i + 1 == G_N_ELEMENTS(kinds) ? "}\n" : "");
    }
    return 0;
}
