#include "conformance_private.h"
#include "lib/camera_open.h"
#include "lib/ok.h"
#include "reports.h"

#include <math.h>

struct bench {
    const struct camera_driver *driver;
    const struct conformance *with;
    Clock *clock;
    Camera *camera;
    gint64 exposure_us;
    int n_exposed, n_ended;
    enum camera_event last;
    gint64 exposed_us;
    Frame *frame;
};

static void on_event(Camera *camera, enum camera_event event, Frame *frame, const GError *error,
                     gpointer data) {
    struct bench *bench = data;
    g_assert_cmpint(frame != NULL, ==, event == CAMERA_FRAME);
    g_assert_cmpint(error != NULL, ==, event == CAMERA_REFUSED || event == CAMERA_FAULT);
    if (event == CAMERA_EXPOSED) {
        bench->n_exposed++;
        bench->exposed_us = clock_now_us(bench->clock);
        return;
    }
    g_assert_false(camera_is_waiting(camera));
    bench->n_ended++;
    bench->last = event;
    if (frame) {
        frame_unref(bench->frame);
        bench->frame = frame_ref(frame);
    }
}

static gboolean configure(struct bench *bench, gint64 exposure_us, GError **error) {
    struct camera_settings settings = {exposure_us, 0};
    return camera_configure(bench->camera, &settings, error);
}

static gboolean open_camera(struct bench *bench, gconstpointer driver,
                            const struct conformance *with) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(with, "", &section);
    *bench = (struct bench){reports_of_camera(driver), with, .clock = conformance_clock(with)};
    g_autoptr(GError) error = NULL;
    bench->camera = camera_open(bench->driver, section, NULL, bench->clock, &error);
    if (!conformance_opened(bench->camera, error))
        return FALSE;
    camera_listen(bench->camera, on_event, bench);
    bench->exposure_us =
        with->exposure_us > 0 ? with->exposure_us : bench->camera->format.min_exposure_us;
    return TRUE;
}

static gboolean begin(struct bench *bench, gconstpointer driver, const struct conformance *with) {
    if (!open_camera(bench, driver, with))
        return FALSE;
    ok(configure(bench, bench->exposure_us, ERR));
    ok(camera_arm(bench->camera, ERR));
    g_assert_true(camera_is_armed(bench->camera));
    return TRUE;
}

static void end(struct bench *bench) {
    camera_close(g_steal_pointer(&bench->camera));
    g_clear_pointer(&bench->clock, clock_unref);
    g_clear_pointer(&bench->frame, frame_unref);
}

static void trigger(struct bench *bench, guint64 shot) {
    GError *error = NULL;
    bench->n_exposed = bench->n_ended = 0;
    camera_trigger(bench->camera, shot, &error);
    g_assert_no_error(error);
    g_assert_true(camera_is_waiting(bench->camera));
}

/* Shoots once and checks what must hold for every picture. */
static void shoot(struct bench *bench, guint64 shot) {
    const struct camera_format *format = &bench->camera->format;
    gint64 triggered = clock_now_us(bench->clock);
    trigger(bench, shot);
    conformance_wait(bench->clock, &bench->n_ended, 1, 600);
    g_assert_cmpint(bench->last, ==, CAMERA_FRAME);
    g_assert_cmpint(bench->n_ended, ==, 1);
    g_assert_cmpint(bench->n_exposed, <=, 1);
    const Frame *frame = bench->frame;
    g_assert_cmpuint(frame->shot, ==, shot);
    g_assert_cmpint(frame->exposure_start_us, >=, triggered);
    g_assert_cmpint(frame->exposure_us, ==, bench->exposure_us);
    g_assert_cmpint(frame->exposure_end_us, <=, clock_now_us(bench->clock));
    if (bench->n_exposed)
        g_assert_cmpint(bench->exposed_us, >=, frame->exposure_end_us);
    g_assert_cmpint(frame->width, ==, format->width);
    g_assert_cmpint(frame->height, ==, format->height);
    g_assert_cmpint(frame->cfa, ==, format->cfa);
    for (gsize i = 0; i < (gsize)frame->width * (gsize)frame->height; i++)
        g_assert_cmpuint(frame->pixels[i], <, 1u << frame->bits);
}

static void expect_silence(struct bench *bench, double seconds) {
    bench->n_exposed = bench->n_ended = 0;
    conformance_pass(bench->clock, seconds);
    g_assert_cmpint(bench->n_exposed + bench->n_ended, ==, 0);
}

