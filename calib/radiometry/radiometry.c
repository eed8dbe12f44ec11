/* Averages a picture of the white tile over the cells of a grid, separately for each colour. Each
 * cell has its mean signal, the prediction of the nominal rig, and the means of the flat field's
 * basis functions. radiometry_fit.c fits all cells together. */
#include "radiometry.h"

#include <string.h>

G_DEFINE_QUARK(radiometry_error, radiometry_error)

#define CELLS      12 /* largest number of cells along a side of a picture */
#define CELL_PX    16 /* smallest side of a cell in pixels */
#define FEW_PIXELS 16 /* smallest number of pixels of a colour in a usable cell */
/* Border of the tile that is left out, because it may be bevelled or soiled. */
#define BORDER_MM 2
#define MAX_ROWS  256 /* largest number of pairs of rows of the picture that are used */

static double half_diagonal(const struct rig_camera *camera) {
    return 0.5 * hypot(camera->width - 1, camera->height - 1);
}

/* Computes the basis functions of radiometry_camera.flat, ln flat = Σ flat_i · basis_i. With s = x²
 * + y², the functions are s, s², s³, x, y, xy, x² − y², xs and ys. Two further functions are steps:
 * ½ in the right half and −½ in the left half, and ½ in the lower half and −½ in the upper half. */
static void flat_basis(const struct rig_camera *camera, double x_px, double y_px,
                       double ret[RADIOMETRY_FLAT]) {
    double x = (x_px - 0.5 * (camera->width - 1)) / half_diagonal(camera);
    double y = (y_px - 0.5 * (camera->height - 1)) / half_diagonal(camera);
    double s = x * x + y * y;
    const double values[RADIOMETRY_FLAT] = {s,
                                            s * s,
                                            s * s * s,
                                            x,
                                            y,
                                            x * y,
                                            x * x - y * y,
                                            x * s,
                                            y * s,
                                            copysign(0.5, x),
                                            copysign(0.5, y)};
    memcpy(ret, values, sizeof values);
}

/* Returns the nominal vignetting (rig.h). */
static double nominal_flat(const struct rig_camera *camera, double x_px, double y_px) {
    double dx = x_px - camera->cx_px, dy = y_px - camera->cy_px, corner = half_diagonal(camera);
    return MAX(1 - camera->vignetting * (dx * dx + dy * dy) / (corner * corner), 0.05);
}

double radiometry_flat(const struct rig_camera *camera, const struct radiometry_camera *radiometry,
                       double x_px, double y_px) {
    double basis[RADIOMETRY_FLAT], log = 0;
    if (radiometry && radiometry->known) {
        flat_basis(camera, x_px, y_px, basis);
        for (int i = 0; i < RADIOMETRY_FLAT; i++)
            log += radiometry->flat[i] * basis[i];
    }
    return nominal_flat(camera, x_px, y_px) * exp(log);
}

/* Sums over the pixels of one colour in a cell. `squares` is a sum of estimates of the noise
 * variance, and `triples` is the number of these estimates. `run` is the number of consecutive
 * pixels of this colour in the row up to now. */
struct sums {
    double n, basis[RADIOMETRY_FLAT], signal, expected, squares, triples;
    struct vec3 point;
    float last[2]; /* the two previous pixels of this colour in the row */
    int last_x, last_y, run;
};

struct measuring {
    double all[3], n_all[3]; /* sums and numbers of the finite pixels of each colour */
    const struct rig *rig;
    const struct rig_camera *camera;
    const char *cfa;
    const float *mosaic;
    const struct tile *tile;
    const struct tile_shot *shot;
    struct vec3 eye;
    int cells; /* number of cells along a side */
    struct sums sums[CELLS * CELLS][3];
};

int radiometry_colour_at(const char *cfa, int x, int y) {
    char name = strcmp(cfa, "mono") == 0 ? 'g' : cfa[2 * (y & 1) + (x & 1)];
    return name == 'r' ? 0 : name == 'g' ? 1 : 2;
}

/* Returns the expected signal response · flat · ρ/π · cos θ · E in DN per second (radiometry.h). */
static double expected(const struct measuring *m, struct vec3 p, int x, int y, int colour) {
    const struct rig_lamp *lamp = &m->rig->lamps[m->shot->lamp];
    struct vec3 path = vec3_sub(rig_lamp_position_mm(&m->rig->arc, lamp, m->shot->arc_rad), p);
    double cosine = MAX(path.z / vec3_length(path), 0);
    return m->camera->response * nominal_flat(m->camera, x, y) * m->tile->reflectance[colour] /
           G_PI * cosine * rig_lamp_irradiance(&m->rig->arc, lamp, m->shot->arc_rad, p);
}

