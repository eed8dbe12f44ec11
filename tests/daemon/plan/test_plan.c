#include "lib/ok.h"
#include "lib/plan_case.h"
#include "lib/test.h"

#include <locale.h>
#include <string.h>

#define RAD(deg) ((deg) * (G_PI / 180))
#define PATH     "test.conf"

static double apart_deg(double a, double b) {
    return fabs(remainder(a - b, 360));
}

/* How far the arc had to be turned for a shot, told by its note only. */
static double shift_of(const struct session_shot *shot) {
    const char *said = shot->note ? strstr(shot->note, "shifted by ") : NULL;
    return said ? g_ascii_strtod(said + strlen("shifted by "), NULL) : 0;
}

/* Every view under every light, each once, and the light where it was asked for. All cameras and
 * lamps of the test rigs stand at azimuth 0. */
static void assert_pairs(const struct plan *plan, enum session_shot_kind kind,
                         const struct session_direction *sources, int n_sources) {
    const struct session_plan *s = &plan->session;
    g_autofree int *seen = g_new0(int, s->n_views *MAX(n_sources, 1));

    for (int i = 0; i < s->n_shots; i++) {
        const struct session_shot *shot = &s->shots[i];
        g_assert_cmpint(shot->id, ==, i + 1);
        if (shot->kind != kind)
            continue;
        const struct session_direction *source = &sources[shot->source];
        g_assert_cmpint(shot->device, ==, source->device);
        double shift = shot->state == SHOT_SKIPPED ? 0 : shift_of(shot);
        double phi = shot->arc_deg - shot->turntable_deg - shift;
        g_assert_cmpfloat(apart_deg(phi, source->phi_deg), <, 3e-6);
        struct camera_set found = {{0}};
        for (int v = 0; v < s->n_views; v++) {
            const struct session_direction *view = &s->views[v];
            if (camera_set_has(shot->cameras, view->device) &&
                apart_deg(-shot->turntable_deg, view->phi_deg) < 3e-6) {
                seen[v * n_sources + shot->source]++;
                camera_set_add(&found, view->device);
            }
        }
        g_assert_true(camera_set_equal(found, shot->cameras));
    }
    for (int i = 0; i < s->n_views * n_sources; i++)
        g_assert_cmpint(seen[i], ==, 1);
}

static void assert_plan(const struct plan *plan) {
    const struct session_plan *s = &plan->session;
    int pose = 0;

    assert_pairs(plan, SHOT_LAMP, s->lights, s->n_lights);
    assert_pairs(plan, SHOT_SWEEP, s->lasers, s->n_lasers);
    g_assert_cmpint(s->shots[0].kind, ==, SHOT_DARK);
    for (int i = 0; i < s->n_shots; i++) {
        g_assert_cmpint(s->shots[i].pose, >=, pose);
        g_assert_cmpint(s->shots[i].pose, <=, pose + 1);
        pose = s->shots[i].pose;
    }
    g_assert_cmpint(plan->n_poses, ==, pose + 1);
    g_assert_cmpfloat(plan->lower_bound_s, <=, plan->predicted_s + 1e-6);
    g_assert_cmpfloat(plan->predicted_s, <=, plan->nested_s + 1e-6);
    g_assert_cmpfloat(plan->lower_bound_s, >, 0);
}

static int notes_of_texels(int texels) {
    static const double theta_deg[] = {30, 60};
    const struct rig rig = plan_case_rig(theta_deg, 2);
    const struct rig_timing timing = plan_case_timing(0.1);
    g_auto(SessionConf) conf = plan_case_conf("[views]\nrings = 30:2\n[lights]\nrings = 30:2\n");
    conf.grid.width = conf.grid.height = texels;
    g_autoptr(Plan) plan = plan_case_build(&conf, &rig, &timing);
    int n = 0;
    for (guint i = 0; i < plan->notes->len; i++)
        n += strstr(plan->notes->pdata[i], "a texel is") != NULL;
    return n;
}

/* 650 mm away a pixel of 1/1664 sees 0.39 mm: 128 of them are 50 mm. */
TEST(texels) {
    g_assert_cmpint(notes_of_texels(64), ==, 0);
    g_assert_cmpint(notes_of_texels(250), ==, 0);
    g_assert_cmpint(notes_of_texels(260), ==, 1);
    g_assert_cmpint(notes_of_texels(2048), ==, 1);
}

