#include "base/data_error.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "mdf/mdf_views.h"

#include "exr/exr.h"
#include "pipeline/pipeline.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

#define SIDE     24
#define N_TEXELS (SIDE * SIDE)
#define N_VIEWS  6

static const struct mdf_plane plane = {SIDE, SIDE, 0.5, 5};

/* A wall across y, from the ground up to z = 4.5, on ground at z = 3. */
#define GROUND 3.0
#define TOP    4.5
#define WALL   1.0 /* its top is where |x| < WALL */
#define UNDER  4.1 /* or a bridge instead, that reaches down to here */

struct scene {
    struct mdf_eye eyes[N_VIEWS];
    float distance[N_VIEWS][N_TEXELS];
};

/* Along the ray from the reference plane: by small steps down. */
static double march(const double *eye, double x, double y, gboolean bridge) {
    double d[3] = {x - eye[0], y - eye[1], plane.reference_mm - eye[2]};
    double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]), t = 0;
    for (; t < 20; t += 1e-3) {
        double px = x + t * d[0] / length, z = plane.reference_mm + t * d[2] / length;
        if (z <= GROUND || (fabs(px) < WALL && z <= TOP && (!bridge || z >= UNDER)))
            return t;
    }
    return -1;
}

static struct scene *new_scene(gboolean bridge) {
    static const double degree = G_PI / 180;
    struct scene *scene = g_new0(struct scene, 1);
    for (int v = 0; v < N_VIEWS; v++) {
        double theta = (10 + 8 * v) * degree, phi = 60 * v * degree;
        struct mdf_eye *eye = &scene->eyes[v];
        *eye = (struct mdf_eye){
            {600 * sin(theta) * cos(phi), 600 * sin(theta) * sin(phi), 600 * cos(theta)},
            scene->distance[v]};
        for (int i = 0; i < N_TEXELS; i++) {
            int column = i % SIDE, row = i / SIDE;
            scene->distance[v][i] =
                (float)march(eye->centre_mm, (column + 0.5 - SIDE / 2.0) * plane.texel_mm,
                             (SIDE / 2.0 - row - 0.5) * plane.texel_mm, bridge);
        }
    }
    return scene;
}

/* What is right is hardly ever refuted, although walls hide much from others. */
TEST(agree) {
    g_autofree struct scene *scene = new_scene(FALSE);
    guint16 confirmed[N_TEXELS], denied[N_TEXELS];
    int sure = 0, refuted = 0;
    for (int v = 0; v < N_VIEWS; v++) {
        mdf_views_compare(scene->eyes, N_VIEWS, v, &plane, confirmed, denied);
        for (int i = 0; i < N_TEXELS; i++) {
            sure += confirmed[i] > 0;
            refuted += mdf_views_refuted(confirmed[i], denied[i]);
        }
    }
    g_test_message("%d of %d confirmed, %d refuted", sure, N_VIEWS * N_TEXELS, refuted);
    g_assert_cmpint(sure, >, N_VIEWS * N_TEXELS * 9 / 10);
    g_assert_cmpint(refuted, <, N_VIEWS * N_TEXELS / 100);
}

/* A point that hangs in the air is refuted; one that was not seen is asked about by nobody. */
TEST(ghost) {
    g_autofree struct scene *scene = new_scene(FALSE);
    guint16 confirmed[N_TEXELS], denied[N_TEXELS];
    int ghost = SIDE * 12 + 4, hole = SIDE * 12 + 18;
    scene->distance[0][ghost] = 0.4F;
    scene->distance[0][hole] = -1;
    mdf_views_compare(scene->eyes, N_VIEWS, 0, &plane, confirmed, denied);
    g_assert_true(mdf_views_refuted(confirmed[ghost], denied[ghost]));
    g_assert_cmpint(confirmed[hole] + denied[hole], ==, 0);
    mdf_views_compare(scene->eyes, 1, 0, &plane, confirmed, denied);
    g_assert_cmpint(confirmed[ghost] + denied[ghost], ==, 0);
}

/* Three texels of a view are not what they were, on ground that others see: holes, then ghosts. */
enum { SPOILT = 3 };
static const int spoilt[SPOILT] = {SIDE * 12 + 4, SIDE * 12 + 5, SIDE * 13 + 4};

