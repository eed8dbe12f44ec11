#include "export_mesh.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

#include "base/bytes.h"
#include "base/data_error.h"
#include "base/output_file.h"
#include "frames/rectify.h"
#include "glb.h"
#include "mdf/mdf_mesh.h"
#include "session/session.h"

#define KIND "mesh"

static void put_floats(GByteArray *to, const float *values, int n) {
    for (int k = 0; k < n; k++)
        bytes_put_float(to, (double)values[k]);
}

static void put_text(GByteArray *to, const char *format, ...) G_GNUC_PRINTF(2, 3);
static void put_text(GByteArray *to, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    g_autofree char *text = g_strdup_vprintf(format, arguments);
    va_end(arguments);
    g_byte_array_append(to, (const guint8 *)text, (guint)strlen(text));
}

/* The texture coordinate v grows towards +y in PLY and OBJ, but towards −y in struct
 * mdf_mesh_vertex. */
static void write_ply(const struct mdf_mesh *mesh, GByteArray *to) {
    put_text(to,
             "ply\nformat binary_little_endian 1.0\ncomment " OUTPUT_FILE_TEXT(
                 KIND) "\ncomment mesorig " MESORIG_VERSION ", mm, z from the turntable\n"
                       "element vertex %u\nproperty float x\nproperty float y\nproperty float z\n"
                       "property float nx\nproperty float ny\nproperty float nz\n"
                       "property float s\nproperty float t\nelement face %u\n"
                       "property list uchar uint vertex_indices\nend_header\n",
             mesh->n_vertices, mesh->n_indices / 3);
    for (guint k = 0; k < mesh->n_vertices; k++) {
        const struct mdf_mesh_vertex *v = &mesh->vertices[k];
        put_floats(to, v->at_mm, 3);
        put_floats(to, v->normal, 3);
        put_floats(to, (const float[]){v->uv[0], 1.0F - v->uv[1]}, 2);
    }
    for (guint k = 0; k < mesh->n_indices; k++) {
        if (k % 3 == 0)
            g_byte_array_append(to, (const guint8 *)"\3", 1);
        bytes_put_u32(to, mesh->indices[k]);
    }
}

static void write_obj(const struct mdf_mesh *mesh, GByteArray *to) {
    put_text(to, "# " OUTPUT_FILE_TEXT(KIND) "\n# mesorig " MESORIG_VERSION
                                             ", mm, z from the turntable\no sample\n");
    char number[3][G_ASCII_DTOSTR_BUF_SIZE];
    for (guint k = 0; k < mesh->n_vertices; k++) {
        const struct mdf_mesh_vertex *v = &mesh->vertices[k];
        for (int c = 0; c < 3; c++)
            g_ascii_formatd(number[c], sizeof number[c], "%.5f", (double)v->at_mm[c]);
        put_text(to, "v %s %s %s\n", number[0], number[1], number[2]);
        g_ascii_formatd(number[0], sizeof number[0], "%.6f", (double)v->uv[0]);
        g_ascii_formatd(number[1], sizeof number[1], "%.6f", 1.0 - (double)v->uv[1]);
        put_text(to, "vt %s %s\n", number[0], number[1]);
        for (int c = 0; c < 3; c++)
            g_ascii_formatd(number[c], sizeof number[c], "%.4f", (double)v->normal[c]);
        put_text(to, "vn %s %s %s\n", number[0], number[1], number[2]);
    }
    for (guint k = 0; k + 2 < mesh->n_indices; k += 3) {
        put_text(to, "f");
        for (guint c = 0; c < 3; c++)
            put_text(to, " %1$u/%1$u/%1$u", mesh->indices[k + c] + 1);
        put_text(to, "\n");
    }
}

/* Gives the minimum (ret[0]) and the maximum (ret[1]) of x, y and z over all vertices, which glTF
 * requires. */
static void bounds(const struct mdf_mesh *mesh, float ret[2][3]) {
    for (int c = 0; c < 3; c++) {
        ret[0][c] = INFINITY;
        ret[1][c] = -INFINITY;
        for (guint k = 0; k < mesh->n_vertices; k++) {
            ret[0][c] = MIN(ret[0][c], mesh->vertices[k].at_mm[c]);
            ret[1][c] = MAX(ret[1][c], mesh->vertices[k].at_mm[c]);
        }
    }
}

/* Returns the JSON text of a GLB. The vertices stay in mm with z upwards. The node's scale and its
 * rotation by −90° about x convert them to metres with y upwards. */