TEST(presets) {
    static const struct {
        const char *name;
        int directions, rings;
    } presets[] = {{"12x5", 60, 5}, {"12x8", 96, 8}, {"81", 81, 6}, {"26", 26, 5}};

    for (gsize i = 0; i < G_N_ELEMENTS(presets); i++) {
        g_autofree char *text = g_strdup_printf(
            "[views]\npreset = %s\noffset_deg = 7\n[lights]\nrings = 15:1\n", presets[i].name);
        g_auto(SessionConf) conf = plan_case_conf(text);
        int n = 0;
        for (int r = 0; r < conf.n_views; r++) {
            n += conf.views[r].count;
            g_assert_cmpfloat(conf.views[r].offset_deg, ==, 7);
        }
        g_assert_cmpint(n, ==, presets[i].directions);
        g_assert_cmpint(conf.n_views, ==, presets[i].rings);
    }
}

TEST(demo_file) {
    g_auto(SessionConf) conf = {0};
    GError *error = NULL;

    g_assert_true(ok(session_conf_load(&conf, SOURCE_DIR "/etc/demo/session.conf", ERR)));
    g_assert_cmpint(conf.n_views, ==, 5);
    g_assert_cmpfloat(conf.lights[4].theta_deg, ==, 75);
    g_assert_cmpfloat(conf.lights[4].offset_deg, ==, 15);
    g_assert_cmpint(conf.lasers[0].count, ==, 2);
    g_assert_cmpint(conf.sweep_steps, ==, 96);
    g_assert_cmpint(conf.grid.width, ==, 64);
    g_assert_cmpint(conf.on_blocked, ==, BLOCKED_SHIFT);
    g_assert_nonnull(strstr(conf.text, "[capture]"));
    session_conf_clear(&conf);
    g_assert_false(session_conf_load(&conf, "/no/such/session.conf", &error));
    g_assert_nonnull(error);
    g_clear_error(&error);
}

struct bad {
    const char *text;
    int line;         /* of the complaint, 0: of the file as a whole */
    const char *says; /* part of the message */
};

#define SAMPLE                                                                                     \
    "[sample]\nwidth_mm=5\nheight_mm=5\ntexels=8\nreference_mm=1\ndepth_mm=1\n" /* lines 3 to 8 */
#define GOOD "[session]\nname=a\n" SAMPLE

static const struct bad bad_files[] = {
    {"", 0, "[session]"},
    {"[session]\nname=\n" SAMPLE, 2, "name"},
    {"[session]\nname=../x\n" SAMPLE, 2, "file"},
    {"[session]\nname=a\nnam=b\n", 3, "name"},
    {"[session]\nname=a\n[sampel]\n", 3, "no such section"},
    {GOOD "[views one]\npreset=81\n", 9, "no such section"},
    {GOOD "[views]\npreset=80\n", 10, "12x5"},
    {GOOD "[views]\npreset=81\nrings=15:1\n", 9, "only one of them"},
    {GOOD "[views]\n", 9, "either"},
    {GOOD "[views]\nrings=15:1\ndevices=all\n", 9, "only one of them"},
    {GOOD "[views]\ndevices=all\noffset_deg=5\n", 11, "leave offset_deg out"},
    {GOOD "[views]\nrings=15\n", 10, "theta:count"},
    {GOOD "[views]\nrings=15:1:2:3\n", 10, "theta:count"},
    {GOOD "[views]\nrings=90:1\n", 10, "theta:count"},
    {GOOD "[views]\nrings=nan:1\n", 10, "theta:count"},
    {GOOD "[views]\nrings=0:2\n", 10, "theta:count"},
    {GOOD "[views]\nrings=15:1.5\n", 10, "theta:count"},
    {GOOD "[views]\nrings=15:0\n", 10, "theta:count"},
    {GOOD "[views]\nrings=15:100000000000\n", 10, "theta:count"},
    {GOOD "[views]\nrings=15:4; 15:2:90\n", 10, "share a direction"},
    {GOOD "[views]\nrings=15:720; 16:720; 17:720; 18:720; 19:720; 20:720\n", 10,
     "have 4320 directions; at most 4096"},
    {GOOD "[views]\nrings=15:1\noffset_deg=inf\n", 11, "number"},
    {GOOD "[views]\nrings=15:1\n", 0, "[lights]"},
    {GOOD "[views]\nrings=15:1\n[lights]\nrings=15:1\n", 0, "[capture]"},
    {GOOD "[views]\nrings=15:1\n[lights]\nrings=15:1\n[capture]\n", 0, "exposures_us"},
    {GOOD "[views]\nrings=15:1\n[lights]\nrings=15:1\n[capture]\nexposures_us=9;8\n", 14, "first"},
    {GOOD "[views]\nrings=15:1\n[lights]\nrings=15:1\n[capture]\nexposures_us=1;2;3;4;5;6;7;8;9;10;"
          "11;12;13\n",
     14, "1 to 12"},
    {GOOD "[views]\nrings=15:1\n[lights]\nrings=15:1\n[capture]\nexposures_us=9;9\n", 14, "first"},
    {GOOD "[views]\nrings=15:1\n[lights]\nrings=15:1\n[capture]\nexposures_us=nan\n", 14, "number"},
    {GOOD "[views]\nrings=15:1\n[lights]\nrings=15:1\n[capture]\nexposures_us=9\nsweep_steps=2\n",
     15, "range"},
    {GOOD "[views]\nrings=15:1\n[lights]\nrings=15:1\n[capture]\nexposures_us=9\non_blocked=go\n",
     15, "shift"},
    {GOOD "[views]\nrings=15:1\n[lasers]\nrings=15:1\n[capture]\nexposures_us=9\n"
          "laser_short_us=4000\n",
     15, "less than laser_exposure_us"},
    {GOOD "[views]\nrings=15:1\n[lasers]\nrings=15:1\n[capture]\nexposures_us=9\n"
          "laser_short_us=0.5\n",
     15, "from 1"},
    {"[session]\nname=a\n[sample]\nwidth_mm=5\nheight_mm=5\nreference_mm=1\ndepth_mm=1\n", 3,
     "texels"},
    {"[session]\nname=a\n[sample]\nwidth_mm=5\nheight_mm=5\ntexels=4\ntexels_x=4\n"
     "reference_mm=1\ndepth_mm=1\n",
     6, "texels"},
    {"[session]\nname=a\n[sample]\nwidth_mm=5\nheight_mm=5\ntexels=4\nreference_mm=1\n"
     "depth_mm=1.5\n",
     8, "below the turntable"},
    {"[session]\nname=a\n[sample]\nwidth_mm=0\nheight_mm=5\ntexels=4\nreference_mm=1\ndepth_mm=1\n",
     4, "range"},
};

