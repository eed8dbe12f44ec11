/* USB3 Vision: the driver's camera looks through a virtual one on a USB that umockdev pretends. */
#include "lib/gige_rig.h"
#include "lib/ok.h"
#include "lib/painted.h"
#include "lib/test.h"
#include "lib/wait.h"

#include "virtual/cameras/u3v.h"
#include "virtual/testbed.h"

#include <string.h>

static VirtualU3v *plug_in(const char *serial, int port, int width, int height, enum cfa cfa) {
    struct virtual_camera_options options = {.serial = serial,
                                             .width = width,
                                             .height = height,
                                             .bits = 12,
                                             .cfa = cfa,
                                             .black_level = 64,
                                             .picture =
                                                 width == PAINTED_WIDTH ? painted_paint : NULL};
    return virtual_u3v_new(&options, port);
}

static VirtualU3v *begin(struct eye *eye, const char *keys) {
    VirtualU3v *device = plug_in("EYE", 1, 320, 240, CFA_RGGB);
    *eye = (struct eye){.where = virtual_u3v_serial(device)};
    eye_start(eye, keys, 1000);
    return device;
}

/* Every phase of every filter array, packed and plain. */
TEST(formats) {
    static const struct eye_depth depths[] = {{"8", 8}, {"12p", 12}};
    for (int cfa = CFA_MONO; cfa <= CFA_GBRG; cfa++) {
        g_autoptr(VirtualU3v) device =
            plug_in("PAINTER", 1, PAINTED_WIDTH, PAINTED_HEIGHT, (enum cfa)cfa);
        struct eye eye = {.where = "PAINTER"};
        eye_check_formats(&eye, (enum cfa)cfa, depths, G_N_ELEMENTS(depths), "");
    }
}

TEST(settings) {
    g_autoptr(VirtualU3v) device = plug_in("PAINTER", 1, PAINTED_WIDTH, PAINTED_HEIGHT, CFA_GRBG);
    struct eye eye = {.where = "PAINTER"};
    struct virtual_camera_state state;
    ok(eye_open(&eye, EYE_PART, ERR));
    eye_check_part(&eye);
    virtual_u3v_state(device, &state);
    eye_check_settings(&state);
    eye_close(&eye);
}

/* Larger than one transfer. */
TEST(large) {
    g_autoptr(VirtualU3v) device = plug_in("LARGE", 1, 1280, 960, CFA_RGGB);
    struct eye eye = {.where = "LARGE"};
    eye_start(&eye, "pixel_format = BayerRG12", 1000);
    for (guint64 shot = 1; shot <= 3; shot++) {
        g_assert_cmpint(eye_shoot(&eye, shot), ==, CAMERA_FRAME);
        g_assert_cmpuint(eye.frame->pixels[1280 * 960 - 1], ==,
                         (1279 * 3 + 959 * 7 + (guint)shot * 11) & 0xfff);
    }
    eye_close(&eye);
}

static VirtualU3v *timed; /* the camera of times() */

static gint64 timed_triggered_us(const struct eye *eye) {
    struct virtual_camera_state state;
    virtual_u3v_state(timed, &state);
    return state.triggered_us;
}

TEST(times) {
    struct eye eye;
    timed = begin(&eye, "");
    eye_check_times(&eye, 10, 1000, timed_triggered_us);
    eye_close(&eye);
    g_clear_pointer(&timed, virtual_u3v_free);
}

TEST(several) {
    VirtualU3v *devices[4];
    struct eye eyes[4] = {0};
    for (int i = 0; i < 4; i++) {
        g_autofree char *serial = g_strdup_printf("SEVERAL%d", i);
        devices[i] = plug_in(serial, i + 1, 1024, 768, CFA_RGGB);
        eyes[i].where = virtual_u3v_serial(devices[i]);
        eye_start(&eyes[i], "pixel_format = BayerRG8", 1000);
    }
    eye_shoot_together(eyes, 4, 5);
    for (int i = 0; i < 4; i++) {
        eye_close(&eyes[i]);
        virtual_u3v_free(devices[i]);
    }
}

