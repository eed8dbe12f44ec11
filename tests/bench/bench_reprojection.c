/*
 * Compares views that are predicted along the surface (reprojection/reprojection.h) with the same
 * views interpolated at each texel, as drawing does it (directions.h), and with what mesorig-view
 * --along-surface draws (along.glsl; error_shell). Views of a session are left out, by default the
 * rings at 30° and 60° of five rings that are 15° apart, so that neighbours are
 * 30° apart in the polar angle. The MDF is computed from the other views, which then predict the
 * views left out. The truth is what the rig has measured in the views left out. With --truth it is
 * what the simulated world says (world.conf next to the session), and the measured views are
 * compared with it as well.
 *
 * error: ‖predicted − measured‖ / ‖measured‖ of R, G, B over all lights and texels of the views
 * left out. delta_e: mean CIEDE2000, the diffuser being white. ratio: along / mixed. fallback:
 * share of texels of which no view sees the surface; they are mixed. depth_rms: of the predicted
 * MDF against what the view itself has measured, in texels, and the share that is off by more than
 * one.
 */
#include "bench.h"

#include <math.h>
#include <string.h>

#include "base/png_bytes.h"
#include "base/work.h"
#include "btf/btf_matrix.h"
#include "directions/directions.h"
#include "exr/exr.h"
#include "lib/direction.h"
#include "mdf/mdf_views.h"
#include "mdf/reprojection.h"
#include "mdf/shell_ray.h"
#include "metrics/delta_e.h"
#include "session/session.h"
#include "world/truth.h"

static char *left_out, *pictures;
static int threads, truth_samples;
static const GOptionEntry entries[] = {
    {"left-out", 0, 0, G_OPTION_ARG_STRING, &left_out,
     "Polar angles of the views left out, in degrees; default 30;60", "DEG;…"},
    {"pictures", 0, 0, G_OPTION_ARG_FILENAME, &pictures,
     "Write a picture of each view there: measured, mixed and predicted under the first light",
     "DIR"},
    {"truth", 0, 0, G_OPTION_ARG_INT, &truth_samples,
     "Compare with the simulated world, of N × N rays a texel, not with what was measured", "N"},
    {"threads", 0, 0, G_OPTION_ARG_INT, &threads, "How many at a time (one a processor)", "N"},
    {NULL},
};

/* As in along.glsl. */
#define DROPPED 0.2F
#define UNSEEN  0.05
#define SHORTER 0.7

#define SCALE    6  /* pixels a texel in pictures */
#define MAX_POLE 64 /* views of the topmost ring */

enum { MIXED, ALONG, SHELL, MEASURED, WAYS };

struct sums {
    double squares[WAYS], norm, delta_e[WAYS];
    gint64 colours, texels, fallback, depths, wrong;
    double depth_squares;
};

struct scene {
    struct btf_matrix *btf;
    struct exr_file *mdf;
    struct mdf_plane plane;
    int n_kept, n_out, *kept, *out;
    struct reprojection_view *views; /* those kept */
    float **settled;
    Reprojection *reprojection;
    Directions *directions; /* of those kept */
    Directions *triangles;  /* of those kept, triangulated */
    MdfTable *table;
    MdfShell *shell;
    float **truth;     /* of each view left out, n_texels × n_lights × 3; NULL: as measured */
    struct sums *sums; /* of each view left out */
    double seconds;    /* CPU, for finding taps */
};

static struct exr_part *reprojection_bench_part(const struct scene *scene, int view) {
    return g_ptr_array_index(scene->mdf->parts, (guint)view);
}

static const float *reprojection_bench_plane(const struct scene *scene, int view,
                                             const char *name) {
    const float *plane = exr_part_plane(reprojection_bench_part(scene, view), name);
    if (!plane)
        bench_fail(1, "the MDF has no channel %s", name);
    return plane;
}

static void reprojection_bench_centre(const struct scene *scene, int view, double ret[3]) {
    g_autoptr(GError) error = NULL;
    exr_get_v3d(reprojection_bench_part(scene, view), "view.centre_mm", ret, &error);
    bench_check(error);
}