TEST(bad_files) {
    for (gsize i = 0; i < G_N_ELEMENTS(bad_files); i++) {
        const struct bad *bad = &bad_files[i];
        struct session_conf conf;
        g_autoptr(GError) error = NULL;
        g_autofree char *where =
            bad->line ? g_strdup_printf(PATH ":%d: ", bad->line) : g_strdup(PATH ":");
        g_test_message("%s", bad->text);
        g_assert_false(session_conf_parse(&conf, bad->text, PATH, &error));
        g_assert_nonnull(error);
        g_test_message("%s", error->message);
        /* Most lack further sections: these are told after it. */
        const char *more = strchr(error->message, '\n');
        g_assert_true(g_str_has_prefix(more ? more + 1 : error->message, where));
        g_assert_nonnull(strstr(error->message, bad->says));
        g_assert_null(conf.name);
    }
}

TEST(truncated_file) {
    g_autofree char *text = NULL;
    gsize length;

    g_assert_true(g_file_get_contents(SOURCE_DIR "/etc/demo/session.conf", &text, &length, NULL));
    for (gsize n = 0; n < length; n++) {
        g_autofree char *part = g_strndup(text, n);
        g_autoptr(GError) error = NULL;
        g_auto(SessionConf) conf = {0};
        if (!session_conf_parse(&conf, part, PATH, &error))
            g_assert_nonnull(error);
    }
}

static const double demo_theta_deg[] = {15, 30, 45, 60, 75};
static const double eight_theta_deg[] = {12, 21, 30, 39, 48, 57, 66, 75};

static const char *const demo_directions =
    "[views]\npreset=12x5\n[lights]\npreset=12x5\noffset_deg=15\n"
    "[lasers]\npreset=26\noffset_deg=15\n";

