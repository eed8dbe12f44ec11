/* Points are fused in cubes whose side is the width of a texel. The points are sorted by cube, and
 * the points of one cube become one point. A height map contains the median height of the upper
 * layer above each texel. */
#include "export_surface.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/bytes.h"
#include "base/data_error.h"
#include "base/output_file.h"
#include "exr/exr.h"
#include "surface_points.h"

#define GAP 1.0 /* gap between two heights, in texels, that separates layers */
/* largest share of texels with two layers that a height field may have */
#define MAX_STACKED 0.05

/* A point and the cube that contains it. Cubes are sorted by key. */
struct cube {
    gint64 key;
    guint index;
};

static int by_key(gconstpointer a, gconstpointer b) {
    const struct cube *x = a, *y = b;
    if (x->key != y->key)
        return x->key < y->key ? -1 : 1;
    return (x->index > y->index) - (x->index < y->index);
}

static gint64 cell(double mm, double texel_mm) {
    return (gint64)CLAMP(floor(mm / texel_mm), -500000, 500000) + 500000;
}

struct fused {
    struct vec3 at_mm, normal;
    double spread_mm;
    int n_views;
};

/* Fuses n points that lie in the same cube. cubes[0] … cubes[n − 1] belong to these points. The
 * mean is weighted by 1/σ² and by the cosine between normal and camera. */
static struct fused fuse(const struct surface *surface, const struct cube *cubes, guint n) {
    struct fused ret = {0};
    double weight = 0, squares = 0;
    int before = -1;
    for (guint i = 0; i < n; i++) {
        const struct surface_point *p =
            &g_array_index(surface->points, struct surface_point, cubes[i].index);
        const double w = (double)p->weight;
        ret.at_mm = vec3_add(ret.at_mm, vec3_scale(p->at_mm, w));
        ret.normal = vec3_add(ret.normal, vec3_scale(p->normal, w));
        weight += w;
        ret.n_views += p->view != before; /* points are in the order of their views */
        before = p->view;
    }
    ret.at_mm = vec3_scale(ret.at_mm, 1 / weight);
    ret.normal = vec3_length(ret.normal) > 0 ? vec3_unit(ret.normal) : vec3(0, 0, 1);
    for (guint i = 0; i < n; i++) {
        const struct surface_point *p =
            &g_array_index(surface->points, struct surface_point, cubes[i].index);
        const double off = vec3_dot(vec3_sub(p->at_mm, ret.at_mm), ret.normal);
        squares += (double)p->weight * off * off;
    }
    ret.spread_mm = sqrt(squares / weight);
    return ret;
}

static void put_vector(GByteArray *to, struct vec3 v) {
    bytes_put_float(to, v.x);
    bytes_put_float(to, v.y);
    bytes_put_float(to, v.z);
}

static gboolean write_points(const struct surface *surface, const char *file, int min_views,
                             struct export_surface_result *ret, GError **error) {
    const guint n_points = surface->points->len;
    const double mm = surface->texel_mm;
    g_autofree struct cube *cubes = g_new(struct cube, MAX(n_points, 1));
    for (guint i = 0; i < n_points; i++) {
        const struct vec3 p = g_array_index(surface->points, struct surface_point, i).at_mm;
        cubes[i].key = (cell(p.z, mm) * 1000001 + cell(p.y, mm)) * 1000001 + cell(p.x, mm);
        cubes[i].index = i;
    }
    qsort(cubes, n_points, sizeof *cubes, by_key);
    g_autoptr(GByteArray) body = g_byte_array_new();
    for (guint i = 0, n; i < n_points; i += n) {
        for (n = 1; i + n < n_points && cubes[i + n].key == cubes[i].key;)
            n++;
        const struct fused fused = fuse(surface, cubes + i, n);
        const guint8 views = (guint8)MIN(fused.n_views, 255);
        if (fused.n_views < min_views)
            continue;
        put_vector(body, fused.at_mm);
        put_vector(body, fused.normal);
        bytes_put_float(body, fused.spread_mm);
        g_byte_array_append(body, &views, 1);
        ret->points++;
    }
    g_autofree char *head = g_strdup_printf(
        "ply\nformat binary_little_endian 1.0\ncomment " OUTPUT_FILE_TEXT(
            "points") "\ncomment mesorig " MESORIG_VERSION
                      ", mm, z from the turntable\nelement vertex %" G_GINT64_FORMAT
                      "\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\n"
                      "property float ny\nproperty float nz\nproperty float spread\nproperty uchar "
                      "views\n"
                      "end_header\n",
        ret->points);
    g_byte_array_prepend(body, (const guint8 *)head, (guint)strlen(head));
    return output_file_write(file, body->data, body->len, error);
}

