#include "found.h"

static void do_free(gpointer data) {
    struct found *found = data;
    g_free(found->bus);
    g_free(found->address);
    g_free(found->what);
    g_free(found->serial);
    g_free(found->section);
    g_free(found->note);
    g_free(found);
}

/* Returns a copy of a text as one line of valid UTF-8, because a device may describe itself in
 * any bytes. Returns "" for NULL. */
static char *tidy(const char *text) {
    g_autofree char *valid = g_utf8_make_valid(text ? text : "", -1);
    for (char *c = valid; *c; c++)
        if (g_ascii_iscntrl(*c))
            *c = ' ';
    return g_strdup(g_strstrip(valid));
}

struct found *found_add(GPtrArray *to, const char *bus, const char *address, const char *what,
                        const char *serial) {
    struct found *found = g_new0(struct found, 1);
    found->bus = g_strdup(bus);
    found->address = g_strdup(address);
    found->what = tidy(what);
    found->serial = tidy(serial);
    g_ptr_array_add(to, found);
    return found;
}

GPtrArray *found_list_new(void) {
    return g_ptr_array_new_with_free_func(do_free);
}
