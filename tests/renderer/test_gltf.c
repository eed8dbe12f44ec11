/* Shapes of glTF files: a square with a known frame in every encoding that a file may use, and
 * files with wrong contents. */
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "shapes/scene.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#define HEAD "{\"asset\": {\"version\": \"2.0\"}, "

/* x and y from −1 to 1, counter-clockwise; v runs downwards in glTF. */
static const float positions[4][3] = {{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}};
static const float normals[4][3] = {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}, {0, 0, 1}};
static const float uvs[4][2] = {{0, 1}, {1, 1}, {1, 0}, {0, 0}};
static const float tangents[4][4] = {{0, 2, 0, -1}, {0, 2, 0, -1}, {0, 2, 0, -1}, {0, 2, 0, -1}};
static const guint16 triangles[6] = {0, 1, 2, 0, 2, 3};
static const guint16 strip[4] = {0, 1, 3, 2};
static const guint16 fan[4] = {1, 2, 3, 0};

/* Views 0 … 6 and accessors of the same number lie one after the other in the buffer. */
static const struct {
    const void *bytes;
    gsize size;
    int n, type;
    const char *shape;
} parts[] = {
    {positions, sizeof positions, 4, 5126, "VEC3"},
    {normals, sizeof normals, 4, 5126, "VEC3"},
    {uvs, sizeof uvs, 4, 5126, "VEC2"},
    {tangents, sizeof tangents, 4, 5126, "VEC4"},
    {triangles, sizeof triangles, 6, 5123, "SCALAR"},
    {strip, sizeof strip, 4, 5123, "SCALAR"},
    {fan, sizeof fan, 4, 5123, "SCALAR"},
};

static GByteArray *buffer_bytes(void) {
    GByteArray *bytes = g_byte_array_new();
    for (gsize k = 0; k < G_N_ELEMENTS(parts); k++)
        g_byte_array_append(bytes, parts[k].bytes, (guint)parts[k].size);
    return bytes;
}

/* Without its last brace: views, accessors and what is given. uri: "" for a .glb. */
static char *json_of(const char *uri, const char *rest) {
    g_autoptr(GByteArray) bytes = buffer_bytes();
    g_autoptr(GString) views = g_string_new(NULL), accessors = g_string_new(NULL);
    gsize at = 0;
    for (gsize k = 0; k < G_N_ELEMENTS(parts); at += parts[k++].size) {
        g_string_append_printf(views,
                               "%s{\"buffer\": 0, \"byteOffset\": %" G_GSIZE_FORMAT
                               ", \"byteLength\": %" G_GSIZE_FORMAT "}",
                               k > 0 ? ", " : "", at, parts[k].size);
        g_string_append_printf(
            accessors,
            "%s{\"bufferView\": %d, \"componentType\": %d, \"count\": %d, \"type\": \"%s\"}",
            k > 0 ? ", " : "", (int)k, parts[k].type, parts[k].n, parts[k].shape);
    }
    return g_strdup_printf(HEAD "\"buffers\": [{\"byteLength\": %u%s%s%s}], \"bufferViews\": [%s], "
                                "\"accessors\": [%s], %s}",
                           bytes->len, *uri ? ", \"uri\": \"" : "", uri, *uri ? "\"" : "",
                           views->str, accessors->str, rest);
}

static struct mesh *read_bytes(const char *name, const void *bytes, gsize size, enum scene_up up,
                               GError **error) {
    g_autofree char *folder = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    g_autofree char *path = g_build_filename(folder, name, NULL);
    g_assert_true(g_file_set_contents(path, bytes, (gssize)size, NULL));
    struct mesh *mesh = scene_shape(path, up, error);
    remove_tree(folder);
    return mesh;
}

static struct mesh *read_json(const char *rest, enum scene_up up, GError **error) {
    g_autoptr(GByteArray) bytes = buffer_bytes();
    g_autofree char *base64 = g_base64_encode(bytes->data, bytes->len);
    g_autofree char *uri = g_strconcat("data:application/octet-stream;base64,", base64, NULL);
    g_autofree char *json = json_of(uri, rest);
    return read_bytes("a.gltf", json, strlen(json), up, error);
}