/* The points above one texel. */
struct column {
    guint *points; /* indices of points, the highest point first */
    guint n;
};

static int by_height(gconstpointer a, gconstpointer b, gpointer data) {
    const struct surface_point *points = data;
    const double x = points[*(const guint *)a].at_mm.z, y = points[*(const guint *)b].at_mm.z;
    return (x < y) - (x > y);
}

/* Sorts all points by texel. *ret_order receives the indices of the points. Returns an array of
 * positions in *ret_order: for each texel the position at which its points begin, and as last
 * element the position at which the points of the last texel end. Free both arrays with
 * g_free(). */
static guint *sort_columns(const struct surface *surface, guint **ret_order) {
    const struct session_grid *grid = &surface->grid;
    const int n = grid->width * grid->height;
    const struct surface_point *points =
        (const struct surface_point *)(gpointer)surface->points->data;
    guint *begin = g_new0(guint, n + 2), *order = g_new0(guint, surface->points->len + 1);
    g_autofree int *texel = g_new(int, surface->points->len + 1);
    for (guint i = 0; i < surface->points->len; i++) {
        const int x = (int)floor((points[i].at_mm.x / grid->width_mm + 0.5) * grid->width);
        const int y = (int)floor((0.5 - points[i].at_mm.y / grid->height_mm) * grid->height);
        const gboolean inside = x >= 0 && x < grid->width && y >= 0 && y < grid->height;
        texel[i] = inside ? y * grid->width + x : -1;
        begin[inside ? texel[i] + 2 : 0] += inside;
    }
    for (int i = 1; i <= n; i++)
        begin[i + 1] += begin[i];
    for (guint i = 0; i < surface->points->len; i++)
        if (texel[i] >= 0)
            order[begin[texel[i] + 1]++] = i;
    *ret_order = order;
    return begin;
}

/* Returns the number of points in the upper layer of a column. A single point above a gap is an
 * outlier, and is removed from the column. *ret_stacked says whether a lower layer has at least two
 * points. */
static guint upper_layer(const struct surface *surface, struct column *column,
                         gboolean *ret_stacked) {
    const struct surface_point *points =
        (const struct surface_point *)(gpointer)surface->points->data;
    *ret_stacked = FALSE;
    for (guint i = 1; i < column->n; i++) {
        if (points[column->points[i - 1]].at_mm.z - points[column->points[i]].at_mm.z <=
            GAP * surface->texel_mm)
            continue;
        if (i == 1) {
            column->points++;
            column->n--;
            return upper_layer(surface, column, ret_stacked);
        }
        *ret_stacked = column->n - i > 1;
        return i;
    }
    return column->n;
}

struct map {
    struct exr_part *part;
    gboolean normals;
    int holes, stacked;
};

