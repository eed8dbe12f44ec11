/*
 * Posts and balls of other sizes than their target's description says, and a turntable that
 * wobbles: lamps_check_sizes() names the sizes, is silent about right ones, and does not blame them
 * for what they do not explain. Sights are computed with noise; the cameras and the arc are ideal.
 */
#include "lamps/lamps.h"
#include "lib/deviate.h"

#include <math.h>
#include <string.h>

#define RAD(deg) ((deg) * (G_PI / 180))
#define CAMERAS  3
#define LAMPS    4
#define TURNS    4
#define ARCS     5
#define NOISE_MM 0.02
#define NOISE_PX 0.05

static void set_rig(struct rig *rig) {
    *rig = (struct rig){
        .n_cameras = CAMERAS, .n_lamps = LAMPS, .arc_radius_mm = 500, .arc_width_mm = 20};
    for (int i = 0; i < CAMERAS; i++) {
        struct rig_camera *c = &rig->cameras[i];
        *c = (struct rig_camera){.width = 640,
                                 .height = 640,
                                 .fx_px = 4160,
                                 .fy_px = 4160,
                                 .cx_px = 319.5,
                                 .cy_px = 319.5,
                                 .response = 6000};
        g_snprintf(c->name, RIG_NAME, "c%d", i);
        rig_camera_look_at(c, vec3_scale(rig_direction(RAD(15 + 27 * i), 0), 650), vec3(0, 0, 0));
    }
    for (int i = 0; i < LAMPS; i++) {
        const struct vec3 out = rig_direction(RAD(15 + 20 * i), 0);
        rig->lamps[i] = (struct rig_lamp){.position_mm = vec3_scale(out, 500),
                                          .aim = vec3_scale(out, -1),
                                          .exponent = 2,
                                          .intensity = 40};
        g_snprintf(rig->lamps[i].name, RIG_NAME, "l%d", i);
    }
}

static const struct lamp_target posts = {
    .kind = LAMP_POLES,
    .plane_mm = 2,
    .radius_mm = 1,
    .plate_mm = {84, 84},
    .marks = {{-22, -20, 24}, {20, -24, 12}, {24, 18, 24}, {-18, 24, 12}, {0, 8, 20}, {-6, -14, 5}},
    .n = 6,
    .tolerance_mm = 0.02};

/* What is seen of a target in a rig whose turntable wobbles as the rig says. */
static GArray *see(const struct rig *rig, const struct lamp_target *target) {
    GArray *sights = g_array_new(FALSE, FALSE, sizeof(struct lamp_sight));
    GRand *rand = g_rand_new_with_seed(11);
    for (int c = 0; c < CAMERAS; c++)
        for (int t = 0; t < TURNS; t++)
            for (int a = 0; a < ARCS; a++)
                for (int l = -1; l < LAMPS; l++)
                    for (int m = 0; m < target->n && (l >= 0 || a == 0); m++) {
                        struct rig at;
                        struct lamp_sight s = {.lamp = l,
                                               .camera = c,
                                               .mark = m,
                                               .turntable_rad = RAD(90 * t + 10),
                                               .arc_rad = RAD(37 + 72 * a + 25 * t),
                                               .sigma = NOISE_MM};
                        struct vec3 end;
                        rig_at(rig, s.turntable_rad, &at);
                        const struct vec3 lamp =
                            l < 0 ? rig_camera_centre_mm(&at.cameras[c])
                                  : rig_lamp_position_mm(&at.arc, &at.lamps[l], s.arc_rad);
                        if (!lamp_shadow_mm(target, m, lamp_mark_mm(target, m, 0),
                                            rig_turn(lamp, -s.turntable_rad), &end, NULL) ||
                            hypot(end.x, end.y) > 40)
                            continue;
                        s.x = end.x + NOISE_MM * deviate_sum(rand);
                        s.y = end.y + NOISE_MM * deviate_sum(rand);
                        g_array_append_val(sights, s);
                    }
    g_rand_free(rand);
    return sights;
}