/* From lamps that are ready at the same time to lamps that are worth being left on during moves. */
TEST(demo) {
    g_auto(SessionConf) conf = plan_case_conf(demo_directions);
    struct rig rig = plan_case_rig(demo_theta_deg, 5);
    const double warm_up_s[] = {0.02, 0.25, 2, 10};

    for (gsize i = 0; i < G_N_ELEMENTS(warm_up_s); i++) {
        struct rig_timing timing = plan_case_timing(warm_up_s[i]);
        g_autoptr(Plan) plan = plan_case_build(&conf, &rig, &timing);
        assert_plan(plan);
        g_test_message("warm-up %g s: predicted %.1f s, bound %.1f s, nested %.1f s", warm_up_s[i],
                       plan->predicted_s, plan->lower_bound_s, plan->nested_s);
        g_assert_cmpfloat(plan->predicted_s, <=, (i < 3 ? 1.05 : 1.1) * plan->lower_bound_s);
        g_assert_cmpint(plan->session.n_views, ==, 60);
        g_assert_cmpint(plan->session.n_lights, ==, 60);
        g_assert_cmpint(plan->session.n_lasers, ==, 26);
        g_assert_cmpint(plan->session.n_shots, ==, 1 + 12 * 60 + 12 * 26);
        /* 4 dark frames at each of two exposures, one of them the laser's too */
        g_assert_cmpint(plan->n_frames, ==, 5 * (8 + 12 * 60 * 2 + 12 * 26 * 97));
        g_assert_cmpuint(plan->notes->len, ==, 0);
        if (i < 2)
            g_assert_cmpint(plan->n_poses, ==, 144);
    }
}

TEST(12x8) {
    g_auto(SessionConf) conf =
        plan_case_conf("[views]\npreset=12x8\n[lights]\npreset=12x8\noffset_deg=15\n");
    struct rig rig = plan_case_rig(eight_theta_deg, 8);
    struct rig_timing timing = plan_case_timing(0.25);
    g_autoptr(Plan) plan = plan_case_build(&conf, &rig, &timing);

    assert_plan(plan);
    g_test_message("predicted %.1f s, bound %.1f s, nested %.1f s", plan->predicted_s,
                   plan->lower_bound_s, plan->nested_s);
    g_assert_cmpfloat(plan->predicted_s, <=, 1.05 * plan->lower_bound_s);
    g_assert_cmpint(plan->n_poses, ==, 144);
}

TEST(81) {
    const double theta_deg[] = {0, 15, 30, 45, 60, 75};
    g_auto(SessionConf) conf =
        plan_case_conf("[views]\npreset=81\n[lights]\npreset=81\noffset_deg=4\n");
    struct rig rig = plan_case_rig(theta_deg, 6);
    struct rig_timing timing = plan_case_timing(0.25);
    gint64 start = g_get_monotonic_time();
    g_autoptr(Plan) plan = plan_case_build(&conf, &rig, &timing);
    g_autoptr(Plan) again = plan_case_build(&conf, &rig, &timing);

    g_test_message("%d poses: predicted %.1f s, bound %.1f s, nested %.1f s, planned in %.2f s",
                   plan->n_poses, plan->predicted_s, plan->lower_bound_s, plan->nested_s,
                   (g_get_monotonic_time() - start) / 2e6);
    assert_plan(plan);
    g_assert_cmpint(plan->session.n_shots, ==, again->session.n_shots);
    for (int i = 0; i < plan->session.n_shots; i++) {
        struct session_shot a = plan->session.shots[i], b = again->session.shots[i];
        g_assert_cmpstr(a.note, ==, b.note);
        a.note = b.note = NULL;
        g_assert_cmpmem(&a.id, sizeof a.id, &b.id, sizeof b.id);
        g_assert_true(a.pose == b.pose && a.source == b.source && a.kind == b.kind &&
                      camera_set_equal(a.cameras, b.cameras) && a.arc_deg == b.arc_deg &&
                      a.turntable_deg == b.turntable_deg);
    }
}

/* Whether a ray from the camera to the disc passes through the arc, by rays: the band stands at
 * its radius over azimuth α, half its width to both sides. */
static gboolean arc_in_picture(const struct rig *rig, int camera, double arc_deg,
                               double radius_mm) {
    struct vec3 eye = rig_turn(rig_camera_centre_mm(&rig->cameras[camera]), -RAD(arc_deg));

    for (int i = 0; i < 360; i++) {
        double r = radius_mm * (i % 4 + 1) / 4;
        struct vec3 q = vec3(r * cos(RAD(i)), r * sin(RAD(i)), 0), d = vec3_sub(eye, q);
        /* |q + t d| = arc radius, the positive root */
        double a = vec3_dot(d, d), b = vec3_dot(q, d);
        double c = vec3_dot(q, q) - rig->arc_radius_mm * rig->arc_radius_mm;
        struct vec3 p = vec3_add(q, vec3_scale(d, (-b + sqrt(b * b - a * c)) / a));
        if (p.x >= 0 && p.z >= 0 && fabs(p.y) < rig->arc_width_mm / 2)
            return TRUE;
    }
    return FALSE;
}

