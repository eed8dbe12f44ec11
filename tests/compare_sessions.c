/* Says how far frames and products of two captures of the same session are apart. */
#include "session_difference.h"

#include <stdio.h>

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
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++) {
        struct difference d;
        g_autoptr(GError) error = NULL;
        if (!difference_folder(argv[1], argv[2], kinds[i].folder, kinds[i].holes, &d, &error)) {
            fprintf(stderr, "compare_sessions: %s\n", error->message);
            return 1;
        }
        printf("%s\"%s\":{\"files\":%d,\"rms\":%.6f,\"mean\":%.6f,\"seen_differently\":%.6f}%s",
               i ? "," : "{", kinds[i].name, d.n_files, d.rms, d.systematic, d.seen_differently,
               i + 1 == G_N_ELEMENTS(kinds) ? "}\n" : "");
    }
    return 0;
}
