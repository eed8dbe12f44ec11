/* Error against size of all models: the measured values, and the diagram. */
#include "codecs/lpca/lpca_choose.h"
#include "codecs/lpca/lpca_pack.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/waves_fixture.h"
#include "materials/curve.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <string.h>

#define WIDTH  23
#define HEIGHT 19
#define SMALL  7 /* columns and rows where all texels are alike */
#define VIEWS  9
#define LIGHTS 10
#define PACKED "local PCA, packed"
#define NAMES  8000 /* bytes, of which those of parts and attributes are half */

static const char *const names[] = {"Ashikhmin–Shirley",
                                    "Lafortune",
                                    "Ward",
                                    "eigen-maps",
                                    "hemispherical harmonics",
                                    "local PCA, 8 bits",
                                    "local PCA, 8-bit weights",
                                    "local PCA, halves",
                                    PACKED,
                                    "neural planes",
                                    "polynomials",
                                    "reflectance fields"};

static struct btf_matrix *waves(void) {
    return waves_fixture_new(WIDTH, HEIGHT, VIEWS, LIGHTS, 0.002, FALSE);
}

static GArray *measure(const struct btf_matrix *btf) {
    GArray *points = ok(curve_measure(btf, NULL, NULL, ERR));
    return points;
}

static const struct plot_point *point_at(const GArray *points, guint i) {
    return &g_array_index(points, struct plot_point, i);
}

/* Every series is there once, and a larger point of it is a better one. */
static void assert_series(const GArray *points) {
    guint series = 0;
    for (guint i = 0; i < points->len; i++) {
        const struct plot_point *point = point_at(points, i), *before = i ? point - 1 : NULL;
        g_assert_cmpfloat(point->bytes, >, 0);
        if (before && g_str_equal(point->series, before->series)) {
            g_assert_cmpfloat(point->bytes, >, before->bytes);
            g_assert_cmpfloat(point->error, <, before->error);
            continue;
        }
        g_assert_cmpuint(series, <, G_N_ELEMENTS(names));
        g_assert_cmpstr(point->series, ==, names[series++]);
    }
    g_assert_cmpuint(series, ==, G_N_ELEMENTS(names));
}

static gint64 size_of_file(const char *path) {
    GStatBuf status;
    g_assert_cmpint(g_stat(path, &status), ==, 0);
    return status.st_size;
}

/* Who asks for the error of a packed point by itself gets a file of about that size, which has that
 * error. Of other local PCAs none is both as small and as good, unless there is so little in the
 * file that the names of its parts count. */
static void assert_packed(const struct btf_matrix *btf, const GArray *points,
                          const struct plot_point *point) {
    g_autoptr(GError) error = NULL;
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "packed.exr", NULL);
    const struct lpca_target wanted = {.error = point->error * 1.0001};
    struct lpca *lpca = ok(lpca_pack(btf, &(struct lpca_options){0}, &wanted, ERR));
    g_assert_true(lpca_write(path, lpca, &error));
    lpca_free(lpca);
    g_assert_cmpfloat_with_epsilon((double)size_of_file(path), point->bytes, 0.05 * point->bytes);
    lpca = ok(lpca_read(path, ERR));
    g_assert_cmpfloat_with_epsilon(lpca_error(lpca, btf, 0), point->error, 0.02 * point->error);
    lpca_free(lpca);
    for (guint i = 0; point->bytes > NAMES && i < points->len; i++) {
        const struct plot_point *other = point_at(points, i);
        if (g_str_has_prefix(other->series, "local PCA") && !g_str_equal(other->series, PACKED))
            g_assert_true(other->bytes > point->bytes || other->error > point->error);
    }
}

