/* Veiling glare is light that lens and sensor scatter over the whole picture. The glare is g times
 * the mean of the picture without glare. M is the mean of the picture with glare. A cell c of a
 * camera's picture that shows a dark surface has, in a shot s under lamp l, the signal
 *   d_s = γ M_s + ρ_(c,l) e_s,   γ = g / (1 + g),
 * where ρ is the reflectance of the surface and e_s is the signal of a white surface in its place.
 * The lamp moves about the turntable and so changes its distance from the cell. M_s and e_s are
 * therefore not proportional to each other.
 *
 * A group is a cell, a lamp and a colour. In each group, the part of M that is proportional to e is
 * subtracted, and γ is found from all groups:
 *   m_s = M_s − e_s Σ w e M / Σ w e²,   γ = Σ w m d / Σ w m²,   w = 1/σ² of the cell.
 * Each group has a separate ρ, because a surface may reflect more light of one lamp than of
 * another. */
#include "radiometry.h"

#include "geometry/fit.h"

#include <stdlib.h>
#include <string.h>

#define CELLS      12 /* as in radiometry.c */
#define CELL_PX    16
#define FEW_PIXELS 16
/* A border of this width plus twice the height of the tile is left out around the tile, because the
 * tile casts shadows and reflects light there. */
#define BORDER_MM 4
#define MAX_ROWS  256
/* A surface is dark if its signal is less than this part of the mean of the picture. */
#define DARK 0.25
/* largest factor between d / M of a shot and the median of d / M in its group */
#define ALIKE     2.0
#define FEW_SHOTS 4     /* smallest number of shots of a group */
#define OUTLIER   4.0   /* number of standard deviations from which a cell is an outlier */
#define MAX_ERROR 0.002 /* largest standard error of a glare that is corrected */
/* If the standard error of a glare is too large for a correction, ret_error includes the glare,
 * provided that the glare exceeds this number of standard errors. */
#define PLAIN 3.0

/* Sums over the pixels of one colour in a cell, as in radiometry.c. */
struct glare_sums {
    double n, signal, white, squares, triples;
    float last[2];
    int last_x, last_y, run;
};

/* Returns the signal of a white surface at the point p, which the pixel x, y sees, in DN per
 * second. */
static double glare_white(const struct rig *rig, const struct radiometry_camera *radiometry,
                          const struct radiometry_lamp *lamp, const struct tile_shot *shot,
                          const struct rig_camera *camera, int x, int y, int colour,
                          struct vec3 p) {
    const struct rig_lamp *l = &rig->lamps[shot->lamp];
    const struct vec3 path = vec3_sub(rig_lamp_position_mm(&rig->arc, l, shot->arc_rad), p);
    return camera->response * radiometry->colour[colour] *
           radiometry_flat(camera, radiometry, x, y) / G_PI * MAX(path.z / vec3_length(path), 0) *
           lamp->colour[colour] * rig_lamp_irradiance(&rig->arc, l, shot->arc_rad, p);
}

