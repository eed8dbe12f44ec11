/* mesorig new-rig: rig files of every kind, with and without devices that are plugged in, are read
 * without an error and contain what was asked for. */
#include "captures/new_rig_text.h"
#include "drivers/found.h"
#include "lib/folder.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/test.h"
#include "lib/text_file.h"
#include "rig/devices.h"

#include <math.h>
#include <string.h>

BEFORE_TESTS {
    folder_make();
}

AFTER_TESTS {
    folder_remove();
}

static void plug(GPtrArray *found, const char *address, const char *section) {
    struct found *device = found_add(found, "usb", address, "Maker\n[Device \xff", "7\x1b");
    device->section = g_strdup(section);
}

/* What the scans of the drivers report (usb/scan.c, v4l2/scan.c, finder.c). */
static GPtrArray *plugged(void) {
    GPtrArray *found = found_list_new();
    /* a drive whose further keys are not known is not used */
    plug(found, "1-9", "[axis NAME]\ndriver = modbus-axis\nbus = 1-9\n");
    plug(found, "1-2",
         "[axis NAME]\ndriver = tic-axis\nserial = 00366\n"
         "# steps_per_deg = microsteps in a degree of the axis\n");
    plug(found, "1-3",
         "[lamps NAME]\ndriver = usb-relays\npath = 1-3\n# or, where it switches a "
         "laser:\n# [laser NAME]\n# driver = usb-relay-laser\n# path = 1-3\n"
         "# relay = 1\n");
    plug(found, "/dev/video0",
         "[camera NAME]\ndriver = v4l2-camera\nbus = usb-1\nformat = GREY\n"
         "width = 640\nheight = 480\n");
    plug(found, "192.168.0.9", "[camera NAME]\ndriver = aravis\ndevice = 192.168.0.9\n");
    found_add(found, "serial", "/dev/ttyUSB3", "Adapter", "");
    return found;
}

/* The rig of the text, which is checked as for a plan: drivers check their options as well. */
static struct rig *read_rig(const char *text) {
    struct rig *rig = g_new0(struct rig, 1);
    g_autofree struct rig_timing *timing = g_new0(struct rig_timing, 1);
    g_autoptr(GPtrArray) assumed = g_ptr_array_new_with_free_func(g_free);
    g_autofree char *path = in_folder("rig.conf");

    text_file_write(folder, "rig.conf", text);
    g_assert_true(ok(devices_read_timing(path, rig, timing, assumed, ERR)));
    return rig;
}

TEST(every_kind) {
    g_autoptr(GPtrArray) nothing = found_list_new(), devices = plugged();
    const GPtrArray *const found[] = {nothing, devices};

    for (int kind = 0; kind < NEW_RIG_KINDS; kind++)
        for (int n = 1; n <= new_rig_banks[NEW_RIG_RELAYS].max_lamps; n++)
            for (int k = 0; k < 2; k++) {
                const struct new_rig wish = {"bench 1", kind, n, 123.5};
                g_autoptr(GPtrArray) missing = g_ptr_array_new_with_free_func(g_free);
                g_autofree char *text = new_rig_text(&wish, found[k], missing);
                g_autofree struct rig *rig = read_rig(text);
                g_assert_cmpstr(rig->id, ==, "bench 1");
                g_assert_cmpint(rig->n_lamps, ==, n);
                g_assert_cmpint(rig->n_cameras, ==, k == 1 && kind != NEW_RIG_DOME ? 2 : 1);
                for (int i = 0; i < n; i++) {
                    const double mm = vec3_length(rig->lamps[i].position_mm);
                    g_assert_cmpfloat(fabs(mm - 123.5), <, 1e-9);
                    g_assert_cmpint(rig->lamps[i].fixed, ==, kind != NEW_RIG_ARC);
                }
                g_assert_cmpfloat(rig->arc_radius_mm, ==, kind == NEW_RIG_ARC ? 123.5 : 0);
            }
}

/* Every way to operate axes, lamps and cameras, with the place that a question has suggested. A
 * program must be there. */
static const char *place_of(const struct new_rig_way *way, const char *program) {
    return g_str_equal(way->name, "program") ? program : way->usual;
}

