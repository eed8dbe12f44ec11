/* A session through USB and V4L2 alone: the small rig's axes are Tics, its lamps and lasers hang on
 * relay boards, its cameras are V4L2's, all over one world, and the programs capture it in real
 * time. Its frames and products are those of the simulated drivers, but for the noise. */
#include "twin_sessions.h"

#include "drivers/config.h"
#include "sim/virtual/testbed.h"
#include "sim/virtual/usb_relays.h"
#include "sim/virtual/usb_tic.h"
#include "sim/virtual/v4l2.h"

#include <gio/gio.h>
#include <string.h>

#define SMALL         SOURCE_DIR "/tests/small/"
#define BIN(x)        BUILD_DIR "/bin/" x
#define STEPS_PER_DEG 500
#define MAX_EACH      4

struct rig {
    World *world;
    VirtualTic *tics[MAX_EACH];
    VirtualRelays *lamps, *lasers;
    VirtualV4l2 *cameras[MAX_EACH];
    int n_tics, n_lasers, n_cameras;
    GString *text;
};

static GSubprocess *starts(GSubprocessFlags flags, const char *const *argv) {
    g_autoptr(GError) error = NULL;
    GSubprocess *process = g_subprocess_newv(argv, flags, &error);
    g_assert_no_error(error);
    return process;
}

static void runs(const char *const *argv) {
    g_autoptr(GSubprocess) process =
        starts(G_SUBPROCESS_FLAGS_STDOUT_PIPE | G_SUBPROCESS_FLAGS_STDERR_MERGE, argv);
    g_autoptr(GBytes) said = NULL;
    g_assert_true(g_subprocess_communicate(process, NULL, NULL, &said, NULL, NULL));
    if (!g_subprocess_get_successful(process))
        g_error("%s %s failed:\n%.*s", argv[0], argv[1], (int)g_bytes_get_size(said),
                (const char *)g_bytes_get_data(said, NULL));
}

static void copy_keys(struct rig *rig, const struct config_section *section) {
    static const char *const left_out[] = {"driver", "world", "part", "clock", NULL};
    g_string_append_printf(rig->text, "\n[%s]\n", section->group);
    for (const char *const *key = config_keys(section); *key; key++)
        if (!g_strv_contains(left_out, *key))
            g_string_append_printf(rig->text, "%s = %s\n", *key, config_value(section, *key, NULL));
}

static void add_axis(struct rig *rig, const struct config_section *section) {
    const char *part = config_value(section, "part", NULL);
    static const char *const serials[MAX_EACH] = {"T0", "T1", "T2", "T3"};
    const char *serial = serials[rig->n_tics];
    gboolean sweeps = g_str_has_prefix(part, "laser");
    g_autofree char *name = g_strconcat(sweeps ? "sweep " : "", part, NULL);
    GError *error = NULL;
    VirtualTic *tic = virtual_tic_new(serial, 1 + rig->n_tics, 0, 0);
    rig->tics[rig->n_tics++] = tic;
    virtual_tic_link(tic, rig->world, name, STEPS_PER_DEG, 0, &error);
    g_assert_no_error(error);
    g_string_append_printf(rig->text,
                           "driver = tic-axis\nserial = %s\nsteps_per_deg = %d\nhoming = here\n"
                           "poll_ms = 10\n",
                           serial, STEPS_PER_DEG);
}

static void add_laser(struct rig *rig, const struct config_section *section) {
    g_autofree char *name = g_strconcat("laser ", section->name, NULL);
    GError *error = NULL;
    virtual_relays_link(rig->lasers, rig->n_lasers++, rig->world, name, &error);
    g_assert_no_error(error);
    g_string_append_printf(rig->text, "driver = usb-relay-laser\nserial = LASER\nrelay = %d\n",
                           rig->n_lasers);
}

static void add_camera(struct rig *rig, const struct config_section *section) {
    GError *error = NULL;
    g_autofree char *port = g_strdup_printf("2-1.%d", rig->n_cameras + 1);
    struct virtual_v4l2_config config = {
        .number = rig->n_cameras, .port = port, .stamp = VIRTUAL_V4L2_FIRST_DATA};
    rig->cameras[rig->n_cameras++] =
        virtual_v4l2_new_world(&config, rig->world, section->name, &error);
    g_assert_no_error(error);
    g_string_append_printf(rig->text,
                           "driver = v4l2-camera\nbus = usb-virtual-%s\nframe_rate = 50\n"
                           "black_level = 64\n",
                           port);
}

static void add_section(struct rig *rig, const struct config_section *section) {
    copy_keys(rig, section);
    if (g_str_equal(section->class_name, "axis"))
        add_axis(rig, section);
    else if (g_str_equal(section->class_name, "laser"))
        add_laser(rig, section);
    else if (g_str_equal(section->class_name, "camera"))
        add_camera(rig, section);
    else if (g_str_equal(section->class_name, "lamps"))
        g_string_append_printf(rig->text, "driver = usb-relays\nserial = LAMPS\nwarm_up_ms = %g\n",
                               world_lamp_warm_up_s(rig->world) * 1000);
    else if (g_str_equal(section->class_name, "interlock"))
        g_string_append(rig->text, "driver = sim-interlock\n");
    else if (g_str_equal(section->class_name, "rig"))
        g_string_append(rig->text, "clock = real\n");
}