struct spoilt {
    struct scene *scene;
    float truth[N_TEXELS], other[N_TEXELS], lasers[N_TEXELS], settled[N_TEXELS];
    guint8 source[N_TEXELS];
};

static struct spoilt *new_spoilt(float instead, gboolean bridge) {
    struct spoilt *s = g_new0(struct spoilt, 1);
    s->scene = new_scene(bridge);
    memcpy(s->truth, s->scene->distance[0], sizeof s->truth);
    for (int i = 0; i < N_TEXELS; i++) {
        s->other[i] = -1;
        s->lasers[i] = 2;
    }
    for (int i = 0; i < SPOILT; i++)
        s->scene->distance[0][spoilt[i]] = instead;
    return s;
}

static void settle(struct spoilt *s) {
    mdf_views_settle(s->scene->eyes, N_VIEWS, 0, &plane, s->settled, s->source);
}

static void free_spoilt(struct spoilt *s) {
    g_free(s->scene);
    g_free(s);
}

/* All spoilt texels have this source; what stands is near the truth. */
static void check_spoilt(const struct spoilt *s, enum mdf_distance_source source) {
    for (int i = 0; i < SPOILT; i++) {
        g_assert_cmpint(s->source[spoilt[i]], ==, source);
        if (source != MDF_UNSEEN)
            g_assert_cmpfloat_with_epsilon(s->settled[spoilt[i]], s->truth[spoilt[i]], 0.02);
        else
            g_assert_cmpfloat(s->settled[spoilt[i]], ==, -1);
    }
}

/* What is missing or refuted comes from others, marked as what it is; all else stays. */
TEST(settle) {
    static const float instead[] = {-1, 0.4F};
    for (int k = 0; k < 2; k++) {
        struct spoilt *s = new_spoilt(instead[k], FALSE);
        settle(s);
        check_spoilt(s, MDF_PREDICTED);
        int changed = 0;
        for (int i = 0; i < N_TEXELS; i++)
            changed += s->source[i] != MDF_MEASURED || s->settled[i] != s->scene->distance[0][i];
        g_test_message("%d of %d changed", changed, N_TEXELS);
        g_assert_cmpint(changed, <=, SPOILT + N_TEXELS / 100);
        free_spoilt(s);
    }
}

/* What the view may have seen itself, and others confirm, is better than their prediction; if they
 * do not, it is not believed. */
TEST(second_choice) {
    for (int right = 0; right < 2; right++) {
        struct spoilt *s = new_spoilt(0.4F, FALSE);
        for (int i = 0; i < SPOILT; i++)
            s->other[spoilt[i]] = s->truth[spoilt[i]] + (right ? 0.01F : 1.0F);
        s->scene->eyes[0].other = s->other;
        settle(s);
        check_spoilt(s, right ? MDF_OTHER : MDF_PREDICTED);
        free_spoilt(s);
    }
}

/* Nothing was measured, but lasers reach the surface all around: there is a gap, which others do
 * not see. Of a single view nothing is settled. */
TEST(dark_gap) {
    struct spoilt *s = new_spoilt(-1, FALSE);
    for (int i = 0; i < N_TEXELS; i++)
        s->lasers[i] = 20;
    s->scene->eyes[0].lasers = s->lasers;
    settle(s);
    check_spoilt(s, MDF_UNSEEN);
    mdf_views_settle(s->scene->eyes, 1, 0, &plane, s->settled, s->source);
    check_spoilt(s, MDF_UNSEEN);
    free_spoilt(s);
}

/* Under a bridge: views that see through below it keep what they see, and what is missing there is
 * the ground again, though others see the bridge's top above it. */
