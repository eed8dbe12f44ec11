/*
 * Outlines and shadows of the samples of Wang et al. 2005, table 1, as drawn from their MDF,
 * against their true surface on a torus and a cylinder (figures 10 and 11). The MDF is traced, as
 * that paper made all but two of its own, so that only drawing is measured; silhouettes_report
 * measures captured ones. Ways:
 *   btf        the BTF only
 *   published  the test of straight rays, with the measured views in a volume of 8 bits
 *   straight   that test, over views that include grazing ones
 *   volume     the test of --mdf-views over a volume of 8 bits
 *   shell      the viewer's: rays are marched through a volume made from the MDF
 *   views      the viewer's with --mdf-views; the relief of grazing views is raised as the MDF says
 *   true       with --true-grazing: as views, with grazing views traced over the true surface
 * With --rays instead: where single rays meet the flat samples (silhouettes_rays.c).
 */
#include "bench.h"
#include "lib/mdf_copy.h"
#include "lib/silhouettes_fixture.h"
#include "scene/picture.h"
#include "silhouettes_rays.h"

#include <stdio.h>
#include <string.h>

#define TILE_MM   25.0
#define MAX_RINGS 8

static const struct material {
    const char *kind;
    double relief_mm, period_mm;
    int rings; /* of twelve views */
    gboolean repeats;
} materials[] = {
    {"weave", 1.2, 6.25, 8, FALSE},   {"brick", 1.8, 6.25, 5, TRUE},
    {"peanuts", 1.8, 6.25, 8, FALSE}, {"grass", 1.8, 2.5, 8, TRUE},
    {"bluepipe", 1.8, 2.5, 5, TRUE},  {"block", 1.8, 3.125, 5, TRUE},
    {"mail", 1.8, 2.5, 5, TRUE},
};

static gboolean true_grazing, rays;
static int texels = 64, azimuths = 12, width = 400, height = 300;
static double distance_mm = 650.0;
/* As in mdf_grazing.c. */
static const double grazing_deg[] = {80.0, 84.0, 87.0};
#define N_GRAZING   ((int)G_N_ELEMENTS(grazing_deg))
#define GRAZING_PHI 36
static char **kinds, **tilings;

/* The presets 12x5 and 12x8 of session files. */
static double theta_deg(const struct material *m, int ring) {
    return m->rings == 8 ? 12 + 9 * ring : 15 * (ring + 1);
}

/* The angle between a ring of views and the next one, or 80° after the last one. */
static double between_deg(const struct material *m, int ring) {
    return ring + 1 < m->rings ? 0.5 * (theta_deg(m, ring) + theta_deg(m, ring + 1)) : 80.0;
}

/* Makes a world with a camera at each ring, and n further ones. */
static World *new_world(const struct material *m, const double *further_deg, int n) {
    g_autoptr(GString) text = g_string_new("[world]\nnoise=no\ngather_rays=0\n");
    g_string_append_printf(text,
                           "[sample]\nkind=%s\nseed=3\nwidth_mm=50\nheight_mm=50\nbase_mm=0.4\n"
                           "relief_mm=%g\ntop_mm=5\nperiod_mm=%g\ngrid=320\nrepeats=%d\n",
                           m->kind, m->relief_mm, m->period_mm, m->repeats ? 2 : 1);
    for (int k = 0; k < m->rings + n; k++)
        g_string_append_printf(text, "[camera c%d]\ntheta_deg=%g\ndistance_mm=%g\n", k,
                               k < m->rings ? theta_deg(m, k) : further_deg[k - m->rings],
                               distance_mm);
    return world_fixture_new(text->str);
}

static double highest_mm(const struct truth_surface *s) {
    double top = 0;
    for (guint k = 0; k < s->n_vertices; k++)
        top = MAX(top, (double)s->vertices[(gsize)s->stride * k + 2]);
    return top;
}

struct scene {
    const struct material *material;
    const struct silhouettes_shape *shape;
    int u, v;
    Viewer *view;
    struct viewer_settings settings;
    struct displaced_pixel *truth;
};

