/* mesorig new-rig with devices that it asks for: the rig file names them, and mesorig test finds
 * every device as it should be. The devices are models, in real time. The camera is a program that
 * sees whether any lamp is lit. */
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/rig_daemon.h"
#include "lib/test.h"
#include "lib/text_file.h"
#include "virtual/cameras/ptpip.h"
#include "virtual/dmx_node.h"
#include "virtual/gcode.h"
#include "virtual/leds.h"
#include "virtual/wled.h"

#include <glib/gstdio.h>
#include <string.h>

#define N_LAMPS 4

enum bank { SERIAL, ARTNET, SACN, WLED };

struct bench {
    enum bank bank;
    VirtualGcode *board; /* NULL if the rig has no axes */
    VirtualLeds *leds;
    VirtualDmx *node;
    VirtualWled *wled;
    char *seen; /* file in which the camera looks for lamps that are lit */
    GThread *mirror;
    int quit;
};

static gboolean is_lit(const struct bench *bench) {
    struct virtual_leds_state leds;
    struct virtual_dmx_state dmx;
    struct virtual_wled_state wled;
    switch (bench->bank) {
    case SERIAL:
        virtual_leds_state(bench->leds, &leds);
        return leds.lit;
    case WLED:
        virtual_wled_state(bench->wled, &wled);
        return wled.lit;
    default:
        virtual_dmx_state(bench->node, &dmx);
        return dmx.lit;
    }
}

/* Shows the light of the models to the camera. */
static gpointer mirror(gpointer data) {
    struct bench *bench = data;
    int before = -1;
    while (!g_atomic_int_get(&bench->quit)) {
        const int lit = is_lit(bench);
        if (lit != before)
            ok(g_file_set_contents(bench->seen, lit ? "{\"on\": [true]}" : "{\"on\": [false]}", -1,
                                   ERR));
        before = lit;
        g_usleep(1000);
    }
    return NULL;
}

static void begin(struct bench *bench, const char *folder, int language, enum bank bank) {
    const struct virtual_gcode_options gcode = {.language =
                                                    (enum virtual_gcode_language)MAX(language, 0),
                                                .n_axes = 3,
                                                .units_s = 200,
                                                .units_s2 = 2000,
                                                .steps = 1000,
                                                .emergency_parser = TRUE,
                                                .boot_ms = 200,
                                                .resets_on_open = language == VIRTUAL_MARLIN};
    const struct virtual_leds_options leds = {.n = N_LAMPS, .dark_ms = 2000};
    const struct virtual_dmx_options dmx = {
        .sacn = bank == SACN, .address = virtual_dmx_address(1), .universe = 1, .n = 1};
    g_autofree char *lamps = g_build_filename(folder, "lamps", NULL);
    g_autofree char *camera = g_build_filename(folder, "camera", NULL);
    *bench = (struct bench){.bank = bank};
    bench->board = language >= 0 ? ok(virtual_gcode_new(&gcode, ERR)) : NULL;
    if (bank == SERIAL)
        bench->leds = ok(virtual_leds_new(&leds, ERR));
    else if (bank == WLED)
        bench->wled = ok(virtual_wled_new(virtual_dmx_address(1), N_LAMPS, ERR));
    else
        bench->node = ok(virtual_dmx_new(&dmx, ERR));
    g_assert_cmpint(g_mkdir(lamps, 0700) + g_mkdir(camera, 0700), ==, 0);
    bench->seen = g_build_filename(lamps, "hardware.json", NULL);
    bench->mirror = g_thread_new("mirror", mirror, bench);
}

static void end(struct bench *bench) {
    g_atomic_int_set(&bench->quit, 1);
    g_thread_join(bench->mirror);
    virtual_gcode_free(bench->board);
    virtual_leds_free(bench->leds);
    virtual_dmx_free(bench->node);
    virtual_wled_free(bench->wled);
    g_free(bench->seen);
}

static char *bank_option(const struct bench *bench) {
    switch (bench->bank) {
    case SERIAL:
        return g_strdup_printf("serial:%s", virtual_leds_port(bench->leds));
    case WLED:
        return g_strdup_printf("wled:%s:%d", virtual_dmx_address(1),
                               virtual_wled_http_port(bench->wled));
    default:
        return g_strdup_printf("%s:%s", bench->bank == SACN ? "sacn" : "artnet",
                               virtual_dmx_address(1));
    }
}

static void replace(GString *text, const char *from, const char *to) {
    g_assert_cmpuint(g_string_replace(text, from, to, 0), ==, 1);
}

/* language is −1 for a rig without axes. says is what the rig file says about the board. n is the
 * number of devices that are tested. */
