/* Passes of the turntable: speed, which shots share one, times; what is refused. */
#include "lib/ok.h"
#include "lib/test.h"
#include "plan/passes.h"

#include <math.h>
#include <string.h>

#include "lib/plan_case.h"

static const double demo[] = {15, 30, 45, 60, 75};

static struct session_conf conf_with(const char *capture) {
    g_autofree char *text = g_strconcat(
        "[session]\nname = test\n[sample]\nwidth_mm = 50\nheight_mm = 50\ntexels = 64\n"
        "reference_mm = 5\ndepth_mm = 5\n[views]\npreset = 12x5\n[lights]\npreset = 12x5\n"
        "offset_deg = 15\n[capture]\nmotion = continuous\n",
        capture, NULL);
    struct session_conf conf;
    g_assert_true(ok(session_conf_parse(&conf, text, "test.conf", ERR)));
    return conf;
}

static struct rig_timing timing(void) {
    struct rig_timing t = plan_case_timing(2);
    t.turntable.report_ms = 20;
    for (int c = 0; c < RIG_MAX_CAMERAS; c++)
        t.readout_us[c] = 30000;
    return t;
}

/* Shots of a lamp, n of them, at these angles of the table. */
static GArray *shots_at(const double *deg, int n, int device) {
    GArray *shots = g_array_new(FALSE, TRUE, sizeof(struct session_shot));
    for (int i = 0; i < n; i++) {
        const struct session_shot shot = {.id = i + 1,
                                          .kind = SHOT_LAMP,
                                          .turntable_deg = deg[i],
                                          .arc_deg = 15,
                                          .device = device,
                                          .cameras = {{1}}};
        g_array_append_val(shots, shot);
    }
    return shots;
}

static int set(GArray *shots, const struct session_conf *conf, const struct rig *rig,
               const struct rig_timing *t) {
    g_autofree struct session_shot **list = g_new(struct session_shot *, shots->len + 1);
    for (guint i = 0; i < shots->len; i++)
        list[i] = &g_array_index(shots, struct session_shot, i);
    return passes_set(list, (int)shots->len, conf, rig, t, 0);
}

static const struct session_shot *at(GArray *shots, guint i) {
    return &g_array_index(shots, struct session_shot, i);
}

/* The corner of 50 × 50 mm is 35.36 mm from the axis, a texel is 0.781 mm: a quarter of it is
 * 0.3165°. */
TEST(speed) {
    struct rig rig = plan_case_rig(demo, 5);
    struct rig_timing t = timing();
    g_auto(SessionConf) conf = conf_with("exposures_us = 8000\n");
    struct passes_speed speed = passes_speed(&conf, &rig, &t, camera_set_of(0));
    g_assert_cmpfloat(speed.deg_s, ==, 39); /* of 39.57, down to two digits */
    g_assert_false(speed.by_axis || speed.by_pose);
    g_assert_cmpfloat_with_epsilon(speed.blur_texels, 0.25 * 39 / 39.57, 1e-3);
    g_assert_cmpfloat_with_epsilon(speed.blur_mm, 0.1925, 1e-3);
    g_assert_cmpfloat(speed.pose_texels, ==, 0);

    conf.exposures_us[0] = 1000;
    speed = passes_speed(&conf, &rig, &t, camera_set_of(0));
    g_assert_true(speed.by_axis);
    g_assert_cmpfloat(speed.deg_s, ==, 60);

    /* Times that are off by 8 ms in all are worse than an exposure of 8 ms. */
    conf.exposures_us[0] = 8000;
    t.turntable.stamp_ms = 7;
    t.stamp_us[0] = 1000;
    speed = passes_speed(&conf, &rig, &t, camera_set_of(0));
    g_assert_true(speed.by_pose);
    g_assert_cmpfloat(speed.deg_s, ==, 19);
    g_assert_cmpfloat(speed.pose_texels, <=, 0.25);
    g_assert_cmpfloat(speed.blur_texels, <, 0.13);
    t.stamp_us[1] = 100000; /* takes no part */
    g_assert_cmpfloat(passes_speed(&conf, &rig, &t, camera_set_of(0)).deg_s, ==, 19);
}

static void refused(const struct session_conf *conf, const struct rig_timing *t, const char *says) {
    struct rig rig = plan_case_rig(demo, 5);
    g_autofree char *why = passes_refused(conf, &rig, t, (struct camera_set){{3}});
    if (says)
        g_assert_nonnull(strstr(why, says));
    else
        g_assert_null(why);
}

