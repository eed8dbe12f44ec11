/* Points and maps of a structure that is known by formula, seen by cameras that are so as well. */
#include "base/data_error.h"
#include "base/vec.h"
#include "formats/export_surface.h"

#include <gio/gio.h>

#include "lib/ok.h"
#include "lib/session_fixture.h"
#include "lib/test.h"

#define SIDE      48 /* texels */
#define SIZE_MM   24.0
#define REFERENCE 5.0
#define TEXEL_MM  (SIZE_MM / SIDE)
#define VIEWS     9

static const struct work silent = {0};

typedef double (*Inside)(struct vec3 p); /* below 0: in the structure */

static double height_at(double x, double y) {
    return 3.5 + 0.8 * sin(0.7 * x + 0.3) * cos(0.5 * y);
}

static double hills(struct vec3 p) {
    return p.z - height_at(p.x, p.y);
}

/* A plate 3 mm above a floor, over its middle third. */
static double bridge(struct vec3 p) {
    const gboolean plate = fabs(p.x) < SIZE_MM / 6 && p.z > 3.9 && p.z < 4.1;
    return plate || p.z < 1 ? -1 : 1;
}

static struct vec3 eye_of(int view) {
    const double phi = view * G_PI / 4 + 0.3, theta = view == 0 ? 0.15 : 0.8;
    return vec3(600 * sin(theta) * cos(phi), 600 * sin(theta) * sin(phi), 600 * cos(theta));
}

/* Where a ray first meets the structure, by small steps and halving; −1: nowhere. */
static double march(struct vec3 from, struct vec3 ray, Inside inside) {
    for (double t = 0; t < 12; t += 0.02)
        if (inside(vec3_add(from, vec3_scale(ray, t))) < 0) {
            double low = MAX(t - 0.02, 0), high = t;
            for (int i = 0; i < 30; i++) {
                const double middle = (low + high) / 2;
                if (inside(vec3_add(from, vec3_scale(ray, middle))) < 0)
                    high = middle;
                else
                    low = middle;
            }
            return high;
        }
    return -1;
}

/* A texel's middle, in the reference plane. */
static struct vec3 texel_mm(int texel) {
    const int column = texel % SIDE, row = texel / SIDE;
    return vec3((column + 0.5) * TEXEL_MM - SIZE_MM / 2, SIZE_MM / 2 - (row + 0.5) * TEXEL_MM,
                REFERENCE);
}

static struct exr_part *view_part(int view, Inside inside) {
    static const char *const channels[] = {"D", "N", "S", NULL};
    g_autofree char *name = g_strdup_printf("view_%04d", view);
    struct exr_part *part = exr_part_new(name, SIDE, SIDE, channels, EXR_FLOAT);
    const struct vec3 eye = eye_of(view);
    for (int i = 0; i < SIDE * SIDE; i++) {
        const struct vec3 p = texel_mm(i);
        part->planes[0][i] = (float)march(p, vec3_unit(vec3_sub(p, eye)), inside);
        part->planes[1][i] = 3;
        part->planes[2][i] = 0.01f;
    }
    exr_set_v3d(part, "view.centre_mm", eye.x, eye.y, eye.z);
    return part;
}

static char *make_session(Inside inside) {
    char *path = session_fixture_path("surface");
    const struct session_plan plan = {.grid = {SIDE, SIDE, SIZE_MM, SIZE_MM, REFERENCE, 5}};
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_create(path, "surface", &texts, &plan, &error);
    g_assert_no_error(error);
    g_autoptr(ExrFile) file = exr_file_new();
    g_autofree char *mdf = session_file(session, "products/mdf.exr");
    for (int view = 0; view < VIEWS; view++)
        exr_file_add(file, view_part(view, inside));
    g_assert_true(exr_write(mdf, file, EXR_NONE, FALSE, &error));
    return path;
}

static gboolean export_as(const char *path, const char *file, enum export_surface what,
                          gboolean layered, struct export_surface_result *ret, GError **error) {
    const struct export_surface_options options = {.what = what, .layered = layered};
    return export_surface(path, file, &options, &silent, ret, error);
}

static struct vec3 normal_of(double x, double y) {
    const double e = 1e-4, dx = (height_at(x + e, y) - height_at(x - e, y)) / (2 * e);
    const double dy = (height_at(x, y + e) - height_at(x, y - e)) / (2 * e);
    return vec3_unit(vec3(-dx, -dy, 1));
}

/* Read as any reader of PLY would, by its head. */
TEST(points) {
    g_autofree char *path = make_session(hills), *file = NULL, *bytes = NULL;
    struct export_surface_result result;
    gsize length = 0;
    int n = 0;
    file = g_build_filename(session_fixture_folder, "points.ply", NULL);
    g_assert_true(ok(export_as(path, file, EXPORT_POINTS, FALSE, &result, ERR)));
    g_assert_true(g_file_get_contents(file, &bytes, &length, NULL));
    const char *count = strstr(bytes, "element vertex "), *body = strstr(bytes, "end_header\n");
    g_assert_true(count && body && sscanf(count, "element vertex %d", &n) == 1);
    body += strlen("end_header\n");
    g_assert_cmpint(n, ==, result.points);
    g_assert_cmpint(n, >, SIDE * SIDE * 8 / 10);
    g_assert_cmpuint(length, ==, (gsize)(body - bytes) + (gsize)n * 29);
    double squares = 0, tilt = 0;
    for (int i = 0; i < n; i++, body += 29) {
        float v[7];
        memcpy(v, body, sizeof v);
        const double off = (double)v[2] - height_at((double)v[0], (double)v[1]);
        const struct vec3 normal = vec3((double)v[3], (double)v[4], (double)v[5]);
        squares += off * off;
        tilt += acos(MIN(vec3_dot(normal, normal_of((double)v[0], (double)v[1])), 1));
        g_assert_cmpfloat(fabs(off), <, 0.1);
        g_assert_cmpint((guint8)body[28], >=, 2);
    }
    g_assert_cmpfloat(sqrt(squares / n), <, 0.02);
    g_assert_cmpfloat(tilt / n, <, 0.03);
}

