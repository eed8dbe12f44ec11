#include "lib/gige_rig.h"
#include "lib/lock_keeper.h"
#include "lib/test.h"

#include <arpa/inet.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

/* What the operator sees of each fault, and what ends the fault. */

static void loss(struct eye *eye, gconstpointer unused) {
    struct virtual_camera_state state;
    struct virtual_camera_faults faults = {.loss = 0.01};
    virtual_gige_fail(eye->device, &faults);
    for (guint64 shot = 1; shot <= 40; shot++)
        g_assert_cmpint(eye_shoot(eye, shot), ==, CAMERA_FRAME);
    virtual_gige_state(eye->device, &state);
    g_assert_cmpuint(state.packets, >, 40 * 78);
    g_assert_cmpuint(state.lost, >, 10);
    g_assert_cmpuint(state.resent, >, 10);
    g_assert_cmpuint(state.pictures, ==, 40);
}

static void loss_without_resend(struct eye *eye, gconstpointer unused) {
    struct virtual_camera_faults faults = {.loss = 0.01, .no_resend = TRUE}, none = {0};
    int refused = 0;
    virtual_gige_fail(eye->device, &faults);
    for (guint64 shot = 1; shot <= 12; shot++) {
        if (eye_shoot(eye, shot) == CAMERA_FRAME)
            continue;
        g_assert_cmpint(eye->last, ==, CAMERA_REFUSED);
        eye_assert_said(eye, DEVICE_ERROR_PROTOCOL, "some of its data was lost on the way");
        refused++;
    }
    g_assert_cmpint(refused, >, 0);
    virtual_gige_fail(eye->device, &none);
    g_assert_cmpint(eye_shoot(eye, 20), ==, CAMERA_FRAME);
}

static void cut(struct eye *eye, gconstpointer unused) {
    struct virtual_camera_faults faults = {.cut = 1};
    g_assert_cmpint(eye_shoot(eye, 1), ==, CAMERA_FRAME);
    virtual_gige_fail(eye->device, &faults);
    g_assert_cmpint(eye_shoot(eye, 2), ==, CAMERA_REFUSED);
    eye_assert_said(eye, DEVICE_ERROR_PROTOCOL, "some of its data was lost on the way");
    g_assert_cmpint(eye_shoot(eye, 2), ==, CAMERA_FRAME);
    g_assert_cmpuint(eye->frame->shot, ==, 2);
}

static void old_picture(struct eye *eye, gconstpointer unused) {
    struct virtual_camera_faults faults = {.old = 1};
    g_assert_cmpint(eye_shoot(eye, 1), ==, CAMERA_FRAME);
    virtual_gige_fail(eye->device, &faults);
    g_assert_cmpint(eye_shoot(eye, 2), ==, CAMERA_FAULT);
    eye_assert_said(eye, DEVICE_ERROR_STALE, "before its trigger, and no frame after that");
    eye_recover(eye, 2);
}

/* One that comes too late for its own trigger is not taken for the next one's answer. */
static void late_picture(struct eye *eye, gconstpointer unused) {
    struct virtual_camera_faults faults = {.late_us = 300000}, none = {0};
    virtual_gige_fail(eye->device, &faults);
    eye_trigger(eye, 1);
    conformance_pass(eye->clock, 0.1);
    virtual_gige_fail(eye->device, &none);
    conformance_pass(eye->clock, 0.15);
    camera_disarm(eye->camera);
    g_assert_true(camera_arm(eye->camera, NULL));
    eye_recover(eye, 2);
    g_assert_cmpuint(eye->frame->shot, ==, 2);
}

static void stamp_in_the_future(struct eye *eye, gconstpointer unused) {
    struct virtual_camera_faults faults = {.ahead_us = 500000}, none = {0};
    virtual_gige_fail(eye->device, &faults);
    g_assert_cmpint(eye_shoot(eye, 1), ==, CAMERA_REFUSED);
    eye_assert_said(eye, DEVICE_ERROR_PROTOCOL, "its time stamp is in the future");
    virtual_gige_fail(eye->device, &none);
    g_assert_cmpint(eye_shoot(eye, 1), ==, CAMERA_FRAME);
}

static void another_size(struct eye *eye, gconstpointer unused) {
    struct virtual_camera_faults faults = {.odd = 1};
    virtual_gige_fail(eye->device, &faults);
    g_assert_cmpint(eye_shoot(eye, 1), ==, CAMERA_FAULT);
    eye_assert_said(eye, DEVICE_ERROR_PROTOCOL, "its frame has 318 × 240 pixels of the format");
    eye_recover(eye, 1);
}