#define ATTRIBUTES "\"attributes\": {\"POSITION\": 0, \"NORMAL\": 1, \"TEXCOORD_0\": 2"
#define MESH(more) "\"meshes\": [{\"primitives\": [{" more "}]}]"

/* t along x, b along y, and v upwards. */
static void check_square(const struct mesh *mesh, guint n_vertices) {
    g_assert_cmpuint(mesh->n_vertices, ==, n_vertices);
    g_assert_cmpuint(mesh->n_indices, ==, 6);
    for (guint k = 0; k < mesh->n_vertices; k++) {
        const struct vertex *v = &mesh->vertices[k];
        const double x = v->position[0] * M_SQRT2, y = v->position[1] * M_SQRT2;
        g_assert_cmpfloat_with_epsilon(fabs(x), 1.0, 1e-5);
        g_assert_cmpfloat_with_epsilon(v->uv[0], 0.5 + 0.5 * x, 1e-5);
        g_assert_cmpfloat_with_epsilon(v->uv[1], 0.5 + 0.5 * y, 1e-5);
        g_assert_cmpfloat_with_epsilon(v->normal[2], 1.0, 1e-5);
        g_assert_cmpfloat_with_epsilon(v->tangent[0], 1.0, 1e-5);
        g_assert_cmpfloat(v->tangent[3], ==, 1.0);
    }
    for (guint k = 0; k < 6; k += 3) {
        const float *p[3];
        for (int c = 0; c < 3; c++)
            p[c] = mesh->vertices[mesh->indices[k + c]].position;
        g_assert_cmpfloat((p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) -
                              (p[1][1] - p[0][1]) * (p[2][0] - p[0][0]),
                          >, 0.5);
    }
}

/* With indices in three modes; without a scene; and flat, where there are no normals. */
TEST(square) {
    static const struct {
        const char *rest;
        guint n_vertices;
    } cases[] = {
        {MESH(ATTRIBUTES "}, \"indices\": 4"), 4},
        {MESH(ATTRIBUTES "}, \"indices\": 5, \"mode\": 5"), 4},
        {MESH(ATTRIBUTES "}, \"indices\": 6, \"mode\": 6"), 4},
        {MESH(ATTRIBUTES "}, \"mode\": 6"), 4},
        {MESH("\"attributes\": {\"POSITION\": 0, \"TEXCOORD_0\": 2}, \"indices\": 4"), 6},
        {MESH("\"attributes\": {\"POSITION\": 0}, \"mode\": 1}, {" ATTRIBUTES "}, \"indices\": 4"),
         4},
        {"\"scenes\": [{}, {\"nodes\": [1]}], \"scene\": 1, \"nodes\": [{\"mesh\": 0}, "
         "{\"children\": [0]}], " MESH(ATTRIBUTES "}, \"indices\": 4"),
         4},
    };
    for (gsize k = 0; k < G_N_ELEMENTS(cases); k++) {
        g_autoptr(GError) error = NULL;
        g_autoptr(Mesh) mesh = read_json(cases[k].rest, SCENE_Z_UP, &error);
        g_assert_no_error(error);
        check_square(mesh, cases[k].n_vertices);
    }
}

