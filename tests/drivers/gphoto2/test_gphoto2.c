/* DSLR and mirrorless cameras: libgphoto2 with a virtual camera on the loopback interface. What
 * every driver must do, the pictures that arrive, and faults of the camera. */
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/wait.h"

#include "conformance/conformance.h"
#include "gphoto2/gphoto2.h"
#include "virtual/cameras/ptpip.h"

#include <math.h>
#include <signal.h>
#include <string.h>

#define WIDTH  36
#define HEIGHT 24
#define BITS   12
#define BLACK  64

/* A pixel of the PGM for a value of the sensor (drivers/gphoto2/convert.h). */
static int expected(int value) {
    return (int)lround(1024 + (double)(value - BLACK) / ((1 << BITS) - 1 - BLACK) * (65535 - 1024));
}

/* The first pixels are the exposure in units of 100 µs and the number of the picture; the others
 * differ from picture to picture. */
static void paint(const struct virtual_exposure *exposure, gpointer data, guint16 *ret_pixels) {
    for (guint i = 0; i < WIDTH * HEIGHT; i++)
        ret_pixels[i] = (guint16)(100 + (i * 37 + exposure->n * 101) % 3000);
    ret_pixels[0] = (guint16)(BLACK + exposure->exposure_us / 100);
    ret_pixels[1] = (guint16)(BLACK + exposure->n);
}

struct bench {
    VirtualPtpip *device;
    Clock *clock;
    Camera *camera;
    int n_ended, n_exposed;
    enum camera_event last;
    Frame *frame;
    GError *error;
};

static const struct virtual_ptpip_options usual = {.serial = "SN7",
                                                   .width = WIDTH,
                                                   .height = HEIGHT,
                                                   .bits = BITS,
                                                   .cfa = CFA_RGGB,
                                                   .black_level = BLACK,
                                                   .picture = paint};

static void on_event(Camera *camera, enum camera_event event, Frame *frame, const GError *error,
                     gpointer data) {
    struct bench *bench = data;
    if (event == CAMERA_EXPOSED) {
        bench->n_exposed++;
        return;
    }
    bench->n_ended++;
    bench->last = event;
    g_clear_error(&bench->error);
    bench->error = error ? g_error_copy(error) : NULL;
    g_clear_pointer(&bench->frame, frame_unref);
    bench->frame = frame ? frame_ref(frame) : NULL;
}

static char *section_of(const VirtualPtpip *device, const char *keys) {
    return g_strdup_printf("[camera test]\ndriver = gphoto2-camera\nport = %s\nreadout_ms = 500\n"
                           "trigger_ms = 100\n%s",
                           virtual_ptpip_port(device), keys);
}

/* Opens the camera in two steps: the program starts in the first one. */
static gboolean open_begin(struct bench *bench, const char *keys, GError **error) {
    const struct config_section *section;
    g_autofree char *text = section_of(bench->device, keys);
    const struct conformance with = {.section = text};
    g_autoptr(Config) config = conformance_config(&with, "", &section);
    bench->camera = camera_open_begin(&gphoto2_camera_driver, section, NULL, bench->clock, error);
    return bench->camera != NULL;
}

static gboolean open_finish(struct bench *bench, GError **error) {
    if (!camera_open_finish(bench->camera, error))
        return FALSE;
    camera_listen(bench->camera, on_event, bench);
    return TRUE;
}

static gboolean open_bench(struct bench *bench, const char *keys, GError **error) {
    return open_begin(bench, keys, error) && open_finish(bench, error);
}

static void configure(struct bench *bench, gint64 exposure_us) {
    const struct camera_settings settings = {exposure_us, 0};
    ok(camera_configure(bench->camera, &settings, ERR));
}

static void start(struct bench *bench, const struct virtual_ptpip_options *options,
                  const char *keys) {
    *bench = (struct bench){.clock = clock_new_real()};
    bench->device = ok(virtual_ptpip_new(options, ERR));
    ok(open_begin(bench, keys, ERR));
}

static void begin(struct bench *bench, const struct virtual_ptpip_options *options,
                  const char *keys) {
    start(bench, options, keys);
    ok(open_finish(bench, ERR));
    configure(bench, 4000);
    ok(camera_arm(bench->camera, ERR));
}

