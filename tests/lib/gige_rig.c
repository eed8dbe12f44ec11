#include "gige_rig.h"
#include "lib/camera_open.h"
#include "lib/ok.h"
#include "lib/painted.h"
#include "lib/wait.h"

/* The time that a frame takes on a busy computer. The driver waits three times as long for a frame,
 * and then for 2 s longer. */
#define READOUT_MS "1000"
/* number of times that the driver reads the clock of a camera; it uses the quickest answer */
#define CLOCK_ASKED 5
#define ROUNDING_US 20 /* rounding error of the clocks and of the time stamps */

VirtualGige *eye_device(const char *serial, int width, int height, enum cfa cfa) {
    struct virtual_camera_options options = {.serial = serial,
                                             .width = width,
                                             .height = height,
                                             .bits = 12,
                                             .cfa = cfa,
                                             .black_level = 64};
    VirtualGige *device = ok(virtual_gige_new(&options, NULL, ERR));
    return device;
}

void eye_on_event(Camera *camera, enum camera_event event, Frame *frame, const GError *error,
                  gpointer data) {
    struct eye *eye = data;
    if (event == CAMERA_EXPOSED) {
        eye->n_exposed++;
        return;
    }
    eye->last = event;
    eye->n_ended++;
    eye->n_frames += event == CAMERA_FRAME;
    g_clear_error(&eye->error);
    eye->error = error ? g_error_copy(error) : NULL;
    g_clear_pointer(&eye->frame, frame_unref);
    eye->frame = frame ? frame_ref(frame) : NULL;
}

gboolean eye_open(struct eye *eye, const char *keys, GError **error) {
    g_autofree char *text = g_strdup_printf(
        "[camera eye]\ndriver = aravis\ndevice = %s\nreadout_ms = " READOUT_MS "\n%s\n",
        eye->where ? eye->where : virtual_gige_address(eye->device), keys);
    g_autoptr(Config) config = config_parse(text, "./rig.conf", NULL);
    eye->clock = clock_new_real();
    eye->camera = camera_open(&aravis_camera_driver, config_find(config, "camera", "eye"), NULL,
                              eye->clock, error);
    if (eye->camera)
        camera_listen(eye->camera, eye_on_event, eye);
    return eye->camera != NULL;
}

gboolean eye_ready(struct eye *eye, gint64 exposure_us, GError **error) {
    struct camera_settings settings = {.exposure_us = exposure_us};
    return camera_configure(eye->camera, &settings, error) && camera_arm(eye->camera, error);
}

void eye_start(struct eye *eye, const char *keys, gint64 exposure_us) {
    ok(eye_open(eye, keys, ERR));
    ok(eye_ready(eye, exposure_us, ERR));
}

void eye_begin(struct eye *eye, gconstpointer keys) {
    *eye = (struct eye){.device = eye_device("EYE", 320, 240, CFA_RGGB)};
    eye_start(eye, keys, 1000);
}

void eye_close(struct eye *eye) {
    g_clear_pointer(&eye->camera, camera_close);
    g_clear_pointer(&eye->clock, clock_unref);
    g_clear_pointer(&eye->frame, frame_unref);
    g_clear_error(&eye->error);
}

void eye_end(struct eye *eye, gconstpointer unused) {
    eye_close(eye);
    virtual_gige_free(eye->device);
}

void eye_trigger(struct eye *eye, guint64 shot) {
    ok(camera_trigger(eye->camera, shot, ERR));
}

enum camera_event eye_shoot(struct eye *eye, guint64 shot) {
    int n = eye->n_ended;
    eye_trigger(eye, shot);
    conformance_wait(eye->clock, &eye->n_ended, n + 1, 10);
    return eye->last;
}

void eye_shoot_together(struct eye *eyes, int n, int shots) {
    for (int shot = 1; shot <= shots; shot++) {
        for (int i = 0; i < n; i++)
            eye_trigger(&eyes[i], (guint64)shot);
        for (int i = 0; i < n; i++)
            conformance_wait(eyes[i].clock, &eyes[i].n_ended, shot, 10);
    }
    for (int i = 0; i < n; i++)
        g_assert_cmpint(eyes[i].n_frames, ==, shots);
}