TEST(bridge) {
    g_autofree struct scene *scene = new_scene(TRUE);
    float mm[N_TEXELS], truth;
    guint8 source[N_TEXELS];
    int under = 0, filled = 0, wrong = 0;
    for (int v = 0; v < N_VIEWS; v++) {
        mdf_views_settle(scene->eyes, N_VIEWS, v, &plane, mm, source);
        for (int i = 0; i < N_TEXELS; i++)
            wrong += fabsf(mm[i] - scene->distance[v][i]) > 0.1F;
    }
    g_assert_cmpint(wrong, <=, N_VIEWS * N_TEXELS / 100);
    wrong = 0;
    for (int i = 0; i < N_TEXELS; i++) {
        const int v = N_VIEWS - 1; /* the lowest */
        const double *c = scene->eyes[v].centre_mm, column = i % SIDE;
        const double x = (column + 0.5 - SIDE / 2.0) * plane.texel_mm;
        truth = scene->distance[v][i];
        const double down = (plane.reference_mm - GROUND) / (c[2] - plane.reference_mm);
        const double at = x + (x - c[0]) * down;
        if (fabs(at) > 0.9 * WALL ||
            fabs(truth / sqrt(pow(x - c[0], 2) + c[1] * c[1] + c[2] * c[2]) - down) > 2e-3)
            continue;
        under++;
        scene->distance[v][i] = -1;
        mdf_views_settle(scene->eyes, N_VIEWS, v, &plane, mm, source);
        scene->distance[v][i] = truth;
        filled += mm[i] >= 0;
        wrong += mm[i] >= 0 && fabsf(mm[i] - truth) > 0.1F;
    }
    g_test_message("%d under the bridge, %d filled, %d wrong", under, filled, wrong);
    g_assert_cmpint(under, >, 10);
    g_assert_cmpint(wrong, ==, 0);
}

static char *write_mdf(const struct scene *scene, double texel_mm, const char *channel) {
    const char *const channels[] = {channel, NULL};
    struct exr_file *file = exr_file_new();
    for (int v = 0; scene && v < N_VIEWS; v++) {
        g_autofree char *name = g_strdup_printf("view_%04d", v);
        struct exr_part *part = exr_part_new(name, SIDE, SIDE, channels, EXR_FLOAT);
        const double *c = scene->eyes[v].centre_mm;
        memcpy(part->planes[0], scene->distance[v], sizeof scene->distance[v]);
        exr_set_v3d(part, "view.centre_mm", c[0], c[1], c[2]);
        exr_set_double(part, "texel_mm", texel_mm);
        exr_set_double(part, "reference_mm", plane.reference_mm);
        exr_file_add(file, part);
    }
    char *path = NULL;
    int fd = ok(g_file_open_tmp("mesorig-mdf-XXXXXX.exr", &path, ERR));
    close(fd);
    ok(exr_write(path, file, EXR_PIZ, FALSE, ERR));
    exr_file_free(file);
    return path;
}

TEST(file) {
    g_autofree struct scene *scene = new_scene(FALSE);
    scene->distance[2][0] = -1;
    g_autofree char *path = write_mdf(scene, plane.texel_mm, "D");
    struct mdf_views_sums sums;
    g_assert_true(ok(mdf_views_check(path, &sums, ERR)));
    g_unlink(path);
    g_assert_cmpint(sums.n_views, ==, N_VIEWS);
    g_assert_cmpint(sums.texels, ==, N_VIEWS * N_TEXELS);
    g_assert_cmpint(sums.seen, ==, N_VIEWS * N_TEXELS - 1);
    g_assert_cmpint(sums.confirmed, >, sums.seen * 9 / 10);
    g_assert_cmpfloat(sums.denied_share, <, 0.05);
}

TEST(damaged) {
    static const struct {
        const char *channel;
        double texel_mm;
        float mm;
    } cases[] = {{"N", 0.5, 1},   {"D", 0, 1},          {"D", NAN, 1},
                 {"D", 0.5, NAN}, {"D", 0.5, INFINITY}, {"D", 0.5, -INFINITY}};
    g_autofree struct scene *scene = new_scene(FALSE);
    struct mdf_views_sums sums;
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        g_autoptr(GError) error = NULL;
        scene->distance[1][7] = cases[i].mm;
        g_autofree char *path = write_mdf(scene, cases[i].texel_mm, cases[i].channel);
        g_assert_false(mdf_views_check(path, &sums, &error));
        g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
        g_unlink(path);
    }
    g_autoptr(GError) error = NULL;
    g_assert_false(mdf_views_check("/nonexistent.exr", &sums, &error));
    g_assert_nonnull(error);
}