static void set_texel(const struct surface *surface, const struct map *map, int texel,
                      const struct column *column, guint n, gboolean stacked) {
    const struct surface_point *points =
        (const struct surface_point *)(gpointer)surface->points->data;
    if (map->normals) {
        struct vec3 sum = vec3(0, 0, 0);
        for (guint i = 0; i < n; i++)
            sum = vec3_add(sum, vec3_scale(points[column->points[i]].normal,
                                           (double)points[column->points[i]].weight));
        sum = vec3_length(sum) > 0 ? vec3_unit(sum) : sum;
        exr_part_plane(map->part, "X")[texel] = (float)sum.x;
        exr_part_plane(map->part, "Y")[texel] = (float)sum.y;
        exr_part_plane(map->part, "Z")[texel] = (float)sum.z;
        return;
    }
    const double low = points[column->points[(n - 1) / 2]].at_mm.z;
    const double middle = (low + points[column->points[n / 2]].at_mm.z) / 2;
    const double spread = points[column->points[n / 4]].at_mm.z -
                          points[column->points[MIN(3 * n / 4, n - 1)]].at_mm.z;
    exr_part_plane(map->part, "Z")[texel] = (float)middle;
    exr_part_plane(map->part, "S")[texel] = (float)(spread / 2);
    exr_part_plane(map->part, "N")[texel] = stacked ? -1 : (float)n;
}

static gboolean write_map(const struct surface *surface, const char *session, const char *file,
                          const struct export_surface_options *options,
                          struct export_surface_result *ret, GError **error) {
    static const char *const heights[] = {"N", "S", "Z", NULL}, *const normals[] = {"X", "Y", "Z",
                                                                                    NULL};
    struct map map = {.normals = options->what == EXPORT_NORMALS};
    map.part = exr_part_new(map.normals ? "normals" : "height", surface->grid.width,
                            surface->grid.height, map.normals ? normals : heights, EXR_FLOAT);
    g_autoptr(ExrFile) exr = exr_file_new();
    exr_file_add(exr, map.part);
    g_autofree guint *order = NULL, *begin = sort_columns(surface, &order);
    for (int texel = 0; texel < surface->grid.width * surface->grid.height; texel++) {
        struct column column = {order + begin[texel], begin[texel + 1] - begin[texel]};
        gboolean stacked = FALSE;
        g_qsort_with_data(column.points, (gint)column.n, sizeof(guint), by_height,
                          surface->points->data);
        const guint n = column.n > 0 ? upper_layer(surface, &column, &stacked) : 0;
        map.holes += n == 0;
        map.stacked += stacked;
        if (n > 0)
            set_texel(surface, &map, texel, &column, n, stacked);
    }
    exr_set_string(map.part, "mesorig.kind", map.normals ? "normals" : "height");
    exr_set_double(map.part, "texel_mm", surface->texel_mm);
    exr_set_double(map.part, "reference_mm", surface->grid.reference_mm);
    exr_set_int(map.part, "holes", map.holes);
    exr_set_int(map.part, "stacked", map.stacked);
    ret->holes = map.holes;
    ret->stacked = map.stacked;
    ret->points = surface->grid.width * surface->grid.height - map.holes;
    if (ret->points == 0)
        return data_error_fail(session, 0, error,
                               "no point of products/mdf.exr lies above the session's texels; "
                               "repeat the laser sweeps and process the session again");
    if (!options->layered && map.stacked > MAX_STACKED * (double)ret->points)
        return data_error_fail(
            session, 0, error,
            "the surface is not a height field, because %d of %d texels have structure below "
            "structure; export points, or export the upper layer with --layered",
            map.stacked, (int)ret->points);
    return exr_write(file, exr, EXR_ZIP, TRUE, error);
}

gboolean export_surface(const char *session, const char *file,
                        const struct export_surface_options *options, const struct work *work,
                        struct export_surface_result *ret, GError **error) {
    struct surface surface;
    *ret = (struct export_surface_result){0};
    gboolean ok = surface_points_read(session, work, &surface, error);
    const int least = options->min_views > 0 ? options->min_views : MIN(2, surface.n_views);
    if (ok && options->what == EXPORT_POINTS)
        ok = write_points(&surface, file, least, ret, error);
    else if (ok)
        ok = write_map(&surface, session, file, options, ret, error);
    ret->seen = surface.points->len;
    ret->n_views = surface.n_views;
    ret->texels = surface.grid.width * surface.grid.height;
    surface_clear(&surface);
    return ok;
}