void eye_recover(struct eye *eye, guint64 shot) {
    UNTIL (camera_arm(eye->camera, NULL) && eye_shoot(eye, shot) == CAMERA_FRAME)
        conformance_pass(eye->clock, 0.1);
}

void eye_expect_lost(struct eye *eye, enum device_error code, const char *words) {
    g_autoptr(GError) error = NULL;
    UNTIL (g_error_matches(error, DEVICE_ERROR, (int)code) && strstr(error->message, words)) {
        conformance_pass(eye->clock, 0.1);
        g_clear_error(&error);
        if (camera_arm(eye->camera, &error))
            camera_disarm(eye->camera);
    }
}

/* The driver reads the clock of an armed camera, and later from time to time before a trigger. The
 * quickest of CLOCK_ASKED answers took at most 1 / CLOCK_ASKED of the time in which all of them
 * came. The mapping is wrong by at most half the time of this answer. */
void eye_check_times(struct eye *eye, int shots, gint64 exposure_us,
                     gint64 (*triggered_us)(const struct eye *eye)) {
    gint64 since_us, longest_us = 0;
    camera_disarm(eye->camera);
    since_us = g_get_monotonic_time();
    ok(camera_arm(eye->camera, ERR));
    for (int shot = 1; shot <= shots; shot++) {
        g_assert_cmpint(eye_shoot(eye, (guint64)shot), ==, CAMERA_FRAME);
        const gint64 at_us = triggered_us(eye), off_us = eye->frame->exposure_start_us - at_us;
        longest_us = MAX(longest_us, at_us - since_us);
        since_us = at_us;
        g_assert_cmpint(ABS(off_us), <=, longest_us / CLOCK_ASKED / 2 + ROUNDING_US);
        g_assert_cmpint(eye->frame->exposure_end_us - eye->frame->exposure_start_us, ==,
                        exposure_us);
    }
}

void eye_check_formats(struct eye *eye, enum cfa cfa, const struct eye_depth *depths, int n,
                       const char *more) {
    static const char *const phases[] = {"Mono", "BayerRG", "BayerBG", "BayerGR", "BayerGB"};
    for (int i = 0; i < n; i++) {
        g_autofree char *key =
            g_strdup_printf("pixel_format = %s%s\n%s", phases[cfa], depths[i].name, more);
        eye_start(eye, key, 100);
        g_assert_cmpint(eye->camera->format.cfa, ==, (int)cfa);
        g_assert_cmpint(eye->camera->format.bits, ==, depths[i].bits);
        g_assert_cmpint(eye_shoot(eye, (guint64)i), ==, CAMERA_FRAME);
        painted_assert(eye->frame, 0, 0, 0);
        eye_close(eye);
    }
}

void eye_check_part(struct eye *eye) {
    struct camera_settings wanted = {.exposure_us = 1234, .gain_db = 6.25}, more = {1234, 24.5};
    g_autoptr(GError) error = NULL;
    g_assert_cmpint(eye->camera->format.max_exposure_us, ==, 60000000);
    g_assert_false(camera_configure(eye->camera, &more, &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_RANGE);
    g_assert_cmpstr(error->message, ==,
                    "camera eye: cannot have a gain of 24.5 dB, only 0 to 24 dB; correct gain_db");
    g_assert_true(camera_configure(eye->camera, &wanted, NULL));
    g_assert_true(camera_arm(eye->camera, NULL));
    g_assert_cmpint(eye_shoot(eye, 1), ==, CAMERA_FRAME);
    g_assert_cmpint(eye->frame->width, ==, 32);
    g_assert_cmpint(eye->frame->height, ==, 16);
    painted_assert(eye->frame, 4, 6, 8); /* black raised by 8 */
}

void eye_check_settings(const struct virtual_camera_state *state) {
    g_assert_cmpint(state->exposure_us, ==, 1234);
    g_assert_cmpfloat_with_epsilon(state->gain_db, 6.25, 0.01);
    g_assert_cmpfloat_with_epsilon(state->black_level, 72, 0.1);
    g_assert_false(state->automatic);
}
