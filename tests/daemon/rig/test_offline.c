/* Timing from a rig file only: if the devices can be opened, it must equal the timing of the opened
 * devices. Otherwise it is what the file says. */
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "plan/plan.h"
#include "rig/devices.h"

#include <glib/gstdio.h>
#include <string.h>
#include <unistd.h>

TEST(as_opened) {
    static const char *const rigs[] = {"rig.conf", "dome/rig.conf", "fixed_lamps/rig.conf",
                                       "arm/rig.conf", "probe/rig.conf"};

    for (gsize i = 0; i < G_N_ELEMENTS(rigs); i++) {
        g_autofree char *path = g_build_filename(SOURCE_DIR "/etc/demo", rigs[i], NULL);
        g_autoptr(GPtrArray) assumed = g_ptr_array_new_with_free_func(g_free);
        struct rig rig;
        struct rig_timing timing;
        g_assert_true(ok(devices_read_timing(path, &rig, &timing, assumed, ERR)));
        g_assert_cmpuint(assumed->len, ==, 0);
        struct devices *devices = ok(devices_open(path, ERR));
        for (int c = 0; c < rig.n_cameras; c++) /* a simulated camera's are its world's */
            timing.bits[c] = devices->timing.bits[c];
        g_assert_cmpmem(&timing, sizeof timing, &devices->timing, sizeof timing);
        g_assert_cmpmem(&rig, sizeof rig, &devices->geometry, sizeof rig);
        devices_close(devices);
    }
}

/* Every preset, on the demo's rig: the same plan or the same refusal. */
TEST(presets) {
    static const char *const presets[] = {"12x5", "12x8", "81", "26"};
    static const char *const path = SOURCE_DIR "/etc/demo/rig.conf";
    g_autoptr(GPtrArray) assumed = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GError) error = NULL;
    struct rig rig;
    struct rig_timing timing;
    int planned = 0;

    g_assert_true(devices_read_timing(path, &rig, &timing, assumed, &error));
    struct devices *devices = ok(devices_open(path, ERR));
    for (gsize i = 0; i < G_N_ELEMENTS(presets); i++) {
        g_autofree char *text = g_strdup_printf(
            "[session]\nname=a\n[sample]\nwidth_mm=50\nheight_mm=50\ntexels=8\nreference_mm=1\n"
            "depth_mm=1\n[views]\npreset=%s\n[lights]\npreset=%s\noffset_deg=15\n[capture]\n"
            "exposures_us=4000\n",
            presets[i], presets[i]);
        g_autoptr(GError) here = NULL, there = NULL;
        struct session_conf conf;
        g_assert_true(session_conf_parse(&conf, text, "s.conf", &error));
        g_autoptr(Plan) offline = plan_build(&conf, &rig, &timing, &here);
        g_autoptr(Plan) opened = plan_build(&conf, &devices->geometry, &devices->timing, &there);
        g_assert_cmpstr(here ? here->message : "", ==, there ? there->message : "");
        if (opened) {
            planned++;
            g_assert_cmpfloat(offline->predicted_s, ==, opened->predicted_s);
            g_assert_cmpuint(offline->bytes, ==, opened->bytes);
        }
        session_conf_clear(&conf);
    }
    g_assert_cmpint(planned, ==, 2);
    devices_close(devices);
}

/* port: the line's, instead of the file's /dev/ttyUSB0. */
static void append_file(GString *to, const char *name, const char *port) {
    g_autofree char *path = g_build_filename(SOURCE_DIR "/etc/devices", name, NULL), *text = NULL;

    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    g_autoptr(GString) changed = g_string_new(text);
    g_string_replace(changed, "/dev/ttyUSB0", port, 0);
    g_string_append(to, changed->str);
}

/* Devices that are not there, as etc/devices has them; a camera that says nothing of its pictures a
 * second. */
