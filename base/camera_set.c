#include "camera_set.h"

char *camera_set_to_text(struct camera_set set) {
    GString *text = g_string_new(NULL);
    for (int c = camera_set_next(set, -1); c >= 0; c = camera_set_next(set, c))
        g_string_append_printf(text, "%s%d", text->len ? " " : "", c);
    return g_string_free(text, FALSE);
}

gboolean camera_set_from_text(const char *text, struct camera_set *ret) {
    g_auto(GStrv) words = g_strsplit(text, " ", -1);
    struct camera_set set = {{0}};
    int least = 0; /* the next number must not be below it */
    for (int i = 0; words[i]; i++) {
        guint64 camera;
        if (least >= CAMERA_SET_MAX ||
            !g_ascii_string_to_unsigned(words[i], 10, (guint64)least, CAMERA_SET_MAX - 1, &camera,
                                        NULL))
            return FALSE;
        camera_set_add(&set, (int)camera);
        least = (int)camera + 1;
    }
    *ret = set;
    return TRUE;
}
