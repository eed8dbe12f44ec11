/* The database of a session: everything that commands read from it. */
#include "fuzz.h"

#include "session/session.h"

#include <glib/gstdio.h>

static void drop(GPtrArray *array, GError **error) {
    fuzz_check(array != NULL, error);
    if (array)
        g_ptr_array_unref(array);
}

static void read_all(Session *session) {
    static const char *const texts[] = {"rig.conf", "session.conf", "calibration.conf"};
    struct session_grid grid;
    GError *error = NULL;
    char *program = NULL, *created = NULL;
    fuzz_check(session_grid(session, &grid, &error), &error);
    fuzz_check(session_origin(session, &program, &created, &error), &error);
    g_free(program);
    g_free(created);
    for (gsize i = 0; i < G_N_ELEMENTS(texts); i++) {
        g_autofree char *text = session_text(session, texts[i], &error);
        fuzz_check(text != NULL, &error);
    }
    drop(session_views(session, &error), &error);
    drop(session_lights(session, &error), &error);
    drop(session_lasers(session, &error), &error);
    drop(session_shots(session, &error), &error);
    drop(session_frames(session, &error), &error);
    drop(session_events(session, &error), &error);
    drop(session_list_products(session, &error), &error);
    g_free(session_value(session, "state"));
    g_autoptr(GHashTable) values = session_values(session, "", &error);
    fuzz_check(values != NULL, &error);
    g_autoptr(GHashTable) products = session_products(session, &error);
    fuzz_check(products != NULL, &error);
    int n = 0;
    drop(session_find_damage(session, SESSION_FRAMES, NULL, NULL, &n, &error), &error);
    drop(session_find_damage(session, SESSION_PRODUCTS_MADE, "", NULL, &n, &error), &error);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const char *const beside[] = {"session.db-wal", "session.db-shm", "session.db-journal"};
    const char *path = fuzz_file_in_folder("session.db", data, size);
    g_autofree char *folder = g_path_get_dirname(path);
    GError *error = NULL;
    g_autoptr(Session) session = session_open(folder, SESSION_READ, &error);
    fuzz_check(session != NULL, &error);
    if (session)
        read_all(session);
    g_clear_pointer(&session, session_close);
    for (gsize i = 0; i < G_N_ELEMENTS(beside); i++) {
        g_autofree char *name = g_build_filename(folder, beside[i], NULL);
        g_unlink(name);
    }
    return 0;
}