/* table NULL: the BTF only. */
static void show(const struct scene *s, const char *way, double value,
                 const struct mdf_table *table, struct visibility_options options) {
    g_autoptr(GError) error = NULL;
    struct viewer_settings one = s->settings;
    one.silhouettes = table != NULL;
    one.visibility.straight = options.straight;
    one.visibility.volume = options.volume;
    one.visibility.views = options.views;
    viewer_set_mdf(s->view, table ? &(struct mdf_source){.table = table} : NULL, &error);
    bench_check(error);
    g_autofree float *seen =
        viewer_render_geometry(s->view, &one, VIEWER_GEOMETRY_LIT, width, height, &error);
    bench_check(error);
    struct scores score = silhouettes_score(s->shape, seen, s->truth, &one, width, height, TRUE);
    g_autofree char *tiles = g_strdup_printf("%dx%d", s->u, s->v);
    bench_row(
        NULL,
        "%-8s{material} %-8s{shape} %s{tiles} %s{way} %.3f{raised} %.4f{outline} %.4f{shadow}",
        s->material->kind, s->shape->name, tiles, way, value, overlap_share(&score.outline),
        overlap_share(&score.shadow));
}

static void measure(struct scene *s, const struct mdf_table *table,
                    const struct mdf_table *grazing) {
    const struct visibility_options views = {.views = TRUE}, volume = {.volume = TRUE};
    show(s, "btf", 0, NULL, views);
    show(s, "published", 0, table, (struct visibility_options){.straight = TRUE, .volume = TRUE});
    show(s, "shell", 0, table, (struct visibility_options){0});
    const double own = mdf_table_raised(table);
    g_autoptr(MdfTable) all = mdf_copy(table);
    mdf_table_add_grazing(all);
    show(s, "straight", own, all, (struct visibility_options){.straight = TRUE});
    show(s, "volume", own, all, volume);
    show(s, "views", own, all, views);
    if (grazing)
        show(s, "true", 0, grazing, views);
}

static void measure_scene(const struct material *m, const struct silhouettes_shape *shape, int u,
                          int v, const struct truth_surface *surface, double reference_mm,
                          const struct mdf_table *table, const struct mdf_table *grazing) {
    g_autoptr(GError) error = NULL;
    const struct scene_options options = {u, v, SCENE_Z_UP, TRUE};
    g_autoptr(Mesh) mesh = scene_make(shape->name, &options, &error);
    bench_check(error);
    g_autoptr(Viewer) view = silhouettes_view(mesh, NULL);
    const struct displaced_shape is =
        silhouettes_displaced(shape, u, v, TRUE, TILE_MM, reference_mm);
    g_autoptr(Displaced) displaced = displaced_new(surface, &is);
    struct scene s = {m, shape, u, v, view, viewer_settings_default, NULL};
    s.settings.shadows = TRUE;
    viewer_fit(view, &s.settings, (double)width / height);
    s.truth = silhouettes_trace(shape, displaced, &s.settings, width, height);
    measure(&s, table, grazing);
    g_free(s.truth);
}

/* The table with the views of the other behind its own. */
static struct mdf_table *joined(const struct mdf_table *table, const struct mdf_table *other) {
    struct mdf_table *t = mdf_copy(table);
    const gsize n = (gsize)t->width * t->height, all = (gsize)t->n_views + other->n_views;
    t->theta_deg = g_renew(float, t->theta_deg, all);
    t->phi_deg = g_renew(float, t->phi_deg, all);
    t->depth_mm = g_renew(float, t->depth_mm, n *all);
    t->seen = g_renew(guint8, t->seen, n * all);
    memcpy(t->theta_deg + t->n_views, other->theta_deg, sizeof(float) * other->n_views);
    memcpy(t->phi_deg + t->n_views, other->phi_deg, sizeof(float) * other->n_views);
    memcpy(t->depth_mm + n * t->n_views, other->depth_mm, sizeof(float) * n * other->n_views);
    memcpy(t->seen + n * t->n_views, other->seen, n * other->n_views);
    t->n_views += other->n_views;
    t->deepest_mm = MAX(t->deepest_mm, other->deepest_mm);
    return t;
}

/* With ret_path, also gives the path of the file of the table. */
static struct mdf_table *true_table(World *world, const struct truth_grid *grid, int first,
                                    const double *rings_deg, int n_rings, int n_phi,
                                    char **ret_path) {
    g_autoptr(GError) error = NULL;
    g_autofree char *path =
        silhouettes_write_truth_rings(world, grid, first, rings_deg, n_rings, n_phi);
    struct mdf_table *table = mdf_table_read(path, &error);
    if (ret_path)
        *ret_path = g_strdup(path);
    bench_check(error);
    return table;
}

