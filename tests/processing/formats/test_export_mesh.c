/* The mesh of a plate over a floor as PLY, OBJ and glTF, read as other programs read them. */
#include "formats/export_mesh.h"

#include "lib/ok.h"
#include "lib/plate.h"
#include "lib/session_fixture.h"
#include "lib/test.h"
#include "shapes/gltf_scene.h"

#include <gio/gio.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#define REFERENCE 6.0 /* height of the reference plane, mm */

static char *plate_session(void) {
    char *path = session_fixture_path("plate");
    const struct session_plan plan = {
        .grid = {PLATE_TEXELS, PLATE_ROWS, PLATE_TILE, PLATE_HEIGHT, REFERENCE, 5}};
    g_autoptr(Session) session = ok(session_create(path, "plate", &texts, &plan, ERR));
    g_autofree char *mdf = session_file(session, "products/mdf.exr");
    plate_write(mdf, 2);
    return path;
}

struct seen {
    int n_vertices, n_triangles;
    double low[3], high[3]; /* of the coordinates */
};

static void see(struct seen *seen, const double at[3]) {
    for (int c = 0; c < 3; c++) {
        seen->low[c] = seen->n_vertices == 0 ? at[c] : MIN(seen->low[c], at[c]);
        seen->high[c] = seen->n_vertices == 0 ? at[c] : MAX(seen->high[c], at[c]);
    }
    seen->n_vertices++;
}

static struct seen see_ply(const char *path) {
    struct seen seen = {0};
    g_autofree char *bytes = NULL;
    gsize length = 0;
    int n = 0;
    g_assert_true(g_file_get_contents(path, &bytes, &length, NULL));
    g_assert_true(g_str_has_prefix(bytes, "ply\nformat binary_little_endian 1.0\n"));
    g_assert_cmpint(sscanf(strstr(bytes, "element vertex "), "element vertex %d", &n), ==, 1);
    g_assert_cmpint(sscanf(strstr(bytes, "element face "), "element face %d", &seen.n_triangles),
                    ==, 1);
    const char *body = strstr(bytes, "end_header\n") + strlen("end_header\n");
    g_assert_cmpuint(length, ==,
                     (gsize)(body - bytes) + 32 * (gsize)n + 13 * (gsize)seen.n_triangles);
    for (int k = 0; k < n; k++, body += 32) {
        float v[8];
        memcpy(v, body, sizeof v);
        see(&seen, (const double[]){(double)v[0], (double)v[1], (double)v[2]});
        /* The top row of texels, at the largest y, has t = 1. */
        g_assert_cmpfloat_with_epsilon((double)v[1], ((double)v[7] - 0.5) * PLATE_HEIGHT, 1e-3);
        g_assert_cmpfloat_with_epsilon((double)v[0], ((double)v[6] - 0.5) * PLATE_TILE, 1e-3);
    }
    for (int k = 0; k < seen.n_triangles; k++, body += 13) {
        guint32 corners[3];
        memcpy(corners, body + 1, sizeof corners);
        g_assert_cmpint(body[0], ==, 3);
        for (int c = 0; c < 3; c++)
            g_assert_cmpuint(corners[c], <, (guint)n);
    }
    return seen;
}

static struct seen see_obj(const char *path) {
    struct seen seen = {0};
    g_autofree char *text = NULL;
    int n_normals = 0, n_places = 0;
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
    for (char **line = lines; *line != NULL; line++) {
        double at[3];
        int corners[9];
        if (sscanf(*line, "v %lf %lf %lf", &at[0], &at[1], &at[2]) == 3)
            see(&seen, at);
        n_places += sscanf(*line, "vt %lf %lf", &at[0], &at[1]) == 2;
        if (sscanf(*line, "vn %lf %lf %lf", &at[0], &at[1], &at[2]) == 3) {
            g_assert_cmpfloat_with_epsilon(at[0] * at[0] + at[1] * at[1] + at[2] * at[2], 1.0,
                                           1e-3);
            n_normals++;
        }
        seen.n_triangles += sscanf(*line, "f %d/%d/%d %d/%d/%d %d/%d/%d", &corners[0], &corners[1],
                                   &corners[2], &corners[3], &corners[4], &corners[5], &corners[6],
                                   &corners[7], &corners[8]) == 9;
    }
    g_assert_cmpint(n_normals, ==, seen.n_vertices);
    g_assert_cmpint(n_places, ==, seen.n_vertices);
    return seen;
}

