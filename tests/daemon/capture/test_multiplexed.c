/* Sessions whose lamps are taken in groups, several of them lit at once: a dome of sixteen dim LEDs
 * over a flat sample, captured both ways and compared with the same world without noise. */
#include "calibration/calibration.h"
#include "exr/exr.h"
#include "lib/capture_run.h"

#include <math.h>
#include <string.h>

#define LAMPS  16
#define SIZE   32
#define WELL_E 15000.0 /* of the sensor, whose noise the calibration is told */
#define READ_E 40.0
#define BLACK  64.0

struct dome {
    const char *multiplex; /* [lights] multiplex */
    double intensity;      /* of the LEDs, W/sr */
    const char *exposures_us, *lamps_more, *rig_more;
    gboolean noise, calibrated;
};

static void dome_write(const struct run *run, const char *name, const GString *text) {
    g_autofree char *path = g_build_filename(run->directory, name, NULL);
    g_assert_true(g_file_set_contents(path, text->str, -1, NULL));
}

static void dome_calibrate(struct run *run) {
    g_autoptr(Calibration) calibration = calibration_new(&run->devices->geometry);
    g_autofree char *path = g_build_filename(run->directory, "calibration.conf", NULL);
    g_autoptr(GError) error = NULL;
    for (int c = 0; c < 2; c++) {
        calibration->noise[c].known = TRUE;
        calibration->noise[c].transfer = (struct transfer){.black_dn = BLACK,
                                                           .gain_dn_e = (4095 - BLACK) / WELL_E,
                                                           .read_noise_e = READ_E,
                                                           .quality = 1,
                                                           .n_points = 10};
    }
    g_assert_true(calibration_write(calibration, path, &error));
    g_assert_no_error(error);
}

static void dome_files(struct run *run, const struct dome *dome) {
    g_autoptr(GString) rig = g_string_new("[rig]\nid = dome\nclock = virtual\n");
    g_autoptr(GString) world = g_string_new(NULL), session = g_string_new(NULL);
    g_string_append_printf(rig, "%s%s", dome->rig_more ? dome->rig_more : "lamps_at_once = 8\n",
                           dome->calibrated ? "calibration = calibration.conf\n" : "");
    g_string_append_printf(rig, "[lamps bank]\ndriver = sim-lamps\nworld = world.conf\n%s",
                           dome->lamps_more ? dome->lamps_more : "");
    g_string_append_printf(world,
                           "[world]\nseed = 7\nsupersample = 1\ngather_rays = 0\nwarm_up_s = 0.05\n"
                           "noise = %s\n[sample]\nkind = flat\nwidth_mm = 50\nheight_mm = 50\n",
                           dome->noise ? "yes" : "no");
    for (int c = 0; c < 2; c++) {
        g_autofree char *place =
            g_strdup_printf("theta_deg = %d\nphi_deg = %d\ndistance_mm = 650\nwidth = %d\n"
                            "height = %d\nfocal_px = 333\nresponse = 6000\n",
                            10 + 20 * c, 90 * c, SIZE, SIZE);
        g_string_append_printf(
            rig, "[camera cam%d]\ndriver = sim-camera\nworld = world.conf\nreadout_ms = 5\n%s", c,
            place);
        g_string_append_printf(world,
                               "[camera cam%d]\n%sfull_well_e = %g\nread_noise_e = %g\n"
                               "black_level = %g\n",
                               c, place, WELL_E, READ_E, BLACK);
    }
    for (int i = 0; i < LAMPS; i++) {
        g_autofree char *place = g_strdup_printf(
            "theta_deg = %d\nphi_deg = %d\ndistance_mm = 400\nexponent = 2\nintensity = %g\n",
            20 + 3 * i, 137 * i % 360, dome->intensity);
        g_string_append_printf(rig, "[lamp led%d]\nbank = bank\nindex = %d\n%s", i, i, place);
        g_string_append_printf(world, "[lamp led%d]\n%s", i, place);
    }
    g_string_append_printf(session,
                           "[session]\nname = dome\n[sample]\nwidth_mm = 50\nheight_mm = 50\n"
                           "texels = 8\nreference_mm = 0\ndepth_mm = 0\n[views]\ndevices = all\n"
                           "[lights]\ndevices = all\nmultiplex = %s\n[capture]\nexposures_us = %s\n"
                           "on_blocked = skip\n",
                           dome->multiplex, dome->exposures_us);
    dome_write(run, "rig.conf", rig);
    dome_write(run, "world.conf", world);
    dome_write(run, "session.conf", session);
}

