#include "rectify.h"

#include <math.h>
#include <string.h>

#include "pipeline.h"

#define COLOURS 3

/* Pixels x0 + step·i, y0 + step·j: all of one colour, or for green one half of them. */
struct lattice {
    int x0, y0, step;
};

struct lattices {
    struct lattice of[COLOURS][2];
    int n[COLOURS];
};

struct Rectify {
    int n_texels, n_outside;
    gsize n_pixels;
    guint32 *start; /* n_texels × COLOURS + 1 rows: into the two below */
    GArray *pixel;  /* guint32 */
    GArray *weight; /* float */
};

struct vec3 rectify_point_mm(const struct session_grid *grid, double column, double row) {
    return vec3(grid->width_mm * (column / grid->width - 0.5),
                grid->height_mm * (0.5 - row / grid->height), grid->reference_mm);
}

void rectify_irradiance(const struct rig_lamp *lamp, double arc_rad, double turntable_rad,
                        const struct session_grid *grid, float *ret_irradiance) {
    for (int row = 0; row < grid->height; row++)
        for (int column = 0; column < grid->width; column++) {
            struct vec3 p = rectify_point_mm(grid, column + 0.5, row + 0.5);
            *ret_irradiance++ =
                (float)rig_lamp_irradiance(lamp, arc_rad, rig_turn(p, turntable_rad));
        }
}

static gboolean parse_cfa(const char *cfa, struct lattices *ret, GError **error) {
    static const char *const names[] = {"rggb", "bggr", "grbg", "gbrg", NULL};
    memset(ret, 0, sizeof *ret);
    if (strcmp(cfa, "mono") == 0) {
        for (int colour = 0; colour < COLOURS; colour++)
            ret->of[colour][ret->n[colour]++] = (struct lattice){0, 0, 1};
        return TRUE;
    }
    if (!g_strv_contains(names, cfa)) {
        g_set_error(error, PIPELINE_ERROR, PIPELINE_ERROR_DATA,
                    "colour filter \"%s\" is not known; there are mono, rggb, bggr, grbg, gbrg",
                    cfa);
        return FALSE;
    }
    for (int k = 0; k < 4; k++) {
        int colour = cfa[k] == 'r' ? 0 : cfa[k] == 'g' ? 1 : 2;
        ret->of[colour][ret->n[colour]++] = (struct lattice){k & 1, k >> 1, 2};
    }
    return TRUE;
}

/* One texel's points in the picture: an even pattern over its area. */
struct footprint {
    double *x, *y;
    int n;
};

static gboolean project_texel(const struct rig_camera *camera, double turntable_rad,
                              const struct session_grid *grid, int column, int row, int side,
                              struct footprint *ret) {
    ret->n = 0;
    for (int j = 0; j < side; j++)
        for (int i = 0; i < side; i++) {
            struct vec3 p =
                rectify_point_mm(grid, column + (i + 0.5) / side, row + (j + 0.5) / side);
            double *x = &ret->x[ret->n], *y = &ret->y[ret->n++];
            if (!rig_project(camera, rig_turn(p, turntable_rad), x, y) || !(*x >= 1) ||
                !(*y >= 1) || *x > camera->width - 2 || *y > camera->height - 2)
                return FALSE;
        }
    return TRUE;
}

