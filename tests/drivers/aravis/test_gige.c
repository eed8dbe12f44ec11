#include "drivers/recording.h"
#include "lib/camera_open.h"
#include "lib/gige_rig.h"
#include "lib/ok.h"
#include "lib/painted.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/wait.h"

#include <gio/gio.h>
#include <glib-unix.h>
#include <glib/gstdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static VirtualGige *painter(enum cfa cfa) {
    struct virtual_camera_options options = {.serial = "PAINTER",
                                             .width = PAINTED_WIDTH,
                                             .height = PAINTED_HEIGHT,
                                             .bits = 12,
                                             .cfa = cfa,
                                             .black_level = 64,
                                             .picture = painted_paint};
    VirtualGige *device = ok(virtual_gige_new(&options, NULL, ERR));
    return device;
}

/* Every format of every phase, against pixels packed by other code than unpacks them. */
static void formats(gconstpointer data) {
    enum cfa cfa = (enum cfa)GPOINTER_TO_INT(data);
    static const struct eye_depth depths[] = {{"8", 8},         {"10", 10}, {"10p", 10},
                                              {"10Packed", 10}, {"12", 12}, {"12p", 12},
                                              {"12Packed", 12}, {"16", 16}};
    struct eye eye = {.device = painter(cfa)};
    eye_check_formats(&eye, cfa, depths, G_N_ELEMENTS(depths), "packet_size = 1500");
    eye_end(&eye, NULL);
}

TEST(settings) {
    struct eye eye = {.device = painter(CFA_GRBG)};
    struct virtual_camera_state state;
    ok(eye_open(&eye, EYE_PART "black_level_dn = 70\nfeatures = GevSCPD=1000\n", ERR));
    g_assert_cmpfloat(eye.camera->format.black_level, ==, 70);
    g_assert_cmpint(eye.camera->format.min_exposure_us, ==, 10);
    eye_check_part(&eye);
    virtual_gige_state(eye.device, &state);
    eye_check_settings(&state);
    eye_end(&eye, NULL);
}

/* A recording has the registers that the driver has set, and no address of the network. */
TEST(recorded) {
    struct eye eye = {.device = painter(CFA_GRBG)};
    struct virtual_camera_state state;
    recording_begin();
    ok(eye_open(&eye, EYE_PART "black_level_dn = 70\n", ERR));
    eye_check_part(&eye);
    virtual_gige_state(eye.device, &state);
    g_autofree char *address = g_strdup(virtual_gige_address(eye.device));
    eye_end(&eye, NULL);
    g_autofree char *text = recording_end();
    g_assert_nonnull(strstr(text, "\n@1 = genicam\n"));
    /* The exposure of eye_check_part(), as the camera has it. */
    g_autofree char *exposure =
        g_strdup_printf(" 4.n\"\n *[0-9]+ @1 > 00 00 %02x %02x\n",
                        (guint)state.exposure_us >> 8 & 255, (guint)state.exposure_us & 255);
    g_assert_true(g_regex_match_simple(exposure, text, 0, 0));
    g_assert_true(g_regex_match_simple(
        "write 0xd18 4.n\"\n *[0-9]+ @1 - \"4 bytes, not recorded\"\n", text, 0, 0));
    g_assert_null(strstr(text, address));
    g_assert_null(strstr(text, "7f 00 00 01"));
    g_assert_nonnull(strstr(text, "] = frame of 32 x 16 pixels, 12 bits, grbg\n"));
    /* Without a recording, nothing is kept. */
    g_assert_null(recording_end());
}

/* As large as gets through, which is found out. */
TEST(packet_size) {
    struct eye eye = {.device = painter(CFA_MONO)};
    struct virtual_camera_state state;
    for (int mtu = 0; mtu <= 1500; mtu += 1500) {
        struct virtual_camera_faults faults = {.mtu = mtu};
        virtual_gige_fail(eye.device, &faults);
        eye_start(&eye, "", 1000);
        g_assert_cmpint(eye_shoot(&eye, 1), ==, CAMERA_FRAME);
        virtual_gige_state(eye.device, &state);
        g_assert_cmpint(state.packet_size, >, mtu > 0 ? 1450 : 8900);
        g_assert_cmpint(state.packet_size, <=, mtu > 0 ? mtu : 9000);
        eye_close(&eye);
    }
    eye_end(&eye, NULL);
}