static gboolean is_left_out(double theta_deg) {
    g_auto(GStrv) list = g_strsplit(left_out ? left_out : "30;60", ";", -1);
    for (char **at = list; *at; at++)
        if (fabs(theta_deg - g_ascii_strtod(*at, NULL)) < 1)
            return TRUE;
    return FALSE;
}

static void reprojection_bench_settle(int k, gpointer data) {
    struct scene *scene = data;
    const int n = scene->plane.width * scene->plane.height;
    g_autofree struct mdf_eye *eyes = g_new0(struct mdf_eye, scene->n_kept);
    g_autofree guint8 *source = g_new(guint8, n);
    for (int i = 0; i < scene->n_kept; i++) {
        const int view = scene->kept[i];
        reprojection_bench_centre(scene, view, eyes[i].centre_mm);
        eyes[i].distance = reprojection_bench_plane(scene, view, "M");
        eyes[i].other = reprojection_bench_plane(scene, view, "O");
        eyes[i].lasers = reprojection_bench_plane(scene, view, "N");
    }
    scene->settled[k] = g_new(float, n);
    mdf_views_settle(eyes, scene->n_kept, k, &scene->plane, scene->settled[k], source);
}

/* Makes the shell of the views that are kept. */
static void reprojection_bench_shell_of(struct scene *scene, const float *theta_deg,
                                        const float *phi_deg) {
    const struct mdf_plane *plane = &scene->plane;
    const int n = plane->width * plane->height;
    MdfTable *t = scene->table = mdf_table_new(plane->width, plane->height, scene->n_kept,
                                               plane->texel_mm, theta_deg, phi_deg);
    t->seen = g_new0(guint8, n * scene->n_kept);
    for (int k = 0; k < scene->n_kept; k++) {
        struct mdf_eye eye = {0};
        memcpy(eye.centre_mm, scene->views[k].centre_mm, sizeof eye.centre_mm);
        float *depth = t->depth_mm + k * n;
        for (int i = 0; i < n; i++) {
            const double mm = (double)scene->settled[k][i];
            t->seen[k * n + i] = mm >= 0;
            depth[i] =
                mm >= 0 ? (float)MAX(plane->reference_mm - mdf_views_point(&eye, plane, i, mm).z, 0)
                        : -1;
        }
        mdf_table_fill(depth, plane->width, plane->height);
        for (int i = 0; i < n; i++)
            t->deepest_mm = MAX(t->deepest_mm, (double)depth[i]);
    }
    scene->shell = mdf_shell_new(t);
}

static void reprojection_bench_open(struct scene *scene, const char *session) {
    g_autoptr(GError) error = NULL;
    g_autofree char *path = g_build_filename(session, "products", "mdf.exr", NULL);
    scene->btf = btf_matrix_read(session, NULL, &error);
    bench_check(error);
    scene->mdf = exr_read(path, &error);
    bench_check(error);
    const struct btf_layout *layout = &scene->btf->layout;
    const int n = (int)layout->views.n;
    if ((int)scene->mdf->parts->len != n)
        bench_fail(1, "%s: not the views of the BTF", path);
    scene->plane = (struct mdf_plane){(int)layout->width, (int)layout->height, layout->texel_mm,
                                      layout->reference_mm};
    scene->kept = g_new(int, n);
    scene->out = g_new(int, n);
    g_autofree float *theta = g_new(float, n), *phi = g_new(float, n);
    for (int v = 0; v < n; v++)
        if (is_left_out((double)layout->views.theta_deg[v])) {
            scene->out[scene->n_out++] = v;
        } else {
            theta[scene->n_kept] = layout->views.theta_deg[v];
            phi[scene->n_kept] = layout->views.phi_deg[v];
            scene->kept[scene->n_kept++] = v;
        }
    if (scene->n_kept < 1 || scene->n_out < 1)
        bench_fail(1, "%d views are left out of %d", scene->n_out, n);
    scene->directions = directions_new(theta, phi, scene->n_kept, &error);
    bench_check(error);
    scene->settled = g_new0(float *, scene->n_kept);
    work_for_each(threads, scene->n_kept, reprojection_bench_settle, scene);
    scene->views = g_new0(struct reprojection_view, scene->n_kept);
    for (int k = 0; k < scene->n_kept; k++) {
        reprojection_bench_centre(scene, scene->kept[k], scene->views[k].centre_mm);
        scene->views[k].distance = scene->settled[k];
        scene->views[k].error_mm = reprojection_bench_plane(scene, scene->kept[k], "S");
    }
    scene->reprojection =
        reprojection_new(&scene->plane, scene->views, scene->n_kept, FALSE, &error);
    bench_check(error);
    scene->sums = g_new0(struct sums, scene->n_out);
    scene->triangles = directions_new_triangulated(theta, phi, scene->n_kept, &error);
    bench_check(error);
    reprojection_bench_shell_of(scene, theta, phi);
}