TEST(blocked) {
    const char *directions = "[views]\npreset=12x8\n[lights]\npreset=12x8\n";
    g_auto(SessionConf) conf = plan_case_conf(directions);
    struct rig rig = plan_case_rig(eight_theta_deg, 8);
    struct rig_timing timing = plan_case_timing(0.25);
    g_autoptr(Plan) plan = plan_case_build(&conf, &rig, &timing);
    int n_shifted = 0, n_skipped = 0;

    assert_plan(plan);
    for (int i = 1; i < plan->session.n_shots; i++) {
        const struct session_shot *shot = &plan->session.shots[i];
        n_shifted += fabs(shift_of(shot)) > 0;
        g_assert_cmpfloat(fabs(shift_of(shot)), <=, 20);
        g_assert_cmpint(shot->state, ==, SHOT_PLANNED);
        for (int c = 0; c < 8; c++)
            if (camera_set_has(shot->cameras, c))
                g_assert_false(arc_in_picture(&rig, c, shot->arc_deg, 35));
    }
    /* The arc is over azimuth 0 once for each turn of the table: eight lamps each time. */
    g_assert_cmpint(n_shifted, ==, 12 * 8);
    g_assert_cmpuint(plan->notes->len, ==, 1);
    g_test_message("%s", (char *)plan->notes->pdata[0]);

    conf.on_blocked = BLOCKED_SKIP;
    plan_free(plan);
    plan = plan_case_build(&conf, &rig, &timing);
    assert_plan(plan);
    for (int i = 1; i < plan->session.n_shots; i++) {
        const struct session_shot *shot = &plan->session.shots[i];
        n_skipped += shot->state == SHOT_SKIPPED;
        if (shot->state == SHOT_SKIPPED)
            g_assert_nonnull(shot->note);
        g_assert_true(shot->state == SHOT_SKIPPED ||
                      plan->session.shots[i - 1].state == SHOT_PLANNED);
    }
    g_assert_cmpint(n_skipped, ==, 12 * 8);
    const char *last = g_ptr_array_index(plan->notes, plan->notes->len - 1);
    g_assert_true(g_str_has_prefix(last, "768 pictures of the BTF will be predicted"));
    g_assert_cmpint(plan->n_frames, ==, 8 * 8 + (12 * 96 - n_skipped) * 8 * 2);

    conf.on_blocked = BLOCKED_REFUSE;
    g_autoptr(GError) error = NULL;
    g_assert_null(plan_build(&conf, &rig, &timing, &error));
    g_assert_error(error, PLAN_ERROR, PLAN_ERROR_BLOCKED);
    g_assert_nonnull(strstr(error->message, "cam12"));
}

/* Refused before the time is spent, by how much it is too large. */
TEST(too_large) {
    const double theta_deg[] = {30, 60};
    static const struct {
        const char *text, *says;
    } cases[] = {
        {"[views]\nrings=30:510;60:510\n[lights]\nrings=30:510;60:510\n", "260100 poses"},
        {"[views]\nrings=30:201\n[lights]\nrings=30:200\n", "40200 poses"},
        {"[views]\nrings=30:400\n[lights]\nrings=30:100;60:100\n[lasers]\nrings=30:100\n",
         "120000 shots"},
        {"[views]\nrings=30:101\n[lights]\nrings=30:103\n", "10403 different angles"},
    };
    struct rig rig = plan_case_rig(theta_deg, 2);
    struct rig_timing timing = plan_case_timing(0.25);
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        g_auto(SessionConf) conf = plan_case_conf(cases[i].text);
        plan_case_refused(&conf, &rig, &timing, PLAN_ERROR_SIZE, cases[i].says);
    }
}