int glare_measure(const struct rig *rig, int camera, const struct radiometry_camera *radiometry,
                  const struct radiometry_lamp *lamps, const char *cfa, const float *mosaic,
                  const struct tile *tile, const struct tile_shot *shots, int shot, double output,
                  GArray *cells) {
    const struct rig_camera *c = &rig->cameras[camera];
    const struct tile_shot *at = &shots[shot];
    const struct vec3 eye = rig_camera_centre_mm(c);
    const int aside = CLAMP(MIN(c->width, c->height) / CELL_PX, 1, CELLS);
    const double border_mm = BORDER_MM + 2 * tile->top_mm;
    g_autofree struct glare_sums *sums = g_new0(struct glare_sums, CELLS * CELLS * 3);
    double all[3] = {0}, n_all[3] = {0}, variance = 0, mean = 0;
    const int stride = 2 * MAX(c->height / (2 * MAX_ROWS), 1);
    for (int row = 0; row + 1 < c->height; row += stride)
        for (int i = 0; i < 2 * c->width; i++) {
            const int x = i % c->width, y = row + i / c->width;
            const float value = mosaic[(gsize)y * (gsize)c->width + (gsize)x];
            const int colour = radiometry_colour_at(cfa, x, y);
            if (!isfinite(value))
                continue;
            all[colour] += (double)value;
            n_all[colour]++;
            const struct vec3 ray = rig_pixel_ray(c, x, y);
            double white = 0; /* stays 0 if the ray does not meet the turntable's plane */
            if (ray.z < 0) {
                const struct vec3 p = vec3_add(eye, vec3_scale(ray, -eye.z / ray.z));
                const struct vec3 own = rig_turn(p, -at->turntable_rad);
                if (fabs(own.x) < tile->width_mm / 2 + border_mm &&
                    fabs(own.y) < tile->height_mm / 2 + border_mm)
                    continue;
                white =
                    output * glare_white(rig, radiometry, &lamps[at->lamp], at, c, x, y, colour, p);
            }
            struct glare_sums *s =
                &sums[3 * (y * aside / c->height * CELLS + x * aside / c->width) + colour];
            s->run = s->last_y == y && x - s->last_x <= 2 ? s->run + 1 : 1;
            if (s->run > 2) { /* as in radiometry.c */
                const double off = value - 2.0 * s->last[0] + s->last[1];
                s->squares += off * off / 6;
                s->triples++;
            }
            s->last[1] = s->last[0];
            s->last[0] = value;
            s->last_x = x;
            s->last_y = y;
            s->n++;
            s->signal += (double)value;
            s->white += white;
        }
    const guint before = cells->len;
    for (int i = 0; i < CELLS * CELLS * 3; i++) {
        variance += sums[i].squares;
        mean += sums[i].triples;
    }
    const double noise = mean > 0 ? variance / mean : 0; /* mean variance of a pixel */
    for (int i = 0; i < CELLS * CELLS * 3 && noise > 0; i++) {
        const struct glare_sums *s = &sums[i];
        if (s->n < FEW_PIXELS || n_all[i % 3] == 0)
            continue;
        const struct glare_cell cell = {.shot = shot,
                                        .camera = camera,
                                        .colour = i % 3,
                                        .cell = i / 3,
                                        .signal = 1000 * s->signal / s->n,
                                        .error = 1000 * sqrt(noise / s->n),
                                        .mean = 1000 * all[i % 3] / n_all[i % 3],
                                        .white = s->white / s->n};
        g_array_append_val(cells, cell);
    }
    return (int)(cells->len - before);
}

struct glare_sort {
    int camera;
    const struct tile_shot *shots;
};

static int compare(gconstpointer a, gconstpointer b, gpointer data) {
    const struct glare_cell *x = a, *y = b;
    const struct glare_sort *by = data;
    const int lamps = by->shots[x->shot].lamp - by->shots[y->shot].lamp;
    if ((x->camera == by->camera) != (y->camera == by->camera))
        return x->camera == by->camera ? -1 : 1;
    return x->cell != y->cell       ? x->cell - y->cell
           : lamps != 0             ? lamps
           : x->colour != y->colour ? x->colour - y->colour
                                    : x->shot - y->shot;
}

/* Sums of one pass over the groups, for all lamps together and for each lamp. γ is `up` /
 * `down`. */
struct glare_pass {
    double up, down, chi2;
    int n, groups;
    double darkest; /* smallest median of d / M in a group; γ cannot be larger */
    double lamp_up[RIG_MAX_LAMPS], lamp_down[RIG_MAX_LAMPS];
};

/* Adds a group of n cells. g is the result γ of the previous pass, or negative in the first pass.
 * In later passes, a cell is left out if it deviates from the model with γ = g by more than OUTLIER
 * · scale standard deviations. A group adds nothing if it is not dark, or if fewer than FEW_SHOTS
 * cells are left. */
static void add_group(const struct glare_cell *cells, int n, int lamp, double g, double scale,
                      struct glare_pass *to) {
    g_autofree double *share = g_new(double, n), *sorted = g_new(double, n);
    g_autofree gboolean *good = g_new(gboolean, n);
    double em = 0, ee = 0, ed = 0;
    int kept = 0;
    for (int i = 0; i < n; i++)
        sorted[i] = share[i] = cells[i].signal / cells[i].mean;
    qsort(sorted, (gsize)n, sizeof *sorted, fit_compare);
    const double median = sorted[n / 2];
    if (n < FEW_SHOTS || !(median > 0) || median > DARK)
        return;
    for (int round = 0; round < 2; round++) { /* the second round leaves outliers out */
        const double rho = round > 0 && ee > 0 ? (ed - g * em) / ee : 0;
        for (int i = 0; i < n; i++) {
            const double off = cells[i].signal - g * cells[i].mean - rho * cells[i].white;
            good[i] = share[i] < ALIKE * median && share[i] > median / ALIKE &&
                      (round == 0 || g < 0 || fabs(off) < OUTLIER * scale * cells[i].error);
        }
        em = ee = ed = kept = 0;
        for (int i = 0; i < n; i++) {
            const double w = good[i] ? 1 / (cells[i].error * cells[i].error) : 0;
            em += w * cells[i].white * cells[i].mean;
            ee += w * cells[i].white * cells[i].white;
            ed += w * cells[i].white * cells[i].signal;
            kept += good[i];
        }
    }
    if (kept < FEW_SHOTS)
        return;
    const double by = ee > 0 ? em / ee : 0, rho = ee > 0 ? (ed - MAX(g, 0) * em) / ee : 0;
    for (int i = 0; i < n; i++) {
        if (!good[i])
            continue;
        const double w = 1 / (cells[i].error * cells[i].error);
        const double m = cells[i].mean - by * cells[i].white;
        const double off = cells[i].signal - MAX(g, 0) * cells[i].mean - rho * cells[i].white;
        to->up += w * m * cells[i].signal;
        to->down += w * m * m;
        to->lamp_up[lamp] += w * m * cells[i].signal;
        to->lamp_down[lamp] += w * m * m;
        to->chi2 += w * off * off;
        to->n++;
    }
    to->groups++;
    to->darkest = MIN(to->darkest, median);
}