static void reprojection_bench_bilinear(const struct scene *scene, double u, double v, int texel[4],
                                        float w[4]) {
    const int width = scene->plane.width, height = scene->plane.height;
    const double x = u * width - 0.5, y = v * height - 0.5;
    const int i = (int)floor(x), j = (int)floor(y);
    for (int k = 0; k < 4; k++) {
        const int c = CLAMP(i + (k & 1), 0, width - 1), r = CLAMP(j + (k >> 1), 0, height - 1);
        texel[k] = r * width + c;
        w[k] = (float)((k & 1 ? x - i : 1 - x + i) * (k >> 1 ? y - j : 1 - y + j));
    }
}

/* Taps as along.glsl draws: the shell says where the ray ends. */
static int reprojection_bench_shell(const struct scene *scene, int texel, struct vec3 v,
                                    struct reprojection_tap *ret) {
    const MdfTable *t = scene->table;
    const int n_texels = t->width * t->height;
    const double width_mm = t->width * t->texel_mm, height_mm = t->height * t->texel_mm;
    const struct shell_surface flat = {.tile = {width_mm, height_mm}};
    struct shell_hit hit = {0};
    struct direction_weights weights;
    float sum = 0;
    int n = 0;
    shell_ray_march(scene->shell, &flat, (texel % t->width + 0.5) / t->width,
                    (texel / t->width + 0.5) / t->height, (const double[]){v.x, v.y, v.z}, INFINITY,
                    &hit);
    directions_weights(scene->triangles, v, &weights);
    for (int i = 0; i < 4; i++) {
        const int k = weights.index[i];
        const float share = MAX(weights.weight[i] - DROPPED, 0.0F);
        const struct vec3 to = direction_of_deg((double)t->theta_deg[k], (double)t->phi_deg[k]);
        int texels[4];
        float near[4];
        double depth = 0;
        reprojection_bench_bilinear(scene, hit.u + hit.depth_mm * to.x / to.z / width_mm,
                                    hit.v - hit.depth_mm * to.y / to.z / height_mm, texels, near);
        for (int j = 0; j < 4; j++)
            depth += (double)near[j] * (double)t->depth_mm[k * n_texels + texels[j]];
        const double q = fabs(hit.depth_mm - depth) / (to.z * t->texel_mm);
        const float w = share * (float)(pow(to.z, SHORTER) * (CLAMP(2 - q, 0, 1) + UNSEEN));
        sum += w;
        for (int j = 0; j < 4 && w > 0; j++)
            ret[n++] = (struct reprojection_tap){k, texels[j], w * near[j]};
    }
    for (int k = 0; k < n; k++)
        ret[k].weight /= sum;
    return n;
}

