#include "processing/mdf_views.h"

#include "processing/exr.h"
#include "processing/pipeline.h"

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

struct scene {
    struct mdf_eye eyes[N_VIEWS];
    float distance[N_VIEWS][N_TEXELS];
};

/* Along the ray from the reference plane: by small steps down. */
static double march(const double *eye, double x, double y) {
    double d[3] = {x - eye[0], y - eye[1], plane.reference_mm - eye[2]};
    double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]), t = 0;
    for (; t < 20; t += 1e-3) {
        double px = x + t * d[0] / length, z = plane.reference_mm + t * d[2] / length;
        if (z <= (fabs(px) < WALL ? TOP : GROUND))
            return t;
    }
    return -1;
}

static struct scene *new_scene(void) {
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
                             (SIDE / 2.0 - row - 0.5) * plane.texel_mm);
        }
    }
    return scene;
}

/* What is right is hardly ever refuted, although walls hide much from others. */
static void test_agree(void) {
    g_autofree struct scene *scene = new_scene();
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
static void test_ghost(void) {
    g_autofree struct scene *scene = new_scene();
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

static char *write_mdf(const struct scene *scene, double texel_mm, const char *channel) {
    const char *const channels[] = {channel, NULL};
    g_autoptr(GError) error = NULL;
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
    int fd = g_file_open_tmp("mesorig-mdf-XXXXXX.exr", &path, &error);
    g_assert_no_error(error);
    close(fd);
    exr_write(path, file, EXR_PIZ, FALSE, &error);
    g_assert_no_error(error);
    exr_file_free(file);
    return path;
}

static void test_file(void) {
    g_autofree struct scene *scene = new_scene();
    g_autoptr(GError) error = NULL;
    scene->distance[2][0] = -1;
    g_autofree char *path = write_mdf(scene, plane.texel_mm, "D");
    struct mdf_views_sums sums;
    g_assert_true(mdf_views_check(path, &sums, &error));
    g_assert_no_error(error);
    g_unlink(path);
    g_assert_cmpint(sums.n_views, ==, N_VIEWS);
    g_assert_cmpint(sums.texels, ==, N_VIEWS * N_TEXELS);
    g_assert_cmpint(sums.seen, ==, N_VIEWS * N_TEXELS - 1);
    g_assert_cmpint(sums.confirmed, >, sums.seen * 9 / 10);
    g_assert_cmpfloat(sums.denied_share, <, 0.05);
}

static void test_damaged(void) {
    g_autofree struct scene *scene = new_scene();
    const double texel_mm[] = {plane.texel_mm, 0, NAN};
    for (int i = 0; i < 3; i++) {
        g_autoptr(GError) error = NULL;
        g_autofree char *path = write_mdf(scene, texel_mm[i], i == 0 ? "N" : "D");
        struct mdf_views_sums sums;
        g_assert_false(mdf_views_check(path, &sums, &error));
        g_assert_error(error, PIPELINE_ERROR, PIPELINE_ERROR_DATA);
        g_unlink(path);
    }
    g_autoptr(GError) error = NULL;
    struct mdf_views_sums sums;
    g_assert_false(mdf_views_check("/nonexistent.exr", &sums, &error));
    g_assert_nonnull(error);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/mdf-views/agree", test_agree);
    g_test_add_func("/mdf-views/ghost", test_ghost);
    g_test_add_func("/mdf-views/file", test_file);
    g_test_add_func("/mdf-views/damaged", test_damaged);
    return g_test_run();
}