/* The reader turns y upwards into z upwards. Metres become mm again. */
static struct seen see_glb(const char *path) {
    struct seen seen = {0};
    g_autoptr(GltfScene) scene = ok(gltf_scene_read(path, ERR));
    g_assert_cmpuint(scene->parts->len, ==, 1);
    const struct gltf_part *part = scene->parts->pdata[0];
    g_assert_true(part->texture);
    seen.n_triangles = (int)part->mesh->n_indices / 3;
    for (guint k = 0; k < part->mesh->n_vertices; k++) {
        const float *p = part->mesh->vertices[k].position;
        see(&seen,
            (const double[]){1000.0 * (double)p[0], 1000.0 * (double)p[1], 1000.0 * (double)p[2]});
    }
    return seen;
}

TEST(forms) {
    static const struct {
        const char *name;
        struct seen (*see)(const char *path);
    } forms[] = {[EXPORT_MESH_PLY] = {"a.ply", see_ply},
                 [EXPORT_MESH_OBJ] = {"a.obj", see_obj},
                 [EXPORT_MESH_GLB] = {"a.glb", see_glb}};
    g_autofree char *session = plate_session();
    for (gsize k = 0; k < G_N_ELEMENTS(forms); k++) {
        g_autofree char *file = g_build_filename(session_fixture_folder, forms[k].name, NULL);
        struct export_mesh_result result;
        ok(export_mesh(session, file, (enum export_mesh_form)k, &result, ERR));
        const struct seen seen = forms[k].see(file);
        g_assert_cmpint(result.n_views, ==, 24);
        /* A reader of glTF may split vertices. */
        g_assert_cmpint(seen.n_vertices, >=, (int)result.n_vertices);
        if (k != EXPORT_MESH_GLB)
            g_assert_cmpint(seen.n_vertices, ==, (int)result.n_vertices);
        g_assert_cmpint(seen.n_triangles, ==, (int)result.n_triangles);
        g_assert_cmpint(seen.n_triangles, >, 1000);
        const double half_mm[] = {PLATE_TILE / 2.0, PLATE_HEIGHT / 2.0};
        for (int c = 0; c < 2; c++) {
            g_assert_cmpfloat_with_epsilon(seen.low[c], -half_mm[c], 1e-3);
            g_assert_cmpfloat_with_epsilon(seen.high[c], half_mm[c], 1e-3);
        }
        g_assert_cmpfloat_with_epsilon(seen.high[2], REFERENCE - PLATE_TOP, 0.4);
        g_assert_cmpfloat_with_epsilon(seen.low[2], REFERENCE - PLATE_FLOOR, 0.4);
    }
}

TEST(no_mdf) {
    g_autofree char *path = session_fixture_path("bare");
    const struct session_plan plan = {.grid = {8, 8, 8.0, 8.0, 1.0, 5}};
    g_autoptr(Session) session = ok(session_create(path, "bare", &texts, &plan, ERR));
    g_autofree char *file = g_build_filename(session_fixture_folder, "none.ply", NULL);
    g_autoptr(GError) error = NULL;
    struct export_mesh_result result;
    g_assert_false(export_mesh(path, file, EXPORT_MESH_PLY, &result, &error));
    g_assert_nonnull(strstr(error->message, "there is no MDF"));
    g_assert_false(g_file_test(file, G_FILE_TEST_EXISTS));
}

TESTS_RUN_BY(session_fixture_run);