static gboolean has_colour(cairo_surface_t *picture, int i) {
    cairo_surface_t *one = cairo_image_surface_create(CAIRO_FORMAT_RGB24, 1, 1);
    cairo_t *cr = cairo_create(one);
    plot_colour(cr, i);
    cairo_paint(cr);
    cairo_destroy(cr);
    cairo_surface_flush(one);
    const guint32 wanted = *(guint32 *)(gpointer)cairo_image_surface_get_data(one) & 0xffffff;
    const guint8 *rows = cairo_image_surface_get_data(picture);
    const int stride = cairo_image_surface_get_stride(picture);
    gboolean found = FALSE;
    for (int y = 0; !found && y < PLOT_HEIGHT; y++)
        for (int x = 0; !found && x < PLOT_WIDTH; x++)
            found = (((const guint32 *)(gconstpointer)(rows + y * stride))[x] & 0xffffff) == wanted;
    cairo_surface_destroy(one);
    return found;
}

/* Each series has a colour of its own. */
static void assert_drawn(const char *folder, const GArray *points) {
    g_autoptr(GError) error = NULL;
    g_autofree char *png = g_build_filename(folder, "curve.png", NULL);
    g_autofree char *svg = g_build_filename(folder, "curve.svg", NULL);
    g_assert_true(
        plot_curve(svg, "waves", "seen", 1e5, point_at(points, 0), (int)points->len, &error));
    g_assert_true(
        plot_curve(png, "waves", "seen", 1e5, point_at(points, 0), (int)points->len, &error));
    g_assert_cmpint(size_of_file(svg), >, 1000);
    cairo_surface_t *picture = cairo_image_surface_create_from_png(png);
    g_assert_cmpint(cairo_surface_status(picture), ==, CAIRO_STATUS_SUCCESS);
    for (int i = 0; i < (int)G_N_ELEMENTS(names); i++)
        g_assert_true(has_colour(picture, i));
    cairo_surface_destroy(picture);
    g_assert_false(plot_curve("curve.jpg", "waves", "seen", 1e5, point_at(points, 0), 1, &error));
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT);
}

TEST(waves) {
    TEMPORARY_FOLDER(folder);
    struct btf_matrix *btf = waves();
    GArray *points = measure(btf);
    int packed = 0;
    assert_series(points);
    for (guint i = 0; i < points->len; i++)
        if (g_str_equal(point_at(points, i)->series, PACKED) && packed++ % 3 == 0)
            assert_packed(btf, points, point_at(points, i));
    g_assert_cmpint(packed, >=, 6);
    assert_drawn(folder, points);
    curve_free(points);
    btf_matrix_free(btf);
}

/* All texels alike, and black. */
TEST(constant) {
    TEMPORARY_FOLDER(folder);
    struct btf_matrix *btf = waves_fixture_new(SMALL, SMALL, VIEWS, LIGHTS, 0, TRUE);
    for (int black = 0; black < 2; black++) {
        GArray *points = measure(btf);
        assert_series(points);
        for (guint i = 0; black && i < points->len; i++)
            g_assert_cmpfloat(point_at(points, i)->error, ==, 0);
        assert_drawn(folder, points);
        curve_free(points);
        memset(btf->values, 0, sizeof(float) * SMALL * SMALL * VIEWS * LIGHTS * 3);
    }
    btf_matrix_free(btf);
}

static void cancel_packed(const struct work_progress *progress, gpointer data) {
    if (g_str_equal(progress->stage, "weights")) /* of packed ones only */
        g_cancellable_cancel(data);
}

TEST(cancelled) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GCancellable) cancellable = g_cancellable_new();
    /* The neural planes are trained before. This takes longer for more texels. */
    struct btf_matrix *btf = waves_fixture_new(WIDTH / 2, HEIGHT / 2, VIEWS, LIGHTS, 0.002, FALSE);
    const struct work work = {
        .progress = cancel_packed, .data = cancellable, .cancellable = cancellable};
    g_assert_null(curve_measure(btf, NULL, &work, &error));
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_CANCELLED);
    btf_matrix_free(btf);
}