/* A node turns, mirrors and stretches; the file's up becomes z. */
TEST(places) {
    static const struct {
        const char *node;
        enum scene_up up;
        float normal[3], tangent[4];
    } cases[] = {
        {"\"translation\": [5, 6, 7]", SCENE_Z_UP, {0, 0, 1}, {1, 0, 0, 1}},
        /* by 90° around x: z becomes −y */
        {"\"rotation\": [0.70710678, 0, 0, 0.70710678]", SCENE_Z_UP, {0, -1, 0}, {1, 0, 0, 1}},
        {"\"scale\": [-1, 1, 1]", SCENE_Z_UP, {0, 0, 1}, {-1, 0, 0, -1}},
        {"\"scale\": [3, 1, 9]", SCENE_Z_UP, {0, 0, 1}, {1, 0, 0, 1}},
        /* in columns: x becomes y, y becomes z */
        {"\"matrix\": [0, 1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 0, 0, 0, 0, 1]",
         SCENE_Z_UP,
         {1, 0, 0},
         {0, 1, 0, 1}},
        {"\"scale\": [1, 1, 1]", SCENE_Y_UP, {0, -1, 0}, {1, 0, 0, 1}},
    };
    for (gsize k = 0; k < G_N_ELEMENTS(cases); k++) {
        g_autoptr(GError) error = NULL;
        g_autofree char *rest =
            g_strdup_printf("\"scenes\": [{\"nodes\": [0]}], \"nodes\": [{\"mesh\": 0, %s}], " MESH(
                                ATTRIBUTES "}, \"indices\": 4"),
                            cases[k].node);
        g_autoptr(Mesh) mesh = read_json(rest, cases[k].up, &error);
        g_assert_no_error(error);
        const struct vertex *v = &mesh->vertices[0];
        for (int c = 0; c < 3; c++)
            g_assert_cmpfloat_with_epsilon(v->normal[c], cases[k].normal[c], 1e-5);
        for (int c = 0; c < 4; c++)
            g_assert_cmpfloat_with_epsilon(v->tangent[c], cases[k].tangent[c], 1e-5);
    }
}

/* Those of the file are taken, of unit length and along the surface; a mirror turns their sense. */
TEST(tangents) {
    g_autoptr(GError) error = NULL;
    const char *with = "\"scenes\": [{\"nodes\": [0]}], \"nodes\": [{\"mesh\": 0%s}], " MESH(
        ATTRIBUTES ", \"TANGENT\": 3}, \"indices\": 4");
    for (int k = 0; k < 2; k++) {
        g_auto(GStrv) halves = g_strsplit(with, "%s", 2);
        g_autofree char *rest =
            g_strconcat(halves[0], k > 0 ? ", \"scale\": [-1, 1, 1]" : "", halves[1], NULL);
        g_autoptr(Mesh) mesh = read_json(rest, SCENE_Z_UP, &error);
        g_assert_no_error(error);
        for (guint i = 0; i < mesh->n_vertices; i++) {
            g_assert_cmpfloat_with_epsilon(mesh->vertices[i].tangent[1], 1.0, 1e-6);
            g_assert_cmpfloat(mesh->vertices[i].tangent[3], ==, k > 0 ? 1.0 : -1.0);
        }
    }
}

static void append_word(GByteArray *bytes, guint32 word) {
    const guint8 four[4] = {(guint8)word, (guint8)(word >> 8), (guint8)(word >> 16),
                            (guint8)(word >> 24)};
    g_byte_array_append(bytes, four, 4);
}

static GByteArray *binary_file(void) {
    g_autofree char *json = json_of("", MESH(ATTRIBUTES "}, \"indices\": 4"));
    g_autoptr(GByteArray) buffer = buffer_bytes();
    GByteArray *file = g_byte_array_new();
    g_autoptr(GString) padded = g_string_new(json);
    while (padded->len % 4 != 0)
        g_string_append_c(padded, ' ');
    append_word(file, 0x46546c67);
    append_word(file, 2);
    append_word(file, (guint32)(28 + padded->len + buffer->len));
    append_word(file, (guint32)padded->len);
    append_word(file, 0x4e4f534a);
    g_byte_array_append(file, (const guint8 *)padded->str, (guint)padded->len);
    append_word(file, buffer->len);
    append_word(file, 0x004e4942);
    g_byte_array_append(file, buffer->data, buffer->len);
    return file;
}