TEST(scan) {
    g_autoptr(VirtualU3v) device = plug_in("SCANNED", 1, 320, 240, CFA_MONO);
    g_autoptr(GPtrArray) all = aravis_scan();
    gboolean found = FALSE;
    for (guint i = 0; i < all->len; i++) {
        const struct aravis_found *camera = all->pdata[i];
        if (g_strcmp0(camera->serial, "SCANNED") != 0)
            continue;
        found = TRUE;
        g_assert_null(camera->address);
        g_assert_cmpstr(camera->model, ==, "Mesorig VirtualCamera");
        g_assert_cmpstr(camera->protocol, ==, "USB3Vision");
    }
    g_assert_true(found);
}

/* What the operator sees of each fault, and how it ends. */

static void assert_retaken(const char *keys, const struct virtual_camera_faults *faults,
                           const char *said) {
    struct eye eye;
    g_autoptr(VirtualU3v) device = begin(&eye, keys);
    g_assert_cmpint(eye_shoot(&eye, 1), ==, CAMERA_FRAME);
    virtual_u3v_fail(device, faults);
    g_assert_cmpint(eye_shoot(&eye, 2), !=, CAMERA_FRAME);
    if (!strstr(eye.error->message, said))
        g_error("said \"%s\", not \"%s\"", eye.error->message, said);
    eye_recover(&eye, 2);
    g_assert_cmpuint(eye.frame->shot, ==, 2);
    eye_close(&eye);
}

TEST(incomplete) {
    static const struct {
        struct virtual_camera_faults faults;
        const char *said;
    } cases[] = {
        {{.cut = 1}, "frame refused: some of its data was lost on the way"},
        {{.hollow = 1}, "frame refused: some of its data was lost on the way"},
        {{.stunted = 1}, "some of its data was lost"},
        {{.tailless = 1}, " s after the trigger (exposure 1000 µs)"},
        {{.headless = 1}, " s after the trigger (exposure 1000 µs)"},
        {{.odd = 1}, "its frame has 318 × 240 pixels of the format"},
        {{.old = 1}, "before its trigger, and no frame after that"},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++)
        assert_retaken("", &cases[i].faults, cases[i].said);
}

TEST(stamp_in_the_future) {
    struct eye eye;
    struct virtual_camera_faults faults = {.ahead_us = 500000}, none = {0};
    g_autoptr(VirtualU3v) device = begin(&eye, "");
    virtual_u3v_fail(device, &faults);
    g_assert_cmpint(eye_shoot(&eye, 1), ==, CAMERA_REFUSED);
    eye_assert_said(&eye, DEVICE_ERROR_PROTOCOL, "its time stamp is in the future");
    virtual_u3v_fail(device, &none);
    g_assert_cmpint(eye_shoot(&eye, 1), ==, CAMERA_FRAME);
    eye_close(&eye);
}

/* In the middle of an exposure; plugged in again, it is set up as before. */
TEST(unplugged) {
    struct eye eye;
    struct virtual_camera_state state;
    struct camera_settings settings = {.exposure_us = 3000000};
    g_autoptr(VirtualU3v) device = begin(&eye, "");
    g_assert_cmpint(eye_shoot(&eye, 1), ==, CAMERA_FRAME);
    g_assert_true(camera_configure(eye.camera, &settings, NULL));
    virtual_u3v_state(device, &state);
    const gint64 before_us = state.triggered_us;
    eye_trigger(&eye, 2);
    UNTIL (state.triggered_us != before_us) {
        conformance_pass(eye.clock, 0.01);
        virtual_u3v_state(device, &state);
    }
    conformance_pass(eye.clock, 0.1);
    virtual_u3v_unplug(device);
    conformance_wait(eye.clock, &eye.n_ended, 2, 3);
    g_assert_cmpint(eye.last, ==, CAMERA_FAULT);
    eye_assert_said(&eye, DEVICE_ERROR_DISCONNECTED, "check the camera's power and cable");
    eye_expect_lost(&eye, DEVICE_ERROR_DISCONNECTED, "no camera \"EYE\" was found");
    virtual_u3v_plug(device);
    eye_recover(&eye, 2);
    virtual_u3v_state(device, &state);
    g_assert_cmpint(state.exposure_us, ==, 3000000);
    g_assert_false(state.automatic);
    eye_close(&eye);
}