/* What the views left out would show without noise and errors of the rig. */
static void reprojection_bench_trace(struct scene *scene, const char *path) {
    g_autoptr(GError) error = NULL;
    g_autofree char *folder = g_path_get_dirname(path);
    g_autofree char *conf = g_build_filename(folder, "world.conf", NULL);
    World *world = world_get(conf, &error);
    bench_check(error);
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    bench_check(error);
    g_autoptr(GPtrArray) shots = session_shots(session, &error);
    g_autoptr(GPtrArray) views = shots ? session_views(session, &error) : NULL;
    bench_check(error);
    if (!views)
        bench_fail(1, "%s: its views cannot be read", path);
    const struct mdf_plane *plane = &scene->plane;
    const struct truth_grid grid = {plane->width, plane->height, plane->width * plane->texel_mm,
                                    plane->height * plane->texel_mm, plane->reference_mm};
    const gsize n = (gsize)plane->width * (gsize)plane->height;
    const gsize n_lights = scene->btf->layout.lights.n;
    g_autofree float *rgb = g_new(float, 3 * n);
    scene->truth = g_new0(float *, scene->n_out);
    for (int k = 0; k < scene->n_out; k++) {
        const struct session_direction *view = views->pdata[scene->out[k]];
        scene->truth[k] = g_new0(float, 3 * n * n_lights);
        for (guint i = 0; i < shots->len; i++) {
            const struct session_shot *shot = shots->pdata[i];
            if (shot->kind != SHOT_LAMP || !camera_set_has(shot->cameras, view->device) ||
                fabs(shot->turntable_deg - view->turntable_deg) > 1e-6)
                continue;
            truth_btf(world, view->device, shot->device, shot->turntable_deg, shot->arc_deg, &grid,
                      truth_samples, rgb);
            for (gsize t = 0; t < n; t++)
                memcpy(scene->truth[k] + 3 * (t * n_lights + (gsize)shot->source), rgb + 3 * t,
                       3 * sizeof(float));
        }
    }
    world_unref(world);
}

static void reprojection_bench_close(struct scene *scene) {
    for (int k = 0; k < scene->n_kept; k++)
        g_free(scene->settled[k]);
    reprojection_free(scene->reprojection);
    directions_free(scene->directions);
    directions_free(scene->triangles);
    mdf_table_free(scene->table);
    mdf_shell_free(scene->shell);
    btf_matrix_free(scene->btf);
    exr_file_free(scene->mdf);
    for (int k = 0; k < scene->n_out && scene->truth; k++)
        g_free(scene->truth[k]);
    g_free(scene->truth);
    g_free(scene->settled);
    g_free(scene->views);
    g_free(scene->kept);
    g_free(scene->out);
    g_free(scene->sums);
}

/* n_lights × 3 */
static const float *reprojection_bench_values(const struct scene *scene, int texel, int view) {
    const gsize row = scene->btf->layout.lights.n * 3;
    return scene->btf->values + ((gsize)texel * scene->btf->layout.views.n + (gsize)view) * row;
}

/* Taps of the views kept, as drawing mixes them: the pole is the mean of its ring. */
static int reprojection_bench_mixed(const struct scene *scene, struct vec3 v, int texel,
                                    struct reprojection_tap *ret) {
    struct direction_weights weights;
    int n = 0, n_pole;
    const int *pole = directions_pole(scene->directions, &n_pole);
    directions_weights(scene->directions, v, &weights);
    for (int i = 0; i < 4; i++)
        if (weights.index[i] < scene->n_kept)
            ret[n++] = (struct reprojection_tap){weights.index[i], texel, weights.weight[i]};
        else
            for (int k = 0; k < n_pole && weights.weight[i] > 0; k++)
                ret[n++] =
                    (struct reprojection_tap){pole[k], texel, weights.weight[i] / (float)n_pole};
    return n;
}

static void reprojection_bench_mix(const struct scene *scene, const struct reprojection_tap *taps,
                                   int n, float *ret) {
    const int row = (int)scene->btf->layout.lights.n * 3;
    memset(ret, 0, sizeof(float) * (gsize)row);
    for (int k = 0; k < n; k++) {
        const float *from =
            reprojection_bench_values(scene, taps[k].texel, scene->kept[taps[k].view]);
        for (int i = 0; i < row; i++)
            ret[i] += taps[k].weight * from[i];
    }
}