/* One file, or bytes in a file next to it. */
TEST(files) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GByteArray) file = binary_file(), bytes = buffer_bytes();
    struct mesh *mesh = ok(read_bytes("A.GLB", file->data, file->len, SCENE_Z_UP, ERR));
    check_square(mesh, 4);
    mesh_free(mesh);
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "a.gltf", NULL);
    g_autofree char *beside = g_build_filename(folder, "the bytes.bin", NULL);
    g_autofree char *json = json_of("the%20bytes.bin", MESH(ATTRIBUTES "}, \"indices\": 4"));
    g_assert_true(g_file_set_contents(path, json, -1, NULL));
    g_assert_null(scene_shape(path, SCENE_Z_UP, &error));
    g_assert_error(error, SCENE_ERROR, SCENE_ERROR_IO);
    g_clear_error(&error);
    g_assert_true(g_file_set_contents(beside, (const char *)bytes->data, bytes->len, NULL));
    mesh = ok(scene_shape(path, SCENE_Z_UP, ERR));
    check_square(mesh, 4);
    mesh_free(mesh);
}

/* Cut off anywhere, and with any byte changed: a sentence or a mesh, never a crash. */
TEST(damaged) {
    g_autoptr(GByteArray) file = binary_file();
    g_autoptr(GRand) rand = g_rand_new_with_seed(3);
    for (guint n = 0; n < file->len; n += 1 + file->len / 150) {
        g_autoptr(GError) error = NULL;
        g_assert_null(read_bytes("a.glb", file->data, n, SCENE_Y_UP, &error));
        g_assert_nonnull(strstr(error->message, "a.glb"));
    }
    for (int round = 0; round < 300; round++) {
        g_autoptr(GError) error = NULL;
        g_autofree guint8 *changed = g_memdup2(file->data, file->len);
        for (int k = 0; k < 1 + round % 3; k++)
            changed[g_rand_int_range(rand, 0, (gint32)file->len)] = (guint8)g_rand_int(rand);
        g_autoptr(Mesh) mesh = read_bytes("a.glb", changed, file->len, SCENE_Y_UP, &error);
        g_assert_true((mesh != NULL) == (error == NULL));
        for (guint k = 0; mesh != NULL && k < mesh->n_indices; k++)
            g_assert_cmpuint(mesh->indices[k], <, mesh->n_vertices);
    }
}

#define ACCESSORS(view, type, count, shape)                                                        \
    "\"bufferViews\": [" view "], \"buffers\": [{\"byteLength\": 4, \"uri\": "                     \
    "\"data:;base64,AAAAAAAA\"}], \"accessors\": [{\"bufferView\": 0, \"componentType\": " type    \
    ", \"count\": " count ", \"type\": \"" shape "\"}], "                                          \
    "\"meshes\": [{\"primitives\": [{\"attributes\": {\"POSITION\": 0, \"TEXCOORD_0\": 0}}]}]}"
#define VIEW(offset, length)                                                                       \
    "{\"buffer\": 0, \"byteOffset\": " offset ", \"byteLength\": " length "}"