TEST(every_way) {
    static const char *const dialects[] = {NULL, "", "grbl", "marlin", "klipper"};
    g_autoptr(GPtrArray) nothing = found_list_new();

    for (int kind = 0; kind < NEW_RIG_KINDS; kind++)
        for (int axes = 0; new_rig_axes[axes].name; axes++)
            for (int bank = 0; new_rig_banks[bank].name; bank++)
                for (int camera = 0; new_rig_cameras[camera].name; camera++)
                    for (gsize d = 0; d < G_N_ELEMENTS(dialects); d++) {
                        const struct new_rig wish = {
                            .id = "r",
                            .kind = (enum new_rig_kind)kind,
                            .n_lamps = 5,
                            .radius_mm = 400,
                            .axes = (enum new_rig_axes)axes,
                            .bank = (enum new_rig_bank)bank,
                            .camera = (enum new_rig_camera)camera,
                            .axes_at = place_of(&new_rig_axes[axes], "/bin/true;one; two"),
                            .bank_at = bank == NEW_RIG_SACN
                                           ? ""
                                           : place_of(&new_rig_banks[bank], "/bin/true;lamps"),
                            .camera_at = place_of(&new_rig_cameras[camera], "/bin/true"),
                            .dialect = dialects[d],
                            .firmware = d > 1 ? "Board 1.0" : NULL,
                            .baud = 250000};
                        g_autoptr(GPtrArray) missing = g_ptr_array_new_with_free_func(g_free);
                        g_autofree char *text = new_rig_text(&wish, nothing, missing);
                        g_autofree struct rig *rig = read_rig(text);
                        g_assert_cmpint(rig->n_lamps, ==, 5);
                        g_assert_cmpint(rig->n_cameras, ==, 1);
                        const guint board = axes == NEW_RIG_GCODE && d == 1 ? 1 : 0;
                        const guint n_axes = (guint)kind; /* dome, turntable, arc */
                        g_assert_cmpuint(missing->len, ==,
                                         (axes == NEW_RIG_TIC ? n_axes : board * n_axes) +
                                             (bank == NEW_RIG_RELAYS) + (camera == NEW_RIG_FOUND));
                    }
}

/* Every bank takes as many lamps as new_rig_banks says, and a board of relays takes no more. */
TEST(limits) {
    g_autoptr(GPtrArray) nothing = found_list_new();
    for (int bank = 0; new_rig_banks[bank].name; bank++)
        for (int kind = 0; kind < NEW_RIG_KINDS; kind++) {
            const struct new_rig wish = {
                .id = "r",
                .kind = (enum new_rig_kind)kind,
                .n_lamps = new_rig_banks[bank].max_lamps,
                .radius_mm = 400,
                .bank = (enum new_rig_bank)bank,
                .bank_at = bank == NEW_RIG_SACN ? "" : place_of(&new_rig_banks[bank], "/bin/true"),
            };
            g_autoptr(GPtrArray) missing = g_ptr_array_new_with_free_func(g_free);
            g_autofree char *text = new_rig_text(&wish, nothing, missing);
            g_autofree struct rig *rig = read_rig(text);
            g_assert_cmpint(rig->n_lamps, ==, wish.n_lamps);
        }
    const struct new_rig many = {"r", NEW_RIG_DOME, 65, 400};
    g_autoptr(GPtrArray) missing = g_ptr_array_new_with_free_func(g_free);
    g_autofree char *text = new_rig_text(&many, nothing, missing);
    g_autofree char *path = in_folder("many.conf");
    g_autofree struct rig *rig = g_new0(struct rig, 1);
    g_autofree struct rig_timing *timing = g_new0(struct rig_timing, 1);
    g_autoptr(GPtrArray) assumed = g_ptr_array_new_with_free_func(g_free);
    text_file_write(folder, "many.conf", text);
    g_assert_false(devices_read_timing(path, rig, timing, assumed, NULL));
}

/* The rig of most people who build a dome: LEDs on a serial controller, under a still camera that
 * has told the size of its pictures. The file fits on a screen. */
