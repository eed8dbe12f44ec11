/* Ways to hold an MDF in fewer bytes: how many, at how many fetches, how far depths are off, and
 * how far outlines are that the viewer draws with them. */
#include "compression_parts.h"

#include "bench.h"
#include "codecs/mdf_codecs/mdf_blocks.h"
#include "codecs/mdf_codecs/mdf_factors.h"
#include "drawing/gl/gpu.h"
#include "drawing/methods/methods.h"
#include "lib/mdf_copy.h"
#include "scene/viewer.h"
#include "shapes/scene.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define WIDTH              400
#define HEIGHT             300
#define N_SCENES           2
#define MOST               255
#define VIEW_FETCH         6 /* four views and where they are in a table of directions */
#define N_OUTLINES         (N_SCENES * WIDTH * HEIGHT)
#define MAP_FETCHES(terms) (2 * (((terms) + 3) / 4) + 1)

static const int tiles[N_SCENES][2] = {{3, 1}, {8, 3}};

/* What all ways are compared with: as measured, and how the viewer draws that. */
struct subject {
    const char *name;
    struct mdf_table *table; /* as read */
    struct mdf_table *all;   /* with flat views */
    Viewer *viewers[N_SCENES];
    gboolean *outline, *smooth; /* of the scenes' pixels */
};

static Viewer *open_scene(int scene, GError **error) {
    const struct scene_options options = {tiles[scene][0], tiles[scene][1], SCENE_Z_UP, FALSE};
    struct mesh *mesh = scene_make("torus", &options, error);
    Viewer *viewer = mesh ? viewer_new(NULL, error) : NULL;
    if (viewer && !viewer_set_mesh(viewer, mesh, error))
        g_clear_pointer(&viewer, viewer_free);
    mesh_free(mesh);
    return viewer;
}

/* Which pixels show the torus; with no table that of the mesh. */
static gboolean *draw(const struct subject *s, const struct mdf_table *table, GError **error) {
    gboolean *ret = g_new0(gboolean, N_OUTLINES);
    for (int scene = 0; scene < N_SCENES; scene++) {
        struct viewer_settings settings = viewer_settings_default;
        const struct mdf_source mdf = {.table = table};
        settings.silhouettes = table != NULL;
        g_autofree float *seen = NULL;
        viewer_fit(s->viewers[scene], &settings, (double)WIDTH / HEIGHT);
        if (viewer_set_mdf(s->viewers[scene], table != NULL ? &mdf : NULL, error))
            seen = viewer_render_geometry(s->viewers[scene], &settings, VIEWER_GEOMETRY_TEXEL,
                                          WIDTH, HEIGHT, error);
        if (!seen) {
            g_free(ret);
            return NULL;
        }
        for (int i = 0; i < WIDTH * HEIGHT; i++)
            ret[scene * WIDTH * HEIGHT + i] = seen[4 * i + 3] > 0.5F;
    }
    return ret;
}

static void count(const gboolean *a, const gboolean *b, gint64 *both, gint64 *either) {
    *both = *either = 0;
    for (int i = 0; i < N_OUTLINES; i++) {
        *both += a[i] && b[i];
        *either += a[i] || b[i];
    }
}

struct way {
    const char *name;
    int number; /* of maps, or 0 */
    gint64 bytes;
    int fetches; /* 0: a ray is traced */
};

/* takes table: measured views and maybe others; without those, they are traced. */
static gboolean report(const struct subject *s, const struct way *way, struct mdf_table *table,
                       GError **error) {
    const int n = s->table->n_views;
    const gint64 published = (gint64)s->table->width * s->table->height * n;
    double most;
    const double rms = mdf_table_difference(s->table, n, table, &most);
    if (table->n_views == n)
        mdf_table_add_grazing(table);
    g_autofree gboolean *outline = draw(s, table, error);
    mdf_table_free(table);
    if (!outline)
        return FALSE;
    gint64 both, either, plain_both, plain_either;
    count(outline, s->outline, &both, &either);
    count(s->smooth, s->outline, &plain_both, &plain_either);
    bench_row(NULL,
              "%-10s{material} %-22s{way} %d{maps} %" G_GINT64_FORMAT
              "{bytes} %.2f{ratio} %d{fetches} %.4f{rms_texels} %.4f{p99_texels} "
              "%.5f{outline_iou} %.4f{displaced}",
              s->name, way->name, way->number, way->bytes, (double)published / (double)way->bytes,
              way->fetches, rms / s->table->texel_mm, most / s->table->texel_mm,
              (double)both / (double)either,
              (double)(either - both) / (double)MAX(1, plain_either - plain_both));
    return TRUE;
}

static gsize texels(const struct mdf_table *t) {
    return (gsize)t->width * (gsize)t->height;
}

static gboolean half_views(const struct subject *s, GError **error) {
    const struct way way = {"views, half", 0, 2 * (gint64)texels(s->table) * s->table->n_views,
                            VIEW_FETCH};
    return report(s, &way, mdf_copy(s->table), error);
}

static gboolean byte_views(const struct subject *s, GError **error) {
    struct mdf_table *t = mdf_copy(s->table);
    const gsize n = texels(t);
    const struct way way = {"views, 8 bit", 0, (gint64)(n + 4) * t->n_views, VIEW_FETCH};
    for (int v = 0; v < t->n_views; v++) {
        float *depth = t->depth_mm + (gsize)v * n, most = 1e-9F;
        for (gsize i = 0; i < n; i++)
            most = MAX(most, depth[i]);
        for (gsize i = 0; i < n; i++)
            depth[i] = roundf(depth[i] / most * MOST) * most / MOST;
    }
    return report(s, &way, t, error);
}

