#include "lib/ok.h"
#include "lib/test.h"
#include "shapes/scene.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

static double dot(const float *a, const float *b) {
    return (double)a[0] * b[0] + (double)a[1] * b[1] + (double)a[2] * b[2];
}

static void bitangent(const struct vertex *v, float ret[3]) {
    const float *n = v->normal, *t = v->tangent;
    ret[0] = t[3] * (n[1] * t[2] - n[2] * t[1]);
    ret[1] = t[3] * (n[2] * t[0] - n[0] * t[2]);
    ret[2] = t[3] * (n[0] * t[1] - n[1] * t[0]);
}

static void check_frames(const struct mesh *mesh) {
    for (guint k = 0; k < mesh->n_vertices; k++) {
        const struct vertex *v = &mesh->vertices[k];
        g_assert_cmpfloat_with_epsilon(dot(v->normal, v->normal), 1.0, 1e-5);
        g_assert_cmpfloat_with_epsilon(dot(v->tangent, v->tangent), 1.0, 1e-5);
        g_assert_cmpfloat_with_epsilon(dot(v->normal, v->tangent), 0.0, 1e-5);
        g_assert_cmpfloat(fabs(v->tangent[3]), ==, 1.0);
        g_assert_cmpfloat(sqrt(dot(v->position, v->position)), <=, mesh->radius * 1.0001);
    }
    for (guint k = 0; k < mesh->n_indices; k++)
        g_assert_cmpuint(mesh->indices[k], <, mesh->n_vertices);
}

/* Along an edge the change of position, seen in the frame, must go with the change of u and v. */
static void check_edge(const struct vertex *a, const struct vertex *b) {
    float along[3], side[3];
    bitangent(a, side);
    for (int k = 0; k < 3; k++)
        along[k] = b->position[k] - a->position[k];
    double length = sqrt(dot(along, along)), du = b->uv[0] - a->uv[0], dv = b->uv[1] - a->uv[1];
    if (length < 1e-4)
        return;
    if (dv == 0.0)
        g_assert_cmpfloat(dot(along, a->tangent) * (du > 0 ? 1 : -1), >, 0.95 * length);
    if (du == 0.0)
        g_assert_cmpfloat(dot(along, side) * (dv > 0 ? 1 : -1), >, 0.95 * length);
}

static void check_triangles(const struct mesh *mesh) {
    for (guint k = 0; k < mesh->n_indices; k += 3) {
        const struct vertex *v[3];
        float a[3], b[3], n[3];
        for (int c = 0; c < 3; c++)
            v[c] = &mesh->vertices[mesh->indices[k + c]];
        for (int c = 0; c < 3; c++)
            check_edge(v[c], v[(c + 1) % 3]);
        for (int axis = 0; axis < 3; axis++) {
            a[axis] = v[1]->position[axis] - v[0]->position[axis];
            b[axis] = v[2]->position[axis] - v[0]->position[axis];
        }
        n[0] = a[1] * b[2] - a[2] * b[1];
        n[1] = a[2] * b[0] - a[0] * b[2];
        n[2] = a[0] * b[1] - a[1] * b[0];
        if (dot(n, n) > 1e-12)
            g_assert_cmpfloat(dot(n, v[0]->normal), >, 0.0);
    }
}

TEST(shapes) {
    const char *const names[] = {"plane", "torus", "sphere", "cylinder", "torus-knot"};
    for (gsize k = 0; k < G_N_ELEMENTS(names); k++) {
        g_autoptr(GError) error = NULL;
        g_autoptr(Mesh) mesh = scene_shape(names[k], SCENE_Y_UP, &error);
        g_assert_no_error(error);
        g_assert_cmpstr(mesh->name, ==, names[k]);
        g_assert_cmpfloat(mesh->tiles_u, >=, 1.0);
        check_frames(mesh);
        check_triangles(mesh);
    }
    g_autoptr(GError) error = NULL;
    g_assert_null(scene_shape("teapot", SCENE_Y_UP, &error));
    g_assert_error(error, SCENE_ERROR, SCENE_ERROR_NO_SHAPE);
}