TEST(dome_of_leds) {
    g_autoptr(GPtrArray) nothing = found_list_new();
    g_autoptr(GPtrArray) missing = g_ptr_array_new_with_free_func(g_free);
    const struct new_rig wish = {.id = "r",
                                 .kind = NEW_RIG_DOME,
                                 .n_lamps = 64,
                                 .radius_mm = 300,
                                 .bank = NEW_RIG_SERIAL,
                                 .bank_at = "/dev/ttyACM0",
                                 .camera = NEW_RIG_STILL,
                                 .camera_at = "ptpip:192.168.1.2:15740:15740",
                                 .width = 6000,
                                 .height = 4000,
                                 .bits = 16};
    g_autofree char *text = new_rig_text(&wish, nothing, missing);
    g_autofree struct rig *rig = read_rig(text);
    g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
    int n_lines = 0;
    for (char **line = lines; *line; line++)
        n_lines += **line && **line != '#';
    g_assert_cmpint(n_lines, <=, 25);
    g_assert_cmpuint(missing->len, ==, 0);
    assert_has(text, "\ndriver = serial-lamps\nport = /dev/ttyACM0\n");
    assert_has(text, "\ndriver = gphoto2-camera\nport = ptpip:192.168.1.2:15740:15740\nwidth = "
                     "6000\nheight = 4000\n");
    /* 65536 DN in 1/60 s at π · 0.3² m² per sr */
    g_assert_cmpfloat_with_epsilon(rig->cameras[0].response, 1.1e6, 1);
    /* x to the right of the picture, as in lists of lights */
    g_assert_cmpfloat(rig->cameras[0].rotation.m[0][0], >, 0.999);
    g_assert_cmpfloat(rig->cameras[0].rotation.m[1][1], <, -0.999);
}

/* The lamps of a file, whose positions are in millimetres or are only directions. */
TEST(positions) {
    g_autoptr(GPtrArray) nothing = found_list_new();
    text_file_write(folder, "mm.lp", "2\na 300 0 400\nb 0 300 400\n");
    text_file_write(folder, "far.lp", "2\na 0.6 0 0.8\nb 0 0.6 0.8\n");
    for (int far = 0; far < 2; far++) {
        const struct new_rig wish = {.id = "r",
                                     .kind = NEW_RIG_DOME,
                                     .n_lamps = 2,
                                     .radius_mm = far ? 1000 : 500,
                                     .positions = far ? "far.lp" : "mm.lp",
                                     .far = far};
        g_autoptr(GPtrArray) missing = g_ptr_array_new_with_free_func(g_free);
        g_autofree char *text = new_rig_text(&wish, nothing, missing);
        g_autofree struct rig *rig = read_rig(text);
        g_assert_cmpint(rig->n_lamps, ==, 2);
        g_assert_cmpfloat(fabs(rig->lamps[0].position_mm.x - (far ? 600 : 300)), <, 1e-3);
        g_assert_cmpfloat(fabs(rig->lamps[1].position_mm.y - (far ? 600 : 300)), <, 1e-3);
    }
}

TEST(devices) {
    g_autoptr(GPtrArray) found = plugged(), missing = g_ptr_array_new_with_free_func(g_free);
    const struct new_rig wish = {"r", NEW_RIG_ARC, 5, 400};
    g_autofree char *text = new_rig_text(&wish, found, missing);
    g_autofree struct rig *rig = read_rig(text);

    /* there is one stepper controller for two axes */
    g_assert_cmpuint(missing->len, ==, 1);
    g_assert_nonnull(strstr(missing->pdata[0], "[axis arc]"));
    g_assert_nonnull(strstr(text, "[axis turntable]\ndriver = tic-axis\nserial = 00366\n"));
    g_assert_nonnull(strstr(text, "[lamps arc]\ndriver = usb-relays\npath = 1-3\nn_lamps = 5\n"));
    g_assert_nonnull(strstr(text, "theta_deg = 15; 30; 45; 60; 75\n"));
    g_assert_nonnull(strstr(text, "[camera cam2]\ndriver = aravis\ndevice = 192.168.0.9\n"));
    g_assert_null(strstr(text, "usb-relay-laser"));
    g_assert_cmpint(rig->cameras[0].width, ==, 640);
    /* 640 pixels across 200 mm at 600 mm */
    g_assert_cmpfloat(rig->cameras[0].fx_px, ==, 1920);
    g_assert_cmpfloat(vec3_length(rig_camera_centre_mm(&rig->cameras[1])), <, 600.001);
}

/* A relay board on USB has too few lamps for a dome: a board on the serial line has them. */
TEST(many_lamps) {
    g_autoptr(GPtrArray) found = plugged(), missing = g_ptr_array_new_with_free_func(g_free);
    const struct new_rig wish = {"r", NEW_RIG_DOME, 9, 400};
    g_autofree char *text = new_rig_text(&wish, found, missing);

    g_assert_cmpuint(missing->len, ==, 1);
    g_assert_nonnull(strstr(text, "driver = modbus-relays\nbus = /dev/ttyUSB3\nunit = 1\nn = 9\n"));
    g_assert_null(strstr(text, "axis"));
}