TEST(refusals) {
    g_auto(SessionConf) conf =
        plan_case_conf("[views]\nrings=15:4\n[lights]\nrings=30:4:15\n[lasers]\nrings=45:2:15\n");
    struct rig rig = plan_case_rig(demo_theta_deg, 5), other = rig;
    struct rig_timing timing = plan_case_timing(0.25), bent = timing;

    conf.views[0].theta_deg = 20;
    plan_case_refused(&conf, &rig, &timing, PLAN_ERROR_NO_CAMERA, "15° (cam15), 30° (cam30)");
    conf.views[0].theta_deg = 15.4; /* near enough */
    g_autoptr(Plan) plan = plan_case_build(&conf, &rig, &timing);
    g_assert_nonnull(strstr(plan->session.views[0].note, "15"));
    conf.lights[0].theta_deg = 20;
    plan_case_refused(&conf, &rig, &timing, PLAN_ERROR_NO_LAMP, "lamp30");
    conf.lights[0].theta_deg = 30;
    other.n_lasers = 0;
    plan_case_refused(&conf, &other, &timing, PLAN_ERROR_NO_LASER, "none");
    bent.turntable.wraps = FALSE;
    bent.turntable.max_deg = 200;
    plan_case_refused(&conf, &rig, &bent, PLAN_ERROR_LIMITS, "turntable");
    bent = timing;
    bent.arc = (struct axis_motion){-60, 200, FALSE, 45, 60, 0, 0};
    plan_case_refused(&conf, &rig, &bent, PLAN_ERROR_LIMITS, "arc");
    bent = timing;
    bent.sweep[2].max_deg = 1;
    plan_case_refused(&conf, &rig, &bent, PLAN_ERROR_LIMITS, "laser45");
    bent = timing;
    bent.max_exposure_us[0] = 10000;
    plan_case_refused(&conf, &rig, &bent, PLAN_ERROR_LIMITS, "16000");
}

/* The sheet must have passed every corner of the sample's box, and not be far beyond. */
TEST(sweep_range) {
    g_auto(SessionConf) conf = plan_case_conf("[views]\nrings=15:1\n[lasers]\nrings=45:1:90\n");
    struct rig rig = plan_case_rig(demo_theta_deg, 5);
    struct rig_timing timing = plan_case_timing(0.25);
    g_autoptr(Plan) plan = plan_case_build(&conf, &rig, &timing);
    const struct session_shot *shot = &plan->session.shots[1];

    /* In the plane of the arc the laser stands at (side, side) and the box reaches from −27 to 27
     * and from 0 to 5; angles there count from horizontal to up, the axis's the other way. */
    double side = 480 * M_SQRT1_2, low = G_MAXDOUBLE, high = -G_MAXDOUBLE;
    for (int i = 0; i < 4; i++) {
        double x = (i & 1 ? 27 : -27) - side, z = (i & 2 ? 5 : 0) - side;
        double angle = (atan2(z, x) - atan2(-1, -1)) * 180 / G_PI;
        low = MIN(low, angle);
        high = MAX(high, angle);
    }
    g_assert_cmpint(shot->kind, ==, SHOT_SWEEP);
    g_assert_cmpint(shot->sweep_steps, ==, 96);
    g_assert_cmpfloat(fabs(shot->sweep_from_deg + high), <, 1e-9);
    g_assert_cmpfloat(fabs(shot->sweep_to_deg + low), <, 1e-9);
}

/* Two cameras of one elevation, half a turn apart, need half the turns of the table. */
TEST(two_cameras) {
    const double theta_deg[] = {30, 30};
    g_auto(SessionConf) conf = plan_case_conf("[views]\nrings=30:12\n[lights]\nrings=30:12:15\n");
    struct rig rig = plan_case_rig(theta_deg, 2);
    struct rig_timing timing = plan_case_timing(0.25);
    double used[12];
    int n_used = 0;

    rig_camera_look_at(&rig.cameras[1], vec3(-325, 0, 325 * sqrt(3)), vec3(0, 0, 0));
    g_autoptr(Plan) plan = plan_case_build(&conf, &rig, &timing);
    for (int v = 0; v < 12; v++) {
        const struct session_direction *view = &plan->session.views[v];
        double phi = view->device * 180 - view->turntable_deg;
        int known = 0;
        g_assert_cmpfloat(apart_deg(phi, view->phi_deg), <, 3e-6);
        for (int i = 0; i < n_used; i++)
            known |= apart_deg(used[i], view->turntable_deg) < 1e-6;
        if (!known)
            used[n_used++] = view->turntable_deg;
    }
    g_assert_cmpint(n_used, ==, 6);
}

static struct axis_motion random_motion(GRand *rand, gboolean wraps) {
    return (struct axis_motion){wraps ? 0 : -400,
                                wraps ? 360 : 400,
                                wraps,
                                g_rand_double_range(rand, 5, 90),
                                g_rand_double_range(rand, 10, 200),
                                g_rand_boolean(rand) ? g_rand_double_range(rand, 0, 1) : 0,
                                g_rand_double_range(rand, 0, 500)};
}

static struct rig_timing random_timing(GRand *rand) {
    struct rig_timing t = plan_case_timing(0);