TEST(lies) {
    g_autofree char *deep = g_strnfill(200000, '[');
    const struct {
        const char *json, *said;
    } cases[] = {
        {"", "not glTF"},
        {"[]", "version 2"},
        {"{\"asset\": {\"version\": \"1.0\"}}", "version 2"},
        {HEAD "\"a\": 1}", "no triangle"},
        {deep, "nested 200000 deep"},
        {HEAD "\"extensionsRequired\": [\"KHR_draco_mesh_compression\"]}", "KHR_draco"},
        {HEAD "\"extensionsRequired\": [[]]}", "extension"},
        {HEAD "\"scenes\": [{\"nodes\": [7]}]}", "no entry 7 in the array “nodes”"},
        {HEAD "\"scenes\": [{\"nodes\": [[]]}]}", "nodes"},
        {HEAD "\"scenes\": [{\"nodes\": [0]}], \"nodes\": [{\"children\": [0]}]}", "form a cycle"},
        {HEAD "\"scenes\": [{\"nodes\": [0]}], \"nodes\": [{\"children\": [1, 1]}, "
              "{\"children\": [0, 0]}]}",
         "form a cycle"},
        {HEAD "\"meshes\": [{\"primitives\": [7]}]}", "primitive"},
        {HEAD "\"meshes\": [{\"primitives\": [{}]}]}", "no positions"},
        {HEAD ACCESSORS(VIEW("0", "6"), "5126", "1", "VEC3"), "outside its buffer view"},
        {HEAD ACCESSORS(VIEW("-1", "6"), "5126", "1", "VEC3"), "outside its buffer"},
        {HEAD ACCESSORS(VIEW("0", "999"), "5126", "1", "VEC3"), "truncated"},
        {HEAD ACCESSORS(VIEW("0", "6"), "5126", "4000000000000000000", "VEC3"), "count"},
        {HEAD ACCESSORS(VIEW("0", "6"), "5126", "-3", "VEC3"), "count"},
        {HEAD ACCESSORS(VIEW("0", "6"), "9", "1", "VEC3"), "the unknown component type 9"},
        {HEAD ACCESSORS(VIEW("0", "6"), "5121", "1", "MAT4"), "is of type MAT4"},
        {HEAD "\"buffers\": [{\"uri\": \"../../etc/passwd\"}], \"bufferViews\": [{\"buffer\": 0, "
              "\"byteLength\": 4}], \"accessors\": [{\"bufferView\": 0, \"componentType\": 5126, "
              "\"count\": 0, \"type\": \"VEC3\"}], \"meshes\": [{\"primitives\": "
              "[{\"attributes\": {\"POSITION\": 0}}]}]}",
         "only files in its own folder are opened"},
    };
    for (gsize k = 0; k < G_N_ELEMENTS(cases); k++) {
        g_autoptr(GError) error = NULL;
        g_assert_null(
            read_bytes("a.gltf", cases[k].json, strlen(cases[k].json), SCENE_Y_UP, &error));
        g_test_message("%s", error->message);
        g_assert_nonnull(strstr(error->message, "a.gltf"));
        g_assert_nonnull(strstr(error->message, cases[k].said));
    }
}

static void refuse_square(const char *rest, int code, const char *said) {
    g_autoptr(GError) error = NULL;
    g_assert_null(read_json(rest, SCENE_Y_UP, &error));
    g_test_message("%s", error->message);
    g_assert_error(error, SCENE_ERROR, code);
    g_assert_nonnull(strstr(error->message, said));
}

TEST(refused) {
    refuse_square(MESH("\"attributes\": {\"POSITION\": 0, \"NORMAL\": 1}"), SCENE_ERROR_NO_TEXTURE,
                  "TEXCOORD_0");
    refuse_square(MESH("\"attributes\": {\"POSITION\": 0, \"TEXCOORD_0\": 0}"), SCENE_ERROR_FORMAT,
                  "is of type VEC3, but VEC2");
    refuse_square(MESH(ATTRIBUTES "}, \"indices\": 0"), SCENE_ERROR_FORMAT,
                  "is of type VEC3, but SCALAR");
    refuse_square(MESH(ATTRIBUTES "}, \"indices\": 99"), SCENE_ERROR_FORMAT, "entry 99");
    refuse_square(MESH(ATTRIBUTES "}, \"mode\": 9"), SCENE_ERROR_FORMAT, "mode");
    refuse_square("\"scenes\": [{\"nodes\": [0]}], \"nodes\": [{}]", SCENE_ERROR_FORMAT, "a.gltf");
    refuse_square("\"scenes\": [{\"nodes\": [0]}], \"nodes\": [{\"mesh\": 0, \"scale\": [1e300, "
                  "1, 1]}], " MESH(ATTRIBUTES "}, \"indices\": 4"),
                  SCENE_ERROR_FORMAT, "within ±1e18");
    refuse_square("\"scenes\": [{\"nodes\": [0]}], \"nodes\": [{\"mesh\": 0, \"scale\": [0, "
                  "0, 0]}], " MESH(ATTRIBUTES "}, \"indices\": 4"),
                  SCENE_ERROR_FORMAT, "the same");
}