/* From least to least + range in blocks and back. */
static void through_blocks(float *values, int width, int height) {
    const gsize n = (gsize)width * (gsize)height;
    g_autofree guint8 *blocks = g_new(guint8, mdf_blocks_bytes(width, height));
    float least = values[0], most = values[0];
    for (gsize i = 0; i < n; i++) {
        least = MIN(least, values[i]);
        most = MAX(most, values[i]);
    }
    mdf_blocks_encode(values, width, height, least, most, blocks);
    mdf_blocks_decode(blocks, width, height, least, most, values);
}

static gboolean block_views(const struct subject *s, GError **error) {
    struct mdf_blocks *blocks = mdf_blocks_new(s->table);
    const struct way way = {
        "views, 4 bit (blocks)", 0,
        (gint64)mdf_blocks_bytes(blocks->width, blocks->height) * blocks->n_views, VIEW_FETCH};
    struct mdf_table *is = mdf_blocks_table(blocks);
    mdf_blocks_free(blocks);
    return report(s, &way, is, error);
}

static gboolean relief(const struct subject *s, gboolean residual, GError **error) {
    struct mdf_table *t = mdf_copy(s->table);
    const gsize n = texels(t);
    const gint64 blocks = (gint64)(mdf_blocks_bytes(t->width, t->height) + 8) * t->n_views;
    const struct way way = {residual ? "relief, rest 4 bit" : "relief", 0,
                            (gint64)n + (residual ? blocks : 0), 0};
    mdf_table_trace(t);
    g_autofree float *rest = g_new0(float, n);
    for (int v = 0; residual && v < t->n_views; v++) {
        const float *should = s->table->depth_mm + (gsize)v * n;
        float *is = t->depth_mm + (gsize)v * n;
        for (gsize i = 0; i < n; i++)
            rest[i] = should[i] - is[i];
        through_blocks(rest, t->width, t->height);
        for (gsize i = 0; i < n; i++)
            is[i] += rest[i];
    }
    return report(s, &way, t, error);
}

static gboolean maps(const struct subject *s, int terms, gboolean blocks, GError **error) {
    struct mdf_factors *f = mdf_factors_compute(s->all, s->table->n_views, terms, 0, NULL, error);
    if (!f)
        return FALSE;
    struct way way = {blocks ? "maps, 4 bit (blocks)" : "maps, 8 bit", f->n_terms,
                      mdf_factors_bytes(f), MAP_FETCHES(f->n_terms)};
    const gsize n = texels(s->table);
    if (blocks) {
        way.bytes -= (gint64)n * f->n_terms / 2;
        way.fetches = (f->n_terms + 3) / 4 + 1 + (f->n_terms + 1) / 2;
    }
    g_autofree float *map = g_new0(float, n);
    for (int i = 0; blocks && i < f->n_terms; i++) {
        for (gsize x = 0; x < n; x++)
            map[x] = f->maps[(gsize)i * n + x];
        through_blocks(map, f->width, f->height);
        for (gsize x = 0; x < n; x++)
            f->maps[(gsize)i * n + x] = (guint8)CLAMP(lroundf(map[x]), 0, MOST);
    }
    struct mdf_table *is = mdf_factors_table(f);
    mdf_factors_free(f);
    return report(s, &way, is, error);
}

static gboolean all_ways(const struct subject *s, GError **error) {
    static const int terms[] = {2, 4, 8, 12, 16, 24, 32}, in_blocks[] = {8, 16, 32};
    gboolean ok = half_views(s, error) && byte_views(s, error) && block_views(s, error) &&
                  relief(s, FALSE, error) && relief(s, TRUE, error);
    for (gsize i = 0; ok && i < G_N_ELEMENTS(terms); i++)
        ok = maps(s, terms[i], FALSE, error);
    for (gsize i = 0; ok && i < G_N_ELEMENTS(in_blocks); i++)
        ok = maps(s, in_blocks[i], TRUE, error);
    return ok;
}

static gboolean measure(struct subject *s, const char *session, GError **error) {
    g_autofree char *path = g_build_filename(session, "products", "mdf.exr", NULL);
    g_autofree char *name = g_path_get_basename(session);
    *strchrnul(name, '.') = '\0';
    s->name = name;
    s->table = mdf_table_read(path, error);
    if (!s->table)
        return FALSE;
    g_autofree char *material = method_path(methods[0], session);
    for (int scene = 0; scene < N_SCENES; scene++)
        if (!viewer_open(s->viewers[scene], methods[0], material, error))
            return FALSE;
    s->all = mdf_copy(s->table);
    mdf_table_add_grazing(s->all);
    s->outline = draw(s, s->all, error);
    s->smooth = s->outline ? draw(s, NULL, error) : NULL;
    const gboolean ok = s->smooth && all_ways(s, error);
    g_free(s->outline);
    g_free(s->smooth);
    mdf_table_free(s->table);
    mdf_table_free(s->all);
    return ok;
}

int bench_mdf_compression(char **sessions) {
    g_autoptr(GError) error = NULL;
    struct subject s = {.name = NULL};
    g_autoptr(Gpu) gpu = gpu_new_headless(&error);
    gboolean ok = gpu != NULL;
    for (int scene = 0; ok && scene < N_SCENES; scene++)
        ok = (s.viewers[scene] = open_scene(scene, &error)) != NULL;
    bench_begin_list(NULL);
    for (int i = 0; ok && sessions[i]; i++) {
        s.table = s.all = NULL;
        s.outline = s.smooth = NULL;
        ok = measure(&s, sessions[i], &error);
    }
    bench_end();
    for (int scene = 0; scene < N_SCENES; scene++)
        viewer_free(s.viewers[scene]);
    if (error)
        fprintf(stderr, "%s\n", error->message);
    return ok ? 0 : 1;
}