TEST(absent_devices) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "rig.conf", NULL);
    g_autoptr(GString) text = g_string_new("[rig]\nid=r\narc_radius_mm=500\n");
    g_autoptr(GPtrArray) assumed = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GError) error = NULL;
    struct rig rig;
    struct rig_timing timing;

    append_file(text, "leadshine-rs.conf", "/dev/ttyUSB0");
    append_file(text, "oriental-az.conf", "/dev/ttyUSB2");
    append_file(text, "waveshare-modbus-rtu-relay.conf", "");
    append_file(text, "gige-camera.conf", "");
    g_string_append(text, "theta_deg=0\nphi_deg=0\ndistance_mm=500\nfocal_px=1000\n"
                          "[camera c1]\ndriver=v4l2-camera\ntheta_deg=20\nphi_deg=0\nwidth=640\n"
                          "height=480\ndistance_mm=500\nfocal_px=1000\n"
                          "[lamp l]\nbank=bank\nindex=0\ntheta_deg=30\ndistance_mm=500\n");
    g_assert_true(g_file_set_contents(path, text->str, -1, NULL));
    g_assert_true(ok(devices_read_timing(path, &rig, &timing, assumed, ERR)));
    g_assert_true(timing.turntable.wraps);
    g_assert_cmpfloat(timing.turntable.speed_deg_s, ==, 20);
    g_assert_cmpfloat(timing.turntable.accel_deg_s2, ==, 333);
    g_assert_cmpfloat(timing.arc.max_deg, ==, 180);
    g_assert_cmpfloat(timing.lamp_warm_up_s[0], ==, 0.2);
    g_assert_cmpint(timing.readout_us[0], ==, 30000);
    g_assert_cmpint(timing.trigger_us[0], ==, 1000);
    g_assert_cmpint(timing.readout_us[1], ==, 33000);
    g_assert_cmpint(assumed->len, ==, 3);
    g_assert_true(g_str_has_prefix(assumed->pdata[1], "assumed for [camera c1]: 30 pictures"));
    g_assert_null(devices_open(path, &error)); /* indeed it is not there */
    g_assert_nonnull(error);
    g_clear_error(&error);

    g_string_append(text, "[axis none]\ndriver=tic-axis\n");
    g_assert_true(g_file_set_contents(path, text->str, -1, NULL));
    g_assert_false(devices_read_timing(path, &rig, &timing, assumed, &error));
    g_assert_error(error, CONFIG_ERROR, CONFIG_ERROR_MISSING); /* its steps_per_deg */
}

#define BOARD                                                                                      \
    "driver=gcode-axis\nport=p\nunits_per_deg=1\nletter=X\nhoming=here\nspeed_deg_s=1\n"           \
    "accel_deg_s2=1\nwraps=yes\n"
/* What motion = continuous needs is known without the devices: of the boards that speak G-code only
 * those with GRBL report positions, and only GigE cameras have the times of their frames. */
TEST(continuous) {
    static const struct {
        const char *table, *camera;
        gboolean reports, stamps;
    } cases[] = {
        {BOARD, "driver=aravis\ndevice=x\n", TRUE, TRUE},
        {BOARD "dialect=marlin\n", "driver=v4l2-camera\n", FALSE, FALSE},
        {BOARD "dialect=klipper\n", "driver=gphoto2-camera\nport=usb\n", FALSE, FALSE},
        {BOARD "dialect=grbl\n", "driver=program-camera\nprogram=/bin/true\n", TRUE, FALSE},
    };
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "rig.conf", NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        g_autofree char *text = g_strdup_printf(
            "[rig]\nid=r\narc_radius_mm=500\n[axis turntable]\n%s[camera c]\n%s"
            "theta_deg=20\nphi_deg=0\nwidth=640\nheight=480\ndistance_mm=500\n"
            "focal_px=1000\n[lamp l]\nindex=0\ntheta_deg=30\nphi_deg=0\ndistance_mm=500\nbank=b\n"
            "[lamps b]\ndriver=modbus-relays\nbus=/dev/ttyUSB1\nn=1\n",
            cases[i].table, cases[i].camera);
        g_autoptr(GPtrArray) assumed = g_ptr_array_new_with_free_func(g_free);
        struct rig rig;
        struct rig_timing timing;
        g_assert_true(g_file_set_contents(path, text, -1, NULL));
        g_assert_true(ok(devices_read_timing(path, &rig, &timing, assumed, ERR)));
        g_assert_true((timing.turntable.report_ms > 0) == cases[i].reports);
        g_assert_true((timing.stamp_us[0] >= 0) == cases[i].stamps);
    }
}