TEST(refused) {
    struct rig_timing t = timing();
    g_auto(SessionConf) conf = conf_with("exposures_us = 8000\n");
    refused(&conf, &t, NULL);
    t.stamp_us[2] = -1; /* another camera */
    refused(&conf, &t, NULL);
    t.stamp_us[1] = -1;
    refused(&conf, &t, "camera cam30 does not report when its frames were exposed");
    t.stamp_us[1] = 0;
    t.turntable.report_ms = 0;
    refused(&conf, &t, "does not report positions with their times");
    t.turntable = (struct axis_motion){0};
    refused(&conf, &t, "there is no [axis turntable]");
    t = timing();
    conf.order = ORDER_VIEWS;
    refused(&conf, &t, "set order = quickest");
    conf.order = ORDER_QUICKEST;
    conf.motion = MOTION_STANDING;
    refused(&conf, &t, NULL);

    struct session_conf bracket;
    GError *error = NULL;
    g_assert_false(session_conf_parse(
        &bracket,
        "[session]\nname = t\n[sample]\nwidth_mm = 5\nheight_mm = 5\ntexels = 4\nreference_mm = 5\n"
        "depth_mm = 5\n[views]\npreset = 12x5\n[lights]\npreset = 12x5\n[capture]\n"
        "exposures_us = 1; 2\nmotion = continuous\n",
        "t.conf", &error));
    g_assert_nonnull(strstr(error->message, "t.conf:14: [capture] exposures_us: 2 exposures"));
    g_clear_error(&error);
}

/* Nine angles, in any order and with those of another lamp between them, become one pass of each,
 * which begins behind the widest gap. */
TEST(turn) {
    static const double deg[] = {330, 0, 30, 90, 60, 300, 120, 150, 180};
    static const double expected[] = {300, 330, 360, 390, 420, 450, 480, 510, 540};
    struct rig rig = plan_case_rig(demo, 5);
    struct rig_timing t = timing();
    g_auto(SessionConf) conf = conf_with("exposures_us = 8000\n");
    g_autoptr(GArray) shots = shots_at(deg, 9, 0), other = shots_at(deg, 9, 1);
    g_array_insert_vals(shots, 3, other->data, 9);
    g_autoptr(GArray) followers = passes_take_followers(shots, &conf, &rig, &t);
    g_assert_cmpint(shots->len, ==, 2);
    g_assert_cmpint(followers->len, ==, 16);
    g_assert_cmpfloat(at(shots, 0)->turntable_deg, ==, 300);
    passes_put_back(shots, followers, &rig);
    g_assert_cmpint(shots->len, ==, 18);
    g_assert_cmpint(set(shots, &conf, &rig, &t), ==, 2);
    for (guint i = 0; i < 9; i++) {
        const struct session_pass *pass = &at(shots, i)->pass;
        g_assert_cmpint(at(shots, i)->device, ==, 0);
        g_assert_cmpint(pass->number, ==, 1);
        g_assert_cmpfloat(passes_at_deg(pass, at(shots, i)->turntable_deg), ==, expected[i]);
        g_assert_cmpfloat(pass->from_deg, <, 300 - 39.0 * 39 / 240);
        g_assert_cmpfloat(pass->from_deg + pass->by_deg, >, 540 + 39.0 * 39 / 240);
    }
    g_assert_cmpint(at(shots, 17)->pass.number, ==, 2);
}