static void tries(const char *kind, int language, enum bank bank, const char *says, int n) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    struct rig_daemon run;
    begin(&bench, folder, language, bank);
    g_autofree char *path = g_build_filename(folder, "new.conf", NULL);
    g_autofree char *lamps = bank_option(&bench);
    g_autofree char *axes =
        bench.board ? g_strdup_printf("--axes gcode:%s", virtual_gcode_port(bench.board))
                    : g_strdup("--axes tic");
    g_autofree char *told = process_mesorig(
        0,
        "new-rig %s --kind %s --lamps %d --radius 400 %s --bank %s --cameras "
        "program:/usr/bin/python3;" SOURCE_DIR "/tests/drivers/program/model.py;camera;%s/camera",
        path, kind, N_LAMPS, axes, lamps, folder);
    g_assert_null(strstr(told, "not found"));
    g_autofree char *text = text_file_read(path);
    assert_has(text, says);
    assert_has(text, "\nwidth = 8\nheight = 6\n"); /* the camera was asked */
    /* Two programs share the loopback interface here. */
    g_autoptr(GString) rig = g_string_new(text);
    if (bank != SERIAL) {
        g_autofree char *local =
            g_strdup_printf("\nlocal_address = %s\nn = ", virtual_dmx_address(0));
        replace(rig, "\nn = ", local);
    }
    rig_daemon_begin(&run, folder, rig->str);
    g_autofree char *tested = process_mesorig(0, "test --address %s", run.address);
    g_autofree char *all = g_strdup_printf("%d of %d are as they should be", n, n);
    assert_has(tested, all);
    assert_has(tested, "seen by 1 of 1 cameras");
    rig_daemon_end(&run);
    end(&bench);
}

TEST(grbl_artnet) {
    tries("turntable", VIRTUAL_GRBL, ARTNET,
          "# GRBL\n[axis turntable]\ndriver = gcode-axis\n"
          "dialect = grbl\n",
          N_LAMPS + 2);
}

TEST(marlin_serial) {
    tries("arc", VIRTUAL_MARLIN, SERIAL,
          "# Marlin 2.1.2 (Jan 1 2023)\n[axis arc]\ndriver = gcode-axis\ndialect = marlin\n",
          N_LAMPS + 3);
}

TEST(klipper_wled) {
    tries("arc", VIRTUAL_KLIPPER, WLED,
          "# Klipper v0.13.0-300-g1234567\n[axis turntable]\ndriver = gcode-axis\ndialect = "
          "klipper\n",
          N_LAMPS + 3);
}

TEST(dome_sacn) {
    tries("dome", -1, SACN, "[lamps dome]\ndriver = sacn-lamps\naddress = ", N_LAMPS + 1);
}

/* A still camera on the network tells its size. */
TEST(still_camera) {
    TEMPORARY_FOLDER(folder);
    const struct virtual_ptpip_options options = {
        .serial = "s", .width = 32, .height = 24, .bits = 12, .cfa = CFA_MONO};
    g_autoptr(VirtualPtpip) still = ok(virtual_ptpip_new(&options, ERR));
    g_autofree char *path = g_build_filename(folder, "new.conf", NULL);
    g_autofree char *told = process_mesorig(0,
                                            "new-rig %s --kind dome --lamps 64 --radius 400 --bank "
                                            "serial:/dev/ttyACM0 --cameras still:%s",
                                            path, virtual_ptpip_port(still));
    g_assert_null(strstr(told, "not found"));
    g_autofree char *text = text_file_read(path),
                    *port = g_strdup_printf(
                        "\ndriver = gphoto2-camera\nport = %s\nwidth = 32\nheight = 24\n",
                        virtual_ptpip_port(still));
    assert_has(text, port);
    /* no camera is there: the size remains to be checked */
    virtual_ptpip_fail(still, &(struct virtual_ptpip_faults){.unplugged = TRUE});
    g_autofree char *without = process_mesorig(0,
                                               "new-rig %s --force --kind dome --lamps 64 --radius "
                                               "400 --bank serial:/dev/ttyACM0 --cameras still:%s",
                                               path, virtual_ptpip_port(still));
    assert_has(without, virtual_ptpip_port(still));
    g_autofree char *unknown = text_file_read(path);
    assert_has(unknown, "# CHECK: size of its pictures, in pixels\nwidth = 1920\nheight = 1080\n");
}

/* A port without a board is named as such. */
TEST(silent_board) {
    TEMPORARY_FOLDER(folder);
    const struct virtual_gcode_options options = {
        .n_axes = 3, .units_s = 1, .units_s2 = 1, .steps = 1};
    g_autoptr(VirtualGcode) board = ok(virtual_gcode_new(&options, ERR));
    virtual_gcode_fail(board, &(struct virtual_gcode_faults){.cut = TRUE});
    const char *port = virtual_gcode_port(board);
    g_autofree char *path = g_build_filename(folder, "new.conf", NULL);
    g_autofree char *told = process_mesorig(
        0,
        "new-rig %s --kind turntable --lamps 2 --radius 400 --axes gcode:%s --bank relays "
        "--cameras found",
        path, port);
    assert_has(told, "not found: a G-code board at ");
    assert_has(told, "no board with GRBL, Marlin or Klipper answers at 115200 or 250000 baud");
    g_autofree char *text = text_file_read(path);
    assert_has(text, "# NOT FOUND: a G-code board at ");
    assert_has(text, "# CHECK: language of the board: grbl, marlin or klipper\ndialect = grbl\n");
}

static char *home;

BEFORE_TESTS {
    home = g_dir_make_tmp("mesorig-new-rig-XXXXXX", NULL);
    g_setenv("HOME", home, TRUE); /* for the settings of libgphoto2 */
}

AFTER_TESTS {
    remove_tree(home);
    g_free(home);
}