static void measure_material(const struct material *m) {
    static const char *const usual[] = {"8x3", "6x2", "3x1", "2x1", NULL};
    g_autoptr(World) world = new_world(m, grazing_deg, N_GRAZING);
    struct truth_surface surface;
    truth_surface(world, &surface);
    const double reference_mm = highest_mm(&surface) + 0.02;
    const struct truth_grid grid = {texels, texels, TILE_MM, TILE_MM, reference_mm};
    double at[MAX_RINGS];
    for (int k = 0; k < m->rings; k++)
        at[k] = theta_deg(m, k);
    g_autoptr(MdfTable) table = true_table(world, &grid, 0, at, m->rings, azimuths, NULL);
    g_autoptr(MdfTable) flat = NULL, all = NULL;
    if (true_grazing) {
        flat = true_table(world, &grid, m->rings, grazing_deg, N_GRAZING, GRAZING_PHI, NULL);
        all = joined(table, flat);
    }
    for (const char *const *tiles = tilings ? (const char *const *)tilings : usual; *tiles;
         tiles++) {
        int u, v;
        char end;
        if (sscanf(*tiles, "%3dx%3d%c", &u, &v, &end) != 2 || u < 1 || v < 1)
            bench_fail(2, "--tiles %s: UxV is expected, whole numbers", *tiles);
        measure_scene(m, &silhouettes_torus, u, v, &surface, reference_mm, table, all);
    }
    /* Tiles of the cylinder are nearly square with 5 × 2. */
    if (!tilings)
        measure_scene(m, &silhouettes_cylinder, 5, 2, &surface, reference_mm, table, all);
}

static void measure_rays(const struct material *m) {
    double at[MAX_RINGS], between[MAX_RINGS];
    for (int k = 0; k < m->rings; k++) {
        at[k] = theta_deg(m, k);
        between[k] = between_deg(m, k);
    }
    g_autoptr(World) world = new_world(m, between, m->rings);
    struct truth_surface surface;
    truth_surface(world, &surface);
    const struct truth_grid grid = {texels, texels, TILE_MM, TILE_MM, highest_mm(&surface) + 0.02};
    /* Both tables have the same file, so the file must be written last from which path is read. */
    g_autofree char *path = NULL;
    g_autoptr(MdfTable) truth =
        true_table(world, &grid, m->rings, between, m->rings, 2 * azimuths, NULL);
    g_autoptr(MdfTable) table = true_table(world, &grid, 0, at, m->rings, azimuths, &path);
    silhouettes_rays(m->kind, table, path, truth);
}

int main(int argc, char **argv) {
    g_autofree char *size = NULL;
    const GOptionEntry entries[] = {
        {"only", 0, 0, G_OPTION_ARG_STRING_ARRAY, &kinds, "Only this sample; may be repeated",
         "KIND"},
        {"tiles", 0, 0, G_OPTION_ARG_STRING_ARRAY, &tilings,
         "Only this tiling of the torus; may be repeated; default 8x3, 6x2, 3x1, 2x1, and the "
         "cylinder",
         "UxV"},
        {"texels", 0, 0, G_OPTION_ARG_INT, &texels, "Of the MDF each way, default 64", "N"},
        {"azimuths", 0, 0, G_OPTION_ARG_INT, &azimuths,
         "Measured views in each ring, default 12, as in the paper", "N"},
        {"distance", 0, 0, G_OPTION_ARG_DOUBLE, &distance_mm,
         "Of the cameras that the MDF is seen by, mm; default 650", "MM"},
        {"true-grazing", 0, 0, G_OPTION_ARG_NONE, &true_grazing,
         "Also with grazing views of the true surface", NULL},
        {"rays", 0, 0, G_OPTION_ARG_NONE, &rays,
         "Measure where rays between the measured directions meet the flat samples", NULL},
        {"size", 0, 0, G_OPTION_ARG_STRING, &size, "Pixels, default 400x300", "WxH"},
        {NULL}};
    char end;
    bench_parse(&argc, &argv, entries, NULL);
    if (texels < 4 || texels > 512 || azimuths < 3 || azimuths > 360 || !(distance_mm >= 100.0) ||
        (size &&
         (sscanf(size, "%4dx%4d%c", &width, &height, &end) != 2 || width < 8 || height < 8)))
        bench_fail(2,
                   "--texels is 4 to 512, --azimuths 3 to 360, --distance 100 or more, --size WxH");
    g_autoptr(GError) error = NULL;
    g_autoptr(Gpu) gpu = gpu_new_headless(&error);
    bench_check(error);
    bench_begin_list(NULL);
    for (gsize k = 0; k < G_N_ELEMENTS(materials); k++)
        if (!kinds || g_strv_contains((const char *const *)kinds, materials[k].kind))
            (rays ? measure_rays : measure_material)(&materials[k]);
    bench_end();
    g_strfreev(kinds);
    g_strfreev(tilings);
    world_fixture_clean();
    return 0;
}