/* Two drives on one line that are to be opened with different parities. */
TEST(line_conflict) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "rig.conf", NULL);
    g_autoptr(GString) text = g_string_new("[rig]\nid=r\narc_radius_mm=500\n");
    g_autoptr(GPtrArray) assumed = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GError) error = NULL;
    struct rig rig;
    struct rig_timing timing;

    append_file(text, "leadshine-rs.conf", "/dev/ttyUSB0");
    append_file(text, "oriental-az.conf", "/dev/ttyUSB0");
    g_string_append(text,
                    "[lamps bank]\ndriver=modbus-relays\nbus=/dev/ttyUSB1\nn=1\n"
                    "[lamp l]\nbank=bank\nindex=0\ntheta_deg=30\ndistance_mm=500\n"
                    "[camera c]\ndriver=aravis\ndevice=x\ntheta_deg=20\nphi_deg=0\nwidth=640\n"
                    "height=480\ndistance_mm=500\nfocal_px=1000\npixel_format=RGB8\n");
    g_assert_true(g_file_set_contents(path, text->str, -1, NULL));
    g_assert_false(devices_read_timing(path, &rig, &timing, assumed, &error));
    g_test_message("%s", error->message);
    g_assert_nonnull(strstr(error->message, "2 mistakes:"));
    g_assert_nonnull(strstr(error->message, "opens /dev/ttyUSB0 with other settings"));
    g_assert_nonnull(strstr(error->message, "pixel_format: \"RGB8\" cannot be used for measuring"));
}

#define RELAYS "driver=modbus-relays\n"
#define LASER  "driver=modbus-laser\n"
#define USB    "driver=usb-relays\n"
#define USBL   "driver=usb-relay-laser\n"
#define TIC    "driver=tic-axis\nsteps_per_deg=100\n"
#define DRIVE                                                                                      \
    "driver=modbus-axis\nsteps_per_deg=100\nposition_register=21\nstatus_register=20\n"            \
    "moving_bit=0\nstart=2=1\nhome=2=2\nstop=2=3\nmin_deg=-90\nmax_deg=90\nspeed_deg_s=2\n"        \
    "accel_deg_s2=40\n"
#define GIGE "driver=aravis\n"
#define UVC  "driver=v4l2-camera\n"