static void radiometry_add_pixel(struct measuring *m, int x, int y) {
    const int own = radiometry_colour_at(m->cfa, x, y);
    const float seen = m->mosaic[(gsize)y * (gsize)m->camera->width + (gsize)x];
    if (isfinite(seen)) {
        m->all[own] += (double)seen;
        m->n_all[own]++;
    }
    struct vec3 ray = rig_pixel_ray(m->camera, x, y);
    if (!(ray.z < 0))
        return;
    struct vec3 p = vec3_add(m->eye, vec3_scale(ray, (m->tile->top_mm - m->eye.z) / ray.z));
    struct vec3 at = rig_turn(p, -m->shot->turntable_rad);
    if (!(fabs(at.x) < m->tile->width_mm / 2 - BORDER_MM &&
          fabs(at.y) < m->tile->height_mm / 2 - BORDER_MM))
        return;
    int row = y * m->cells / m->camera->height, column = x * m->cells / m->camera->width;
    int colour = radiometry_colour_at(m->cfa, x, y);
    struct sums *s = &m->sums[row * CELLS + column][colour];
    float value = m->mosaic[(gsize)y * (gsize)m->camera->width + (gsize)x];
    s->run = s->last_y == y && x - s->last_x <= 2 ? s->run + 1 : 1;
    if (s->run > 2) { /* second differences give the noise despite a gradient: Var(a − 2b + c) =
                         6σ² */
        double off = value - 2.0 * s->last[0] + s->last[1];
        s->squares += off * off / 6;
        s->triples++;
    }
    s->last[1] = s->last[0];
    s->last[0] = value;
    s->last_x = x;
    s->last_y = y;
    s->n++;
    double basis[RADIOMETRY_FLAT];
    flat_basis(m->camera, x, y, basis);
    for (int i = 0; i < RADIOMETRY_FLAT; i++)
        s->basis[i] += basis[i];
    s->signal += value;
    s->expected += expected(m, p, x, y, colour);
    s->point = vec3_add(s->point, p);
}

static gboolean radiometry_is_good(const struct sums *s) {
    return s->n >= FEW_PIXELS && 4 * s->triples >= FEW_PIXELS && isfinite(s->signal) &&
           s->signal > 0 && s->expected > 0;
}

/* Returns the ratio of variance to mean of a pixel, or 0 if there is no usable cell. All cells
 * share this ratio, because shot noise has a variance proportional to the signal, and all cells
 * together determine the ratio better than one cell. */
static double variance_by_mean(const struct measuring *m) {
    double variance = 0, mean = 0;
    for (int i = 0; i < CELLS * CELLS; i++)
        for (int k = 0; k < 3; k++) {
            const struct sums *s = &m->sums[i][k];
            if (!radiometry_is_good(s))
                continue;
            variance += s->squares;
            mean += s->signal / s->n * s->triples;
        }
    return mean > 0 ? variance / mean : 0;
}

int tile_measure(const struct rig *rig, int camera, const char *cfa, const float *mosaic,
                 const struct tile *tile, const struct tile_shot *shots, int shot, GArray *cells) {
    g_autofree struct measuring *m = g_new0(struct measuring, 1);
    /* Use the frame in which the turntable's axis is z, because the tile is level in it. */
    g_autofree struct rig *at = g_new(struct rig, 1);
    double tilt_rad[2];
    rig_at(rig, shots[shot].turntable_rad, at);
    rig_wobble_tilt(&rig->wobble, shots[shot].turntable_rad, tilt_rad);
    const struct rig_camera *c = &at->cameras[camera];
    m->rig = at;
    m->camera = c;
    m->cfa = cfa;
    m->mosaic = mosaic;
    m->tile = tile;
    m->shot = &shots[shot];
    m->cells = CLAMP(MIN(c->width, c->height) / CELL_PX, 1, CELLS);
    m->eye = rig_camera_centre_mm(c);
    /* Use whole rows, because the noise is measured with neighbouring pixels. */
    int stride = 2 * MAX(c->height / (2 * MAX_ROWS), 1);
    for (int y = 0; y + 1 < c->height; y += stride)
        for (int x = 0; x < 2 * c->width; x++)
            radiometry_add_pixel(m, x % c->width, y + x / c->width);
    int before = (int)cells->len;
    double noise = variance_by_mean(m);
    for (int i = 0; i < CELLS * CELLS && noise > 0; i++)
        for (int k = 0; k < 3; k++) {
            const struct sums *s = &m->sums[i][k];
            if (!radiometry_is_good(s))
                continue;
            /* The signal is in DN/s. Its standard error from shot noise is √(noise · mean / n). */
            double mean = s->signal / s->n;
            struct tile_cell cell = {
                .shot = shot,
                .camera = camera,
                .colour = k,
                .point_mm = rig_tilt_point(tilt_rad, vec3_scale(s->point, 1 / s->n), 1),
                .signal = 1000 * mean,
                .error = 1000 * sqrt(noise * mean / s->n),
                .expected = s->expected / s->n,
                .mean = 1000 * m->all[k] / MAX(m->n_all[k], 1)};
            for (int b = 0; b < RADIOMETRY_FLAT; b++)
                cell.basis[b] = s->basis[b] / s->n;
            g_array_append_val(cells, cell);
        }
    return (int)cells->len - before;
}