static void end(struct bench *bench) {
    g_clear_pointer(&bench->camera, camera_close);
    g_clear_pointer(&bench->device, virtual_ptpip_free);
    g_clear_pointer(&bench->clock, clock_unref);
    g_clear_pointer(&bench->frame, frame_unref);
    g_clear_error(&bench->error);
}

static struct virtual_ptpip_state state_of(const struct bench *bench) {
    struct virtual_ptpip_state state;
    virtual_ptpip_state(bench->device, &state);
    return state;
}

static enum camera_event shoot(struct bench *bench, guint64 shot) {
    bench->n_ended = bench->n_exposed = 0;
    ok(camera_arm(bench->camera, ERR));
    ok(camera_trigger(bench->camera, shot, ERR));
    conformance_wait(bench->clock, &bench->n_ended, 1, 60);
    return bench->last;
}

/* Shoots once. The frame must be the picture of the last trigger that the camera has obeyed. */
static void shoot_well(struct bench *bench, guint64 shot, gint64 exposure_us) {
    shoot(bench, shot);
    g_assert_no_error(bench->error);
    g_assert_cmpint(bench->last, ==, CAMERA_FRAME);
    g_assert_cmpint(bench->frame->pixels[0], ==, expected(BLACK + (int)exposure_us / 100));
    g_assert_cmpint(bench->frame->pixels[1], ==, expected(BLACK + state_of(bench).triggers));
}

static void fail(const struct bench *bench, struct virtual_ptpip_faults faults) {
    virtual_ptpip_fail(bench->device, &faults);
}

/* Every pixel, the identity and the exposure. Nothing stays on the card. */
TEST(truth) {
    struct bench bench;
    guint16 painted[WIDTH * HEIGHT];
    begin(&bench, &usual, "iso = 200\naperture = 5.6\n");
    const struct camera_format *format = &bench.camera->format;
    g_assert_cmpint(format->width, ==, WIDTH);
    g_assert_cmpint(format->height, ==, HEIGHT);
    g_assert_cmpint(format->cfa, ==, CFA_RGGB);
    g_assert_cmpint(format->bits, ==, 16);
    g_assert_cmpint(format->min_exposure_us, ==, 100);
    g_assert_cmpint(format->max_exposure_us, ==, 5000000);
    assert_has(bench.camera->device.identity, "SN7");
    g_assert_cmpint(state_of(&bench).iso, ==, 200);
    shoot_well(&bench, 1, 4000);
    g_assert_cmpint(bench.n_exposed, ==, 1);
    g_assert_cmpint(state_of(&bench).shutter_us, ==, 4000);
    const struct virtual_exposure exposure = {.n = (guint64)state_of(&bench).triggers,
                                              .exposure_us = 4000};
    paint(&exposure, NULL, painted);
    for (int i = 0; i < WIDTH * HEIGHT; i++)
        g_assert_cmpint(bench.frame->pixels[i], ==, expected(painted[i]));
    configure(&bench, 100000);
    shoot_well(&bench, 2, 100000);
    g_assert_cmpint(state_of(&bench).on_card, ==, 0);
    g_assert_cmpint(state_of(&bench).connections, ==, 1);
    end(&bench);
}