/* Told to be over too early: lamps may have been switched while it still exposed. */
static void exposed_longer_than_said(struct eye *eye, gconstpointer unused) {
    struct virtual_camera_faults faults = {.announces = TRUE}, slow = {0};
    virtual_gige_fail(eye->device, &faults);
    for (guint64 shot = 1; shot <= 3; shot++) /* announced, but as quick as it says */
        g_assert_cmpint(eye_shoot(eye, shot), ==, CAMERA_FRAME);
    slow = faults;
    slow.slow_us = 2000000; /* longer than this program is held up on a busy computer */
    virtual_gige_fail(eye->device, &slow);
    g_assert_cmpint(eye_shoot(eye, 4), ==, CAMERA_FAULT);
    eye_assert_said(eye, DEVICE_ERROR_PROTOCOL,
                    "ms after the end that trigger_ms and the exposure time give; increase "
                    "trigger_ms");
    virtual_gige_fail(eye->device, &faults);
    eye_recover(eye, 4);
}

static void no_picture(struct eye *eye, gconstpointer unused) {
    struct virtual_camera_faults faults = {.blind = 1};
    virtual_gige_fail(eye->device, &faults);
    g_assert_cmpint(eye_shoot(eye, 1), ==, CAMERA_FAULT);
    eye_assert_said(eye, DEVICE_ERROR_TIMEOUT, " s after the trigger (exposure 1000 µs)");
    g_assert_false(camera_is_armed(eye->camera));
    eye_recover(eye, 1);
}

static void control_stolen(struct eye *eye, gconstpointer unused) {
    g_assert_cmpint(eye_shoot(eye, 1), ==, CAMERA_FRAME);
    virtual_gige_steal(eye->device, TRUE);
    g_assert_cmpint(eye_shoot(eye, 2), ==, CAMERA_FAULT);
    eye_assert_said(eye, DEVICE_ERROR_DISCONNECTED, "no other program uses the camera");
    g_assert_false(camera_is_armed(eye->camera));
    eye_expect_lost(eye, DEVICE_ERROR_BUSY,
                    "camera eye: another program controls the camera; end that program");
    virtual_gige_steal(eye->device, FALSE);
    eye_recover(eye, 2);
}

/* Off and on again: its registers are as they were delivered. */
static void power_lost(struct eye *eye, gconstpointer unused) {
    struct virtual_camera_state state;
    g_assert_cmpint(eye_shoot(eye, 1), ==, CAMERA_FRAME);
    int n = eye->n_ended;
    virtual_gige_restart(eye->device, 300);
    conformance_wait(eye->clock, &eye->n_ended, n + 1, 10);
    g_assert_cmpint(eye->last, ==, CAMERA_FAULT);
    eye_assert_said(eye, DEVICE_ERROR_DISCONNECTED, "control of the camera was lost");
    eye_recover(eye, 2);
    virtual_gige_state(eye->device, &state);
    g_assert_cmpint(state.exposure_us, ==, 1000);
    g_assert_false(state.automatic);
}

static void unplugged(struct eye *eye, gconstpointer unused) {
    struct virtual_camera_faults faults = {.unplugged = TRUE}, none = {0};
    virtual_gige_fail(eye->device, &faults);
    g_assert_cmpint(eye_shoot(eye, 1), ==, CAMERA_FAULT);
    eye_assert_said(eye, DEVICE_ERROR_TIMEOUT, "check the camera's cable");
    eye_expect_lost(eye, DEVICE_ERROR_TIMEOUT, "it does not answer");
    virtual_gige_fail(eye->device, &none);
    eye_recover(eye, 1);
}

/* The daemon has died and starts again while the camera still believes in its heartbeat. */
TEST(restarted_within_heartbeat) {
    static const guint8 take_control[] = {0x42, 1, 0, 0x82, 0, 8, 0, 1, 0, 0, 0x0a, 0, 0, 0, 0, 2};
    struct eye eye = {.device = eye_device("EYE", 320, 240, CFA_RGGB)};
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons(3956)};
    struct virtual_camera_state state;
    inet_pton(AF_INET, virtual_gige_address(eye.device), &to.sin_addr);
    int fd = socket(AF_INET, SOCK_DGRAM, 0);
    sendto(fd, take_control, sizeof take_control, 0, (struct sockaddr *)&to, sizeof to);
    do
        virtual_gige_state(eye.device, &state);
    while (!state.controlled);
    close(fd);
    gint64 start = g_get_monotonic_time();
    eye_start(&eye, "", 1000);
    g_assert_cmpint(g_get_monotonic_time() - start, >, 2 * G_USEC_PER_SEC);
    g_assert_cmpint(eye_shoot(&eye, 1), ==, CAMERA_FRAME);
    eye_end(&eye, NULL);
}