static const struct mistaken {
    const char *path;
    double factor[6];   /* of the true heights by those of the description */
    double wobble_deg;  /* of the turntable, which the calibration does not know */
    const char *reason; /* part of the error; NULL: it succeeds */
    const char *never;  /* no part of it */
} mistakes[] = {
    {"/lamp mistakes/none", {1, 1, 1, 1, 1, 1}, 0, NULL, NULL},
    {"/lamp mistakes/all posts",
     {1.06, 1.06, 1.06, 1.06, 1.06, 1.06},
     0,
     "with all posts 1.06 times what the target's description says",
     "farther apart"},
    {"/lamp mistakes/two posts", {1, 1.1, 1, 1, 0.9, 1}, 0, "post 2 13.2", "farther apart"},
    {"/lamp mistakes/wobble",
     {1, 1, 1, 1, 1, 1},
     1.5,
     "the turntable's bearing wobbles",
     "heights of the posts"},
};

static void test_mistake(gconstpointer data) {
    const struct mistaken *mistake = data;
    g_autoptr(GError) error = NULL;
    g_autofree struct rig *rig = g_new(struct rig, 1), *known = g_new(struct rig, 1);
    g_autofree struct lamps_result *result = g_new0(struct lamps_result, 1);
    struct lamp_target truth = posts;
    set_rig(rig);
    *known = *rig;
    for (int i = 0; i < truth.n; i++)
        truth.marks[i].size_mm *= mistake->factor[i];
    rig->wobble.rad[1][0] = rig->wobble.rad[1][3] = RAD(mistake->wobble_deg);
    g_autoptr(GArray) sights = see(rig, &truth);
    const struct lamp_sight *all = (const struct lamp_sight *)(gpointer)sights->data;
    const gboolean ok = lamps_fit(known, &posts, all, (int)sights->len, result, &error);
    g_autoptr(GError) sizes = NULL;
    if (!lamps_check_sizes(known, &posts, all, (int)sights->len, result, &sizes)) {
        g_clear_error(&error);
        error = g_steal_pointer(&sizes);
        g_assert_error(error, LAMPS_ERROR, LAMPS_ERROR_MISTAKE);
    }
    g_test_message("%u sights, %.4f mm RMS, %.2f times the noise: %s", sights->len, result->rms,
                   result->sigma, error ? error->message : "");
    g_assert_true((ok && !error) == !mistake->reason);
    if (error) {
        g_assert_nonnull(strstr(error->message, mistake->reason));
        g_assert_null(strstr(error->message, mistake->never));
    }
    lamps_result_clear(result);
    /* A calibration that knows the wobble places the lamps. */
    if (!(mistake->wobble_deg > 0))
        return;
    g_clear_error(&error);
    known->wobble = rig->wobble;
    g_assert_true(lamps_fit(known, &posts, all, (int)sights->len, result, &error));
    g_test_message("with the wobble known: %.4f mm RMS, %.2f times the noise", result->rms,
                   result->sigma);
    g_assert_cmpfloat(result->sigma, <, 1.2);
    for (int i = 0; i < LAMPS; i++) {
        const struct vec3 off =
            vec3_sub(rig_lamp_position_mm(&result->rig.arc, &result->rig.lamps[i], 0),
                     rig_lamp_position_mm(&rig->arc, &rig->lamps[i], 0));
        const double(*c)[3] = result->covariance_mm2[i];
        g_assert_cmpfloat(vec3_length(off), <, 4 * sqrt(c[0][0] + c[1][1] + c[2][2]));
    }
    lamps_result_clear(result);
}

/* Sights of the posts themselves say nothing about the arc. If the lamps are seen over 50° of
 * the arc only, its axis is not estimated, however far the arc moved between sights of posts. */
static void test_posts_only(void) {
    g_autoptr(GError) error = NULL;
    g_autofree struct rig *rig = g_new(struct rig, 1);
    g_autofree struct lamps_result *result = g_new0(struct lamps_result, 1);
    g_autoptr(GArray) some = g_array_new(FALSE, FALSE, sizeof(struct lamp_sight));
    set_rig(rig);
    g_autoptr(GArray) sights = see(rig, &posts);
    for (guint i = 0; i < sights->len; i++) {
        const struct lamp_sight *s = &g_array_index(sights, struct lamp_sight, i);
        if (s->lamp < 0 || s->arc_rad < RAD(90))
            g_array_append_val(some, *s);
    }
    lamps_fit(rig, &posts, (const struct lamp_sight *)(gpointer)some->data, (int)some->len, result,
              &error);
    g_assert_no_error(error);
    g_assert_false(result->arc_known);
    lamps_result_clear(result);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/lamp mistakes/posts only", test_posts_only);
    for (gsize i = 0; i < G_N_ELEMENTS(mistakes); i++)
        g_test_add_data_func(mistakes[i].path, &mistakes[i], test_mistake);
    return g_test_run();
}
