/* A session through real protocols: mesorig-rig stands for the small rig, 1 % of its cameras'
 * packets lost, and the programs capture it in real time. Its frames and products are those of the
 * simulated drivers, but for the noise. */
#include "session_difference.h"

#include "processing/session.h"
#include "sim/virtual/rig.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <signal.h>
#include <sys/wait.h>

#define SMALL  SOURCE_DIR "/tests/small/"
#define BIN(x) BUILD_DIR "/bin/" x

static char *top;

static char *in_top(const char *name) {
    return g_build_filename(top, name, NULL);
}

static char *text_of(const char *path) {
    char *text = NULL;
    g_autoptr(GError) error = NULL;
    g_file_get_contents(path, &text, NULL, &error);
    g_assert_no_error(error);
    return text;
}

static void runs(const char *program, ...) G_GNUC_NULL_TERMINATED;
static void runs(const char *program, ...) {
    g_autoptr(GPtrArray) argv = g_ptr_array_new();
    g_autofree char *out = NULL, *err = NULL;
    g_autoptr(GError) error = NULL;
    int status = -1;
    va_list arguments;
    g_ptr_array_add(argv, (char *)program);
    va_start(arguments, program);
    for (char *argument; (argument = va_arg(arguments, char *));)
        g_ptr_array_add(argv, argument);
    va_end(arguments);
    g_ptr_array_add(argv, NULL);
    g_spawn_sync(NULL, (char **)argv->pdata, NULL, 0, NULL, NULL, &out, &err, &status, &error);
    g_assert_no_error(error);
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0)
        g_error("%s %s: status %x\n%s%s", program, (char *)argv->pdata[1], status, out, err);
}

static GSubprocess *starts(GSubprocessFlags flags, const char *program, ...) G_GNUC_NULL_TERMINATED;
static GSubprocess *starts(GSubprocessFlags flags, const char *program, ...) {
    g_autoptr(GPtrArray) argv = g_ptr_array_new();
    g_autoptr(GError) error = NULL;
    va_list arguments;
    g_ptr_array_add(argv, (char *)program);
    va_start(arguments, program);
    for (char *argument; (argument = va_arg(arguments, char *));)
        g_ptr_array_add(argv, argument);
    va_end(arguments);
    g_ptr_array_add(argv, NULL);
    GSubprocess *process = g_subprocess_newv((const char *const *)argv->pdata, flags, &error);
    g_assert_no_error(error);
    return process;
}

static void ends(GSubprocess *process) {
    g_subprocess_send_signal(process, SIGTERM);
    g_subprocess_wait(process, NULL, NULL);
    g_assert_true(g_subprocess_get_successful(process));
    g_object_unref(process);
}

static char *first_line(GSubprocess *process) {
    g_autoptr(GDataInputStream) in = g_data_input_stream_new(g_subprocess_get_stdout_pipe(process));
    return g_data_input_stream_read_line(in, NULL, NULL, NULL);
}

/* The same rig, with other noise. */
static void capture_simulated(const char *name, const char *seed) {
    g_autofree char *rig = in_top("rig.conf"), *world = in_top("world.conf");
    g_autofree char *session = in_top(name);
    g_autofree char *rig_text = text_of(SMALL "rig.conf"), *text = text_of(SMALL "world.conf");
    g_auto(GStrv) parts = g_strsplit(text, "seed = 7", 2);
    g_assert_nonnull(parts[1]);
    g_autofree char *changed = g_strconcat(parts[0], "seed = ", seed, parts[1], NULL);
    g_assert_true(g_file_set_contents(rig, rig_text, -1, NULL));
    g_assert_true(g_file_set_contents(world, changed, -1, NULL));
    runs(BIN("mesorig"), "capture", rig, SMALL "session.conf", "-o", session, NULL);
    runs(BIN("mesorig"), "process", session, NULL);
}

static void wait_for_file(const char *path) {
    for (int i = 0; i < 1000 && !g_file_test(path, G_FILE_TEST_EXISTS); i++)
        g_usleep(10000);
    g_assert_true(g_file_test(path, G_FILE_TEST_EXISTS));
}