TEST(torus) {
    g_autoptr(Mesh) mesh = scene_torus(1.0, 0.4, 64, 32);
    for (guint k = 0; k < mesh->n_vertices; k++) {
        const float *p = mesh->vertices[k].position;
        double ring = hypot(p[0], p[1]) - 1.0;
        g_assert_cmpfloat_with_epsilon(ring * ring + p[2] * p[2], 0.16, 1e-6);
    }
}

static struct mesh *parse(const char *text, enum scene_up up) {
    struct mesh *mesh = ok(scene_parse_obj("test.obj", text, up, ERR));
    check_frames(mesh);
    return mesh;
}

static const char square[] = "# a square\r\n"
                             "o square\n"
                             "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\n"
                             "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1 0\n"
                             "vn 0 0 1\n"
                             "usemtl none\ns off\n"
                             "f 1/1/1 2/2/1 3/3/1 4/4/1\n";

TEST(obj__square) {
    g_autoptr(Mesh) mesh = parse(square, SCENE_Z_UP);
    g_assert_cmpuint(mesh->n_vertices, ==, 4);
    g_assert_cmpuint(mesh->n_indices, ==, 6);
    check_triangles(mesh);
    for (int k = 0; k < 4; k++) {
        g_assert_cmpfloat_with_epsilon(mesh->vertices[k].tangent[0], 1.0, 1e-6);
        g_assert_cmpfloat(mesh->vertices[k].tangent[3], ==, 1.0);
        g_assert_cmpfloat_with_epsilon(fabs(mesh->vertices[k].position[0]), sqrt(0.5), 1e-6);
    }
}

/* A quarter around the first vertex has its texture's +x along x; the next one, in three slivers,
 * along y. Weighted by angles, as MikkTSpace has it, the vertex's tangent lies half way between. */
TEST(obj__tangent) {
    g_autoptr(GString) text = g_string_new("v 0 0 0\nvt 0 0\nvn 0 0 1\nv 1 0 0\nvt 1 0\n"
                                           "v 0 1 0\nvt 0 1\nf 1/1/1 2/2/1 3/3/1\n");
    const double angles[] = {0.0, 10.0, 35.0, 90.0};
    for (int k = 0; k < 4; k++) {
        double c = cos(angles[k] * G_PI / 180.0), s = sin(angles[k] * G_PI / 180.0);
        g_string_append_printf(text, "v %.9f %.9f 0\nvt %.9f %.9f\n", -s, c, c, s);
        if (k > 0)
            g_string_append(text, "f 1/1/1 -2/-2/1 -1/-1/1\n");
    }
    g_autoptr(Mesh) mesh = parse(text->str, SCENE_Z_UP);
    const struct vertex *v = &mesh->vertices[mesh->indices[0]];
    g_assert_cmpuint(mesh->indices[3], ==, mesh->indices[0]);
    g_assert_cmpfloat_with_epsilon(v->tangent[0], sqrt(0.5), 1e-5);
    g_assert_cmpfloat_with_epsilon(v->tangent[1], sqrt(0.5), 1e-5);
}

/* The floor touches the shape, and its tiles are as large as the shape's in the mean. */
TEST(floor) {
    const struct scene_options options = {8, 4, SCENE_Z_UP, TRUE};
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_make("torus", &options, &error);
    g_assert_no_error(error);
    check_triangles(mesh);
    g_assert_cmpuint(mesh->n_floor_vertices, ==, 4);
    const struct vertex *v = &mesh->vertices[mesh->n_vertices - 4];
    double tile[2] = {(v[1].position[0] - v[0].position[0]) / (8 * (v[1].uv[0] - v[0].uv[0])),
                      (v[2].position[1] - v[0].position[1]) / (4 * (v[2].uv[1] - v[0].uv[1]))};
    g_assert_cmpfloat_with_epsilon(v->position[2], -0.4, 1e-6);
    g_assert_cmpfloat_with_epsilon(tile[0], tile[1], 1e-5);
    /* The torus has 4 π² · 0.4 in 32 tiles. */
    g_assert_cmpfloat_with_epsilon(tile[0] * tile[1], 4.0 * G_PI * G_PI * 0.4 / 32.0, 2e-3);
    g_assert_cmpfloat(mesh->radius, <, 1.5);
}