static void assert_refused(struct bench *bench, enum device_error code) {
    GError *error = NULL;
    g_assert_false(camera_trigger(bench->camera, 99, &error));
    g_assert_error(error, DEVICE_ERROR, (int)code);
    g_clear_error(&error);
}

static void assert_not_configured(struct bench *bench, gint64 exposure_us, enum device_error code) {
    GError *error = NULL;
    g_assert_false(configure(bench, exposure_us, &error));
    g_assert_error(error, DEVICE_ERROR, (int)code);
    g_clear_error(&error);
}

static void wrong_option(struct bench *bench) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(bench->with, "no_such_option = 1\n", &section);
    GError *error = NULL;
    g_assert_null(camera_open(bench->driver, section, NULL, bench->clock, &error));
    conformance_assert_unknown_option(error);
}

static void not_armed(struct bench *bench) {
    const struct camera_driver *driver = bench->driver;
    const struct conformance *with = bench->with;
    end(bench);
    open_camera(bench, driver, with);
    assert_refused(bench, DEVICE_ERROR_UNSUPPORTED);
    g_assert_true(configure(bench, bench->exposure_us, NULL));
    assert_refused(bench, DEVICE_ERROR_UNSUPPORTED);
    expect_silence(bench, 0.3);
}

static void exposures(struct bench *bench) {
    const struct camera_format *format = &bench->camera->format;
    assert_not_configured(bench, 0, DEVICE_ERROR_RANGE);
    assert_not_configured(bench, -1, DEVICE_ERROR_RANGE);
    assert_not_configured(bench, format->min_exposure_us - 1, DEVICE_ERROR_RANGE);
    assert_not_configured(bench, format->max_exposure_us + 1, DEVICE_ERROR_RANGE);
    struct camera_settings settings = {bench->exposure_us, NAN};
    g_assert_false(camera_configure(bench->camera, &settings, NULL));
    shoot(bench, 1);
    bench->exposure_us = MIN(bench->exposure_us * 3, format->max_exposure_us);
    g_assert_true(configure(bench, bench->exposure_us, NULL));
    shoot(bench, 2);
}

static void frames(struct bench *bench) {
    guint64 last = 0;
    for (guint64 shot = 100; shot < 110; shot++) {
        shoot(bench, shot);
        if (shot > 100)
            g_assert_cmpuint(bench->frame->id, >, last);
        last = bench->frame->id;
    }
    expect_silence(bench, 0.5);
}

static void one_at_a_time(struct bench *bench) {
    trigger(bench, 1);
    assert_refused(bench, DEVICE_ERROR_BUSY);
    assert_not_configured(bench, bench->exposure_us + 1, DEVICE_ERROR_BUSY);
    conformance_wait(bench->clock, &bench->n_ended, 1, 600);
    g_assert_cmpint(bench->last, ==, CAMERA_FRAME);
    g_assert_cmpuint(bench->frame->shot, ==, 1);
    expect_silence(bench, 0.5);
}

static void disarm(struct bench *bench) {
    shoot(bench, 1);
    trigger(bench, 2);
    camera_disarm(bench->camera);
    g_assert_false(camera_is_armed(bench->camera));
    g_assert_false(camera_is_waiting(bench->camera));
    expect_silence(bench, 1);
    assert_refused(bench, DEVICE_ERROR_UNSUPPORTED);
    g_assert_true(camera_arm(bench->camera, NULL));
    shoot(bench, 2);
    shoot(bench, 3);
}

static void close_waiting(struct bench *bench) {
    trigger(bench, 1);
    g_clear_pointer(&bench->camera, camera_close);
    expect_silence(bench, 1);
}

static void shoot_once(struct bench *bench) {
    shoot(bench, 1);
}

void conformance_camera(const struct camera_driver *driver, const struct conformance *with) {
    static const struct check checks[] = {
        {"wrong-option", wrong_option, .unopened = TRUE},
        {"not-armed", not_armed},
        {"exposures", exposures},
        {"frames", frames},
        {"one-at-a-time", one_at_a_time},
        {"disarm", disarm},
        {"close-waiting", close_waiting},
        {"open-close", shoot_once, TRUE},
        {NULL},
    };
    static const struct suite suite = {"camera", sizeof(struct bench), begin, end, checks};
    conformance_add(&suite, driver, with);
}