TEST(unplugged_idle) {
    struct eye eye;
    g_autoptr(VirtualU3v) device = begin(&eye, "");
    g_assert_cmpint(eye_shoot(&eye, 1), ==, CAMERA_FRAME);
    camera_disarm(eye.camera);
    conformance_pass(eye.clock, 0.2);
    virtual_u3v_unplug(device);
    eye_expect_lost(&eye, DEVICE_ERROR_DISCONNECTED, "");
    virtual_u3v_plug(device);
    eye_recover(&eye, 1);
    eye_close(&eye);
}

/* The stream's endpoint stalls, and goes on stalling until somebody clears it. */
TEST(stream_stalls) {
    struct eye eye;
    g_autoptr(VirtualU3v) device = begin(&eye, "");
    g_assert_cmpint(eye_shoot(&eye, 1), ==, CAMERA_FRAME);
    virtual_u3v_halt_stream(device);
    g_assert_cmpint(eye_shoot(&eye, 2), ==, CAMERA_FAULT);
    eye_assert_said(&eye, DEVICE_ERROR_TIMEOUT, " s after the trigger (exposure 1000 µs)");
    eye_recover(&eye, 2);
    eye_close(&eye);
}

/* Aravis 0.8 joins a thread that it has not begun, and is told so by GLib, when a camera leaves off
 * answering while it is being opened. */
static gboolean is_fatal(const char *domain, GLogLevelFlags level, const char *message,
                         gpointer data) {
    return !strstr(message, "g_thread_join: assertion 'thread' failed");
}

/* Every transfer stalls, or is not answered, or in part, for a while. */
static void bus_fails(gconstpointer data) {
    struct eye eye;
    enum virtual_usb_fault fault = (enum virtual_usb_fault)GPOINTER_TO_INT(data);
    /* Aravis sends the trigger several times before it gives up. That takes longer than a frame on
     * a busy computer. */
    g_autoptr(VirtualU3v) device = begin(&eye, "trigger_ms = 20000");
    g_test_log_set_fatal_handler(is_fatal, NULL);
    g_assert_cmpint(eye_shoot(&eye, 1), ==, CAMERA_FRAME);
    virtual_usb_set_fault(virtual_u3v_usb(device), fault);
    g_assert_cmpint(eye_shoot(&eye, 2), ==, CAMERA_FAULT);
    eye_assert_said(&eye, DEVICE_ERROR_TIMEOUT, "check its");
    conformance_pass(eye.clock, 3);
    g_assert_false(camera_arm(eye.camera, NULL));
    virtual_usb_set_fault(virtual_u3v_usb(device), VIRTUAL_USB_WELL);
    eye_recover(&eye, 2);
    eye_close(&eye);
}

TEST(not_there) {
    struct eye eye = {.where = "NOBODY"};
    g_autoptr(VirtualU3v) device = plug_in("EYE", 1, 320, 240, CFA_RGGB);
    GError *error = NULL;
    g_assert_false(eye_open(&eye, "", &error));
    conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED,
                             "no camera \"NOBODY\" was found");
    eye_close(&eye);
}

static VirtualU3v *conforming; /* the camera of the conformance suite */

BEFORE_TESTS {
    static const struct conformance with = {
        .name = "u3v",
        .section = "[camera test]\ndriver = aravis\ndevice = CONFORMANCE\nreadout_ms = 3000\n",
        .real_clock = TRUE};
    conforming = plug_in("CONFORMANCE", 9, 640, 480, CFA_RGGB);
    conformance_camera(&aravis_camera_driver, &with);
    g_test_add_data_func("/u3v/stalls", GINT_TO_POINTER(VIRTUAL_USB_STALLS), bus_fails);
    g_test_add_data_func("/u3v/silent", GINT_TO_POINTER(VIRTUAL_USB_SILENT), bus_fails);
    g_test_add_data_func("/u3v/short-answers", GINT_TO_POINTER(VIRTUAL_USB_SHORT), bus_fails);
}

AFTER_TESTS {
    virtual_u3v_free(conforming);
}

int main(int argc, char **argv) {
    testbed_enter(argv);
    return tests_run(argc, argv);
}
