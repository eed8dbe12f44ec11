/* A session with real protocols: mesorig-rig imitates the small rig, 1 % of the packets of its
 * cameras are lost, and the programs capture the session in real time. Its frames and products are
 * those of the simulated drivers, except for the noise. */
#include "lib/find_guardian.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/twin_sessions.h"
#include "lib/wait.h"

#include "virtual/rig/rig.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <signal.h>

#define SMALL  SOURCE_DIR "/tests/small/"
#define BIN(x) BUILD_DIR "/bin/" x

static void runs(const char *program, ...) G_GNUC_NULL_TERMINATED;
static void runs(const char *program, ...) {
    va_list arguments;
    va_start(arguments, program);
    g_autofree const char **argv = process_argv_valist(program, arguments);
    va_end(arguments);
    g_free(process_text(0, argv));
}

static GSubprocess *starts(GSubprocessFlags flags, const char *program, ...) G_GNUC_NULL_TERMINATED;
static GSubprocess *starts(GSubprocessFlags flags, const char *program, ...) {
    va_list arguments;
    va_start(arguments, program);
    g_autofree const char **argv = process_argv_valist(program, arguments);
    va_end(arguments);
    return process_start(flags, NULL, argv);
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

/* What it says is told if it does not listen. */
static GSubprocess *starts_daemon(const char *rig, const char *address) {
    g_autofree char *says = twin_path("daemon.log"), *said = NULL;
    GSubprocess *daemon = twin_start_daemon(G_SUBPROCESS_FLAGS_NONE, says, rig, address);
    g_assert_true(g_file_get_contents(says, &said, NULL, NULL));
    if (!g_file_test(address + strlen("unix:path="), G_FILE_TEST_EXISTS))
        g_error("mesorigd does not listen: %s", said);
    return daemon;
}

static void capture_virtual(const char *name) {
    g_autofree char *rig = twin_path("virtual.conf"), *socket = twin_path("bus");
    g_autofree char *session = twin_path(name);
    g_autofree char *address = g_strdup_printf("unix:path=%s", socket);
    GSubprocess *devices =
        starts(G_SUBPROCESS_FLAGS_STDOUT_PIPE, BIN("mesorig-rig"), "--virtual", SMALL "rig.conf",
               "-o", rig, "--loss", "0.01", "--gcode", "turntable", "--json", NULL);
    g_autofree char *said = first_line(devices);
    g_assert_nonnull(strstr(said, "{\"section\":\"camera cam30\",\"driver\":\"aravis\""));
    g_assert_nonnull(strstr(said, "{\"section\":\"axis arc\",\"driver\":\"modbus-axis\""));
    g_assert_nonnull(strstr(said, "{\"section\":\"axis turntable\",\"driver\":\"gcode-axis\""));
    GSubprocess *daemon = starts_daemon(rig, address);
    runs(BIN("mesorig"), "capture", "--address", address, rig, SMALL "session.conf", "-o", session,
         NULL);
    runs(BIN("mesorig"), "process", session, NULL);
    ends(daemon);
    ends(devices);
    g_assert_false(g_file_test(rig, G_FILE_TEST_EXISTS));
}

TEST(through_real_protocols) {
    capture_virtual("virtual.session");
    g_assert_cmpfloat(twin_value("virtual.session", "frames"), ==, 144);
    twin_assert_noise_alone("virtual.session");
}

static void write_short_session(const char *conf) {
    g_assert_true(g_file_set_contents(conf,
                                      "[session]\nname = short\n[sample]\nwidth_mm = 50\n"
                                      "height_mm = 50\ntexels = 8\nreference_mm = 5\n"
                                      "depth_mm = 5\n[views]\nrings = 30:2; 60:2\n"
                                      "[lights]\nrings = 30:2; 60:2\noffset_deg = 45\n"
                                      "[capture]\nexposures_us = 4000; 16000\nretries = 6\n",
                                      -1, NULL));
}

/* One camera is a still camera, whose pictures are raw files that libgphoto2 copies. */
TEST(still_camera) {
    g_autofree char *rig = twin_path("still.conf"), *socket = twin_path("still-bus");
    g_autofree char *session = twin_path("still.session"), *conf = twin_path("short.conf");
    g_autofree char *address = g_strdup_printf("unix:path=%s", socket);
    write_short_session(conf);
    GSubprocess *devices = starts(G_SUBPROCESS_FLAGS_STDOUT_PIPE, BIN("mesorig-rig"), "--virtual",
                                  SMALL "rig.conf", "-o", rig, "--still", "cam30", "--json", NULL);
    g_autofree char *said = first_line(devices);
    assert_has(said, "{\"section\":\"camera cam30\",\"driver\":\"gphoto2-camera\"");
    assert_has(said, "{\"section\":\"camera cam60\",\"driver\":\"aravis\"");
    GSubprocess *daemon = starts_daemon(rig, address);
    runs(BIN("mesorig"), "capture", "--address", address, rig, conf, "-o", session, NULL);
    runs(BIN("mesorig"), "process", session, NULL);
    g_autofree char *simulated = twin_path("short-simulated.session");
    runs(BIN("mesorig"), "capture", SMALL "rig.conf", conf, "-o", simulated, NULL);
    g_assert_cmpfloat(twin_value("still.session", "frames"), ==,
                      twin_value("short-simulated.session", "frames"));
    ends(daemon);
    ends(devices);
}

/* A command on standard input, and what is said to it. */
static void tell_rig(GSubprocess *devices, GDataInputStream *out, const char *command,
                     const char *answer) {
    g_autofree char *line = g_strconcat(command, "\n", NULL);
    GOutputStream *to = g_subprocess_get_stdin_pipe(devices);
    g_assert_true(g_output_stream_write_all(to, line, strlen(line), NULL, NULL, NULL));
    g_assert_true(g_output_stream_flush(to, NULL, NULL));
    g_autofree char *said = g_data_input_stream_read_line(out, NULL, NULL, NULL);
    g_assert_cmpstr(said, ==, answer);
}

#define DOME SOURCE_DIR "/etc/demo/dome/"

/* Captures a session of the demo's dome with its simulated drivers. noise is “yes” or “no”. */
static void capture_dome(const char *name, const char *conf, const char *noise) {
    g_autofree char *folder = twin_path(noise), *session = twin_path(name), *text = NULL;
    g_autofree char *world = g_build_filename(folder, "world.conf", NULL);
    g_autofree char *rig = g_build_filename(folder, "rig.conf", NULL), *rig_text = NULL;
    g_autofree char *line = g_strconcat("noise = ", noise, NULL);
    g_assert_true(g_file_get_contents(DOME "rig.conf", &rig_text, NULL, NULL));
    g_assert_true(g_file_get_contents(DOME "world.conf", &text, NULL, NULL));
    g_autoptr(GString) changed = g_string_new(text);
    g_assert_cmpuint(g_string_replace(changed, "noise = yes", line, 0), ==, 1);
    g_assert_cmpint(g_mkdir(folder, 0755), ==, 0);
    g_assert_true(g_file_set_contents(world, changed->str, -1, NULL));
    g_assert_true(g_file_set_contents(rig, rig_text, -1, NULL));
    runs(BIN("mesorig"), "capture", rig, conf, "-o", session, NULL);
    runs(BIN("mesorig"), "process", session, NULL);
}

/* The LEDs of a dome are on a serial controller, under a still camera. Every picture has the light
 * of its lamp: its BTF is as far from a BTF without noise as a simulated BTF with noise. */
TEST(dome) {
    g_autofree char *rig = twin_path("dome.conf"), *socket = twin_path("dome-bus");
    g_autofree char *session = twin_path("dome.session"), *conf = twin_path("dome-session.conf");
    g_autofree char *address = g_strdup_printf("unix:path=%s", socket);
    g_assert_true(g_file_set_contents(
        conf,
        "[session]\nname = dome\n[sample]\nwidth_mm = 50\nheight_mm = 50\ntexels = 16\n"
        "reference_mm = 2.2\ndepth_mm = 2.2\n[views]\ndevices = all\n[lights]\n"
        "devices = dome_01; dome_10; dome_19; dome_28; dome_37; dome_46; dome_55; dome_64\n"
        "[capture]\nexposures_us = 4000; 16000\n",
        -1, NULL));
    GSubprocess *devices = starts(G_SUBPROCESS_FLAGS_STDIN_PIPE | G_SUBPROCESS_FLAGS_STDOUT_PIPE,
                                  BIN("mesorig-rig"), "--virtual", DOME "rig.conf", "-o", rig,
                                  "--still", "all", "--serial", "all", "--json", NULL);
    g_autoptr(GDataInputStream) out =
        g_data_input_stream_new(g_subprocess_get_stdout_pipe(devices));
    g_autofree char *said = g_data_input_stream_read_line(out, NULL, NULL, NULL);
    assert_has(said, "{\"section\":\"lamps dome\",\"driver\":\"serial-lamps\"");
    assert_has(said, "{\"section\":\"camera cam\",\"driver\":\"gphoto2-camera\"");

    const char *const safe[] = {BIN("mesorigd"), "--safe-state", rig, NULL};
    tell_rig(devices, out, "unplug dome", "dome is unplugged");
    g_free(process_text(1, safe));
    tell_rig(devices, out, "plug dome", "dome is plugged in");
    g_free(process_text(0, safe));

    GSubprocess *daemon = starts_daemon(rig, address);
    runs(BIN("mesorig"), "capture", "--address", address, rig, conf, "-o", session, NULL);
    runs(BIN("mesorig"), "process", session, NULL);
    ends(daemon);
    ends(devices);
    capture_dome("simulated-dome.session", conf, "yes");
    capture_dome("noiseless-dome.session", conf, "no");
    g_assert_cmpfloat(twin_value("dome.session", "frames"), ==,
                      twin_value("simulated-dome.session", "frames"));
    struct difference noise =
        twin_compare("noiseless-dome.session", "simulated-dome.session", "products/btf", FALSE);
    struct difference real =
        twin_compare("noiseless-dome.session", "dome.session", "products/btf", FALSE);
    g_assert_cmpfloat(real.rms, >, 0);
    g_assert_cmpfloat(real.rms, <, 1.4 * noise.rms);
    g_assert_cmpfloat(fabs(real.systematic), <, noise.rms);
}

struct mishap { /* a session, and what happens to a camera in it */
    VirtualRig *rig;
    GSubprocess *capture;
    char *out;
    int n_late;
    gboolean over;
};

#define MAX_LATE 6

/* A line of every drive and relay board answers late, once, damaged, once, and once not at all. */
static gboolean answer_late(gpointer data) {
    static const struct virtual_modbus_faults kinds[] = {
        {.late = 1, .late_ms = 450}, {.damaged = 1}, {.silent = 1}};
    struct mishap *mishap = data;
    virtual_rig_fail_lines(mishap->rig, &kinds[mishap->n_late % G_N_ELEMENTS(kinds)]);
    return ++mishap->n_late < MAX_LATE ? G_SOURCE_CONTINUE : G_SOURCE_REMOVE;
}

static gboolean lose_power(gpointer data) {
    struct mishap *mishap = data;
    virtual_rig_restart_camera(mishap->rig, "cam30", 4000);
    return G_SOURCE_REMOVE;
}

static void on_over(GObject *source, GAsyncResult *result, gpointer data) {
    struct mishap *mishap = data;
    ok(g_subprocess_communicate_utf8_finish(mishap->capture, result, &mishap->out, NULL, ERR));
    mishap->over = TRUE;
}

static gboolean is_lit(VirtualRig *rig) {
    struct virtual_rig_state state;
    virtual_rig_state(rig, &state);
    return state.n_lit > 0;
}

/* The capture must end by itself, and with this exit code. */
static void wait_over(struct mishap *mishap, int code) {
    UNTIL (mishap->over)
        g_main_context_iteration(NULL, TRUE); /* the rig's own timer wakes it */
    const int is = g_subprocess_get_exit_status(mishap->capture);
    if (is != code) {
        g_autofree char *log = twin_path("daemon.log"), *said = NULL;
        g_file_get_contents(log, &said, NULL, NULL);
        g_error("mesorig capture has exit code %d, not %d. It said: %s\nmesorigd said: %s", is,
                code, mishap->out, said);
    }
}

/* The daemon is killed, or hangs, while a lamp is on: the relay boards switch it off by themselves
 * after their 5 s. A daemon that goes on afterwards pauses the session. */
TEST(abandoned) {
    const int signals[] = {SIGKILL, SIGSTOP};
    g_autofree char *path = twin_path("abandoned.conf"), *conf = twin_path("short.conf");
    write_short_session(conf);
    for (gsize i = 0; i < G_N_ELEMENTS(signals); i++) {
        g_autofree char *folder = g_strdup_printf("abandoned%d.session", signals[i]);
        g_autofree char *session = twin_path(folder), *socket = twin_path(folder + 9);
        g_autofree char *address = g_strdup_printf("unix:path=%s", socket);
        struct mishap mishap = {0};
        mishap.rig = ok(virtual_rig_new(SMALL "rig.conf", NULL, ERR));
        /* A stopped daemon that goes on must notice the lamp, not the silent interlock. */
        g_autoptr(GString) text = g_string_new(virtual_rig_text(mishap.rig));
        assert_has(text->str, "watchdog_after_s = 5\n");
        g_assert_cmpint(g_string_replace(text, "lost_ms = 3000\n", "lost_ms = 10000\n", 0), ==, 1);
        g_assert_true(g_file_set_contents(path, text->str, -1, NULL));
        g_autoptr(GSubprocess) daemon = starts_daemon(path, address);
        mishap.capture =
            starts(G_SUBPROCESS_FLAGS_STDOUT_PIPE | G_SUBPROCESS_FLAGS_STDERR_MERGE, BIN("mesorig"),
                   "capture", "--address", address, path, conf, "-o", session, NULL);
        g_subprocess_communicate_utf8_async(mishap.capture, NULL, NULL, on_over, &mishap);
        UNTIL (is_lit(mishap.rig))
            g_main_context_iteration(NULL, TRUE);
        kill(find_guardian(path), SIGKILL); /* which would be quicker */
        g_subprocess_send_signal(daemon, signals[i]);
        UNTIL (!is_lit(mishap.rig))
            g_main_context_iteration(NULL, TRUE);
        if (signals[i] == SIGSTOP)
            g_subprocess_send_signal(daemon, SIGCONT);
        wait_over(&mishap, 1);
        /* The next feeding notices it, or the switching itself if that was stopped before it had
         * read back what it wrote. */
        if (signals[i] == SIGSTOP && !strstr(mishap.out, "may not be on any more"))
            assert_has(mishap.out, "1 was written to address 0, which reads back as 0");
        g_subprocess_force_exit(daemon);
        g_subprocess_wait(daemon, NULL, NULL);
        end_guardian(path);
        virtual_rig_free(mishap.rig);
        g_object_unref(mishap.capture);
        g_free(mishap.out);
    }
}

/* Two pictures of each camera come incomplete, all lines answer late again and again, and one
 * camera is without power for a while: the session goes on by itself and says what happened. */
TEST(mishaps) {
    g_autofree char *path = twin_path("mishaps.conf"), *conf = twin_path("short.conf");
    g_autofree char *session = twin_path("mishap.session"), *socket = twin_path("mishap-bus");
    g_autofree char *address = g_strdup_printf("unix:path=%s", socket);
    struct virtual_camera_faults faults = {.cut = 2};
    struct mishap mishap = {0};
    mishap.rig = ok(virtual_rig_new(SMALL "rig.conf", NULL, ERR));
    virtual_rig_fail_cameras(mishap.rig, &faults);
    g_assert_true(g_file_set_contents(path, virtual_rig_text(mishap.rig), -1, NULL));
    write_short_session(conf);
    GSubprocess *daemon = starts_daemon(path, address);
    mishap.capture =
        starts(G_SUBPROCESS_FLAGS_STDOUT_PIPE | G_SUBPROCESS_FLAGS_STDERR_MERGE, BIN("mesorig"),
               "capture", "--address", address, path, conf, "-o", session, NULL);
    g_subprocess_communicate_utf8_async(mishap.capture, NULL, NULL, on_over, &mishap);
    g_timeout_add(5000, lose_power, &mishap);
    g_timeout_add(1300, answer_late, &mishap);
    wait_over(&mishap, 0);
    assert_has(mishap.out, "cam60: frame taken again: frame refused: some of its data was lost");
    assert_has(mishap.out, "cam30: frame taken again: ");
    runs(BIN("mesorig"), "process", session, NULL);
    g_assert_cmpfloat(twin_value("mishap.session", "retakes"), >=, 5);
    g_assert_cmpint(mishap.n_late, ==, MAX_LATE);
    ends(daemon);
    virtual_rig_free(mishap.rig);
    g_object_unref(mishap.capture);
    g_free(mishap.out);
}

static double mean_dn(const char *address) {
    g_autofree char *picture = twin_path("picture.png");
    g_autofree char *json = process_mesorig(
        0, "snap cam30 --address %s -l lamp30 -e 20000 -o %s --json", address, picture);
    const char *mean = strstr(json, "\"mean_dn\": ");
    g_assert_nonnull(mean);
    return g_ascii_strtod(mean + strlen("\"mean_dn\": "), NULL);
}

/* Plugs are pulled and put in again, and another sample is laid on it, while it runs. */
TEST(by_hand) {
    g_autofree char *rig = twin_path("hand.conf"), *socket = twin_path("hand");
    g_autofree char *other = twin_path("other.conf"), *text = NULL;
    g_autofree char *address = g_strdup_printf("unix:path=%s", socket);
    g_assert_true(g_file_get_contents(SMALL "world.conf", &text, NULL, NULL));
    g_autoptr(GString) world = g_string_new(text);
    g_assert_cmpuint(
        g_string_replace(world, "width_mm = 50\nheight_mm = 50", "width_mm = 5\nheight_mm = 5", 1),
        ==, 1);
    g_assert_true(g_file_set_contents(other, world->str, -1, NULL));
    GSubprocess *devices =
        starts(G_SUBPROCESS_FLAGS_STDIN_PIPE | G_SUBPROCESS_FLAGS_STDOUT_PIPE, BIN("mesorig-rig"),
               "--virtual", SMALL "rig.conf", "-o", rig, "--json", NULL);
    g_autoptr(GDataInputStream) out =
        g_data_input_stream_new(g_subprocess_get_stdout_pipe(devices));
    g_free(g_data_input_stream_read_line(out, NULL, NULL, NULL));

    const char *const safe[] = {BIN("mesorigd"), "--safe-state", rig, NULL};
    tell_rig(devices, out, "unplug turntable", "turntable is unplugged");
    g_autofree char *gone = process_text(1, safe);
    assert_has(gone, "axis turntable: NOT safe: ");
    assert_has(gone, "axis arc: stands, read back");
    tell_rig(devices, out, "plug turntable", "turntable is plugged in");
    g_free(process_text(0, safe));

    GSubprocess *daemon = starts_daemon(rig, address);
    const double before = mean_dn(address);
    g_autofree char *replaces = g_strconcat("world ", other, NULL);
    g_autofree char *replaced = g_strconcat("the world is ", other, NULL);
    tell_rig(devices, out, replaces, replaced);
    const double after = mean_dn(address);
    g_test_message("mean %.1f DN of the sample, %.1f DN of a small one", before, after);
    g_assert_cmpfloat(after, <, 0.7 * before);
    tell_rig(devices, out, "unplug cam30", "cam30 is unplugged");
    g_free(process_mesorig(1, "snap cam30 --address %s", address));
    tell_rig(devices, out, "plug cam30", "cam30 is plugged in");
    ends(daemon);
    ends(devices);
}

TEST(refused) {
    static const struct {
        const char *text, *said;
        const char *usb;
    } cases[] = {
        {"[rig]\nid = x\n", "no section of a device has the key world"},
        {"[axis a]\ndriver = tic-axis\n", "driver = tic-axis has no virtual device"},
        {"[camera c]\ndriver = sim-camera\nworld = " SMALL "world.conf\n",
         "world.conf has no camera “c”"},
        {"[axis a]\ndriver = sim-axis\nworld = /nowhere.conf\n", "/nowhere.conf"},
        {"[axis a]\ndriver = sim-axis\n", "no section of a device has the key world"},
        {"[axis a]\ndriver = sim-axis\nworld =\n", "no section of a device has the key world"},
        {"[axis a]\ndriver = sim-axis\n", "has no device “b”", "b"},
        {"[axis a]\ndriver = sim-axis\n", "libumockdev-preload0", "a"},
    };
    g_autofree char *path = twin_path("bad.conf");
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        const struct virtual_rig_kinds kinds = {.usb = (const char *[]){cases[i].usb, NULL}};
        g_autoptr(GError) error = NULL;
        g_assert_true(g_file_set_contents(path, cases[i].text, -1, NULL));
        g_assert_null(virtual_rig_new(path, &kinds, &error));
        if (!strstr(error->message, cases[i].said))
            g_error("said \"%s\", not \"%s\"", error->message, cases[i].said);
    }
}

BEFORE_TESTS {
    twin_folder = g_dir_make_tmp("mesorig-virtual-XXXXXX", NULL);
    g_setenv("HOME", twin_folder, TRUE); /* for the settings of libgphoto2 */
}

AFTER_TESTS {
    remove_tree(twin_folder);
    g_free(twin_folder);
}
