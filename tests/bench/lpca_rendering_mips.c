#include "lpca_rendering_parts.h"

#include "codecs/lpca/lpca_levels.h"
#include "drawing/methods/lpca_grid.h"
#include "drawing/methods/lpca_revised.h"
#include "drawing/methods/lpca_view.h"
#include "drawing/methods/methods.h"
#include "frame_time.h"
#include "scene/viewer.h"
#include "shapes/scene.h"

#include <math.h>

#define PIXELS 96
#define FINE   5    /* samples of the reference, each way of a pixel */
#define STEPS  16   /* pictures, from each to the next the camera is */
#define AWAY   1.02 /* times as far away */
#define TILES  8

enum { PAIRS, REVISED, GRID, WAYS };
static const struct method *const mips_methods[WAYS] = {&method_lpca, &method_lpca_revised,
                                                        &method_lpca_grid};

struct mips_quality {
    double error, flicker; /* RMS, relative to the reference */
};

static gboolean mips_open(Viewer *viewer, struct lpca *const *levels, int n, int way, int n_grid,
                          GError **error) {
    gpointer material = way == PAIRS     ? (gpointer)lpca_view_new(levels, n, error)
                        : way == REVISED ? (gpointer)lpca_revised_new(levels, n, n_grid, error)
                                         : (gpointer)lpca_grid_new(levels, n, n_grid, error);
    return material && viewer_set_method(viewer, mips_methods[way], material, error);
}

/* A plane that is seen from further and further away. */
static struct viewer_settings mips_settings(int step) {
    struct viewer_settings s = viewer_settings_default;
    s.ambient = 0;
    s.camera_elevation_deg = 35;
    s.tiles_u = s.tiles_v = TILES;
    s.camera_distance = 3 * pow(AWAY, step);
    return s;
}

/* Means over FINE × FINE samples a pixel; the fourth is 1 where all of them see the plane. */
static float *mips_reference(Viewer *viewer, int step, GError **error) {
    const struct viewer_settings s = mips_settings(step);
    const int size = PIXELS * FINE;
    g_autofree float *fine = viewer_render_linear(viewer, &s, size, size, error);
    float *ret = fine ? g_new0(float, 4 * PIXELS * PIXELS) : NULL;
    for (int k = 0; fine && k < size * size; k++) {
        float *to = ret + 4 * (k / size / FINE * PIXELS + k % size / FINE);
        for (int c = 0; c < 3; c++)
            to[c] += fine[4 * k + c] / (FINE * FINE);
        to[3] += fine[4 * k + 3] > 0 ? 1.0F / (FINE * FINE) : 0;
    }
    for (int k = 3; ret && k < 4 * PIXELS * PIXELS; k += 4)
        ret[k] = ret[k] > 0.999F ? 1 : 0;
    return ret;
}

/* Pictures against the references. Flicker: how much the error of a pixel changes from a picture to
 * the next. */
static gboolean mips_judge(Viewer *viewer, float *const truth[STEPS], struct mips_quality *ret,
                           GError **error) {
    double off = 0, all = 0, change = 0, of_change = 0;
    g_autofree float *before = NULL;
    for (int step = 0; step < STEPS; step++) {
        const struct viewer_settings s = mips_settings(step);
        g_autofree float *drawn = viewer_render_linear(viewer, &s, PIXELS, PIXELS, error);
        if (!drawn)
            return FALSE;
        for (int k = 0; k < 4 * PIXELS * PIXELS; k++) {
            const gboolean whole = k % 4 < 3 && truth[step][k | 3] > 0 && drawn[k | 3] > 0;
            const double value = truth[step][k], away = (double)drawn[k] - value;
            if (!whole)
                continue;
            off += away * away;
            all += value * value;
            if (step > 0 && truth[step - 1][k | 3] > 0) {
                change += pow(away - ((double)before[k] - truth[step - 1][k]), 2);
                of_change += value * value;
            }
        }
        g_free(before);
        before = g_steal_pointer(&drawn);
    }
    *ret = (struct mips_quality){sqrt(off / all), sqrt(change / of_change)};
    return TRUE;
}

static gboolean mips_flicker(struct lpca *const *levels, int n, int way, int n_grid,
                             struct mips_quality ret[2], GError **error) {
    g_autoptr(Viewer) viewer = viewer_new(NULL, error);
    struct mesh *plane = scene_plane();
    float *truth[STEPS] = {NULL};
    gboolean good = viewer && viewer_set_mesh(viewer, plane, error) &&
                    mips_open(viewer, levels, 1, way, n_grid, error);
    for (int step = 0; good && step < STEPS; step++)
        good = (truth[step] = mips_reference(viewer, step, error)) != NULL;
    good = good && mips_judge(viewer, truth, &ret[0], error) &&
           mips_open(viewer, levels, n, way, n_grid, error) &&
           mips_judge(viewer, truth, &ret[1], error);
    for (int step = 0; step < STEPS; step++)
        g_free(truth[step]);
    mesh_free(plane);
    return good;
}

gboolean lpca_rendering_mips(const char *path, int n_grid, int frames, GError **error) {
    static const char *const keys[WAYS] = {"pairs", "revised", "grid"};
    struct lpca *levels[LPCA_MAX_LEVELS];
    const int n = lpca_read_levels(path, levels, error);
    struct mesh *torus = scene_torus(1.0, 0.4, 192, 96);
    Viewer *viewers[2 * WAYS] = {NULL};
    struct viewer_settings settings[2 * WAYS];
    double ms[2 * WAYS];
    gboolean good = n > 0;
    for (int k = 0; good && k < 2 * WAYS; k++) {
        settings[k] = viewer_settings_default;
        settings[k].ambient = 0;
        settings[k].tiles_u = 2 * TILES;
        settings[k].tiles_v = TILES;
        good = (viewers[k] = viewer_new(NULL, error)) &&
               viewer_set_mesh(viewers[k], torus, error) &&
               mips_open(viewers[k], levels, k % 2 ? n : 1, k / 2, n_grid, error);
    }
    good = good && time_in_turns(viewers, settings, 2 * WAYS, frames, ms, NULL, error);
    for (int k = 0; k < 2 * WAYS; k++)
        viewer_free(viewers[k]);
    for (int way = 0; good && way < WAYS; way++) {
        struct mips_quality q[2];
        good = mips_flicker(levels, n, way, n_grid, q, error);
        if (!good)
            break;
        bench_begin(NULL);
        bench_put("%s{method} %d{levels}", keys[way], n);
        bench_put_doubles("ms", "%.2f", ms + (gsize)(2 * way), 2); /* without and with levels */
        bench_put_doubles("error", "%.4f", (const double[]){q[0].error, q[1].error}, 2);
        bench_put_doubles("flicker", "%.4f", (const double[]){q[0].flicker, q[1].flicker}, 2);
        bench_end();
    }
    for (int k = 0; k < n; k++)
        lpca_free(levels[k]);
    mesh_free(torus);
    return good;
}
