#include "calibration_parts.h"

#include "bench.h"
#include "lib/lasers_scene.h"

#include <stdio.h>

#define CAMERA_PX 0.01 /* across and down, standard deviations; bench_cameras finds 0.003 */

enum { POLES, BALLS, LASER, KINDS };
static const char *const names[KINDS] = {"poles", "balls", "laser"};

struct figures {
    double direction_deg, distance_pct, zero_deg, axis_deg, chi2; /* lamps */
    double sheet_deg, sheet_mm, source_mm;                        /* laser */
    double cpu_s;                                                 /* rendering too */
    int n;                                                        /* sights or points */
};

static gboolean run_lamps(int kind, int seed, struct figures *ret) {
    struct scene *scene =
        scene_of(kind == POLES ? LAMP_POLES : LAMP_BALLS, (guint32)seed, 320, CAMERA_PX);
    const struct scene_poses poses = {6, kind == POLES ? 1 : 2};
    g_autoptr(GPtrArray) rejected = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GError) error = NULL;
    struct lamps_result found;
    struct scene_errors errors;
    gboolean ok = kind == POLES ? scene_measure_poles(scene, &poses, &found, rejected, &error)
                                : scene_measure_balls(scene, &poses, 150, &found, rejected, &error);
    if (!ok) {
        fprintf(stderr, "%s, seed %d: refused: %s\n", names[kind], seed, error->message);
    } else {
        scene_compare(scene, &found, &errors);
        *ret = (struct figures){.direction_deg = errors.direction_deg,
                                .distance_pct = 100 * errors.distance,
                                .zero_deg = errors.zero_deg,
                                .axis_deg = errors.axis_deg,
                                .chi2 = errors.chi2,
                                .n = found.n_used};
        lamps_result_clear(&found);
    }
    scene_free(scene);
    return ok;
}

static gboolean run_laser(int seed, struct figures *ret) {
    const struct sweep_poses poses = {
        .arcs = 3, .steps = 80, .span_deg = 3.2, .most = 600, .cameras = SCENE_CAMERAS};
    g_autoptr(GError) error = NULL;
    struct laser_result found;
    struct sweep_errors errors;
    struct scene *scene;
    gboolean ok = sweep_measure((guint32)seed, 192, CAMERA_PX, &poses, 2, &found, &scene, &error);
    if (!ok) {
        fprintf(stderr, "laser, seed %d: refused: %s\n", seed, error->message);
    } else {
        sweep_compare(scene, &poses, &found, &errors);
        *ret = (struct figures){.sheet_deg = errors.angle_deg,
                                .sheet_mm = errors.offset_mm,
                                .source_mm = errors.source_mm,
                                .n = found.n_used};
        laser_result_clear(&found);
    }
    scene_free(scene);
    return ok;
}

static void put_figures(int kind, const struct figures *f) {
    if (kind == LASER)
        bench_put("%.4f{sheet_deg} %.4f{sheet_mm} %.3f{source_mm} %d{points} %.1f{cpu_s}",
                  f->sheet_deg, f->sheet_mm, f->source_mm, f->n, f->cpu_s);
    else
        bench_put("%.4f{direction_deg} %.3f{distance_pct} %.4f{zero_deg} %.4f{axis_deg} %.2f{chi2} "
                  "%d{sights} %.1f{cpu_s}",
                  f->direction_deg, f->distance_pct, f->zero_deg, f->axis_deg, f->chi2, f->n,
                  f->cpu_s);
}

void bench_lights(int n_seeds) {
    for (int kind = 0; kind < KINDS; kind++) {
        struct figures all = {0};
        int refused = 0;
        bench_begin(names[kind]);
        bench_begin_list("each");
        for (int seed = 1; seed <= n_seeds; seed++) {
            struct figures one = {0};
            const double start = bench_cpu_s();
            if (!(kind == LASER ? run_laser(seed, &one) : run_lamps(kind, seed, &one))) {
                refused++;
                continue;
            }
            one.cpu_s = bench_cpu_s() - start;
            bench_begin(NULL);
            bench_put("%d{seed}", seed);
            put_figures(kind, &one);
            bench_end();
            all.direction_deg = MAX(all.direction_deg, one.direction_deg);
            all.distance_pct = MAX(all.distance_pct, one.distance_pct);
            all.zero_deg = MAX(all.zero_deg, one.zero_deg);
            all.axis_deg = MAX(all.axis_deg, one.axis_deg);
            all.chi2 += one.chi2;
            all.sheet_deg = MAX(all.sheet_deg, one.sheet_deg);
            all.sheet_mm = MAX(all.sheet_mm, one.sheet_mm);
            all.source_mm = MAX(all.source_mm, one.source_mm);
            all.cpu_s += one.cpu_s;
            all.n += one.n;
        }
        all.chi2 /= MAX(n_seeds - refused, 1);
        bench_end();
        bench_put("%d{seeds} %d{refused}", n_seeds, refused);
        put_figures(kind, &all);
        bench_end();
    }
    world_fixture_clean();
}
