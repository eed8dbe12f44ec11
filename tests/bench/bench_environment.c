/*
 * Measures the error of replacing an environment by lamps (median cut, Debevec 2005). For views at
 * even steps of the hemisphere, the reflected light is computed from the lamps and as a sum over
 * all pixels of the map. Both are computed on the CPU in doubles, without shadows. The materials
 * are formulas T (v, l), which include n · l: a white diffuser, and a Ward reflection of three
 * roughnesses over it. A BTF may be given as well, as a session or a compressed file; its texels of
 * the middle row are used.
 */
#include "bench.h"

#include "base/direction.h"
#include "base/vec.h"
#include "scene/environment.h"

#include <math.h>
#include <mesorig/material.h>

#define VIEWS  240 /* directions from which each is seen */
#define FRAMES 60  /* ways in which the surface lies in the environment */
#define TEXELS 4

static const int lamp_numbers[] = {1, 2, 4, 8, 16, 32, 64};
#define NUMBERS (int)G_N_ELEMENTS(lamp_numbers)

struct bench_surface {
    const char *name;
    double alpha; /* 0: a diffuser */
    mesorig_material *material;
};

/* From the surface's frame to the world. */
struct bench_frame {
    struct vec3 x, y, z;
};

static struct vec3 of_angles(double theta_deg, double phi_deg) {
    float d[3];
    direction_from_deg(theta_deg, phi_deg, d);
    return vec3((double)d[0], (double)d[1], (double)d[2]);
}

static struct bench_frame frame_of(int k) {
    struct bench_frame ret;
    ret.z = of_angles(90.0 * (k % 4) / 3.0, 137.5 * k);
    ret.x = vec3_unit(vec3_cross(ret.z, fabs(ret.z.x) < 0.7 ? vec3(1, 0, 0) : vec3(0, 1, 0)));
    ret.y = vec3_cross(ret.z, ret.x);
    return ret;
}

static struct vec3 to_local(const struct bench_frame *f, struct vec3 d) {
    return vec3(vec3_dot(f->x, d), vec3_dot(f->y, d), vec3_dot(f->z, d));
}

/* Values in RGB; 0 below the horizon. */
static void surface_value(const struct bench_surface *s, int texel, struct vec3 v, struct vec3 l,
                          double ret[3]) {
    ret[0] = ret[1] = ret[2] = 0.0;
    if (l.z <= 0.0)
        return;
    if (s->material != NULL) {
        const float uv[] = {(float)((texel + 0.5) / TEXELS), 0.5F};
        const float view[] = {(float)v.x, (float)v.y, (float)v.z};
        const float light[] = {(float)l.x, (float)l.y, (float)l.z};
        float rgb[3];
        mesorig_material_evaluate(s->material, 1, uv, view, light, NULL, rgb);
        for (int c = 0; c < 3; c++)
            ret[c] = (double)rgb[c];
        return;
    }
    double value = l.z;
    if (s->alpha > 0.0) { /* Ward 1992: 0.5 diffuse, 0.3 specular, times π */
        const struct vec3 h = vec3_unit(vec3_add(v, l));
        const double tan2 = (1.0 - h.z * h.z) / (h.z * h.z), a2 = s->alpha * s->alpha;
        value = 0.5 * l.z + 0.3 * exp(-tan2 / a2) / (4.0 * a2) * sqrt(l.z / fmax(v.z, 0.05));
    }
    ret[0] = ret[1] = ret[2] = value;
}

/* Radiance towards v: ∫ L T dω / π over the map's pixels. */
static void shade_by_map(const struct bench_surface *s, const struct environment *e, int texel,
                         const struct bench_frame *f, struct vec3 v, double ret[3]) {
    ret[0] = ret[1] = ret[2] = 0.0;
    for (int y = 0; y < e->height; y++) {
        const double angle =
            2.0 * G_PI / e->width * (cos(G_PI * y / e->height) - cos(G_PI * (y + 1) / e->height));
        for (int x = 0; x < e->width; x++) {
            const struct vec3 l =
                of_angles(180.0 * (y + 0.5) / e->height, 180.0 - 360.0 * (x + 0.5) / e->width);
            const float *rgb = e->rgb + 3 * ((gsize)y * (gsize)e->width + (gsize)x);
            double value[3];
            surface_value(s, texel, v, to_local(f, l), value);
            for (int c = 0; c < 3; c++)
                ret[c] += (double)rgb[c] * value[c] * angle / G_PI;
        }
    }
}