static void glare_run(const struct glare_cell *cells, int n, const struct tile_shot *shots,
                      double g, double scale, struct glare_pass *ret) {
    *ret = (struct glare_pass){.darkest = HUGE_VAL};
    for (int first = 0, i = 1; i <= n; i++) {
        const struct glare_cell *a = &cells[first], *b = &cells[i];
        if (i < n && a->cell == b->cell && a->colour == b->colour &&
            shots[a->shot].lamp == shots[b->shot].lamp)
            continue;
        add_group(a, i - first, shots[a->shot].lamp, g, scale, ret);
        first = i;
    }
}

gboolean glare_fit(struct glare_cell *cells, int n, int camera, const struct tile_shot *shots,
                   double *ret_glare, double *ret_error) {
    const struct glare_sort by = {camera, shots};
    struct glare_pass pass;
    double g = -1, scale = 1, scatter = 0;
    int own = 0, lamps = 0;
    *ret_glare = *ret_error = 0;
    g_qsort_with_data(cells, n, sizeof *cells, compare, (gpointer)&by);
    while (own < n && cells[own].camera == camera)
        own++;
    for (int round = 0; round < 4; round++) {
        glare_run(cells, own, shots, g, scale, &pass);
        if (!(pass.down > 0))
            return FALSE;
        g = MAX(pass.up / pass.down, 0);
        if (round > 0)
            scale = sqrt(MAX(pass.chi2 / MAX(pass.n - pass.groups - 1, 1), 1));
        else
            scale = HUGE_VAL;
    }
    /* The glare is also found for each lamp alone, because effects that the model lacks, such as
     * gloss of the surround, differ from lamp to lamp. */
    for (int l = 0; l < RIG_MAX_LAMPS; l++)
        if (pass.lamp_down[l] > 0) {
            scatter += pass.lamp_down[l] * pow(pass.lamp_up[l] / pass.lamp_down[l] - g, 2);
            lamps++;
        }
    double error = scale / sqrt(pass.down);
    if (lamps > 1)
        error = MAX(error, sqrt(scatter / (lamps - 1) / pass.down));
    if (!(g < pass.darkest + 3 * error))
        return FALSE;
    const gboolean known = error < MAX_ERROR;
    const double glare = g / (1 - g); /* The variable g is γ, because M includes the glare. */
    if (known)
        *ret_glare = glare;
    if (known || g > PLAIN * error)
        *ret_error = known ? error : hypot(glare, error);
    return known;
}

void radiometry_glare(const struct radiometry_camera *radiometry, const char *cfa, int width,
                      int height, const float *mosaic, double ret_mean[3], float ret_glare[3]) {
    const gsize n = (gsize)width * (gsize)height;
    double counts[3] = {0};
    memset(ret_mean, 0, 3 * sizeof *ret_mean);
    for (gsize i = 0; i < n; i++) {
        const int colour =
            radiometry_colour_at(cfa, (int)(i % (gsize)width), (int)(i / (gsize)width));
        if (!isfinite(mosaic[i]))
            continue;
        ret_mean[colour] += (double)mosaic[i];
        counts[colour]++;
    }
    for (int k = 0; k < 3; k++) {
        ret_mean[k] = counts[k] > 0 ? ret_mean[k] / counts[k] : 0;
        ret_glare[k] = (float)(radiometry->glare / (1 + radiometry->glare) * ret_mean[k]);
    }
}