/* y of the file becomes z, and its z comes towards the camera, which is at −y. */
TEST(obj__y_up) {
    g_autoptr(Mesh) mesh = parse(square, SCENE_Y_UP);
    g_assert_cmpfloat_with_epsilon(mesh->vertices[0].normal[1], -1.0, 1e-6);
    g_assert_cmpfloat(mesh->vertices[2].position[2], >, 0.5);
    g_assert_cmpfloat_with_epsilon(mesh->vertices[0].tangent[0], 1.0, 1e-6);
}

TEST(obj__negative_and_ngon) {
    g_autoptr(Mesh) mesh = parse("v 0 0 0\nv 2 0 0\nv 3 1 0\nv 1 2 0\nv -1 1 0\n"
                                 "vt 0 0\nvt 2 0\nvt 3 1\nvt 1 2\nvt -1 1\n"
                                 "f -5/-5 -4/-4 -3/-3 \\\n-2/-2 -1/-1\n",
                                 SCENE_Z_UP);
    g_assert_cmpuint(mesh->n_indices, ==, 9);
    g_assert_cmpuint(mesh->n_vertices, ==, 5);
    for (int k = 0; k < 5; k++) {
        g_assert_cmpfloat_with_epsilon(mesh->vertices[k].normal[2], 1.0, 1e-6);
        g_assert_cmpfloat_with_epsilon(mesh->vertices[k].tangent[0], 1.0, 1e-6);
    }
}

/* The second triangle's texture is mirrored: the shared edge must have vertices of both senses. */
TEST(obj__mirrored) {
    g_autoptr(Mesh) mesh = parse("v 0 0 0\nv 1 0 0\nv 0 1 0\nv -1 0 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
                                 "f 1/1 2/2 3/3\nf 1/1 3/3 4/2\n",
                                 SCENE_Z_UP);
    g_assert_cmpuint(mesh->n_vertices, ==, 6);
    int mirrored = 0;
    for (int k = 0; k < 6; k++) {
        float side[3];
        bitangent(&mesh->vertices[k], side);
        g_assert_cmpfloat_with_epsilon(side[1], 1.0, 1e-5);
        mirrored += mesh->vertices[k].tangent[3] < 0.0f;
        g_assert_cmpfloat_with_epsilon(mesh->vertices[k].tangent[0], mesh->vertices[k].tangent[3],
                                       1e-5);
    }
    g_assert_cmpint(mirrored, ==, 3);
}

/* The normals, not the winding, say what is outside. */
TEST(obj__wound_backwards) {
    g_autoptr(Mesh) mesh = parse("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 5\n"
                                 "f 1/1/1 3/3/1 2/2/1\n",
                                 SCENE_Z_UP);
    check_triangles(mesh);
}

TEST(obj__degenerate) {
    g_autoptr(Mesh) mesh = parse("v 0 0 0\nv 1 0 0\nv 2 0 0\nvt 0.5 0.5\nvn 0 0 0\n"
                                 "f 1/1/1 2/1/1 3/1/1\n",
                                 SCENE_Z_UP);
    g_assert_cmpuint(mesh->n_indices, ==, 3);
}