    t.turntable = random_motion(rand, g_rand_boolean(rand));
    t.arc = random_motion(rand, g_rand_boolean(rand));
    for (int i = 0; i < RIG_MAX_LASERS; i++) {
        t.lamp_warm_up_s[i] = g_rand_double_range(rand, 0, g_rand_boolean(rand) ? 0.5 : 8);
        t.laser_warm_up_s[i] = g_rand_double_range(rand, 0, 2);
        t.readout_us[i] = g_rand_int_range(rand, 0, 200000);
    }
    return t;
}

static void random_rings(GRand *rand, struct ring *rings, int *n, int max_rings, int max_count) {
    int chosen = g_rand_int_range(rand, 1, max_rings + 1);

    for (*n = 0; *n < chosen; (*n)++)
        rings[*n] = (struct ring){demo_theta_deg[*n],
                                  g_rand_boolean(rand) ? g_rand_int_range(rand, -8, 9) * 15
                                                       : g_rand_double_range(rand, -180, 180),
                                  g_rand_int_range(rand, 1, max_count + 1)};
}

static void randomise(GRand *rand, struct session_conf *conf, int max_rings, int max_count) {
    random_rings(rand, conf->views, &conf->n_views, max_rings, max_count);
    random_rings(rand, conf->lights, &conf->n_lights, max_rings, max_count);
    conf->n_lasers = 0;
    if (g_rand_boolean(rand))
        random_rings(rand, conf->lasers, &conf->n_lasers, max_rings, max_count);
    conf->on_blocked = g_rand_boolean(rand) ? BLOCKED_SHIFT : BLOCKED_SKIP;
    conf->n_exposures = g_rand_int_range(rand, 1, 3);
}

TEST(random) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(5);
    g_auto(SessionConf) conf = plan_case_conf(demo_directions);
    struct rig rig = plan_case_rig(demo_theta_deg, 5);

    for (int round = 0; round < 30; round++) {
        struct rig_timing timing = random_timing(rand);
        randomise(rand, &conf, 3, 6);
        g_autoptr(Plan) plan = plan_case_build(&conf, &rig, &timing);
        assert_plan(plan);
    }
}

/* With the order of views, the turntable stops at each of its angles once, and the predicted time
 * is that of the nested order. */
TEST(views_first) {
    g_auto(SessionConf) conf = plan_case_conf(demo_directions);
    struct rig rig = plan_case_rig(demo_theta_deg, 5);
    struct rig_timing timing = plan_case_timing(0.25);

    conf.order = ORDER_VIEWS;
    g_autoptr(Plan) plan = plan_case_build(&conf, &rig, &timing);
    assert_plan(plan);
    g_assert_cmpfloat(plan->predicted_s, ==, plan->nested_s);
    g_assert_cmpint(plan->n_poses, >, 1);
    int n_turns = 0;
    double at_deg = NAN;
    for (int i = 0; i < plan->session.n_shots; i++) {
        const struct session_shot *shot = &plan->session.shots[i];
        if (shot->state != SHOT_PLANNED || shot->kind == SHOT_DARK)
            continue;
        n_turns += shot->turntable_deg != at_deg;
        at_deg = shot->turntable_deg;
    }
    g_assert_cmpint(n_turns, ==, 12);
}

/* The sequencer's time written once more, as a diary: from when each thing is ready. Dark frames
 * aside. */
static double diary_s(const struct session_shot *const *shots, int n,
                      const struct session_conf *conf, const struct rig_timing *t) {
    double now = 0, read_at = 0, turntable = shots[0]->turntable_deg, arc = shots[0]->arc_deg;
    int lit = -1;

    for (int i = 0; i < n; i++) {
        const struct session_shot *s = shots[i];
        double readout = 0, sweep_back = 0, step = 0, warm = 0, to_middle = 0;
        for (int c = 0; c < RIG_MAX_CAMERAS; c++)
            if (camera_set_has(s->cameras, c))
                readout = MAX(readout, t->readout_us[c] / 1e6);
        if (s->kind == SHOT_SWEEP) {
            const struct axis_motion *sweep = &t->sweep[s->device];
            double step_deg = (s->sweep_to_deg - s->sweep_from_deg) / (s->sweep_steps - 1);
            double middle_deg = (s->sweep_to_deg + s->sweep_from_deg) / 2;
            to_middle = axis_move_time_s(sweep, s->sweep_to_deg, middle_deg);
            sweep_back = axis_move_time_s(sweep, middle_deg, s->sweep_from_deg);
            step = axis_move_time_s(sweep, s->sweep_from_deg, s->sweep_from_deg + step_deg);
            warm = t->laser_warm_up_s[s->device];
            lit = -1;
        } else {
            warm = lit == s->device ? 0 : t->lamp_warm_up_s[s->device];
            lit = s->device;
        }
        double turned = now + axis_move_time_s(&t->turntable, turntable, s->turntable_deg);
        double swung = now + axis_move_time_s(&t->arc, arc, s->arc_deg);
        turntable = s->turntable_deg;
        arc = s->arc_deg;
        now = MAX(MAX(turned, swung), MAX(read_at, now + MAX(warm, sweep_back)));
        if (s->kind == SHOT_SWEEP) {
            for (int k = 1; k < s->sweep_steps; k++)
                now += conf->laser_exposure_us / 1e6 + MAX(readout, step);
            now += 2 * conf->laser_exposure_us / 1e6 + MAX(readout, to_middle);
        }
        for (int e = 0; s->kind == SHOT_LAMP && e < conf->n_exposures; e++)
            now += conf->exposures_us[e] / 1e6 + (e ? readout : 0);
        read_at = now + readout;
    }
    return read_at;
}