/* Two sections of a rig file. */
static const struct needs {
    const char *first, *second;
    const char *same; /* what both need; NULL: nothing */
} needs[] = {
    {"lamps a]\n" RELAYS "bus=tcp:10.0.0.2\nn=4", "laser b]\n" LASER "bus=tcp:10.0.0.2:502\ncoil=3",
     "coil 3 of unit 1 at tcp:10.0.0.2:502"},
    {"lamps a]\n" RELAYS "bus=tcp:10.0.0.2\nn=4", "laser b]\n" LASER "bus=tcp:10.0.0.2\ncoil=4",
     NULL},
    {"lamps a]\n" RELAYS "bus=tcp:10.0.0.2\nn=4", "laser b]\n" LASER "bus=tcp:10.0.0.2\nunit=2",
     NULL},
    {"lamps a]\n" RELAYS "bus=tcp:10.0.0.2\nn=4", "laser b]\n" LASER "bus=tcp:10.0.0.2:503", NULL},
    {"lamps a]\n" RELAYS "bus=tcp:Relays:502\nfirst_coil=2\nn=4",
     "lamps b]\n" RELAYS "bus=tcp:relays\nfirst_coil=5\nn=2", "coil 5 of unit 1 at tcp:relays:502"},
    {"lamps a]\n" RELAYS "bus=tcp:localhost\nn=1", "lamps b]\n" RELAYS "bus=tcp:127.0.0.1\nn=1",
     "coil 0 of unit 1 at tcp:127.0.0.1:502"},
    {"lamps a]\n" RELAYS "bus=tcp:[::1]\nn=1", "lamps b]\n" RELAYS "bus=tcp:[0::1]:502\nn=1",
     "coil 0 of unit 1 at tcp:[::1]:502"},
    {"lamps a]\n" RELAYS "bus=FOLDER/ttyUSB0\nn=1", "laser b]\n" LASER "bus=FOLDER/by-id",
     "coil 0 of unit 1 at FOLDER/ttyUSB0"},
    {"lamps a]\n" RELAYS "bus=tcp:h\nn=2\npulse_coil=512", "laser b]\n" LASER "bus=tcp:h\ncoil=513",
     "coil 513 of unit 1 at tcp:h:502"},
    {"lamps a]\n" USB "serial=ABCDE", "laser b]\n" USBL "serial=ABCDE\nrelay=8",
     "relay 8 of the USB relay board with serial ABCDE"},
    {"lamps a]\n" USB "n_lamps=2", "laser b]\n" USBL "relay=2",
     "relay 2 of the only USB relay board"},
    {"lamps a]\n" USB "path=1-2\nn_lamps=2", "laser b]\n" USBL "path=1-2\nrelay=3", NULL},
    {"lamps a]\n" USB "path=1-2\nn_lamps=2", "laser b]\n" USBL "path=1-3\nrelay=2", NULL},
    {"axis a]\n" TIC "serial=0012", "axis b]\n" TIC "serial=0012", "the Tic with serial 0012"},
    {"axis a]\n" TIC "path=1-2", "axis b]\n" TIC "path=1-2", "the Tic at 1-2"},
    {"axis a]\n" TIC, "axis b]\n" TIC, "the only Tic"},
    {"axis a]\n" TIC "serial=0012", "axis b]\n" TIC "serial=0013", NULL},
    {"axis a]\n" DRIVE "bus=/dev/ttyUSB9\nunit=5\ntarget_register=0",
     "axis b]\n" DRIVE "bus=/dev/ttyUSB9\nunit=5\ntarget_register=0",
     "the axis with target_register 0 of unit 5 at /dev/ttyUSB9"},
    {"axis a]\n" DRIVE "bus=/dev/ttyUSB9\nunit=5\ntarget_register=0",
     "axis b]\n" DRIVE "bus=/dev/ttyUSB9\nunit=6\ntarget_register=0", NULL},
    {"axis a]\n" DRIVE "bus=/dev/ttyUSB9\nunit=5\ntarget_register=0", /* two axes of one drive */
     "axis b]\n" DRIVE "bus=/dev/ttyUSB9\nunit=5\ntarget_register=100", NULL},
    {"camera a]\n" GIGE "device=10.0.0.7", "camera b]\n" GIGE "device=10.0.0.7",
     "the camera 10.0.0.7"},
    {"camera a]\n" GIGE "device=10.0.0.7", "camera b]\n" GIGE "device=10.0.0.8", NULL},
    {"camera a]\n" UVC "device=FOLDER/by-id", "camera b]\n" UVC "device=FOLDER/ttyUSB0",
     "the camera FOLDER/ttyUSB0"},
    {"camera a]\n" UVC "bus=usb-1", "camera b]\n" UVC "bus=usb-1", "the camera on bus usb-1"},
    {"camera a]\n" UVC, "camera b]\n" UVC, "the only V4L2 camera"},
};

/* The sections are not whole: of all their mistakes only this one matters. */
TEST(needs) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "rig.conf", NULL);
    g_autofree char *node = g_build_filename(folder, "ttyUSB0", NULL);
    g_autofree char *link = g_build_filename(folder, "by-id", NULL);
    g_autoptr(GPtrArray) assumed = g_ptr_array_new_with_free_func(g_free);

    g_assert_true(g_file_set_contents(node, "", 0, NULL));
    g_assert_cmpint(symlink(node, link), ==, 0);
    for (gsize i = 0; i < G_N_ELEMENTS(needs); i++) {
        g_autoptr(GString) text = g_string_new("[rig]\nid=r\n[");
        g_autoptr(GString) words = g_string_new(NULL);
        g_autoptr(GError) error = NULL;
        struct rig rig;
        struct rig_timing timing;
        const char *of = strchr(needs[i].first, ']');
        g_string_append_printf(text, "%s\n[%s\n", needs[i].first, needs[i].second);
        g_string_replace(text, "FOLDER", folder, 0);
        g_assert_true(g_file_set_contents(path, text->str, -1, NULL));
        g_assert_false(devices_read_timing(path, &rig, &timing, assumed, &error));
        g_string_printf(words, "]: %s is already used by [%.*s], in line 3; correct one of the two",
                        needs[i].same ? needs[i].same : "", (int)(of - needs[i].first),
                        needs[i].first);
        g_string_replace(words, "FOLDER", folder, 0);
        if ((strstr(error->message, needs[i].same ? words->str : "is already used by [") != NULL) !=
            (needs[i].same != NULL))
            g_error("%s\n%s: %s", text->str, words->str, error->message);
    }
}
