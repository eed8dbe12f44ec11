/*
 * Pictures of the whole sample, drawn from the truth, from all measured values, and from the
 * predictions of one way, with the interpolation between directions that drawing uses
 * (directions.h). Each texel is one pixel. The twelve pairs of directions were not measured.
 */
#include "prediction_parts.h"

#include <math.h>
#include <string.h>

#include "base/png_bytes.h"
#include "base/work.h"
#include "bench.h"
#include "btf/btf_matrix.h"
#include "directions/directions.h"
#include "metrics/delta_e.h"

#define PICTURES 12
#define GOLDEN   137.508 /* degrees: azimuths that are spread over the circle */

enum { TRUE_ONE, FULL, MADE, DRAWN };

struct taps {
    int n, *at;
    double *weight;
};

struct drawing {
    const struct prediction_scene *scene;
    PredictionMake make;
    gpointer data;
    struct taps pictures[PICTURES];
    double *delta_e; /* n_texels × DRAWN: sums over the pictures */
    float *rgb;      /* n_texels × PICTURES × DRAWN × 3 */
};

/* Polar angles 12.5° … 67.5° in steps of 5°, those of the lights in another order. */
static struct vec3 pictures_direction(int k, gboolean light) {
    const double theta = (12.5 + 5 * (light ? (5 * k + 2) % PICTURES : k)) * G_PI / 180;
    const double phi = (light ? 77 - GOLDEN * k : GOLDEN * k) * G_PI / 180;
    return vec3(sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta));
}

/* The weight of each of n measured directions, and what reflectance fades by. */
static double *pictures_weights(const struct direction_list *of, struct vec3 direction, int n,
                                gboolean light) {
    g_autoptr(GError) error = NULL;
    struct direction_weights weights;
    g_autoptr(Directions) directions = directions_new(of->theta_deg, of->phi_deg, n, &error);
    bench_check(error);
    double *ret = g_new0(double, n);
    int n_pole;
    const int *pole = directions_pole(directions, &n_pole);
    const double fade = directions_fade_weights(directions, direction, &weights);
    for (int i = 0; i < 4; i++)
        if (weights.weight[i] > 0 && weights.index[i] < n)
            ret[weights.index[i]] += (double)weights.weight[i];
        else if (weights.weight[i] > 0)
            for (int k = 0; k < n_pole; k++)
                ret[pole[k]] += (double)weights.weight[i] / n_pole;
    for (int i = 0; i < n && light; i++)
        ret[i] *= fade;
    return ret;
}

static void pictures_taps(const struct prediction_scene *scene, int k, struct taps *ret) {
    const struct btf_layout *layout = &scene->btf->layout;
    g_autofree double *views =
        pictures_weights(&layout->views, pictures_direction(k, FALSE), scene->n_views, FALSE);
    g_autofree double *lights =
        pictures_weights(&layout->lights, pictures_direction(k, TRUE), scene->n_lights, TRUE);
    ret->at = g_new(int, scene->n_pairs);
    ret->weight = g_new(double, scene->n_pairs);
    for (int v = 0; v < scene->n_views; v++)
        for (int l = 0; l < scene->n_lights; l++)
            if (views[v] * lights[l] > 0) {
                ret->at[ret->n] = v * scene->n_lights + l;
                ret->weight[ret->n++] = views[v] * lights[l];
            }
}

/* step and across: from a pair, and from a colour, to the next. */
static void pictures_pixel(const struct taps *taps, const float *values, gsize step, gsize across,
                           float *ret) {
    for (gsize c = 0; c < 3; c++) {
        double sum = 0;
        for (int i = 0; i < taps->n; i++)
            sum += taps->weight[i] * (double)values[(gsize)taps->at[i] * step + c * across];
        ret[c] = (float)sum;
    }
}