static gint64 eye_triggered_us(const struct eye *eye) {
    struct virtual_camera_state state;
    virtual_gige_state(eye->device, &state);
    return state.triggered_us;
}

static void times(struct eye *eye, gconstpointer unused) {
    eye_check_times(eye, 10, 1000, eye_triggered_us);
}

/* Some cameras stamp the end of the exposure. With the right option, the driver computes when the
 * exposure began. */
TEST(stamps_of_the_end) {
    struct eye eye;
    struct virtual_camera_faults faults = {.stamps_end = TRUE};
    struct camera_settings settings = {.exposure_us = 200000};
    eye_begin(&eye, "stamp = end");
    virtual_gige_fail(eye.device, &faults);
    g_assert_true(camera_configure(eye.camera, &settings, NULL));
    eye_check_times(&eye, 1, settings.exposure_us, eye_triggered_us);
    eye_end(&eye, NULL);
    /* Without this option, the driver must not misinterpret the time stamps. */
    eye_begin(&eye, "");
    virtual_gige_fail(eye.device, &faults);
    g_assert_true(camera_configure(eye.camera, &settings, NULL));
    g_assert_cmpint(eye_shoot(&eye, 1), ==, CAMERA_REFUSED);
    eye_assert_said(&eye, DEVICE_ERROR_PROTOCOL, "its time stamp is in the future");
    eye_end(&eye, NULL);
}

/* Returns whether the end of the exposure was told at least 20 ms before the frame. */
static gboolean is_told_early(struct eye *eye, guint64 shot) {
    const int n = eye->n_ended;
    eye->n_exposed = 0;
    eye_trigger(eye, shot);
    conformance_wait(eye->clock, &eye->n_exposed, 1, 5);
    const gint64 exposed_us = clock_now_us(eye->clock);
    const gboolean early = eye->n_ended == n;
    conformance_wait(eye->clock, &eye->n_ended, n + 1, 5);
    g_assert_cmpint(eye->last, ==, CAMERA_FRAME);
    g_assert_cmpint(eye->frame->exposure_end_us, <=, exposed_us);
    return early && clock_now_us(eye->clock) - exposed_us > 20000;
}

/* Lamps may go on while the picture is still being sent. A busy computer may run this program only
 * when the picture is there. */
static void exposed_before_it_is_here(struct eye *eye, gconstpointer unused) {
    guint64 shot = 1;
    for (int i = 0; i < 3; i++)
        UNTIL (is_told_early(eye, shot++))
            ;
}

static void without_clock(struct eye *eye, gconstpointer unused) {
    for (guint64 shot = 1; shot <= 5; shot++)
        g_assert_cmpint(eye_shoot(eye, shot), ==, CAMERA_FRAME);
}

/* Past the kernel's UDP where this process may, else as without. */
static void packet_socket(struct eye *eye, gconstpointer unused) {
    int n_frames = 0;
    /* The ring of a packet socket overflows while the computer is busy, and frames are torn. */
    for (guint64 shot = 1; shot <= 20 && n_frames < 5; shot++) {
        const enum camera_event event = eye_shoot(eye, shot);
        g_assert_true(event == CAMERA_FRAME || event == CAMERA_REFUSED);
        n_frames += event == CAMERA_FRAME;
    }
    g_assert_cmpint(n_frames, ==, 5);
}

struct line {
    VirtualGige *device;
    int fd, pulses;
};

/* The wire from an output to the camera's input. */
static gboolean on_line(gint fd, GIOCondition condition, gpointer data) {
    struct line *line = data;
    char level;
    while (read(fd, &level, 1) == 1)
        if (level == '1') {
            virtual_gige_pulse(line->device);
            line->pulses++;
        }
    return G_SOURCE_CONTINUE;
}

TEST(hardware_trigger) {
    struct eye eye = {.device = eye_device("EYE", 320, 240, CFA_MONO)};
    struct line line = {.device = eye.device};
    TEMPORARY_FOLDER(dir);
    g_autofree char *path = g_build_filename(dir, "value", NULL);
    g_autofree char *keys = g_strdup_printf("trigger = Line0\npulse_path = %s", path);
    g_assert_cmpint(mkfifo(path, 0600), ==, 0);
    line.fd = g_open(path, O_RDWR | O_NONBLOCK | O_CLOEXEC, 0);
    guint source = g_unix_fd_add(line.fd, G_IO_IN, on_line, &line);
    eye_start(&eye, keys, 1000);
    for (guint64 shot = 1; shot <= 5; shot++)
        g_assert_cmpint(eye_shoot(&eye, shot), ==, CAMERA_FRAME);
    g_assert_cmpint(line.pulses, ==, 5);
    g_source_remove(source);
    close(line.fd);
    g_unlink(path);
    g_assert_cmpint(eye_shoot(&eye, 6), ==, CAMERA_FAULT);
    eye_assert_said(&eye, DEVICE_ERROR_PROTOCOL, "cannot make a pulse with");
    eye_end(&eye, NULL);
}