static char *gltf_json(const struct mdf_mesh *mesh) {
    const gsize vertex = sizeof(struct mdf_mesh_vertex), vertices = vertex * mesh->n_vertices;
    char corner[6][G_ASCII_DTOSTR_BUF_SIZE];
    float box[2][3];
    bounds(mesh, box);
    for (int k = 0; k < 6; k++)
        g_ascii_formatd(corner[k], sizeof corner[k], "%.9g", (double)box[k / 3][k % 3]);
    return g_strdup_printf(
        "{\"asset\":{\"version\":\"2.0\",\"generator\":\"mesorig " MESORIG_VERSION "\"},"
        "\"scene\":0,\"scenes\":[{\"nodes\":[0]}],"
        "\"nodes\":[{\"name\":\"sample\",\"mesh\":0,\"rotation\":[-0.70710678,0,0,0.70710678],"
        "\"scale\":[0.001,0.001,0.001]}],"
        "\"meshes\":[{\"name\":\"sample\",\"primitives\":[{\"attributes\":{\"POSITION\":0,"
        "\"NORMAL\":1,\"TEXCOORD_0\":2},\"indices\":3}]}],"
        "\"accessors\":["
        "{\"bufferView\":0,\"componentType\":5126,\"count\":%1$u,\"type\":\"VEC3\","
        "\"min\":[%3$s,%4$s,%5$s],\"max\":[%6$s,%7$s,%8$s]},"
        "{\"bufferView\":0,\"byteOffset\":12,\"componentType\":5126,\"count\":%1$u,"
        "\"type\":\"VEC3\"},"
        "{\"bufferView\":0,\"byteOffset\":24,\"componentType\":5126,\"count\":%1$u,"
        "\"type\":\"VEC2\"},"
        "{\"bufferView\":1,\"componentType\":5125,\"count\":%2$u,\"type\":\"SCALAR\"}],"
        "\"bufferViews\":["
        "{\"buffer\":0,\"byteLength\":%9$zu,\"byteStride\":%10$zu,\"target\":34962},"
        "{\"buffer\":0,\"byteOffset\":%9$zu,\"byteLength\":%11$zu,\"target\":34963}],"
        "\"buffers\":[{\"byteLength\":%12$zu}]}",
        mesh->n_vertices, mesh->n_indices, corner[0], corner[1], corner[2], corner[3], corner[4],
        corner[5], vertices, vertex, sizeof(guint32) * mesh->n_indices,
        vertices + sizeof(guint32) * mesh->n_indices);
}

static void write_glb(const struct mdf_mesh *mesh, GByteArray *to) {
    g_autofree char *json = gltf_json(mesh);
    g_autoptr(GByteArray) binary = g_byte_array_new();
    for (guint k = 0; k < mesh->n_vertices; k++) {
        put_floats(binary, mesh->vertices[k].at_mm, 3);
        put_floats(binary, mesh->vertices[k].normal, 3);
        put_floats(binary, mesh->vertices[k].uv, 2);
    }
    for (guint k = 0; k < mesh->n_indices; k++)
        bytes_put_u32(binary, mesh->indices[k]);
    g_autoptr(GBytes) glb = glb_new(json, binary);
    g_byte_array_append(to, g_bytes_get_data(glb, NULL), (guint)g_bytes_get_size(glb));
}

static struct mdf_table *read_table(const char *session, struct session_grid *ret_grid,
                                    GError **error) {
    g_autoptr(Session) from = session_open(session, SESSION_READ, error);
    if (from == NULL || !session_grid(from, ret_grid, error))
        return NULL;
    g_autofree char *path = session_file(from, "products/mdf.exr");
    if (!g_file_test(path, G_FILE_TEST_EXISTS)) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INCOMPLETE,
                    "%s: there is no MDF; process the session if it has laser sweeps", path);
        return NULL;
    }
    return session_check_products(from, "products/mdf.exr", NULL, error)
               ? mdf_table_read(path, error)
               : NULL;
}

gboolean export_mesh(const char *session, const char *file, enum export_mesh_form form,
                     struct export_mesh_result *ret, GError **error) {
    static void (*const write[])(const struct mdf_mesh *, GByteArray *) = {
        [EXPORT_MESH_PLY] = write_ply,
        [EXPORT_MESH_OBJ] = write_obj,
        [EXPORT_MESH_GLB] = write_glb,
    };
    struct session_grid grid;
    g_autoptr(MdfTable) table = read_table(session, &grid, error);
    if (table == NULL)
        return FALSE;
    g_autoptr(MdfShell) shell = mdf_shell_new(table);
    g_autoptr(MdfMesh) mesh = mdf_mesh_new(shell, table);
    for (guint k = 0; k < mesh->n_vertices; k++) {
        struct mdf_mesh_vertex *v = &mesh->vertices[k];
        const struct vec3 at =
            rectify_point_mm(&grid, (double)v->uv[0] * grid.width, (double)v->uv[1] * grid.height);
        v->at_mm[0] = (float)at.x;
        v->at_mm[1] = (float)at.y;
        v->at_mm[2] += (float)at.z;
    }
    ret->n_views = table->n_measured > 0 ? table->n_measured : table->n_views;
    ret->n_vertices = mesh->n_vertices;
    ret->n_triangles = mesh->n_indices / 3;
    g_autoptr(GByteArray) bytes = g_byte_array_new();
    write[form](mesh, bytes);
    return output_file_write(file, bytes->data, bytes->len, error);
}