/* Where a pass does not pay the table stands, and where it cannot begin or end. */
TEST(stands) {
    static const double near[] = {0, 7.5, 15, 22.5, 200, 207.5, 215, 222.5}, two[] = {0, 180};
    static const double limited[] = {0, 30, 60, 90, 120, 150, 180};
    struct rig rig = plan_case_rig(demo, 5);
    struct rig_timing t = timing();
    g_auto(SessionConf) conf = conf_with("exposures_us = 8000\n");
    g_autoptr(GArray) shots = shots_at(near, 8, 0);
    g_assert_cmpint(set(shots, &conf, &rig, &t), ==, 2); /* a stop between them */
    g_assert_cmpint(at(shots, 3)->pass.number, !=, at(shots, 4)->pass.number);

    g_autoptr(GArray) far = shots_at(two, 2, 0);
    g_assert_cmpint(set(far, &conf, &rig, &t), ==, 0);

    conf.exposures_us[0] = 16000; /* 19°/s: 1.6 s from one to the next, where a stop takes 1.2 s */
    g_autoptr(GArray) slow = shots_at(limited, 7, 0);
    g_assert_cmpint(set(slow, &conf, &rig, &t), ==, 0);

    conf.exposures_us[0] = 8000;
    t.turntable.wraps = FALSE;
    t.turntable.min_deg = 0;
    t.turntable.max_deg = 190;
    g_assert_cmpint(set(slow, &conf, &rig, &t), ==, 1);
    g_assert_cmpint(at(slow, 0)->pass.number, ==, 0); /* there is no room for acceleration */
    for (guint i = 1; i < 7; i++) {
        g_assert_cmpint(at(slow, i)->pass.number, ==, i < 6 || at(slow, i)->pass.number);
        g_assert_cmpfloat(at(slow, i)->pass.from_deg, >=, 0);
        g_assert_cmpfloat(at(slow, i)->pass.from_deg + at(slow, i)->pass.by_deg, <=, 190);
    }

    /* Sweeps and shots that are skipped are never in a pass. */
    struct session_shot *first = &g_array_index(slow, struct session_shot, 2);
    first->state = SHOT_SKIPPED;
    first[1].kind = SHOT_SWEEP;
    set(slow, &conf, &rig, &t);
    g_assert_cmpint(first->pass.number + first[1].pass.number, ==, 0);
    conf.motion = MOTION_STANDING;
    g_assert_cmpint(set(slow, &conf, &rig, &t), ==, 0);
}

/* The same shots have the same pass, whether they were taken or not. */
TEST(done) {
    static const double deg[] = {0, 30, 60, 90, 120, 150};
    struct rig rig = plan_case_rig(demo, 5);
    struct rig_timing t = timing();
    g_auto(SessionConf) conf = conf_with("exposures_us = 4000\n");
    g_autoptr(GArray) shots = shots_at(deg, 6, 0), done = shots_at(deg, 6, 0);
    for (guint i = 0; i < 3; i++)
        g_array_index(done, struct session_shot, i).state = SHOT_DONE;
    set(shots, &conf, &rig, &t);
    set(done, &conf, &rig, &t);
    g_assert_cmpint(at(shots, 5)->pass.number, ==, 1);
    for (guint i = 0; i < 6; i++)
        g_assert_cmpmem(&at(shots, i)->pass, sizeof(struct session_pass), &at(done, i)->pass,
                        sizeof(struct session_pass));
}

/* From the start of a pass until the table stands, by its parts and as a whole: v/a + d/v. */
TEST(times) {
    static const double deg[] = {0, 30, 60, 90, 120, 150, 180, 210, 240};
    struct rig rig = plan_case_rig(demo, 5);
    struct rig_timing t = timing();
    g_auto(SessionConf) conf = conf_with("exposures_us = 8000\n");
    g_autoptr(GArray) shots = shots_at(deg, 9, 0);
    set(shots, &conf, &rig, &t);
    const double frame_s = 0.011, exposure_s = 0.008; /* 3 ms from trigger to exposure */
    double sum = 0;
    for (guint i = 0; i < 9; i++)
        sum += passes_lead_s(i ? at(shots, i - 1) : NULL, at(shots, i), frame_s, exposure_s,
                             &t.turntable) +
               frame_s;
    sum += passes_exit_s(at(shots, 8), exposure_s, &t.turntable);
    const struct session_pass *pass = &at(shots, 0)->pass;
    const double v = pass->speed_deg_s;
    g_assert_cmpint(pass->number, ==, 1);
    g_assert_cmpfloat_with_epsilon(sum, pass->by_deg / v + v / 120 + 0.15, 1e-9);
    g_assert_cmpfloat_with_epsilon(
        passes_lead_s(at(shots, 0), at(shots, 1), frame_s, exposure_s, &t.turntable),
        30 / v - frame_s, 1e-12);
    g_assert_cmpfloat_with_epsilon(passes_after_s(at(shots, 0), at(shots, 2), &conf, &rig, &t),
                                   60 / v, 1e-12);
    g_assert_cmpfloat_with_epsilon(passes_after_s(at(shots, 2), at(shots, 0), &conf, &rig, &t),
                                   300 / v, 1e-12);
    g_array_index(shots, struct session_shot, 1).device = 1;
    g_assert_cmpfloat(passes_after_s(at(shots, 0), at(shots, 1), &conf, &rig, &t), ==, G_MAXDOUBLE);
}