static void reprojection_bench_add(const struct scene *scene, const float *const *made,
                                   const float *truth, struct sums *sums) {
    for (gsize light = 0; light < scene->btf->layout.lights.n; light++) {
        double lab[3], lab_made[3];
        delta_e_lab(truth + 3 * light, lab);
        for (int way = 0; way < WAYS; way++) {
            for (int c = 0; c < 3; c++) {
                const double off =
                    (double)made[way][3 * light + (gsize)c] - (double)truth[3 * light + (gsize)c];
                sums->squares[way] += off * off;
            }
            delta_e_lab(made[way] + 3 * light, lab_made);
            sums->delta_e[way] += delta_e_2000(lab, lab_made);
        }
        for (gsize c = 0; c < 3; c++)
            sums->norm += (double)truth[3 * light + c] * (double)truth[3 * light + c];
        sums->colours++;
    }
}

static void reprojection_bench_depth(const struct scene *scene, int view, int texel, double mm,
                                     struct sums *sums) {
    const float measured = reprojection_bench_plane(scene, view, "M")[texel];
    if (!(measured >= 0) || mm < 0)
        return;
    const double off = (mm - (double)measured) / scene->plane.texel_mm;
    sums->depths++;
    if (fabs(off) > 1)
        sums->wrong++;
    else
        sums->depth_squares += off * off;
}

static guint8 reprojection_bench_srgb(float value) {
    const double v = CLAMP((double)value, 0, 1);
    return (guint8)lround(255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * pow(v, 1 / 2.4) - 0.055));
}

/* Measured, mixed and predicted next to each other, as sRGB, the brightest hundredth being white.
 */
static void reprojection_bench_write(const struct scene *scene, int view, float *const *planes) {
    g_autoptr(GError) error = NULL;
    g_autofree char *path = g_strdup_printf("%s/view_%04d.png", pictures, view);
    const int width = scene->plane.width, height = scene->plane.height, panels = 3;
    const int across = panels * width * SCALE, down = height * SCALE, n = 3 * width * height;
    g_autofree guint8 *rgb = g_malloc(3 * (gsize)across * (gsize)down);
    g_autofree double *sorted = g_new(double, n);
    for (int i = 0; i < n; i++)
        sorted[i] = (double)planes[0][i];
    const float white = (float)bench_time_quantile(sorted, n, 0.99);
    for (int i = 0; i < across * down; i++) {
        const int x = i % across / SCALE, y = i / across / SCALE;
        for (int c = 0; c < 3; c++)
            rgb[3 * i + c] = reprojection_bench_srgb(
                planes[x / width][3 * (y * width + x % width) + c] / MAX(white, 1e-6F));
    }
    g_autoptr(GBytes) png = png_bytes(rgb, across, down, &error);
    bench_check(error);
    g_file_set_contents(path, g_bytes_get_data(png, NULL), (gssize)g_bytes_get_size(png), &error);
    bench_check(error);
}