TEST(obj__bad) {
    const struct {
        const char *text;
        enum scene_error code;
        const char *said;
    } cases[] = {
        {"", SCENE_ERROR_FORMAT, "no face"},
        {"hello\n", SCENE_ERROR_FORMAT, "no face"},
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", SCENE_ERROR_NO_TEXTURE, ":4:"},
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\n", SCENE_ERROR_NO_TEXTURE, "vt"},
        {"v 0 0\n", SCENE_ERROR_FORMAT, ":1:"},
        {"v 0 0", SCENE_ERROR_FORMAT, "3 numbers within"},
        {"v 0 nan 0\n", SCENE_ERROR_FORMAT, "numbers within"},
        {"v 0 inf 0\n", SCENE_ERROR_FORMAT, "numbers within"},
        {"v 0 1e300 0\n", SCENE_ERROR_FORMAT, "numbers within"},
        {"v 0 zero 0\n", SCENE_ERROR_FORMAT, "numbers within"},
        {"v 0 0 0\nvt 0 0\nf 1/1 1/1 2/1\n", SCENE_ERROR_FORMAT, "position 2"},
        {"v 0 0 0\nvt 0 0\nf 1/1 1/1 -2/1\n", SCENE_ERROR_FORMAT, "position"},
        {"v 0 0 0\nvt 0 0\nf 1/0 1/1 1/1\n", SCENE_ERROR_FORMAT, "texture coordinate 0"},
        {"v 0 0 0\nvt 0 0\nf 1/1/1 1/1/1 1/1/1\n", SCENE_ERROR_FORMAT, "normal 1"},
        {"v 0 0 0\nvt 0 0\nf 1/99999999999999999999 1/1 1/1\n", SCENE_ERROR_FORMAT, "coordinate"},
        {"v 0 0 0\nvt 0 0\nf 1/1 1/1\n", SCENE_ERROR_FORMAT, "three corners"},
        {"v 0 0 0\nvt 0 0\nf 1/\n1 1/1 1/1\n", SCENE_ERROR_FORMAT, "expected"},
        {"v 0 0 0\nvt 0 0\nf 1/1x 1/1 1/1\n", SCENE_ERROR_FORMAT, "v/vt/vn"},
        {"v 0 0 0\nvt 0 0\nf 1/1/", SCENE_ERROR_FORMAT, "expected"},
        {"v 1 2 3\nvt 0 0\nf 1/1 1/1 1/1\n", SCENE_ERROR_FORMAT, "the same"},
    };
    for (gsize k = 0; k < G_N_ELEMENTS(cases); k++) {
        g_autoptr(GError) error = NULL;
        g_assert_null(scene_parse_obj("bad.obj", cases[k].text, SCENE_Y_UP, &error));
        g_assert_error(error, SCENE_ERROR, (int)cases[k].code);
        g_assert_nonnull(strstr(error->message, cases[k].said));
    }
}

/* Whatever is done to a file, it is read or refused. */
TEST(obj__damaged) {
    g_autoptr(GRand) random = g_rand_new_with_seed(11);
    static const char letters[] = "0123456789-/. \n\\vtnfe#";
    for (int k = 0; k < 3000; k++) {
        g_autofree char *text = g_strdup(square);
        gsize length = strlen(text);
        for (int hit = 0; hit < 1 + k % 5; hit++)
            text[g_rand_int_range(random, 0, length)] =
                letters[g_rand_int_range(random, 0, sizeof letters - 1)];
        text[k % 3 == 0 ? g_rand_int_range(random, 0, length) : (int)length] = '\0';
        g_autoptr(GError) error = NULL;
        g_autoptr(Mesh) mesh = scene_parse_obj("damaged.obj", text, SCENE_Y_UP, &error);
        g_assert_true((mesh != NULL) == (error == NULL));
        if (mesh != NULL)
            check_frames(mesh);
    }
}

TEST(obj__files) {
    g_autofree char *path = NULL;
    g_autoptr(GError) error = NULL, missing = NULL, binary = NULL;
    int file = ok(g_file_open_tmp("mesorig-XXXXXX.obj", &path, ERR));
    g_close(file, NULL);
    g_assert_true(g_file_set_contents(path, square, -1, NULL));
    g_autoptr(Mesh) mesh = scene_shape(path, SCENE_Z_UP, &error);
    g_assert_no_error(error);
    g_assert_true(g_file_set_contents(path, "v 0\0 0", 6, NULL));
    g_assert_null(scene_shape(path, SCENE_Z_UP, &binary));
    g_assert_error(binary, SCENE_ERROR, SCENE_ERROR_FORMAT);
    g_unlink(path);
    g_assert_null(scene_shape(path, SCENE_Z_UP, &missing));
    g_assert_error(missing, SCENE_ERROR, SCENE_ERROR_IO);
}