/* On plain sockets, all triggered at the same time, and nothing lost, not even of the first
 * pictures: what is asked for again does not come. */
TEST(eight_at_once) {
    struct eye eyes[8] = {0};
    struct virtual_camera_faults faults = {.no_resend = TRUE};
    for (int i = 0; i < 8; i++) {
        g_autofree char *serial = g_strdup_printf("EIGHT%d", i);
        eyes[i].device = eye_device(serial, 1024, 768, CFA_RGGB);
        virtual_gige_fail(eyes[i].device, &faults);
        eye_start(&eyes[i], "pixel_format = BayerRG8", 1000);
    }
    eye_shoot_together(eyes, 8, 10);
    for (int i = 0; i < 8; i++)
        eye_end(&eyes[i], NULL);
}

TEST(scan) {
    g_autoptr(VirtualGige) device = eye_device("SCANNED", 320, 240, CFA_MONO);
    g_autoptr(GPtrArray) all = aravis_scan();
    gboolean found = FALSE;
    for (guint i = 0; i < all->len; i++) {
        const struct aravis_found *camera = all->pdata[i];
        if (g_strcmp0(camera->address, virtual_gige_address(device)) != 0)
            continue;
        found = TRUE;
        g_assert_cmpstr(camera->serial, ==, "SCANNED");
        g_assert_cmpstr(camera->model, ==, "Mesorig VirtualCamera");
        g_assert_cmpstr(camera->protocol, ==, "GigEVision");
    }
    g_assert_true(found);
}

/* A section that names the serial number finds it wherever it is. */
TEST(by_serial) {
    struct eye eye = {.device = eye_device("BYSERIAL", 320, 240, CFA_MONO)};
    const struct conformance with = {.section = "[camera eye]\ndriver = aravis\n"};
    const struct config_section *section;
    GError *error = NULL;
    g_autoptr(Config) config = conformance_config(&with, "device = BYSERIAL\n", &section);
    g_autoptr(Config) other = conformance_config(&with, "device = NOBODY\n", &section);
    eye.clock = clock_new_real();
    g_assert_null(camera_open(&aravis_camera_driver, section, NULL, eye.clock, &error));
    conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED,
                             "no camera \"NOBODY\" was found");
    section = config_find(config, "camera", "eye");
    eye.camera = ok(camera_open(&aravis_camera_driver, section, NULL, eye.clock, ERR));
    g_assert_true(g_str_has_prefix(eye.camera->device.identity, "Mesorig VirtualCamera"));
    camera_listen(eye.camera, eye_on_event, &eye);
    g_assert_true(eye_ready(&eye, 1000, NULL));
    g_assert_cmpint(eye_shoot(&eye, 1), ==, CAMERA_FRAME);
    eye_end(&eye, NULL);
}

TEST(refused_options) {
    static const struct {
        const char *keys, *said;
    } cases[] = {
        {"pixel_format = RGB8", "./rig.conf:5: [camera eye] pixel_format: \"RGB8\" cannot be"},
        {"pixel_format = BayerGB8", "it does not offer \"BayerGB8\"; choose from: BayerRG8"},
        {"trigger = Line0", "pulse_path: must be given for a trigger by Line0"},
        {"trigger = Line7\npulse_path = /dev/null",
         "trigger: it has no source \"Line7\"; choose from: Line0, Software"},
        {"width = 400", "a region of 400 × 240 at 0, 0 does not fit its sensor of 320 × 240"},
        {"offset_y = 200\nheight = 100", "a region of 320 × 100 at 0, 200 does not fit"},
        {"features = NoSuchThing=1", "features: NoSuchThing=1"},
        {"gain_per_db = nan", "gain_per_db"},
    };
    struct eye eye = {.device = eye_device("EYE", 320, 240, CFA_RGGB)};
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        GError *error = NULL;
        g_assert_false(eye_open(&eye, cases[i].keys, &error));
        if (!strstr(error->message, cases[i].said))
            g_error("said \"%s\", not \"%s\"", error->message, cases[i].said);
        g_clear_error(&error);
        eye_close(&eye);
    }
    eye_end(&eye, NULL);
}