static void capture_virtual(const char *name) {
    g_autofree char *rig = in_top("virtual.conf"), *socket = in_top("bus");
    g_autofree char *session = in_top(name);
    g_autofree char *address = g_strdup_printf("unix:path=%s", socket);
    GSubprocess *devices = starts(G_SUBPROCESS_FLAGS_STDOUT_PIPE, BIN("mesorig-rig"), "--virtual",
                                  SMALL "rig.conf", "-o", rig, "--loss", "0.01", "--json", NULL);
    g_autofree char *said = first_line(devices);
    g_assert_nonnull(strstr(said, "{\"section\":\"camera cam30\",\"driver\":\"aravis\""));
    g_assert_nonnull(strstr(said, "{\"section\":\"axis arc\",\"driver\":\"modbus-axis\""));
    GSubprocess *daemon = starts(G_SUBPROCESS_FLAGS_STDERR_SILENCE, BIN("mesorigd"), "--listen",
                                 address, "--rig", rig, NULL);
    wait_for_file(socket);
    runs(BIN("mesorig"), "capture", "--address", address, rig, SMALL "session.conf", "-o", session,
         NULL);
    runs(BIN("mesorig"), "process", session, NULL);
    ends(daemon);
    ends(devices);
    g_assert_false(g_file_test(rig, G_FILE_TEST_EXISTS));
}

static struct difference compare(const char *a, const char *b, const char *folder, gboolean holes) {
    struct difference difference;
    g_autofree char *in_a = in_top(a), *in_b = in_top(b);
    g_autoptr(GError) error = NULL;
    difference_folder(in_a, in_b, folder, holes, &difference, &error);
    g_assert_no_error(error);
    g_assert_cmpint(difference.n_files, >, 0);
    g_assert_cmpint(difference.n_values, >, 0);
    g_test_message("%s and %s, %s: RMS %.5f, mean %+.5f, seen differently %.4f", a, b, folder,
                   difference.rms, difference.systematic, difference.seen_differently);
    return difference;
}

static double value(const char *name, const char *key) {
    g_autofree char *path = in_top(name);
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autofree char *text = session_value(session, key);
    g_assert_nonnull(text);
    return g_ascii_strtod(text, NULL);
}

static void through_real_protocols(void) {
    capture_virtual("virtual.session");
    capture_simulated("simulated.session", "7");
    capture_simulated("other.session", "8");
    g_assert_cmpfloat(value("virtual.session", "frames"), ==, 144);
    g_assert_cmpfloat(value("virtual.session", "retakes"), ==, 0);
    static const struct {
        const char *folder;
        gboolean holes;
    } kinds[] = {{"frames", FALSE}, {"products/btf", FALSE}, {"products", TRUE}};
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++) {
        struct difference noise =
            compare("simulated.session", "other.session", kinds[i].folder, kinds[i].holes);
        struct difference real =
            compare("simulated.session", "virtual.session", kinds[i].folder, kinds[i].holes);
        g_assert_cmpfloat(noise.rms, >, 0);
        g_assert_cmpfloat(real.rms, >, 0); /* other noise */
        g_assert_cmpfloat(real.rms, <, 1.4 * noise.rms);
        g_assert_cmpfloat(fabs(real.systematic), <, noise.rms);
        g_assert_cmpfloat(real.seen_differently, <, noise.seen_differently + 0.05);
    }
}

static void refused(void) {
    static const struct {
        const char *text, *said;
    } cases[] = {
        {"[rig]\nid = x\n", "no device of it has a world"},
        {"[axis a]\ndriver = tic-axis\n", "only simulated devices have a virtual one"},
        {"[camera c]\ndriver = sim-camera\nworld = " SMALL "world.conf\n", "no such camera"},
        {"[axis a]\ndriver = sim-axis\nworld = /nowhere.conf\n", "/nowhere.conf"},
        {"[axis a]\ndriver = sim-axis\n", "no device of it has a world"},
    };
    g_autofree char *path = in_top("bad.conf");
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        g_autoptr(GError) error = NULL;
        g_assert_true(g_file_set_contents(path, cases[i].text, -1, NULL));
        g_assert_null(virtual_rig_new(path, &error));
        if (!strstr(error->message, cases[i].said))
            g_error("said \"%s\", not \"%s\"", error->message, cases[i].said);
    }
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    top = g_dir_make_tmp("mesorig-virtual-XXXXXX", NULL);
    g_test_add_func("/virtual-rig/refused", refused);
    g_test_add_func("/virtual-rig/through-real-protocols", through_real_protocols);
    int failed = g_test_run();
    const char *const remove[] = {"/bin/rm", "-rf", top, NULL};
    g_spawn_sync(NULL, (char **)remove, NULL, 0, NULL, NULL, NULL, NULL, NULL, NULL);
    g_free(top);
    return failed;
}