/* The quickest of all orders of all shots. */
static double quickest_s(const struct session_shot **shots, int n, int fixed,
                         const struct session_conf *conf, const struct rig_timing *t) {
    double best = G_MAXDOUBLE;

    if (fixed == n)
        return diary_s(shots, n, conf, t);
    for (int i = fixed; i < n; i++) {
        const struct session_shot *chosen = shots[i];
        shots[i] = shots[fixed];
        shots[fixed] = chosen;
        best = MIN(best, quickest_s(shots, n, fixed + 1, conf, t));
        shots[fixed] = shots[i];
        shots[i] = chosen;
    }
    return best;
}

TEST(all_orders) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(7);
    g_auto(SessionConf) conf = plan_case_conf(demo_directions);
    struct rig rig = plan_case_rig(demo_theta_deg, 5);
    double worst = 0, sum = 0;
    int rounds = 0;

    while (rounds < 30) {
        struct rig_timing timing = random_timing(rand);
        const struct session_shot *shots[7];
        int n = 0;
        randomise(rand, &conf, 2, 2);
        g_autoptr(Plan) plan = plan_case_build(&conf, &rig, &timing);
        for (int i = 1; i < plan->session.n_shots; i++)
            if (plan->session.shots[i].state == SHOT_PLANNED && n++ < 7)
                shots[n - 1] = &plan->session.shots[i];
        if (n > 0 && n <= 7) {
            /* Dark frames are taken first, in the first pose; their time is in every order. */
            double ours = diary_s(shots, n, &conf, &timing);
            double dark =
                plan->predicted_s - plan_remaining_s(shots, n, &conf, &rig, &timing, shots[0]);
            double best = quickest_s(shots, n, 0, &conf, &timing);
            g_assert_cmpfloat(dark, >, 0);
            g_assert_cmpfloat(plan->lower_bound_s, <=, best + dark + 1e-6);
            g_assert_cmpfloat(ours, >=, best - 1e-9);
            sum += ours / best - 1;
            worst = MAX(worst, ours / best - 1);
            rounds++;
        }
    }
    g_test_message("longer than the best of all orders: %.1f %% on average, %.1f %% at worst",
                   100 * sum / rounds, 100 * worst);
    g_assert_cmpfloat(sum / rounds, <, 0.03);
    g_assert_cmpfloat(worst, <, 0.25);
}

TEST(remaining) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(9);
    g_auto(SessionConf) conf = plan_case_conf(demo_directions);
    struct rig rig = plan_case_rig(demo_theta_deg, 5);
    struct rig_timing timing = random_timing(rand);
    g_autoptr(Plan) plan = plan_case_build(&conf, &rig, &timing);
    int n = plan->session.n_shots - 1;
    g_autofree const struct session_shot **shots = g_new(const struct session_shot *, n);

    for (int i = 0; i < n; i++)
        shots[i] = &plan->session.shots[i + 1];
    double left = plan_remaining_s(shots, n, &conf, &rig, &timing, shots[0]);
    g_assert_cmpfloat(fabs(left - diary_s(shots, n, &conf, &timing)), <, 1e-6);
    g_assert_cmpfloat(plan_remaining_s(shots, 0, &conf, &rig, &timing, NULL), ==, 0);
    g_assert_cmpfloat(plan_remaining_s(shots + n / 2, n - n / 2, &conf, &rig, &timing, NULL), <,
                      left);
}

BEFORE_TESTS {
    setlocale(LC_ALL, "");
}