TEST(exposures) {
    struct bench bench;
    g_autoptr(GError) error = NULL;
    const struct camera_settings settings = {7000, 0};
    begin(&bench, &usual, "");
    g_assert_false(camera_configure(bench.camera, &settings, &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_RANGE);
    assert_has(error->message,
               "cannot expose for 7000 µs; the nearest time that it has is 6000 µs");
    end(&bench);
}

/* Shoots until a picture arrives, as the sequencer does. */
static void recover(struct bench *bench, guint64 shot) {
    UNTIL (shoot(bench, shot) == CAMERA_FRAME) {
        g_assert_nonnull(bench->error);
        g_test_message("%s", bench->error->message);
        conformance_pass(bench->clock, 0.05);
    }
    g_assert_cmpint(bench->frame->pixels[0], ==, expected(BLACK + 40));
    g_assert_cmpint(bench->frame->pixels[1], ==, expected(BLACK + state_of(bench).triggers));
}

/* Each fault comes with the second picture. Afterwards the camera takes pictures again. */
static const struct fault {
    const char *name;
    struct virtual_ptpip_faults faults;
    gint64 exposure_us;
    const char *says; /* NULL: the picture arrives all the same */
    int left;         /* pictures that stay on the card, because the program was killed */
} faults[] = {
    {"busy", {.busy = 1}, 4000, NULL},
    {"always-busy", {.busy = G_MAXINT}, 4000, "the camera stays busy"},
    {"incomplete", {.incomplete = 1}, 4000, NULL},
    {"complete-first", {.complete_first = TRUE}, 4000, NULL},
    {"late", {.late = 1, .late_exposures = 2}, 250000, NULL},
    {"late-after-short", {.late = 1, .late_exposures = 50}, 4000, NULL},
    {"slow", {.slow_us = 90000}, 4000, NULL},
    {"unsaid", {.unsaid = 1}, 4000, NULL},
    {"unsaid-and-incomplete", {.unsaid = 1, .incomplete = 1}, 4000, NULL},
    {"blind", {.blind = 1}, 4000, "the camera has taken no picture"},
    {"blind-battery", {.blind = 1, .battery = 4}, 4000, "battery of the camera is at 4 %"},
    {"unanswered", {.unanswered = 1}, 4000, "did not answer “trigger” within 3104 ms", 1},
    {"dropped", {.dropped = 1}, 4000, NULL},
    {"stalled", {.stalled = 1}, 4000, "did not answer “trigger” within 3104 ms", 1},
    {"full", {.full = TRUE}, 4000, "the card of the camera is full"},
    {"neighbour", {.neighbour = TRUE}, 16000, "shutterspeed = 0.0200s instead of 0.0160s"},
    {"unplugged", {.unplugged = TRUE}, 4000, "cannot be opened"},
};

static void run_fault(gconstpointer data) {
    const struct fault *fault = data;
    struct bench bench;
    begin(&bench, &usual, "");
    shoot_well(&bench, 1, 4000);
    fail(&bench, fault->faults);
    configure(&bench, fault->exposure_us);
    if (!fault->says) {
        shoot_well(&bench, 2, fault->exposure_us);
    } else {
        g_assert_cmpint(shoot(&bench, 2), ==, CAMERA_FAULT);
        g_assert_true(g_str_has_prefix(bench.error->message, "camera test: "));
        assert_has(bench.error->message, fault->says);
    }
    fail(&bench, (struct virtual_ptpip_faults){0});
    configure(&bench, 4000);
    if (fault->says)
        recover(&bench, 3);
    else
        shoot_well(&bench, 3, 4000);
    shoot_well(&bench, 4, 4000);
    g_assert_cmpint(state_of(&bench).on_card, ==, fault->left);
    end(&bench);
}

static const struct fault open_faults[] = {
    {"refuses", {.refuses = TRUE}, 0, "cannot be opened"},
    {"deaf", {.deaf = TRUE}, 0, "cannot be opened"},
    {"unplugged", {.unplugged = TRUE}, 0, "cannot be opened"},
    {"battery", {.battery = 3}, 0, "the battery of the camera is at 3 %; charge it"},
    {"full",
     {.full = TRUE},
     0,
     "the card of the camera is full; copy the pictures and format the card"},
};

static void run_open_fault(gconstpointer data) {
    const struct fault *fault = data;
    struct bench bench = {.clock = clock_new_real()};
    g_autoptr(GError) error = NULL;
    bench.device = ok(virtual_ptpip_new(&usual, ERR));
    fail(&bench, fault->faults);
    g_assert_false(open_bench(&bench, "", &error));
    assert_has(error->message, fault->says);
    end(&bench);
}

/* A setting that the camera does not offer, or does not have. */
static void refuse_setting(const char *keys, const char *says) {
    struct bench bench = {.clock = clock_new_real()};
    g_autoptr(GError) error = NULL;
    bench.device = ok(virtual_ptpip_new(&usual, ERR));
    g_assert_false(open_bench(&bench, keys, &error));
    assert_has(error->message, says);
    end(&bench);
}

TEST(settings) {
    refuse_setting("iso = 300\n", "does not offer iso = 300; the nearest value is 400");
    refuse_setting("aperture = 7\n", "does not offer f-number = 7; the nearest value is f/8");
    refuse_setting("settings = imageformat\n", "“imageformat” is not NAME=VALUE");
    refuse_setting("settings = no-such=1\n", "the camera has no setting no-such");
    refuse_setting("settings = expprogram=Moonlight\n",
                   "does not offer expprogram = Moonlight; choose from: M, P");
    refuse_setting("shutter = f-stop\n", "offers no exposure times in the setting f-stop");
}

/* The camera gives the name of a picture that was removed to a new one. */
TEST(same_name) {
    struct bench bench;
    begin(&bench, &usual, "");
    fail(&bench, (struct virtual_ptpip_faults){.same_name = TRUE});
    for (guint64 shot = 1; shot < 4; shot++)
        shoot_well(&bench, shot, 4000);
    fail(&bench, (struct virtual_ptpip_faults){.same_name = TRUE, .unsaid = 1});
    shoot_well(&bench, 4, 4000);
    end(&bench);
}

/* Pictures by hand are neither taken nor removed. */
TEST(by_hand) {
    struct bench bench = {.clock = clock_new_real()};
    bench.device = ok(virtual_ptpip_new(&usual, ERR));
    virtual_ptpip_put(bench.device, "AAA_0001.DNG", NULL, FALSE);
    virtual_ptpip_put(bench.device, "ZZZ_0001.DNG", NULL, FALSE);
    ok(open_bench(&bench, "", ERR));
    configure(&bench, 4000);
    ok(camera_arm(bench.camera, ERR));
    shoot_well(&bench, 1, 4000);
    fail(&bench, (struct virtual_ptpip_faults){.unsaid = 1});
    shoot_well(&bench, 2, 4000);
    g_assert_cmpint(state_of(&bench).on_card, ==, 2);
    end(&bench);
}

/* A picture that comes before the exposure can be over was taken by hand. */
TEST(by_hand_meanwhile) {
    struct bench bench;
    begin(&bench, &usual, "");
    configure(&bench, 500000);
    bench.n_ended = 0;
    ok(camera_trigger(bench.camera, 1, ERR));
    UNTIL (state_of(&bench).triggers == 2)
        conformance_pass(bench.clock, 0.001);
    virtual_ptpip_put(bench.device, "HAND0001.DNG", NULL, TRUE);
    conformance_wait(bench.clock, &bench.n_ended, 1, 60);
    g_assert_no_error(bench.error);
    g_assert_nonnull(bench.frame);
    g_assert_cmpint(bench.frame->pixels[1], ==, expected(BLACK + 2));
    g_assert_cmpint(state_of(&bench).on_card, ==, 1);
    end(&bench);
}

/* The card is exchanged while the camera is off, and after a shot that was given up: pictures on
 * the new card are neither taken nor removed. */
TEST(other_card) {
    struct bench bench;
    begin(&bench, &usual, "");
    configure(&bench, 250000);
    ok(camera_trigger(bench.camera, 1, ERR));
    conformance_pass(bench.clock, 0.05);
    camera_disarm(bench.camera);
    fail(&bench, (struct virtual_ptpip_faults){.unplugged = TRUE});
    for (int i = 0; i < 5; i++) {
        g_autofree char *name = g_strdup_printf("OLD_%04d.DNG", i);
        virtual_ptpip_put(bench.device, name, "20200131T235959", FALSE);
    }
    fail(&bench, (struct virtual_ptpip_faults){.unsaid = 2});
    configure(&bench, 4000);
    recover(&bench, 2);
    recover(&bench, 3);
    g_assert_cmpint(state_of(&bench).on_card, ==, 5);
    end(&bench);
}

/* The picture that was given up is taken from the card. */
TEST(given_up_exposing) {
    struct bench bench;
    begin(&bench, &usual, "");
    configure(&bench, 250000);
    ok(camera_trigger(bench.camera, 1, ERR));
    UNTIL (state_of(&bench).triggers == 2)
        conformance_pass(bench.clock, 0.001);
    camera_disarm(bench.camera);
    configure(&bench, 4000);
    shoot_well(&bench, 2, 4000);
    g_assert_cmpint(state_of(&bench).triggers, ==, 3);
    g_assert_cmpint(state_of(&bench).on_card, ==, 0);
    end(&bench);
}

/* A trigger that was given up while the camera was busy is not given again. */
TEST(given_up_busy) {
    struct bench bench;
    begin(&bench, &usual, "");
    fail(&bench, (struct virtual_ptpip_faults){.busy = G_MAXINT});
    ok(camera_trigger(bench.camera, 1, ERR));
    conformance_pass(bench.clock, 0.2);
    camera_disarm(bench.camera);
    conformance_pass(bench.clock, 0.2);
    fail(&bench, (struct virtual_ptpip_faults){0});
    shoot_well(&bench, 2, 4000);
    g_assert_cmpint(state_of(&bench).triggers, ==, 2);
    end(&bench);
}

static void signal_program(const struct bench *bench, int number) {
    g_autofree char *argument = g_strdup_printf("--port=%s", virtual_ptpip_port(bench->device));
    g_autoptr(GArray) found = process_find("cmdline", argument);
    g_assert_cmpint(found->len, >, 0);
    for (guint i = 0; i < found->len; i++)
        kill(g_array_index(found, pid_t, i), number);
}

/* The computer stands still, and with it the program and the camera, for longer than a picture may
 * take. This time does not count. */
TEST(standstill) {
    struct bench bench;
    begin(&bench, &usual, "");
    fail(&bench, (struct virtual_ptpip_faults){.slow_us = 1100000});
    bench.n_ended = 0;
    ok(camera_trigger(bench.camera, 1, ERR));
    UNTIL (state_of(&bench).triggers == 2)
        conformance_pass(bench.clock, 0.001);
    signal_program(&bench, SIGSTOP);
    conformance_pass(bench.clock, 1);
    signal_program(&bench, SIGCONT);
    conformance_wait(bench.clock, &bench.n_ended, 1, 60);
    g_assert_no_error(bench.error);
    g_assert_nonnull(bench.frame);
    g_assert_cmpint(bench.frame->pixels[1], ==, expected(BLACK + 2));
    end(&bench);
}

/* The camera is switched off and on while nothing is asked of it. */
TEST(off_and_on) {
    struct bench bench;
    begin(&bench, &usual, "iso = 200\n");
    shoot_well(&bench, 1, 4000);
    fail(&bench, (struct virtual_ptpip_faults){.unplugged = TRUE});
    conformance_pass(bench.clock, 0.1);
    fail(&bench, (struct virtual_ptpip_faults){0});
    shoot_well(&bench, 2, 4000);
    end(&bench);
}

/* Somebody turns the dials between two pictures: they are set back. */
TEST(dials) {
    struct bench bench;
    begin(&bench, &usual, "iso = 200\n");
    shoot_well(&bench, 1, 4000);
    virtual_ptpip_turn_dials(bench.device, 100000, 800);
    shoot_well(&bench, 2, 4000);
    g_assert_cmpint(state_of(&bench).iso, ==, 200);
    end(&bench);
}

TEST(keep_on_card) {
    struct bench bench;
    begin(&bench, &usual, "keep_on_card = yes\n");
    shoot_well(&bench, 1, 4000);
    fail(&bench, (struct virtual_ptpip_faults){.unsaid = 1});
    shoot_well(&bench, 2, 4000);
    g_assert_cmpint(state_of(&bench).on_card, ==, 3); /* with the first one, at the opening */
    end(&bench);
}

/* A raw file and a JPEG for each picture: the raw file counts, and both are removed. */
TEST(raw_and_jpeg) {
    struct bench bench;
    struct virtual_ptpip_options options = usual;
    options.both = TRUE;
    begin(&bench, &options, "");
    for (guint64 shot = 1; shot < 4; shot++)
        shoot_well(&bench, shot, 4000);
    fail(&bench, (struct virtual_ptpip_faults){.unsaid = 1});
    shoot_well(&bench, 5, 4000);
    g_assert_cmpint(state_of(&bench).on_card, ==, 0);
    end(&bench);
}

/* The first picture is not announced. */
TEST(first_unsaid) {
    struct bench bench = {.clock = clock_new_real()};
    struct virtual_ptpip_options options = usual;
    options.both = TRUE;
    bench.device = ok(virtual_ptpip_new(&options, ERR));
    virtual_ptpip_put(bench.device, "AAA_0001.DNG", NULL, FALSE);
    fail(&bench, (struct virtual_ptpip_faults){.unsaid = 1});
    ok(open_bench(&bench, "", ERR));
    configure(&bench, 4000);
    shoot_well(&bench, 1, 4000);
    g_assert_cmpint(bench.camera->format.cfa, ==, CFA_RGGB);
    g_assert_cmpint(state_of(&bench).on_card, ==, 1);
    end(&bench);
}

/* 8 bits of sRGB become linear again, within one step of the JPEG. */
static void paint_flat(const struct virtual_exposure *exposure, gpointer data,
                       guint16 *ret_pixels) {
    for (guint i = 0; i < WIDTH * HEIGHT; i++)
        ret_pixels[i] = (guint16)(1000 + 500 * (exposure->n % 5));
    ret_pixels[WIDTH * HEIGHT - 1]++;
}

TEST(jpeg) {
    struct bench bench;
    struct virtual_ptpip_options options = usual;
    options.jpeg = TRUE;
    options.picture = paint_flat;
    begin(&bench, &options, "");
    g_assert_cmpint(bench.camera->format.cfa, ==, CFA_MONO);
    for (guint64 shot = 1; shot < 3; shot++) {
        g_assert_cmpint(shoot(&bench, shot), ==, CAMERA_FRAME);
        const int value = 1000 + 500 * (state_of(&bench).triggers % 5);
        /* An sRGB step at a value v of 0 to 1 is at most 2.4 v ^ (1.4 / 2.4) / 1.055 / 255. */
        g_assert_cmpint(ABS(bench.frame->pixels[0] - expected(value)), <, 65535 * 0.009);
    }
    end(&bench);
}

TEST(nikon) {
    struct bench bench;
    struct virtual_ptpip_options options = usual;
    options.nikon = TRUE;
    begin(&bench, &options, "");
    shoot_well(&bench, 1, 4000);
    configure(&bench, 100000);
    shoot_well(&bench, 2, 100000);
    fail(&bench, (struct virtual_ptpip_faults){.busy = 1, .incomplete = 1});
    shoot_well(&bench, 3, 100000);
    fail(&bench, (struct virtual_ptpip_faults){.dropped = 1});
    shoot_well(&bench, 4, 100000);
    g_assert_cmpint(state_of(&bench).on_card, ==, 0);
    end(&bench);
}

/* Pictures are only in the camera's memory. Their names begin again with each connection. */
TEST(nikon_memory) {
    struct bench bench;
    struct virtual_ptpip_options options = usual;
    options.nikon = options.memory = TRUE;
    begin(&bench, &options, "");
    shoot_well(&bench, 1, 4000);
    shoot_well(&bench, 2, 4000);
    fail(&bench, (struct virtual_ptpip_faults){.unplugged = TRUE});
    conformance_pass(bench.clock, 0.1);
    fail(&bench, (struct virtual_ptpip_faults){0});
    shoot_well(&bench, 3, 4000);
    fail(&bench, (struct virtual_ptpip_faults){.dropped = 1});
    recover(&bench, 4);
    shoot_well(&bench, 5, 4000);
    g_assert_cmpint(state_of(&bench).on_card, ==, 0);
    end(&bench);
}

#define N_TOGETHER 4

static gboolean all_ended(const struct bench *benches) {
    for (int i = 0; i < N_TOGETHER; i++)
        if (benches[i].n_ended == 0)
            return FALSE;
    return TRUE;
}

/* Several cameras at the same time, each on an address of its own. They are opened at the same
 * time, as a rig does, because a program that nobody asks for 10 s ends. */
TEST(together) {
    struct bench benches[N_TOGETHER];
    for (int i = 0; i < N_TOGETHER; i++) {
        g_autofree char *host = g_strdup_printf("127.0.0.%d", i + 2);
        struct virtual_ptpip_options options = usual;
        options.host = host;
        start(&benches[i], &options, "");
    }
    for (int i = 0; i < N_TOGETHER; i++) {
        ok(open_finish(&benches[i], ERR));
        configure(&benches[i], 4000);
        ok(camera_arm(benches[i].camera, ERR));
    }
    for (guint64 shot = 1; shot < 4; shot++) {
        for (int i = 0; i < N_TOGETHER; i++) {
            benches[i].n_ended = 0;
            ok(camera_trigger(benches[i].camera, shot, ERR));
        }
        UNTIL (all_ended(benches))
            g_main_context_iteration(NULL, TRUE);
        for (int i = 0; i < N_TOGETHER; i++) {
            g_assert_no_error(benches[i].error);
            g_assert_cmpint(benches[i].last, ==, CAMERA_FRAME);
            g_assert_cmpint(benches[i].frame->pixels[1], ==,
                            expected(BLACK + state_of(&benches[i]).triggers));
        }
    }
    for (int i = 0; i < N_TOGETHER; i++)
        end(&benches[i]);
}

/* A virtual camera at an address that is none, and at one of another computer. */
TEST(no_address) {
    static const char *const hosts[][2] = {
        {"nowhere", "virtual camera nowhere: this is not an IPv4 address"},
        {"192.0.2.1", "virtual camera 192.0.2.1: no socket can be opened at this address"}};
    for (gsize i = 0; i < G_N_ELEMENTS(hosts); i++) {
        struct virtual_ptpip_options options = usual;
        g_autoptr(GError) error = NULL;
        options.host = hosts[i][0];
        g_assert_null(virtual_ptpip_new(&options, &error));
        assert_has(error->message, hosts[i][1]);
    }
}

#define MAX_RECOVERY_S 5

/* After a picture was given up at any time, with any fault, the next one arrives within 5 s, and
 * it is not the one that was given up. MESORIG_ABORTS is the number of pictures given up. */
TEST(given_up) {
    static const struct virtual_ptpip_faults kinds[] = {{.busy = 1},
                                                        {.incomplete = 1},
                                                        {.unsaid = 1},
                                                        {.dropped = 1},
                                                        {.stalled = 1},
                                                        {.late = 1, .late_exposures = 2},
                                                        {.blind = 1},
                                                        {.unanswered = 1},
                                                        {.complete_first = TRUE},
                                                        {0},
                                                        {.busy = G_MAXINT},
                                                        {0}};
    static const gint64 exposures_us[] = {1000, 16000, 100000, 250000, 500000};
    const char *wanted = g_getenv("MESORIG_ABORTS");
    const int n = wanted ? atoi(wanted) : 5;
    g_autoptr(GRand) rand = g_rand_new_with_seed(7);
    double longest_s = 0;
    struct bench bench;
    begin(&bench, &usual, "");
    for (int i = 0; i < n; i++) {
        const int kind = g_rand_int_range(rand, 0, G_N_ELEMENTS(kinds));
        const gint64 exposure_us = exposures_us[g_rand_int_range(rand, 0, 5)];
        const double wait_s = g_rand_double_range(rand, 0, (double)exposure_us / 1e6 + 0.1);
        fail(&bench, kinds[kind]);
        configure(&bench, exposure_us);
        ok(camera_arm(bench.camera, ERR));
        ok(camera_trigger(bench.camera, 1000 + (guint64)i, ERR));
        conformance_pass(bench.clock, wait_s);
        const gint64 begin_us = g_get_monotonic_time();
        camera_disarm(bench.camera);
        fail(&bench, (struct virtual_ptpip_faults){0});
        configure(&bench, 4000);
        recover(&bench, (guint64)i);
        const double s = (double)(g_get_monotonic_time() - begin_us) / 1e6;
        longest_s = MAX(longest_s, s);
        g_test_message("fault %d, %g s of %g s: %.2f s", kind, wait_s, (double)exposure_us / 1e6,
                       s);
        g_assert_cmpfloat(s, <, MAX_RECOVERY_S);
    }
    g_print("# the next picture after %d that were given up: at most %.2f s\n", n, longest_s);
    end(&bench);
}

static char *home; /* for the settings of libgphoto2, which the programs inherit */
static VirtualPtpip *model;
static struct conformance conformance = {
    .name = "gphoto2-camera", .real_clock = TRUE, .exposure_us = 2000};

BEFORE_TESTS {
    home = remove_tree_begin();
    g_setenv("HOME", home, TRUE);
    model = ok(virtual_ptpip_new(&usual, ERR));
    conformance.section = section_of(model, "");
    conformance_camera(&gphoto2_camera_driver, &conformance);
    for (gsize i = 0; i < G_N_ELEMENTS(faults); i++) {
        g_autofree char *path = g_strdup_printf("/gphoto2/fault/%s", faults[i].name);
        g_test_add_data_func(path, &faults[i], run_fault);
    }
    for (gsize i = 0; i < G_N_ELEMENTS(open_faults); i++) {
        g_autofree char *path = g_strdup_printf("/gphoto2/open/%s", open_faults[i].name);
        g_test_add_data_func(path, &open_faults[i], run_open_fault);
    }
}

AFTER_TESTS {
    g_free((gpointer)conformance.section);
    virtual_ptpip_free(model);
    remove_tree_end(&home);
}