static struct run *dome_new(const struct dome *dome) {
    struct run *run = run_new(NULL);
    g_autofree char *path = g_build_filename(run->directory, "session.conf", NULL);
    g_autoptr(GError) error = NULL;
    dome_files(run, dome);
    devices_close(run->devices);
    session_conf_clear(&run->conf);
    run_open_devices(run);
    if (dome->calibrated)
        dome_calibrate(run);
    g_assert_true(session_conf_load(&run->conf, path, &error));
    g_assert_no_error(error);
    return run;
}

/* The dome with other devices, opened anew. */
static void dome_change(struct run *run, const struct dome *dome) {
    devices_close(run->devices);
    dome_files(run, dome);
    run_open_devices(run);
}

static struct plan *dome_plan(const struct run *run) {
    g_autoptr(GError) error = NULL;
    struct plan *plan = capture_plan(run->devices, &run->conf, &error);
    g_assert_no_error(error);
    return plan;
}

static const struct dome dim = {"auto", 0.01, "400000", NULL, NULL, TRUE, TRUE};
static const struct dome alone = {"no", 0.01, "400000", NULL, NULL, TRUE, TRUE};
static const struct dome exact = {"no", 0.01, "400000", NULL, NULL, FALSE, TRUE};

static gboolean dome_says(const struct plan *plan, const char *words) {
    for (guint i = 0; i < plan->notes->len; i++)
        if (strstr(plan->notes->pdata[i], words))
            return TRUE;
    return FALSE;
}

static const char *dome_note(const struct plan *plan) {
    for (guint i = 0; i < plan->notes->len; i++)
        if (strstr(plan->notes->pdata[i], "multiplex"))
            return plan->notes->pdata[i];
    return "nothing";
}

/* The plan takes what pays, says so, and refuses what cannot be. */
static void test_multiplexed_choice(void) {
    const struct {
        struct dome dome;
        int n;
        const char *says;
    } cases[] = {
        {dim, 15, "1 group of 15 lamps, of which 8 are lit at once"},
        {{"auto", 20, "400000", NULL, NULL, TRUE, TRUE}, 0, "photons make most of the noise"},
        {{"auto", 0.01, "400000", NULL, NULL, TRUE, FALSE}, 0, "noise of the cameras is not known"},
        {{"auto", 0.01, "400000", NULL, "lamps_at_once = 4\n", TRUE, TRUE}, 7, "2 groups of 7"},
        {{"auto", 0.01, "400000", NULL, "", TRUE, TRUE}, 0, "the rig file does not allow more"},
        {{"7", 0.01, "400000", NULL, NULL, TRUE, FALSE}, 7, "is not known"},
        {{"7", 20, "400000", NULL, NULL, TRUE, TRUE}, 7, "white sample would saturate"},
        {{"auto", 0.01, "50", NULL, NULL, TRUE, TRUE}, 0, "light is not what takes the time"},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        struct run *run = dome_new(&cases[i].dome);
        g_autoptr(Plan) plan = dome_plan(run);
        g_test_message("%s", dome_note(plan));
        g_assert_cmpint(plan->multiplex.n, ==, cases[i].n);
        g_assert_true(dome_says(plan, cases[i].says));
        g_assert_true(cases[i].n == 0 || strcmp(cases[i].dome.multiplex, "auto") ||
                      plan->predicted_s < plan->alone_s);
        run_free(run);
    }
    const struct {
        const char *multiplex, *rig_more, *says;
    } refused[] = {{"19", NULL, "19 lamps cannot be lit at once"},
                   {"7", "lamps_at_once = 3\n", "need 4 of them lit at once"}};
    for (gsize i = 0; i < G_N_ELEMENTS(refused); i++) {
        struct run *run = dome_new(&(struct dome){refused[i].multiplex, 0.01, "400000", NULL,
                                                  refused[i].rig_more, TRUE, TRUE});
        g_autoptr(GError) error = NULL;
        g_assert_null(capture_plan(run->devices, &run->conf, &error));
        g_assert_nonnull(strstr(error->message, refused[i].says));
        run_free(run);
    }
    struct session_conf conf;
    g_autoptr(GError) error = NULL;
    g_assert_false(session_conf_parse(
        &conf,
        "[session]\nname=a\n[sample]\nwidth_mm=5\nheight_mm=5\ntexels=4\nreference_mm=1\n"
        "depth_mm=1\n[views]\nrings=0:1\n[lights]\ndevices=all\nmultiplex=9\n[capture]\n"
        "exposures_us=10\n",
        "s.conf", &error));
    g_assert_nonnull(strstr(error->message, "take 7 or 11"));
}