static Camera *set_off(VirtualGige *device, int i, Clock *clock) {
    g_autofree char *text = g_strdup_printf("[camera eye%d]\ndriver = aravis\ndevice = %s\n", i,
                                            virtual_gige_address(device));
    g_autoptr(Config) config = config_parse(text, "./rig.conf", NULL);
    Camera *camera = ok(camera_open_begin(&aravis_camera_driver,
                                          config_find(config, "camera", NULL), NULL, clock, ERR));
    return camera;
}

static gboolean is_controlled(VirtualGige *device) {
    struct virtual_camera_state state;
    virtual_gige_state(device, &state);
    return state.controlled;
}

/* Cameras that answer slowly are opened at the same time. */
TEST(opened_at_once) {
    struct virtual_camera_faults slow = {.answer_us = 10000}, slowest = {.answer_us = 200000};
    VirtualGige *devices[8];
    Camera *cameras[8];
    Clock *clock = clock_new_real();
    for (int i = 0; i < 8; i++) {
        g_autofree char *serial = g_strdup_printf("SLOW%d", i);
        devices[i] = eye_device(serial, 64, 48, CFA_MONO);
        virtual_gige_fail(devices[i], &slow);
    }
    virtual_gige_fail(devices[7], &slowest);
    for (int i = 0; i < 8; i++)
        cameras[i] = set_off(devices[i], i, clock);
    g_assert_false(is_controlled(devices[7])); /* nobody has waited for it */
    virtual_gige_fail(devices[7], &slow);
    /* Before the program waits for the first one, all are being opened. */
    for (int i = 0; i < 8; i++)
        UNTIL (is_controlled(devices[i]))
            g_usleep(1000);
    for (int i = 0; i < 8; i++) {
        ok(camera_open_finish(cameras[i], ERR));
        g_assert_cmpint(cameras[i]->format.width, ==, 64);
    }
    for (int i = 0; i < 8; i++) {
        camera_close(cameras[i]);
        virtual_gige_free(devices[i]);
    }
    clock_unref(clock);
}

/* Closed while it is still being opened. */
TEST(closed_before_opened) {
    VirtualGige *device = eye_device("SLOW", 64, 48, CFA_MONO);
    struct virtual_camera_faults slow = {.answer_us = 10000}, none = {0};
    struct eye eye = {.device = device};
    Clock *clock = clock_new_real();
    virtual_gige_fail(device, &slow);
    camera_close(set_off(device, 0, clock));
    virtual_gige_fail(device, &none);
    eye_start(&eye, "", 1000);
    g_assert_cmpint(eye_shoot(&eye, 1), ==, CAMERA_FRAME);
    eye_end(&eye, NULL);
    clock_unref(clock);
}

static const struct {
    const char *name;
    void (*run)(struct eye *eye, gconstpointer unused);
    const char *keys;
} cases[] = {
    {"/gige/times", times, ""},
    {"/gige/exposed-before-it-is-here", exposed_before_it_is_here,
     "packet_delay_ns = 2000000\npacket_size = 1500"},
    {"/gige/without-clock", without_clock, "stamp = none"},
    {"/gige/packet-socket", packet_socket, "packet_socket = yes"},
};

static VirtualGige *conforming; /* the camera of the conformance suite */
static char *section;

BEFORE_TESTS {
    static struct conformance with = {.name = "gige", .real_clock = TRUE};
    conforming = eye_device("CONFORMANCE", 640, 480, CFA_RGGB);
    with.section = section =
        g_strdup_printf("[camera test]\ndriver = aravis\ndevice = %s\nreadout_ms = 3000\n",
                        virtual_gige_address(conforming));
    conformance_camera(&aravis_camera_driver, &with);
    for (int cfa = CFA_MONO; cfa <= CFA_GBRG; cfa++) {
        g_autofree char *path = g_strdup_printf("/gige/formats/%s", cfa_name((enum cfa)cfa));
        g_test_add_data_func(path, GINT_TO_POINTER(cfa), formats);
    }
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++)
        g_test_add(cases[i].name, struct eye, cases[i].keys, eye_begin, cases[i].run, eye_end);
}

AFTER_TESTS {
    virtual_gige_free(conforming);
    g_free(section);
}