static void spread(const struct lattice *lattice, double x, double y, double weight, int width,
                   float *sums, GArray *touched) {
    double u = (x - lattice->x0) / lattice->step, v = (y - lattice->y0) / lattice->step;
    int i = (int)floor(u), j = (int)floor(v);
    u -= i, v -= j;
    const double parts[4] = {(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v};
    for (int k = 0; k < 4; k++) {
        if (parts[k] <= 0)
            continue;
        guint32 pixel = (guint32)((lattice->y0 + (j + (k >> 1)) * lattice->step) * width +
                                  lattice->x0 + (i + (k & 1)) * lattice->step);
        if (sums[pixel] == 0)
            g_array_append_val(touched, pixel);
        sums[pixel] += (float)(weight * parts[k]);
    }
}

static void add_row(Rectify *rectify, const struct footprint *footprint,
                    const struct lattices *lattices, int colour, int width, const float *gain,
                    float *sums) {
    g_autoptr(GArray) touched = g_array_new(FALSE, FALSE, sizeof(guint32));
    for (int l = 0; l < lattices->n[colour]; l++)
        for (int i = 0; i < footprint->n; i++)
            spread(&lattices->of[colour][l], footprint->x[i], footprint->y[i],
                   1.0 / (footprint->n * lattices->n[colour]), width, sums, touched);
    for (guint i = 0; i < touched->len; i++) {
        guint32 pixel = g_array_index(touched, guint32, i);
        float weight = sums[pixel] * gain[pixel];
        g_array_append_val(rectify->pixel, pixel);
        g_array_append_val(rectify->weight, weight);
        sums[pixel] = 0;
    }
}

/* What a pixel's value is multiplied with to be a radiance: DN a millisecond → DN a second, then
 * response and vignetting. */
static float *pixel_gains(const struct rig_camera *camera) {
    float *gain = g_new(float, (gsize)camera->width * camera->height);
    double w = camera->width - 1, h = camera->height - 1, corner2 = 0.25 * (w * w + h * h);
    for (int y = 0; y < camera->height; y++)
        for (int x = 0; x < camera->width; x++) {
            double dx = x - camera->cx_px, dy = y - camera->cy_px;
            double light = 1 - camera->vignetting * (dx * dx + dy * dy) / corner2;
            gain[y * camera->width + x] = (float)(1000 / (camera->response * MAX(light, 0.05)));
        }
    return gain;
}

/* Points a texel and direction, so that they lie at most half a pixel apart. */
static int points_aside(const struct rig_camera *camera, double turntable_rad,
                        const struct session_grid *grid) {
    double most = 0;
    for (int k = 0; k < 4; k++) { /* distances grow and shrink smoothly: the corners tell */
        double column = k & 1 ? grid->width - 1 : 0, row = k >> 1 ? grid->height - 1 : 0;
        double x[3], y[3];
        for (int c = 0; c < 3; c++) {
            struct vec3 p = rectify_point_mm(grid, column + (c == 1), row + (c == 2));
            if (!rig_project(camera, rig_turn(p, turntable_rad), &x[c], &y[c]))
                return 4;
        }
        most = MAX(most, MAX(hypot(x[1] - x[0], y[1] - y[0]), hypot(x[2] - x[0], y[2] - y[0])));
    }
    return (int)CLAMP(ceil(most / 0.5), 2, 32);
}

static gboolean check_outside(const Rectify *rectify, const struct rig_camera *camera,
                              double turntable_rad, GError **error) {
    if (rectify->n_outside * 100.0 <= rectify->n_texels)
        return TRUE;
    g_set_error(error, PIPELINE_ERROR, PIPELINE_ERROR_DATA,
                "camera %s at turntable %.6g°: %d of %d texels lie outside of its %d × %d pixels; "
                "point it at the sample and calibrate it, or make [sample] smaller in the session",
                camera->name, turntable_rad * 180 / G_PI, rectify->n_outside, rectify->n_texels,
                camera->width, camera->height);
    return FALSE;
}

Rectify *rectify_new(const struct rig_camera *camera, const char *cfa, double turntable_rad,
                     const struct session_grid *grid, GError **error) {
    struct lattices lattices;
    if (!parse_cfa(cfa, &lattices, error)) {
        g_prefix_error(error, "camera %s: ", camera->name);
        return NULL;
    }
    g_autoptr(Rectify) rectify = g_new0(Rectify, 1);
    rectify->n_texels = grid->width * grid->height;
    rectify->n_pixels = (gsize)camera->width * camera->height;
    rectify->start = g_new0(guint32, (gsize)rectify->n_texels * COLOURS + 1);
    rectify->pixel = g_array_new(FALSE, FALSE, sizeof(guint32));
    rectify->weight = g_array_new(FALSE, FALSE, sizeof(float));
    g_autofree float *gain = pixel_gains(camera), *sums = g_new0(float, rectify->n_pixels);
    int side = points_aside(camera, turntable_rad, grid);
    g_autofree double *x = g_new(double, side *side), *y = g_new(double, side *side);
    struct footprint footprint = {x, y, 0};
    guint32 *start = rectify->start;
    for (int row = 0; row < grid->height; row++)
        for (int column = 0; column < grid->width; column++) {
            gboolean inside =
                project_texel(camera, turntable_rad, grid, column, row, side, &footprint);
            rectify->n_outside += !inside;
            for (int colour = 0; colour < COLOURS; colour++) {
                if (inside)
                    add_row(rectify, &footprint, &lattices, colour, camera->width, gain, sums);
                *++start = rectify->pixel->len;
            }
        }
    if (!check_outside(rectify, camera, turntable_rad, error))
        return NULL;
    return g_steal_pointer(&rectify);
}

void rectify_free(Rectify *rectify) {
    if (!rectify)
        return;
    g_free(rectify->start);
    g_clear_pointer(&rectify->pixel, g_array_unref);
    g_clear_pointer(&rectify->weight, g_array_unref);
    g_free(rectify);
}

int rectify_outside(const Rectify *rectify) {
    return rectify->n_outside;
}

int rectify_apply(const Rectify *rectify, const float *mosaic, float *ret_rgb) {
    const guint32 *pixel = (const guint32 *)(void *)rectify->pixel->data;
    const float *weight = (const float *)(void *)rectify->weight->data;
    int holes = 0;
    for (int texel = 0; texel < rectify->n_texels; texel++, ret_rgb += COLOURS) {
        const guint32 *start = rectify->start + (gsize)texel * COLOURS;
        gboolean hole = start[0] == start[COLOURS];
        for (int colour = 0; colour < COLOURS; colour++) {
            float sum = 0;
            for (guint32 k = start[colour]; k < start[colour + 1]; k++)
                sum += weight[k] * mosaic[pixel[k]];
            ret_rgb[colour] = sum;
            hole |= !isfinite(sum);
        }
        if (hole) {
            memset(ret_rgb, 0, COLOURS * sizeof *ret_rgb);
            holes++;
        }
    }
    return holes;
}