static void reprojection_bench_view(int k, gpointer data) {
    struct scene *scene = data;
    const int view = scene->out[k], n = scene->plane.width * scene->plane.height;
    const gsize row = scene->btf->layout.lights.n * 3;
    double centre[3];
    g_autofree float *mixed = g_new(float, row), *along = g_new(float, row);
    g_autofree float *shell = g_new(float, row);
    float *shown[3] = {NULL};
    reprojection_bench_centre(scene, view, centre);
    const struct vec3 nominal =
        vec3_unit(vec3(centre[0], centre[1], centre[2] - scene->plane.reference_mm));
    for (int i = 0; i < 3 && pictures; i++)
        shown[i] = g_new0(float, 3 * n);
    for (int texel = 0; texel < n; texel++) {
        struct reprojection_tap taps[4 * MAX_POLE];
        struct reprojection_hit hit;
        double at_mm[2];
        int n_taps = reprojection_bench_mixed(scene, nominal, texel, taps);
        reprojection_bench_mix(scene, taps, n_taps, mixed);
        reprojection_texel_mm(scene->reprojection, texel, at_mm);
        const struct vec3 towards = vec3_unit(vec3(centre[0] - at_mm[0], centre[1] - at_mm[1],
                                                   centre[2] - scene->plane.reference_mm));
        n_taps = reprojection_taps(scene->reprojection, at_mm, towards, &hit, taps);
        reprojection_bench_mix(scene, taps, n_taps, along);
        n_taps = reprojection_bench_shell(scene, texel, towards, taps);
        reprojection_bench_mix(scene, taps, n_taps, shell);
        const float *measured = reprojection_bench_values(scene, texel, view);
        const float *truth = scene->truth ? scene->truth[k] + (gsize)texel * row : measured;
        reprojection_bench_add(scene, (const float *const[]){mixed, along, shell, measured}, truth,
                               &scene->sums[k]);
        reprojection_bench_depth(scene, view, texel, hit.mm, &scene->sums[k]);
        scene->sums[k].texels++;
        scene->sums[k].fallback += !hit.seen;
        for (int i = 0; i < 3 && shown[i]; i++)
            memcpy(shown[i] + 3 * texel, (const float *const[]){truth, mixed, along}[i],
                   3 * sizeof(float));
    }
    if (shown[0])
        reprojection_bench_write(scene, view, shown);
    for (int i = 0; i < 3; i++)
        g_free(shown[i]);
}

static void reprojection_bench_tell(const char *session, const struct scene *scene) {
    struct sums all = {0};
    for (int k = 0; k < scene->n_out; k++) {
        const struct sums *one = &scene->sums[k];
        for (int way = 0; way < WAYS; way++) {
            all.squares[way] += one->squares[way];
            all.delta_e[way] += one->delta_e[way];
        }
        all.norm += one->norm;
        all.colours += one->colours;
        all.texels += one->texels;
        all.fallback += one->fallback;
        all.depths += one->depths;
        all.wrong += one->wrong;
        all.depth_squares += one->depth_squares;
    }
    double error[WAYS], delta_e[WAYS];
    for (int way = 0; way < WAYS; way++) {
        error[way] = sqrt(all.squares[way] / all.norm);
        delta_e[way] = all.delta_e[way] / (double)all.colours;
    }
    const double depth = sqrt(all.depth_squares / (double)MAX(all.depths - all.wrong, 1));
    const double wrong = (double)all.wrong / (double)MAX(all.depths, 1);
    const double fallback = (double)all.fallback / (double)all.texels;
    const double us = 1e6 * scene->seconds / (double)all.texels;
    bench_row(
        session,
        "%d{views_kept} %d{views_left_out} %.4f{error_mixed} %.4f{error_along} %.4f{error_shell} "
        "%.4f{error_measured} %.3f{ratio} %.3f{delta_e_mixed} %.3f{delta_e_along} "
        "%.3f{delta_e_shell} "
        "%.3f{delta_e_measured} %.5f{fallback} %.4f{depth_rms_texels} %.5f{depth_wrong} "
        "%.2f{cpu_us_a_texel}",
        scene->n_kept, scene->n_out, error[MIXED], error[ALONG], error[SHELL], error[MEASURED],
        error[ALONG] / error[MIXED], delta_e[MIXED], delta_e[ALONG], delta_e[SHELL],
        delta_e[MEASURED], fallback, depth, wrong, us);
}

int main(int argc, char **argv) {
    bench_parse(&argc, &argv, entries, "DIR.session …");
    if (argc < 2)
        bench_fail(2, "give sessions with a BTF and an MDF");
    bench_begin(NULL);
    for (int i = 1; i < argc; i++) {
        struct scene scene = {0};
        reprojection_bench_open(&scene, argv[i]);
        if (truth_samples > 0)
            reprojection_bench_trace(&scene, argv[i]);
        const double begun = bench_cpu_s();
        work_for_each(threads, scene.n_out, reprojection_bench_view, &scene);
        scene.seconds = bench_cpu_s() - begun;
        reprojection_bench_tell(argv[i], &scene);
        reprojection_bench_close(&scene);
    }
    bench_end();
    return 0;
}