static void plug_in(struct rig *rig, const char *path) {
    static const char *const lamps[] = {"lamp lamp30", "lamp lamp60"};
    GError *error = NULL;
    gsize n;
    g_autoptr(Config) config = config_load(SMALL "rig.conf", &error);
    g_assert_no_error(error);
    *rig = (struct rig){.world = world_get(SMALL "world.conf", &error), .text = g_string_new(NULL)};
    g_assert_no_error(error);
    rig->lamps = virtual_relays_new("USBRelay2", "LAMPS", 8, FALSE);
    rig->lasers = virtual_relays_new("USBRelay2", "LASER", 9, TRUE);
    for (int i = 0; i < 2; i++)
        g_assert_true(virtual_relays_link(rig->lamps, i, rig->world, lamps[i], NULL));
    const struct config_section *sections = config_sections(config, &n);
    for (gsize i = 0; i < n; i++)
        add_section(rig, &sections[i]);
    g_assert_true(g_file_set_contents(path, rig->text->str, -1, NULL));
}

static void unplug(struct rig *rig) {
    for (int i = 0; i < MAX_EACH; i++) {
        virtual_tic_free(rig->tics[i]);
        virtual_v4l2_free(rig->cameras[i]);
    }
    virtual_relays_free(rig->lamps);
    virtual_relays_free(rig->lasers);
    world_unref(rig->world);
    g_string_free(rig->text, TRUE);
}

static void capture_usb(const char *name) {
    g_autofree char *path = in_top("usb.conf"), *socket = in_top("bus"), *session = in_top(name);
    g_autofree char *address = g_strdup_printf("unix:path=%s", socket);
    struct rig rig;
    plug_in(&rig, path);
    g_autoptr(GSubprocess) daemon =
        starts(G_SUBPROCESS_FLAGS_STDERR_SILENCE,
               (const char *[]){BIN("mesorigd"), "--listen", address, "--rig", path, NULL});
    for (int i = 0; i < 3000 && !g_file_test(socket, G_FILE_TEST_EXISTS); i++)
        g_usleep(10000);
    runs((const char *[]){BIN("mesorig"), "capture", "--address", address, path,
                          SMALL "session.conf", "-o", session, NULL});
    g_subprocess_send_signal(daemon, SIGTERM);
    g_subprocess_wait(daemon, NULL, NULL);
    g_assert_true(g_subprocess_get_successful(daemon));
    /* All is left dark and still. */
    g_assert_cmphex(virtual_relays_state(rig.lamps), ==, 0);
    g_assert_cmphex(virtual_relays_state(rig.lasers), ==, 0);
    for (int i = 0; i < rig.n_tics; i++)
        g_assert_cmpfloat(virtual_tic_speed(rig.tics[i]), ==, 0);
    unplug(&rig);
    runs((const char *[]){BIN("mesorig"), "process", session, NULL});
}

/* The same rig, with other noise. */
static void capture_simulated(const char *name, const char *seed) {
    g_autofree char *rig = in_top("rig.conf"), *world = in_top("world.conf");
    g_autofree char *session = in_top(name), *rig_text = NULL, *text = NULL;
    g_assert_true(g_file_get_contents(SMALL "rig.conf", &rig_text, NULL, NULL));
    g_assert_true(g_file_get_contents(SMALL "world.conf", &text, NULL, NULL));
    g_auto(GStrv) parts = g_strsplit(text, "seed = 7", 2);
    g_assert_nonnull(parts[1]);
    g_autofree char *changed = g_strconcat(parts[0], "seed = ", seed, parts[1], NULL);
    g_assert_true(g_file_set_contents(rig, rig_text, -1, NULL));
    g_assert_true(g_file_set_contents(world, changed, -1, NULL));
    runs((const char *[]){BIN("mesorig"), "capture", rig, SMALL "session.conf", "-o", session,
                          NULL});
    runs((const char *[]){BIN("mesorig"), "process", session, NULL});
}

static void test_session(void) {
    static const struct {
        const char *folder;
        gboolean holes;
    } kinds[] = {{"frames", FALSE}, {"products/btf", FALSE}, {"products", TRUE}};
    capture_usb("usb.session");
    capture_simulated("simulated.session", "7");
    capture_simulated("other.session", "8");
    g_assert_cmpfloat(value("usb.session", "frames"), ==, value("simulated.session", "frames"));
    g_assert_cmpfloat(value("usb.session", "retakes"), ==, 0);
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++) {
        struct difference noise =
            compare("simulated.session", "other.session", kinds[i].folder, kinds[i].holes);
        struct difference real =
            compare("simulated.session", "usb.session", kinds[i].folder, kinds[i].holes);
        g_assert_cmpfloat(real.rms, >, 0); /* other noise */
        g_assert_cmpfloat(real.rms, <, 1.4 * noise.rms);
        g_assert_cmpfloat(fabs(real.systematic), <, noise.rms);
        g_assert_cmpfloat(real.seen_differently, <, noise.seen_differently + 0.05);
    }
}

int main(int argc, char **argv) {
    testbed_enter(argv);
    g_test_init(&argc, &argv, NULL);
    top = g_dir_make_tmp("mesorig-usb-XXXXXX", NULL);
    g_test_add_func("/usb-rig/session", test_session);
    int failed = g_test_run();
    const char *const remove[] = {"/bin/rm", "-rf", top, NULL};
    g_spawn_sync(NULL, (char **)remove, NULL, 0, NULL, NULL, NULL, NULL, NULL, NULL);
    g_free(top);
    return failed;
}
