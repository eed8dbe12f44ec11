#include "operator.h"

#include <glib/gstdio.h>
#include <string.h>

#include "bus/bus.h"
#include "ok.h"
#include "remove_tree.h"
#include "session/session.h"

#define MESORIG BUILD_DIR "/bin/mesorig"

static char *top;
static int n_made;

struct operation *operator_new_in(const char *parent, const struct change *rig_changes) {
    struct operation *run = g_new0(struct operation, 1);
    run->directory = g_strdup_printf("%s/%d", parent, n_made++);
    run->rig = g_build_filename(run->directory, "rig.conf", NULL);
    run->conf = g_build_filename(run->directory, "session.conf", NULL);
    run->session = g_build_filename(run->directory, "small.session", NULL);
    g_assert_cmpint(g_mkdir(run->directory, 0777), ==, 0);
    small_rig_write(run->directory, "rig.conf", rig_changes);
    small_rig_write(run->directory, "world.conf", NULL);
    small_rig_write(run->directory, "session.conf", NULL);
    return run;
}

struct operation *operator_new(const struct change *rig_changes) {
    return operator_new_in(top, rig_changes);
}

void operator_free(struct operation *run) {
    remove_tree(run->directory);
    g_free(run->directory);
    g_free(run->rig);
    g_free(run->conf);
    g_free(run->session);
    g_free(run->out);
    g_free(run->err);
    g_free(run);
}

void operator_does(struct operation *run, int code, ...) {
    va_list arguments;
    va_start(arguments, code);
    g_autofree const char **argv = process_argv_valist(MESORIG, arguments);
    va_end(arguments);
    g_clear_pointer(&run->out, g_free);
    g_clear_pointer(&run->err, g_free);
    const int is = process_run(argv, &run->out, &run->err);
    if (is != code)
        g_error("mesorig %s: exit code %d, not %d\n%s%s", argv[1], is, code, run->out, run->err);
}

void operator_captures(struct operation *run, int code) {
    operator_does(run, code, "capture", run->rig, run->conf, "-o", run->session, NULL);
}

static int by_text(gconstpointer a, gconstpointer b) {
    return strcmp(*(char *const *)a, *(char *const *)b);
}

char *operator_products(const char *session) {
    static const char *const folders[] = {"products", "products/btf"};
    g_autoptr(GPtrArray) lines = g_ptr_array_new_with_free_func(g_free);
    for (gsize i = 0; i < G_N_ELEMENTS(folders); i++) {
        g_autofree char *folder = g_build_filename(session, folders[i], NULL);
        g_autoptr(GDir) dir = g_dir_open(folder, 0, NULL);
        const char *name;
        while (dir && (name = g_dir_read_name(dir))) {
            g_autofree char *path = g_build_filename(folder, name, NULL);
            g_autofree char *data = NULL;
            gsize length = 0;
            if (!g_str_has_suffix(name, ".exr"))
                continue;
            g_assert_true(g_file_get_contents(path, &data, &length, NULL));
            g_autofree char *sum =
                g_compute_checksum_for_data(G_CHECKSUM_SHA256, (guchar *)data, length);
            g_ptr_array_add(lines, g_strdup_printf("%s/%s %s", folders[i], name, sum));
        }
    }
    g_ptr_array_sort(lines, by_text);
    g_ptr_array_add(lines, NULL);
    return g_strjoinv("\n", (char **)lines->pdata);
}

const char *operator_undisturbed(void) {
    static char *products;
    if (products)
        return products;
    struct operation *run = operator_new(NULL);
    operator_captures(run, 0);
    assert_has(run->out, "no retakes");
    operator_does(run, 0, "process", run->session, NULL);
    products = operator_products(run->session);
    assert_has(products, "products/mdf.exr");
    assert_has(products, "products/eigenmaps.exr");
    assert_has(products, "products/btf/view_0003.exr");
    operator_free(run);
    return products;
}

void operator_check_products(struct operation *run) {
    operator_does(run, 0, "process", run->session, NULL);
    g_autofree char *products = operator_products(run->session);
    g_assert_cmpstr(products, ==, operator_undisturbed());
}

char *operator_frames(const char *path) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autoptr(GPtrArray) frames = session_frames(session, &error);
    g_assert_no_error(error);
    GString *text = g_string_new(NULL);
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        g_autofree char *file = g_build_filename(path, frame->path, NULL);
        g_assert_true(g_file_test(file, G_FILE_TEST_IS_REGULAR));
        g_string_append_printf(text, "%s %s %.6f %d\n", frame->path, frame->sha256,
                               frame->captured_s, frame->retakes);
    }
    return g_string_free(text, FALSE);
}

GVariant *operator_properties(const char *address) {
    g_autoptr(GDBusConnection) connection = ok(g_dbus_connection_new_for_address_sync(
        address, G_DBUS_CONNECTION_FLAGS_AUTHENTICATION_CLIENT, NULL, NULL, ERR));
    g_autoptr(GVariant) answer = ok(g_dbus_connection_call_sync(
        connection, NULL, BUS_PATH, "org.freedesktop.DBus.Properties", "GetAll",
        g_variant_new("(s)", BUS_NAME), G_VARIANT_TYPE("(a{sv})"), G_DBUS_CALL_FLAGS_NONE, -1, NULL,
        ERR));
    return g_variant_get_child_value(answer, 0);
}

const char *operator_folder(void) {
    return top;
}

int operator_tests(void) {
    top = g_dir_make_tmp("mesorig-operator-XXXXXX", NULL);
    g_setenv("LC_ALL", "C.UTF-8", TRUE);
    /* The tests must not use services of this machine. */
    g_setenv("DBUS_SYSTEM_BUS_ADDRESS", "unix:path=/no/such", TRUE);
    g_setenv("DBUS_SESSION_BUS_ADDRESS", "unix:path=/no/such", TRUE);
    g_setenv("XDG_RUNTIME_DIR", top, TRUE);
    const int result = g_test_run();
    remove_tree(top);
    g_clear_pointer(&top, g_free);
    return result;
}
