#include "codec_geometry.h"

#include "base/direction.h"
#include "btf/near_field.h"
#include "mdf/mdf_table.h"

#include <gio/gio.h>
#include <math.h>

#define SAME_DEG 0.01F /* views of BTF and MDF are the same if their angles differ by less */

void codec_geometry_free(struct codec_geometry *geometry) {
    if (!geometry)
        return;
    g_free(geometry->camera_mm);
    g_free(geometry->lamp_mm);
    g_free(geometry->points);
    g_free(geometry);
}

void codec_geometry_towards(const struct btf_layout *layout, const float *positions_mm,
                            const struct direction_list *list, int index, int texel, float ret[3]) {
    if (!positions_mm) {
        direction_from_deg(list->theta_deg[index], list->phi_deg[index], ret);
        return;
    }
    const int width = (int)layout->width;
    const int row = texel / width, column = texel % width;
    const float *at = positions_mm + 3 * (gsize)index;
    const double x = at[0] - (column + 0.5 - 0.5 * (double)layout->width) * layout->texel_mm;
    const double y = at[1] - (0.5 * (double)layout->height - row - 0.5) * layout->texel_mm;
    const double z = at[2] - layout->reference_mm;
    const double length = sqrt(x * x + y * y + z * z);
    ret[0] = (float)(x / length);
    ret[1] = (float)(y / length);
    ret[2] = (float)(z / length);
}

/* Copies the positions of cameras and lamps. The position of a lamp is the mean over the views. */
static void take_positions(struct codec_geometry *to, const struct near_field *from) {
    const gsize n_views = (gsize)to->n_views, n_lights = (gsize)to->n_lights;
    to->camera_mm = g_new0(float, 3 * n_views);
    to->lamp_mm = g_new0(float, 3 * n_lights);
    for (gsize v = 0; v < n_views; v++) {
        const struct vec3 camera = from->camera_mm[v];
        to->camera_mm[3 * v] = (float)camera.x;
        to->camera_mm[3 * v + 1] = (float)camera.y;
        to->camera_mm[3 * v + 2] = (float)camera.z;
    }
    for (gsize l = 0; l < n_lights; l++) {
        struct vec3 sum = {0, 0, 0};
        for (gsize v = 0; v < n_views; v++)
            sum = vec3_add(sum, from->lamp_mm[v * n_lights + l]);
        to->lamp_mm[3 * l] = (float)(sum.x / (double)n_views);
        to->lamp_mm[3 * l + 1] = (float)(sum.y / (double)n_views);
        to->lamp_mm[3 * l + 2] = (float)(sum.z / (double)n_views);
    }
}

static int find_view(const struct direction_list *views, float theta_deg, float phi_deg) {
    for (gsize v = 0; v < views->n; v++)
        if (fabsf(views->theta_deg[v] - theta_deg) < SAME_DEG &&
            fabsf(views->phi_deg[v] - phi_deg) < SAME_DEG)
            return (int)v;
    return -1;
}

/* Adds the points that a view of the MDF saw. The point at the depth d on the ray of a texel is the
 * texel's centre − d v_xy / v_z, at the height −d. v is the direction from the texel to the
 * camera. */
static void add_points(struct codec_geometry *to, const struct btf_layout *layout,
                       const struct mdf_table *table, int index) {
    const int width = table->width, n = width * table->height;
    const int view = find_view(&layout->views, table->theta_deg[index], table->phi_deg[index]);
    const float *camera = to->camera_mm && view >= 0 ? to->camera_mm + 3 * (gsize)view : NULL;
    float nominal[3];
    direction_from_deg((double)table->theta_deg[index], (double)table->phi_deg[index], nominal);
    for (int texel = 0; texel < n; texel++) {
        const gsize at = (gsize)index * (gsize)n + (gsize)texel;
        const int row = texel / width, column = texel % width;
        const double x = (column + 0.5 - 0.5 * width) * table->texel_mm;
        const double y = (0.5 * table->height - row - 0.5) * table->texel_mm;
        const double depth = (double)table->depth_mm[at];
        struct vec3 v = vec3((double)nominal[0], (double)nominal[1], (double)nominal[2]);
        if (table->seen && !table->seen[at])
            continue;
        if (camera)
            v = vec3((double)camera[0] - x, (double)camera[1] - y,
                     (double)camera[2] - layout->reference_mm);
        to->points[to->n_points++] = (struct codec_surface_point){
            (float)(x - v.x / v.z * depth), (float)(y - v.y / v.z * depth), (float)-depth, view};
    }
}

static gboolean read_points(struct codec_geometry *to, const struct btf_matrix *btf,
                            GError **error) {
    g_autofree char *path = g_build_filename(btf->directory, "products", "mdf.exr", NULL);
    if (!g_file_test(path, G_FILE_TEST_EXISTS))
        return TRUE;
    if (!session_check_product(path, error))
        return FALSE;
    g_autoptr(MdfTable) table = mdf_table_read(path, error);
    if (!table)
        return FALSE;
    to->points = g_new(struct codec_surface_point,
                       (gsize)table->width * (gsize)table->height * (gsize)table->n_measured);
    for (int view = 0; view < table->n_measured; view++)
        add_points(to, &btf->layout, table, view);
    return TRUE;
}

struct codec_geometry *codec_geometry_read(const struct btf_matrix *btf, GError **error) {
    g_autoptr(CodecGeometry) ret = g_new0(struct codec_geometry, 1);
    ret->n_views = (int)btf->layout.views.n;
    ret->n_lights = (int)btf->layout.lights.n;
    if (!btf->directory)
        return g_steal_pointer(&ret);
    struct near_field *near_field = near_field_read(btf->directory, error);
    if (!near_field)
        return NULL;
    if (near_field->camera_mm && near_field->lamp_mm && near_field->views.n == btf->layout.views.n)
        take_positions(ret, near_field);
    near_field_free(near_field);
    return read_points(ret, btf, error) ? g_steal_pointer(&ret) : NULL;
}