static void pictures_texel(int texel, gpointer data) {
    struct drawing *drawing = data;
    const struct prediction_scene *scene = drawing->scene;
    const gsize n = (gsize)scene->n_pairs, first = 3 * (gsize)texel * n;
    g_autofree float *made = g_new(float, 3 * n);
    drawing->make(texel, made, drawing->data);
    for (int k = 0; k < PICTURES; k++) {
        float *rgb = drawing->rgb + ((gsize)texel * PICTURES + (gsize)k) * DRAWN * 3;
        double lab[DRAWN][3];
        pictures_pixel(&drawing->pictures[k], scene->truth + first, 3, 1, rgb);
        pictures_pixel(&drawing->pictures[k], scene->btf->values + first, 3, 1, rgb + 3 * FULL);
        pictures_pixel(&drawing->pictures[k], made, 1, n, rgb + 3 * MADE);
        for (int i = 0; i < DRAWN; i++) {
            delta_e_lab(rgb + 3 * i, lab[i]);
            drawing->delta_e[texel * DRAWN + i] += delta_e_2000(lab[TRUE_ONE], lab[i]);
        }
    }
}

static guint8 pictures_byte(float linear) {
    const double x = fmin(fmax((double)linear, 0), 1);
    return (guint8)lround(255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1 / 2.4) - 0.055));
}

/* A column a picture; the truth on top, then all that was measured, then what was made up. */
static void pictures_write(const struct drawing *drawing, const char *path) {
    g_autoptr(GError) error = NULL;
    const int scale = 3, w = (int)drawing->scene->btf->layout.width;
    const int h = (int)drawing->scene->btf->layout.height;
    const int across = PICTURES * (w * scale + 2), down = DRAWN * (h * scale + 2);
    g_autofree guint8 *rgb = g_malloc0(3 * (gsize)across * (gsize)down);
    for (int k = 0; k < PICTURES; k++)
        for (int i = 0; i < DRAWN; i++)
            for (int y = 0; y < h * scale; y++)
                for (int x = 0; x < w * scale; x++) {
                    const gsize texel = (gsize)(y / scale) * (gsize)w + (gsize)(x / scale);
                    const float *from =
                        drawing->rgb + ((texel * PICTURES + (gsize)k) * DRAWN + (gsize)i) * 3;
                    guint8 *to = rgb + 3 * ((gsize)(i * (h * scale + 2) + y) * (gsize)across +
                                            (gsize)(k * (w * scale + 2) + x));
                    for (int c = 0; c < 3; c++)
                        to[c] = pictures_byte(from[c]);
                }
    g_autoptr(GBytes) png = png_bytes(rgb, across, down, &error);
    bench_check(error);
    g_file_set_contents(path, g_bytes_get_data(png, NULL), (gssize)g_bytes_get_size(png), &error);
    bench_check(error);
}

struct prediction_pictures prediction_pictures_compare(const struct prediction_scene *scene,
                                                       PredictionMake make, gpointer data,
                                                       const char *write) {
    struct drawing drawing = {.scene = scene, .make = make, .data = data};
    struct prediction_pictures ret = {0, 0};
    const gsize n = (gsize)scene->n_texels;
    drawing.delta_e = g_new0(double, n *DRAWN);
    drawing.rgb = g_new(float, n *PICTURES *DRAWN * 3);
    for (int k = 0; k < PICTURES; k++)
        pictures_taps(scene, k, &drawing.pictures[k]);
    work_for_each(0, scene->n_texels, pictures_texel, &drawing);
    for (gsize t = 0; t < n; t++) {
        ret.full += drawing.delta_e[t * DRAWN + FULL] / (double)(n * PICTURES);
        ret.made += drawing.delta_e[t * DRAWN + MADE] / (double)(n * PICTURES);
    }
    if (write)
        pictures_write(&drawing, write);
    for (int k = 0; k < PICTURES; k++) {
        g_free(drawing.pictures[k].at);
        g_free(drawing.pictures[k].weight);
    }
    g_free(drawing.delta_e);
    g_free(drawing.rgb);
    return ret;
}