/* All frames of lamps, of the same session captured in one way; seconds of the rig's clock. */
struct taken {
    GPtrArray *pictures; /* of float *, by shot's light and camera */
    double clock_s;
};

static struct taken dome_take(const struct dome *dome) {
    struct run *run = dome_new(dome);
    struct taken ret = {g_ptr_array_new_with_free_func(g_free), 0};
    g_autoptr(GError) error = NULL;
    run_start(run);
    run_to_end(run);
    run_check_whole(run->session);
    g_autoptr(GPtrArray) shots = run_shots(run->session), frames = run_frames(run->session);
    g_ptr_array_set_size(ret.pictures, 2 * LAMPS);
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        const struct session_shot *shot = shots->pdata[frame->shot - 1];
        g_autofree char *path = g_build_filename(run->session, frame->path, NULL);
        if (shot->kind != SHOT_LAMP)
            continue;
        struct exr_file *file = exr_read(path, &error);
        g_assert_no_error(error);
        const struct exr_part *part = file->parts->pdata[0];
        int n = 0;
        g_assert_true(exr_get_int(part, "mesorig.multiplexed", &n, NULL) ==
                      (shot->multiplex.group > 0));
        g_assert_cmpint(n, ==, shot->multiplex.n);
        ret.pictures->pdata[2 * shot->source + frame->camera] =
            g_memdup2(exr_part_plane(part, "Y"), SIZE * SIZE * sizeof(float));
        exr_file_free(file);
    }
    g_autoptr(Session) session = session_open(run->session, SESSION_READ, &error);
    g_autofree char *clock = session_value(session, "clock_s");
    ret.clock_s = g_ascii_strtod(clock, NULL);
    run_free(run);
    return ret;
}

static double dome_rms(const struct taken *a, const struct taken *b, double *ret_mean) {
    double sum = 0, mean = 0;
    for (int i = 0; i < 2 * LAMPS; i++)
        for (int p = 0; p < SIZE * SIZE; p++) {
            const float *x = a->pictures->pdata[i], *y = b->pictures->pdata[i];
            sum += pow((double)x[p] - (double)y[p], 2);
            mean += (double)x[p] - (double)y[p];
        }
    *ret_mean = mean / (2 * LAMPS * SIZE * SIZE);
    return sqrt(sum / (2 * LAMPS * SIZE * SIZE));
}

/* The same noise in less time, and no bias. */
static void test_multiplexed_both_ways(void) {
    struct taken truth = dome_take(&exact), one = dome_take(&alone), all = dome_take(&dim);
    double bias_one, bias_all;
    const double noise_one = dome_rms(&one, &truth, &bias_one);
    const double noise_all = dome_rms(&all, &truth, &bias_all);
    g_test_message("noise %.5f and %.5f DN/ms, bias %.5f and %.5f, time %.2f and %.2f s", noise_one,
                   noise_all, bias_one, bias_all, one.clock_s, all.clock_s);
    /* 32768 values: the noise is known to 1 %. That of the four dark frames is in it, √1.25, which
     * patterns nearly cancel. */
    g_assert_cmpfloat(noise_all, <, 0.95 * noise_one);
    g_assert_cmpfloat(noise_all, >, 0.85 * noise_one);
    g_assert_cmpfloat(fabs(bias_all), <, 0.1 * noise_one);
    g_assert_cmpfloat(all.clock_s, <, 0.9 * one.clock_s);
    g_ptr_array_unref(truth.pictures);
    g_ptr_array_unref(one.pictures);
    g_ptr_array_unref(all.pictures);
}

static char *dome_sums(const char *path) {
    g_autoptr(GPtrArray) frames = run_frames(path);
    GString *sums = g_string_new(NULL);
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        g_string_append_printf(sums, "%s %s\n", frame->path, frame->sha256);
    }
    return g_string_free(sums, FALSE);
}

/* Ends a run, whose files must have these checksums. */
static void dome_end_as(struct run *run, const char *wanted) {
    run_to_end(run);
    run_check_whole(run->session);
    g_autofree char *sums = dome_sums(run->session);
    g_assert_cmpstr(sums, ==, wanted);
    run_free(run);
}

/* Nothing of a group is stored: there is only one, which was not completed. */
static void dome_check_no_group(const struct run *run) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(run->session, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autoptr(GPtrArray) shots = session_shots(session, &error);
    g_assert_no_error(error);
    int n = 0;
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        n += shot->multiplex.group > 0;
        if (shot->multiplex.group > 0)
            g_assert_cmpint(shot->state, ==, SHOT_PLANNED);
    }
    g_assert_cmpint(n, ==, 15);
}