TEST(in_use) {
    struct eye eye = {.device = eye_device("EYE", 320, 240, CFA_RGGB)};
    GError *error = NULL;
    virtual_gige_steal(eye.device, TRUE);
    g_assert_false(eye_open(&eye, "", &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_BUSY);
    g_assert_cmpstr(error->message, ==,
                    "camera eye: another program controls the camera; end that program");
    g_clear_error(&error);
    eye_end(&eye, NULL);
}

/* Another daemon has it, and may not control it at this moment. */
static void locked(void) {
    struct eye eye = {.device = eye_device("EYE", 320, 240, CFA_RGGB)};
    g_autofree char *key = g_strconcat("gige ", virtual_gige_address(eye.device), NULL);
    GSubprocess *keeper = lock_keeper_start(key);
    GError *error = NULL;
    g_assert_false(eye_open(&eye, "", &error));
    lock_keeper_expect(keeper, &error);
    lock_keeper_end(keeper);
    eye_close(&eye);
    eye_start(&eye, "", 1000);
    g_assert_cmpint(eye_shoot(&eye, 1), ==, CAMERA_FRAME);
    eye_end(&eye, NULL);
}

TEST(not_there) {
    struct eye eye = {.device = eye_device("EYE", 320, 240, CFA_RGGB)};
    struct virtual_camera_faults faults = {.unplugged = TRUE};
    GError *error = NULL;
    virtual_gige_fail(eye.device, &faults);
    g_assert_false(eye_open(&eye, "", &error));
    conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED,
                             "no camera answers at 127.");
    eye_end(&eye, NULL);
}

static void exposure_it_cannot_keep(struct eye *eye, gconstpointer unused) {
    struct virtual_camera_faults faults = {.rounding_us = 700};
    struct camera_settings settings = {.exposure_us = 2000}, fits = {.exposure_us = 2100};
    virtual_gige_fail(eye->device, &faults);
    g_assert_true(camera_configure(eye->camera, &settings, NULL));
    g_assert_cmpint(eye_shoot(eye, 1), ==, CAMERA_FAULT);
    eye_assert_said(eye, DEVICE_ERROR_RANGE,
                    "it exposes for 2100.0 µs instead of the requested 2000 µs");
    /* Told again, since the class does not set anew what it has set. */
    g_assert_true(camera_arm(eye->camera, NULL));
    g_assert_true(camera_configure(eye->camera, &settings, NULL));
    g_assert_cmpint(eye_shoot(eye, 1), ==, CAMERA_FAULT);
    g_assert_true(camera_arm(eye->camera, NULL));
    g_assert_true(camera_configure(eye->camera, &fits, NULL));
    g_assert_cmpint(eye_shoot(eye, 1), ==, CAMERA_FRAME);
}

static const struct {
    const char *name;
    void (*run)(struct eye *eye, gconstpointer unused);
    const char *keys;
} cases[] = {
    {"/gige/loss", loss, "packet_size = 1500\nretention_ms = 2000"},
    {"/gige/loss-without-resend", loss_without_resend, "packet_size = 1500\nretention_ms = 50"},
    {"/gige/cut", cut, "retention_ms = 50"},
    {"/gige/old-picture", old_picture, ""},
    {"/gige/late-picture", late_picture, ""},
    {"/gige/stamp-in-the-future", stamp_in_the_future, ""},
    {"/gige/another-size", another_size, ""},
    {"/gige/exposed-longer-than-said", exposed_longer_than_said,
     "trigger_ms = 200\nretention_ms = 10000"},
    {"/gige/no-picture", no_picture, ""},
    {"/gige/control-stolen", control_stolen, ""},
    {"/gige/power-lost", power_lost, ""},
    {"/gige/unplugged", unplugged, ""},
    {"/gige/exposure-it-cannot-keep", exposure_it_cannot_keep, ""},
};

BEFORE_TESTS {
    g_test_add_func("/gige/locked", locked);
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++)
        g_test_add(cases[i].name, struct eye, cases[i].keys, eye_begin, cases[i].run, eye_end);
}