static void shade_by_lamps(const struct bench_surface *s, const struct viewer_lamp *lamps, int n,
                           int texel, const struct bench_frame *f, struct vec3 v, double ret[3]) {
    ret[0] = ret[1] = ret[2] = 0.0;
    for (int k = 0; k < n; k++) {
        double value[3];
        const struct vec3 l = of_angles(lamps[k].theta_deg, lamps[k].phi_deg);
        surface_value(s, texel, v, to_local(f, l), value);
        for (int c = 0; c < 3; c++)
            ret[c] += (double)lamps[k].rgb[c] * value[c];
    }
}

/* Averages blocks of pixels, so that summation takes seconds; the mean radiance stays nearly. */
static struct environment *make_smaller(const struct environment *e, int by) {
    struct environment *ret = g_new(struct environment, 1);
    *ret = (struct environment){e->width / by, e->height / by, NULL};
    ret->rgb = g_new0(float, 3 * (gsize)ret->width * (gsize)ret->height);
    for (int y = 0; y < ret->height * by; y++)
        for (int x = 0; x < ret->width * by; x++)
            for (int c = 0; c < 3; c++)
                ret->rgb[3 * ((gsize)(y / by) * (gsize)ret->width + (gsize)(x / by)) + (gsize)c] +=
                    e->rgb[3 * ((gsize)y * (gsize)e->width + (gsize)x) + (gsize)c] /
                    (float)(by * by);
    return ret;
}

/* ret: ‖lamps − map‖ / ‖map‖ by number of lamps. */
static void judge(const struct bench_surface *s, const struct environment *e, double ret[NUMBERS]) {
    struct viewer_lamp lamps[NUMBERS][VIEWER_MAX_LAMPS];
    int n[NUMBERS];
    double squares = 0.0, off[NUMBERS] = {0.0};
    for (int k = 0; k < NUMBERS; k++)
        n[k] = environment_lamps(e->rgb, e->width, e->height, lamp_numbers[k], lamps[k]);
    for (int view = 0; view < VIEWS; view++) {
        const struct bench_frame frame = frame_of(view % FRAMES);
        const int texel = view % TEXELS;
        const struct vec3 v =
            of_angles(acos(1.0 - 0.85 * (view + 0.5) / VIEWS) * 180.0 / G_PI, 137.5 * view);
        double truth[3], found[3];
        shade_by_map(s, e, texel, &frame, v, truth);
        for (int c = 0; c < 3; c++)
            squares += truth[c] * truth[c];
        for (int k = 0; k < NUMBERS; k++) {
            shade_by_lamps(s, lamps[k], n[k], texel, &frame, v, found);
            for (int c = 0; c < 3; c++)
                off[k] += (found[c] - truth[c]) * (found[c] - truth[c]);
        }
    }
    for (int k = 0; k < NUMBERS; k++)
        ret[k] = sqrt(off[k] / squares);
}

int main(int argc, char **argv) {
    int smaller = 4;
    const GOptionEntry entries[] = {
        {"smaller", 0, 0, G_OPTION_ARG_INT, &smaller,
         "Average maps over so many pixels each way first, default 4", "N"},
        {NULL},
    };
    bench_parse(&argc, &argv, entries, "[MATERIAL [ENVIRONMENT.exr]]");
    if (smaller < 1 || smaller > 64)
        bench_fail(2, "--smaller is 1 … 64");
    struct bench_surface surfaces[] = {
        {"diffuse", 0.0, NULL},  {"ward 0.5", 0.5, NULL}, {"ward 0.2", 0.2, NULL},
        {"ward 0.1", 0.1, NULL}, {"material", 0.0, NULL},
    };
    int n_surfaces = (int)G_N_ELEMENTS(surfaces) - 1;
    if (argc > 1) {
        struct mesorig_error why;
        surfaces[n_surfaces].material = mesorig_material_open(argv[1], NULL, &why);
        if (surfaces[n_surfaces++].material == NULL)
            bench_fail(1, "%s", why.text);
    }
    bench_begin(NULL);
    for (int e = 0; e < 3; e++) {
        const char *name = e < 2 ? environment_names[e] : argc > 2 ? argv[2] : NULL;
        g_autoptr(GError) error = NULL;
        if (name == NULL)
            continue;
        struct environment *whole = environment_open(name, &error);
        bench_check(error);
        struct environment *map = make_smaller(whole, smaller);
        bench_begin(name);
        for (int s = 0; s < n_surfaces; s++) {
            double found[NUMBERS];
            judge(&surfaces[s], map, found);
            bench_begin(surfaces[s].name);
            for (int k = 0; k < NUMBERS; k++) {
                g_autofree char *lamps = g_strdup_printf("%d", lamp_numbers[k]);
                bench_put_double(lamps, "", "%.5f", found[k]);
            }
            bench_end();
        }
        bench_end();
        environment_free(whole);
        environment_free(map);
    }
    bench_end();
    mesorig_material_close(surfaces[G_N_ELEMENTS(surfaces) - 1].material);
    return 0;
}