/* However often it is interrupted, within groups and between, the frames are to the byte the same;
 * a pause waits for the group's end; and a frame that is lost takes its whole group with it, whose
 * files are not replaced while they have rows. */
static void test_multiplexed_resume(void) {
    struct run *whole = dome_new(&dim);
    run_start(whole);
    run_to_end(whole);
    g_autofree char *wanted = dome_sums(whole->session);
    run_free(whole);
    for (int every = 3; every < 60; every += 11) {
        struct run *run = dome_new(&dim);
        run_start(run);
        for (int cut = 0; cut < 3 && run_until(run, every + 5 * cut) != CAPTURE_DONE; cut++)
            run_resume(run);
        dome_end_as(run, wanted);
    }
    struct run *run = dome_new(&dim);
    run_start(run);
    run_until(run, 25); /* after the dark frames, in the group */
    capture_pause(run->capture);
    g_assert_cmpint(run_until(run, 0), ==, CAPTURE_PAUSED);
    run_continue(run);
    run_to_end(run);
    g_autoptr(GPtrArray) frames = run_frames(run->session);
    const struct session_frame *lost = frames->pdata[frames->len / 2];
    g_autofree char *path = g_build_filename(run->session, lost->path, NULL);
    g_assert_true(g_file_set_contents(path, "", 0, NULL));
    run_resume(run);
    run_until(run, 10);
    g_clear_pointer(&run->capture, capture_free);
    dome_check_no_group(run);
    run_resume(run);
    dome_end_as(run, wanted);
}

/* Lamps that die: from the beginning, or within the group, first or last of it. Nothing wrong is
 * stored, and with a new lamp the session is what it would have been. The light is bright enough
 * that a lamp stands out of the noise of a whole picture. */
static void test_multiplexed_dead(void) {
    const struct dome lit = {"15", 0.2, "400000", NULL, NULL, TRUE, TRUE};
    struct run *whole = dome_new(&lit);
    run_start(whole);
    run_to_end(whole);
    g_autofree char *wanted = dome_sums(whole->session);
    run_free(whole);
    /* How often it is switched on before. */
    for (int after = 0; after < 4; after++) {
        struct dome dome = lit;
        g_autofree char *more =
            g_strdup_printf("fault_dead = led%d\nfault_dead_after = %d\n", 2 + 3 * after, after);
        dome.lamps_more = more;
        struct run *run = dome_new(&dome);
        run_start(run);
        run_to_pause(run, after == 0 ? "lamp led2 gives no light" : "Check the lamp");
        g_test_message("%s", run_status(run).reason);
        g_clear_pointer(&run->capture, capture_free);
        dome_check_no_group(run);
        dome_change(run, &lit);
        run_resume(run);
        dome_end_as(run, wanted);
    }
}

/* Light that saturates a pattern: it is taken again with a quarter of the exposure, and pixels that
 * are saturated still are marked in the pictures of all lamps of the group. */
static void test_multiplexed_saturation(void) {
    const struct dome bright = {"7", 30, "20000", NULL, NULL, TRUE, TRUE};
    const struct dome too_bright = {"7", 4000, "20000", NULL, NULL, TRUE, TRUE};
    struct run *run = dome_new(&bright);
    run_start(run);
    run_to_end(run);
    g_assert_nonnull(strstr(run->told->str, "it is taken again at"));
    run_free(run);
    run = dome_new(&too_bright);
    run_start(run);
    run_to_end(run);
    g_autoptr(GPtrArray) frames = run_frames(run->session), shots = run_shots(run->session);
    int marked = 0;
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        const struct session_shot *shot = shots->pdata[frame->shot - 1];
        g_autofree char *path = g_build_filename(run->session, frame->path, NULL);
        g_autoptr(GError) error = NULL;
        if (shot->multiplex.group == 0)
            continue;
        struct exr_file *file = exr_read(path, &error);
        const float *saturated = exr_part_plane(file->parts->pdata[0], "saturated");
        for (int p = 0; saturated && p < SIZE * SIZE; p++)
            marked += saturated[p] > 0;
        exr_file_free(file);
    }
    g_assert_cmpint(marked, >, 7 * SIZE);
    g_assert_nonnull(strstr(run->told->str, "saturated"));
    run_free(run);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/multiplexed/choice", test_multiplexed_choice);
    g_test_add_func("/multiplexed/both_ways", test_multiplexed_both_ways);
    g_test_add_func("/multiplexed/resume", test_multiplexed_resume);
    g_test_add_func("/multiplexed/dead_lamps", test_multiplexed_dead);
    g_test_add_func("/multiplexed/saturation", test_multiplexed_saturation);
    return run_tests();
}