TEST(height) {
    g_autoptr(GError) error = NULL;
    g_autofree char *path = make_session(hills);
    g_autofree char *file = g_build_filename(session_fixture_folder, "height.exr", NULL);
    struct export_surface_result result;
    g_assert_true(ok(export_as(path, file, EXPORT_HEIGHT, FALSE, &result, ERR)));
    g_assert_cmpint(result.stacked, ==, 0);
    g_assert_cmpint(result.holes, <, SIDE * SIDE / 20);
    g_autoptr(ExrPart) part = exr_read_part(file, "height", &error);
    const float *z = exr_part_plane(part, "Z"), *n = exr_part_plane(part, "N");
    double squares = 0;
    int holes = 0, seen = 0;
    for (int i = 0; i < SIDE * SIDE; i++) {
        const struct vec3 p = texel_mm(i);
        holes += n[i] == 0;
        if (n[i] < 3)
            continue;
        squares += pow((double)z[i] - height_at(p.x, p.y), 2);
        seen++;
    }
    g_assert_cmpint(holes, ==, result.holes);
    g_assert_cmpfloat(sqrt(squares / seen), <, 0.05); /* a tenth of a texel, of points next to */
    g_assert_true(export_as(path, file, EXPORT_NORMALS, FALSE, &result, &error));
    g_autoptr(ExrPart) normals = exr_read_part(file, "normals", &error);
    const struct vec3 wanted = normal_of(0.25, -0.25);
    const int middle = SIDE / 2 * SIDE + SIDE / 2;
    const double got = wanted.x * (double)exr_part_plane(normals, "X")[middle] +
                       wanted.y * (double)exr_part_plane(normals, "Y")[middle] +
                       wanted.z * (double)exr_part_plane(normals, "Z")[middle];
    g_assert_cmpfloat(got, >, 0.998);
}

TEST(no_height_field) {
    g_autoptr(GError) error = NULL;
    g_autofree char *path = make_session(bridge);
    g_autofree char *file = g_build_filename(session_fixture_folder, "bridge.exr", NULL);
    struct export_surface_result result;
    g_assert_false(export_as(path, file, EXPORT_HEIGHT, FALSE, &result, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_assert_nonnull(strstr(error->message, "the surface is not a height field"));
    g_assert_false(g_file_test(file, G_FILE_TEST_EXISTS));
    g_clear_error(&error);
    g_assert_true(export_as(path, file, EXPORT_HEIGHT, TRUE, &result, &error));
    g_autoptr(ExrPart) part = exr_read_part(file, "height", &error);
    const int middle = SIDE / 2 * SIDE + SIDE / 2 - 4; /* under the plate, where others see */
    const float *z = exr_part_plane(part, "Z"), *n = exr_part_plane(part, "N");
    int marked = 0;
    for (int i = 0; i < SIDE * SIDE; i++)
        if (n[i] == -1) {
            g_assert_cmpfloat_with_epsilon((double)z[i], 4.0, 0.15);
            marked++;
        }
    g_assert_cmpint(marked, ==, result.stacked);
    g_assert_cmpint(marked, >, SIDE * SIDE / 20);
    g_assert_cmpfloat_with_epsilon((double)z[middle], 4.1, 0.01);
}

TEST(bad) {
    g_autoptr(GError) error = NULL;
    g_autofree char *path = make_session(hills);
    g_autofree char *mdf = g_build_filename(path, "products/mdf.exr", NULL);
    g_autofree char *file = g_build_filename(session_fixture_folder, "bad.exr", NULL);
    struct export_surface_result result;
    g_autoptr(ExrFile) exr = exr_read(mdf, NULL);
    struct exr_part *first = exr->parts->pdata[0];
    for (int i = 0; i < SIDE * SIDE; i++)
        first->planes[0][i] = i % 2 ? NAN : INFINITY;
    g_assert_true(exr_write(mdf, exr, EXR_NONE, FALSE, NULL));
    g_assert_true(export_as(path, file, EXPORT_POINTS, FALSE, &result, &error));
    g_unlink(mdf);
    g_assert_false(export_as(path, file, EXPORT_POINTS, FALSE, &result, &error));
    g_assert_nonnull(strstr(error->message, "there is no MDF"));
    g_clear_error(&error);
    g_assert_true(g_file_set_contents(mdf, "no EXR", -1, NULL));
    g_assert_false(export_as(path, file, EXPORT_HEIGHT, FALSE, &result, &error));
    g_assert_nonnull(error);
    g_clear_error(&error);
    g_assert_false(export_as(session_fixture_folder, file, EXPORT_HEIGHT, FALSE, &result, &error));
    g_assert_nonnull(error);
}

TESTS_RUN_BY(session_fixture_run);
