/* Fits cameras, lamps and outputs to the cells of radiometry.c. The fit is done twice, and outliers
 * are dropped after the first time. Each step solves the normal equations
 *   (Σ w rowᵀ row + priors + gauges) dx = Σ w rowᵀ r
 * by Cholesky decomposition, where row is a row of the Jacobian, r its residual and w its weight. A
 * gauge fixes a factor that the pictures do not determine. The model is linear but for the
 * exponents and aims of the lamps. */
#include "radiometry.h"

#include <lapacke.h>
#include <string.h>

#define STEPS          5
#define GAUGE          1e8   /* weight of gauge constraints */
#define EXPONENT_SD    1.0   /* standard deviation of the prior of a lamp's exponent */
#define AIM_SD_RAD     0.035 /* standard deviation of the prior of a lamp's aim */
#define DRIFT_SD       0.05  /* standard deviation of the prior of the drift between shots */
#define MAX_GAIN_ERROR 0.01
#define OUTLIER        5.0 /* number of standard deviations from which a cell is an outlier */
#define MAX_OUTLIERS   0.05
#define MAX_RESIDUAL   0.03
#define APART_RAD      (30 * G_PI / 180)
/* Two arc angles that differ by less than this count as the same. */
#define STILL_RAD      (1 * G_PI / 180)
#define MAX_FLAT_ERROR 0.05
#define FEW_CELLS      30 /* smallest number of cells of a camera */

/* Standard deviations of the priors of the flat field's coefficients, in their order. These priors
 * keep the flat field smooth, like that of a lens, where the tile was not seen. */
static const double flat_sd[RADIOMETRY_FLAT] = {0.5, 0.2, 0.1, 0.1,  0.1, 0.1,
                                                0.1, 0.1, 0.1, 0.05, 0.05};

/*
 * Least squares in logarithms: the residual ln(signal / expected) − Σ of parameters is weighted by
 * (signal / error)². The parameters are:
 * - of a camera, three logarithms of gain (relative to nominal) and the coefficients of its flat
 *   field,
 * - of a lamp, three logarithms of intensity (relative to nominal), its exponent and two tilts of
 *   its aim,
 * - of a shot, the logarithm of its output.
 */
#define CAMERA_SIZE (3 + RADIOMETRY_FLAT)
#define LAMP_SIZE   6
#define ROW_SIZE    (1 + RADIOMETRY_FLAT + 1 + 3 + 1)

struct problem {
    struct rig *rig;
    const struct tile_shot *shots;
    const struct tile_cell *cells;
    int n_shots, n_cells, n;
    gboolean *bad;
    double *x;      /* present solution */
    double *matrix; /* n × n, lower triangle; finish() replaces it by the covariance */
    double *right;
    double chi2, sum2;
    int n_used;
};

static int camera_at(const struct problem *p, int camera) {
    return camera * CAMERA_SIZE;
}

static int lamp_at(const struct problem *p, int lamp) {
    return p->rig->n_cameras * CAMERA_SIZE + lamp * LAMP_SIZE;
}

static int shot_at(const struct problem *p, int shot) {
    return p->rig->n_cameras * CAMERA_SIZE + p->rig->n_lamps * LAMP_SIZE + shot;
}

/* Returns two directions perpendicular to the aim. */
static void across(const struct rig_lamp *lamp, struct vec3 *ret_a, struct vec3 *ret_b) {
    struct vec3 side = fabs(lamp->aim.y) < 0.9 ? vec3(0, 1, 0) : vec3(1, 0, 0);
    *ret_a = vec3_unit(vec3_cross(lamp->aim, side));
    *ret_b = vec3_cross(lamp->aim, *ret_a);
}

static struct vec3 tilted_aim(const struct rig_lamp *lamp, double a, double b) {
    struct vec3 e1, e2;
    across(lamp, &e1, &e2);
    return vec3_unit(vec3_add(lamp->aim, vec3_add(vec3_scale(e1, a), vec3_scale(e2, b))));
}

struct row {
    int at[ROW_SIZE];
    double value[ROW_SIZE];
    int n;
    double off, weight;
};

static void put(struct row *row, int at, double value) {
    row->at[row->n] = at;
    row->value[row->n++] = value;
}

/* Computes one row of the Jacobian, its residual r = ln(signal / expected) − model, and its weight
 * (signal / error)². */
static void cell_row(const struct problem *p, const struct tile_cell *cell, struct row *row) {
    int lamp = p->shots[cell->shot].lamp;
    memset(row, 0, sizeof *row);
    put(row, camera_at(p, cell->camera) + cell->colour, 1);
    for (int i = 0; i < RADIOMETRY_FLAT; i++)
        put(row, camera_at(p, cell->camera) + 3 + i, cell->basis[i]);
    put(row, lamp_at(p, lamp) + cell->colour, 1);
    put(row, shot_at(p, cell->shot), 1);
    double model = 0;
    for (int i = 0; i < row->n; i++)
        model += row->value[i] * p->x[row->at[i]];
    /* Add the logarithm of the lamp's pattern cosⁿ towards the point, minus its nominal value.
     * Append the derivatives with respect to the exponent, ln cos, and to the tilts, n (d·e − cos ·
     * aim·e) / cos. d is the direction to the point and e the direction of a tilt. */
    const struct tile_shot *shot = &p->shots[cell->shot];
    const struct rig_lamp *l = &p->rig->lamps[shot->lamp];
    const double *x = p->x + lamp_at(p, shot->lamp);
    struct vec3 direction = vec3_unit(vec3_sub(
        rig_lamp_point_back(&p->rig->arc, l, shot->arc_rad, cell->point_mm), l->position_mm));
    struct vec3 aim = tilted_aim(l, x[4], x[5]), e[2];
    double exponent = l->exponent + x[3], cosine = MAX(vec3_dot(direction, aim), 1e-3);
    across(l, &e[0], &e[1]);
    put(row, lamp_at(p, shot->lamp) + 3, log(cosine));
    for (int k = 0; k < 2; k++)
        put(row, lamp_at(p, shot->lamp) + 4 + k,
            exponent * (vec3_dot(direction, e[k]) - cosine * vec3_dot(aim, e[k])) / cosine);
    model += exponent * log(cosine) - l->exponent * log(MAX(vec3_dot(direction, l->aim), 1e-3));
    row->off = log(cell->signal / cell->expected) - model;
    row->weight = cell->signal * cell->signal / (cell->error * cell->error);
}

/* Adds a gauge constraint: the sum of some parameters is 0. */
static void add_gauge(struct problem *p, const int *at, int n) {
    double sum = 0;
    for (int i = 0; i < n; i++)
        sum += p->x[at[i]];
    for (int i = 0; i < n; i++) {
        p->right[at[i]] -= GAUGE * sum;
        for (int j = 0; j < n; j++)
            if (at[j] <= at[i])
                p->matrix[(gsize)at[i] * (gsize)p->n + (gsize)at[j]] += GAUGE;
    }
}

static double *diagonal(const struct problem *p, int i) {
    return &p->matrix[(gsize)i * (gsize)p->n + (gsize)i];
}

/* Adds one gauge for the cameras' gains in each of the three colours, and one gauge for the outputs
 * of the shots of each lamp. */
static void add_gauges(struct problem *p) {
    g_autofree int *at = g_new(int, MAX(p->n_shots, p->rig->n_cameras));
    for (int k = 0; k < 3; k++) {
        int n = 0;
        for (int c = 0; c < p->rig->n_cameras; c++)
            if (*diagonal(p, camera_at(p, c) + k) > 0)
                at[n++] = camera_at(p, c) + k;
        add_gauge(p, at, n);
    }
    for (int l = 0; l < p->rig->n_lamps; l++) {
        int n = 0;
        for (int s = 0; s < p->n_shots; s++)
            if (p->shots[s].lamp == l && *diagonal(p, shot_at(p, s)) > 0)
                at[n++] = shot_at(p, s);
        add_gauge(p, at, n);
    }
}

/* Ties to green each of the three colours at `at` that no picture determines. The pictures of mono
 * sensors determine only green, for the camera and for the lamps. */
static void tie_colours(struct problem *p, int at) {
    for (int k = 0; k < 3; k++) {
        if (*diagonal(p, at + k) > 0 || *diagonal(p, at + 1) == 0)
            continue;
        int low = at + MIN(k, 1), high = at + MAX(k, 1);
        double off = p->x[high] - p->x[low];
        *diagonal(p, low) += GAUGE;
        *diagonal(p, high) += GAUGE;
        p->matrix[(gsize)high * (gsize)p->n + (gsize)low] -= GAUGE;
        p->right[high] -= GAUGE * off;
        p->right[low] += GAUGE * off;
    }
}

/* Adds a prior with mean 0, which adds 1/σ² to the diagonal. */
static void add_prior(struct problem *p, int at, double sd) {
    *diagonal(p, at) += 1 / (sd * sd);
    p->right[at] -= p->x[at] / (sd * sd);
}

static void build(struct problem *p) {
    struct row row;
    memset(p->matrix, 0, (gsize)p->n * (gsize)p->n * sizeof(double));
    memset(p->right, 0, (gsize)p->n * sizeof(double));
    p->chi2 = p->sum2 = 0;
    p->n_used = 0;
    for (int i = 0; i < p->n_cells; i++) {
        if (p->bad[i])
            continue;
        cell_row(p, &p->cells[i], &row);
        for (int a = 0; a < row.n; a++) {
            p->right[row.at[a]] += row.weight * row.value[a] * row.off;
            for (int b = 0; b < row.n; b++)
                if (row.at[b] <= row.at[a])
                    p->matrix[(gsize)row.at[a] * (gsize)p->n + (gsize)row.at[b]] +=
                        row.weight * row.value[a] * row.value[b];
        }
        p->chi2 += row.weight * row.off * row.off;
        p->sum2 += row.off * row.off;
        p->n_used++;
    }
    add_gauges(p);
    for (int c = 0; c < p->rig->n_cameras; c++)
        tie_colours(p, camera_at(p, c));
    for (int l = 0; l < p->rig->n_lamps; l++)
        tie_colours(p, lamp_at(p, l));
    for (int c = 0; c < p->rig->n_cameras; c++)
        for (int i = 0; i < RADIOMETRY_FLAT; i++)
            add_prior(p, camera_at(p, c) + 3 + i, flat_sd[i]);
    for (int s = 0; s < p->n_shots; s++)
        add_prior(p, shot_at(p, s), DRIFT_SD);
    for (int l = 0; l < p->rig->n_lamps; l++) {
        add_prior(p, lamp_at(p, l) + 3, EXPONENT_SD);
        add_prior(p, lamp_at(p, l) + 4, AIM_SD_RAD);
        add_prior(p, lamp_at(p, l) + 5, AIM_SD_RAD);
    }
    for (int i = 0; i < p->n; i++) /* keeps undetermined parameters unchanged */
        if (*diagonal(p, i) == 0)
            *diagonal(p, i) = 1;
}

static gboolean factor(struct problem *p, GError **error) {
    if (LAPACKE_dpotrf(LAPACK_ROW_MAJOR, 'L', p->n, p->matrix, p->n) == 0)
        return TRUE;
    g_set_error(
        error, RADIOMETRY_ERROR, RADIOMETRY_ERROR_DEGENERATE,
        "the pictures of the tile do not separate the effects of cameras and lamps; capture "
        "the tile with every camera under every lamp, at several arc and turntable angles");
    return FALSE;
}

static gboolean solve(struct problem *p, GError **error) {
    for (int i = 0; i < STEPS; i++) {
        build(p);
        if (!factor(p, error))
            return FALSE;
        LAPACKE_dpotrs(LAPACK_ROW_MAJOR, 'L', p->n, 1, p->matrix, p->n, p->right, 1);
        for (int k = 0; k < p->n; k++)
            p->x[k] += p->right[k];
    }
    build(p);
    return TRUE;
}

/* Returns the azimuth from which the lamp lights the tile in a shot, in radians. */
static double lit_from_rad(const struct problem *p, int shot) {
    const struct vec3 at = rig_lamp_position_mm(&p->rig->arc, &p->rig->lamps[p->shots[shot].lamp],
                                                p->shots[shot].arc_rad);
    return atan2(at.y, at.x);
}

/* Refuses shots that do not light the tile from several sides. Light from several sides separates a
 * lamp's fall-off from the cameras' vignetting. If the arc turns, each lamp on it must light the
 * tile at several arc angles. If the arc never turns, all lamps together must light several sides.
 *
 * For a lamp that is not on the arc of a rig with an arc, the lamps on the arc determine the
 * vignetting. The fall-off of such a lamp is less certain, and its standard error says so. The
 * product of its fall-off and the vignetting is as certain as for other lamps, and the pictures of
 * the rig depend only on this product. */
static gboolean check_shots(const struct problem *p, GError **error) {
    gboolean turns = FALSE;
    for (int s = 1; s < p->n_shots; s++)
        turns |= fabs(remainder(p->shots[s].arc_rad - p->shots[0].arc_rad, 2 * G_PI)) > STILL_RAD;
    for (int l = 0; l < p->rig->n_lamps; l++) {
        double first = 0, apart = 0;
        int n = 0;
        for (int s = 0; s < p->n_shots; s++) {
            if (p->shots[s].lamp != l && turns)
                continue;
            const double from = turns ? p->shots[s].arc_rad : lit_from_rad(p, s);
            first = n++ == 0 ? from : first;
            apart = MAX(apart, fabs(remainder(from - first, 2 * G_PI)));
        }
        if (n == 0 || apart >= APART_RAD || (turns && p->rig->lamps[l].fixed))
            continue;
        g_set_error(error, RADIOMETRY_ERROR, RADIOMETRY_ERROR_TOO_FEW,
                    "lamp %s lights the tile from one side only (%s within %.0f°, and %.0f° is "
                    "needed), so the lamp's fall-off and the cameras' vignetting cannot be "
                    "separated; capture the tile at several arc angles, or with fixed lamps on "
                    "several sides",
                    p->rig->lamps[l].name, turns ? "arc angles" : "all lamps stand",
                    apart * 180 / G_PI, APART_RAD * 180 / G_PI);
        return FALSE;
    }
    return TRUE;
}

static gboolean check_cells(const struct problem *p, GError **error) {
    int seen[RIG_MAX_CAMERAS] = {0};
    for (int i = 0; i < p->n_cells; i++)
        seen[p->cells[i].camera]++;
    for (int c = 0; c < p->rig->n_cameras; c++)
        if (seen[c] > 0 && seen[c] < FEW_CELLS) {
            g_set_error(
                error, RADIOMETRY_ERROR, RADIOMETRY_ERROR_TOO_FEW,
                "camera %s sees too little of the tile (%d cells in all pictures, and at least %d "
                "are needed); use a larger tile, or put the tile where the camera looks",
                p->rig->cameras[c].name, seen[c], FEW_CELLS);
            return FALSE;
        }
    if (p->n_cells >= FEW_CELLS)
        return TRUE;
    g_set_error(error, RADIOMETRY_ERROR, RADIOMETRY_ERROR_TOO_FEW,
                "the pictures show too little of the lit tile (%d cells in all, and at least %d "
                "are needed); put the tile in the middle of the turntable, under the lamps",
                p->n_cells, FEW_CELLS);
    return FALSE;
}

static double covariance(const struct problem *p, int i, int j) {
    return p->matrix[(gsize)MAX(i, j) * (gsize)p->n + (gsize)MIN(i, j)];
}

/* Splits three logarithms x_i into their mean and the colour factors exp(x_i − mean), with their
 * standard errors. The standard errors are multiplied by `worse`. */
static void split_colours(const struct problem *p, int at, double worse, double *ret_mean,
                          double *ret_error, double colour[3], double colour_error[3]) {
    double mean = (p->x[at] + p->x[at + 1] + p->x[at + 2]) / 3, variance = 0;
    double with[3] = {0};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            variance += covariance(p, at + i, at + j) / 9;
            with[i] += covariance(p, at + i, at + j) / 3;
        }
    for (int i = 0; i < 3; i++) {
        double own = covariance(p, at + i, at + i) - 2 * with[i] + variance;
        colour[i] = exp(p->x[at + i] - mean);
        colour_error[i] = colour[i] * sqrt(MAX(own, 0)) * worse;
    }
    *ret_mean = mean;
    *ret_error = sqrt(MAX(variance, 0)) * worse;
}

/* Writes a lamp's intensity, exponent and aim to the rig, and their standard errors to ret. Adds
 * the squared changes of exponent and aim to ret->exponent_off and ret->aim_off_rad. */
static void store_lamp(const struct problem *p, int l, double worse, struct tile_fit *ret) {
    struct radiometry_lamp *to = &ret->lamps[l];
    struct rig_lamp *lamp = &p->rig->lamps[l];
    int at = lamp_at(p, l);
    double mean;
    for (int s = 0; s < p->n_shots; s++)
        to->shots += p->shots[s].lamp == l;
    to->known = to->shots > 0;
    split_colours(p, at, worse, &mean, &to->intensity_error, to->colour, to->colour_error);
    if (!to->known)
        return;
    ret->exponent_off += p->x[at + 3] * p->x[at + 3];
    ret->aim_off_rad += p->x[at + 4] * p->x[at + 4] + p->x[at + 5] * p->x[at + 5];
    lamp->intensity *= exp(mean);
    lamp->exponent = MAX(lamp->exponent + p->x[at + 3], 0);
    lamp->aim = tilted_aim(lamp, p->x[at + 4], p->x[at + 5]);
    to->exponent_error = sqrt(covariance(p, at + 3, at + 3)) * worse;
    to->aim_error_rad =
        sqrt(0.5 * (covariance(p, at + 4, at + 4) + covariance(p, at + 5, at + 5))) * worse;
}

static gboolean check_errors(const struct rig *rig, const struct tile_fit *fit, GError **error) {
    for (int c = 0; c < rig->n_cameras; c++) {
        /* Slopes in x and y matter most at the picture's edge, where |x| is about 1. */
        double worst = MAX(fit->cameras[c].flat_error[3], fit->cameras[c].flat_error[4]);
        if (!fit->cameras[c].known)
            continue;
        if (fit->cameras[c].response_error > MAX_GAIN_ERROR)
            g_set_error(error, RADIOMETRY_ERROR, RADIOMETRY_ERROR_DEGENERATE,
                        "the response of camera %s relative to the other cameras is known only to "
                        "%.1f %%, and %g %% is needed, because too few shots show the tile to "
                        "several cameras; plan views of all cameras at the same turntable angles",
                        rig->cameras[c].name, 100 * fit->cameras[c].response_error,
                        100 * MAX_GAIN_ERROR);
        else if (!(worst < MAX_FLAT_ERROR))
            g_set_error(
                error, RADIOMETRY_ERROR, RADIOMETRY_ERROR_DEGENERATE,
                "the flat field of camera %s is known only to %.0f %%, and %g %% is needed; "
                "capture the tile at more arc and turntable angles, or use a larger tile",
                rig->cameras[c].name, 100 * worst, 100 * MAX_FLAT_ERROR);
        else
            continue;
        return FALSE;
    }
    return TRUE;
}

/* Finds `expected`, frame_flicker and `excess` (radiometry.h) from the residuals r of the used
 * cells.
 *
 * The mean m of a picture's residuals, with the standard error s, shows light that differs between
 * the cameras of a shot: frame_flicker² = mean of (m² k/(k − 1) − s²), where k is the number of
 * cameras of the shot. The deviations from m show errors of the flat field and of the light's
 * pattern: excess² = mean of ((r − m)² − σ²), where σ is the noise of a cell. */
static void tell_residuals(const struct problem *p, struct tile_fit *ret) {
    const int n_cameras = p->rig->n_cameras, n = p->n_shots * n_cameras;
    g_autofree double *sum = g_new0(double, n), *weights = g_new0(double, n);
    double lamp_squares[RIG_MAX_LAMPS] = {0}, camera_squares[RIG_MAX_CAMERAS] = {0};
    int lamp_n[RIG_MAX_LAMPS] = {0}, camera_n[RIG_MAX_CAMERAS] = {0};
    struct row row;
    double explained = 0;
    for (int i = 0; i < p->n_cells; i++) {
        const int picture = p->cells[i].shot * n_cameras + p->cells[i].camera;
        if (p->bad[i])
            continue;
        cell_row(p, &p->cells[i], &row);
        sum[picture] += row.weight * row.off;
        weights[picture] += row.weight;
        explained += 1 / row.weight;
    }
    ret->expected = sqrt(explained / p->n_used);
    for (int i = 0; i < p->n_cells; i++) {
        const int camera = p->cells[i].camera, picture = p->cells[i].shot * n_cameras + camera;
        if (p->bad[i])
            continue;
        cell_row(p, &p->cells[i], &row);
        camera_squares[camera] +=
            pow(row.off - sum[picture] / weights[picture], 2) - 1 / row.weight;
        camera_n[camera]++;
    }
    for (int s = 0; s < p->n_shots; s++) {
        int k = 0;
        for (int c = 0; c < n_cameras; c++)
            k += weights[s * n_cameras + c] > 0;
        for (int c = 0; c < n_cameras && k > 1; c++) {
            const double w = weights[s * n_cameras + c];
            if (!(w > 0))
                continue;
            lamp_squares[p->shots[s].lamp] +=
                pow(sum[s * n_cameras + c] / w, 2) * k / (k - 1) - 1 / w;
            lamp_n[p->shots[s].lamp]++;
        }
    }
    for (int c = 0; c < n_cameras; c++)
        ret->cameras[c].excess = sqrt(MAX(camera_squares[c] / MAX(camera_n[c], 1), 0));
    for (int l = 0; l < p->rig->n_lamps; l++)
        ret->lamps[l].frame_flicker = sqrt(MAX(lamp_squares[l] / MAX(lamp_n[l], 1), 0));
}

/* Finds the flicker of each lamp from the outputs o of its shots, in the order of the shots. A slow
 * drift is nearly a straight line over three shots, and is removed by the difference of a shot from
 * the mean of its neighbours. With independent outputs of variance σ² and standard errors e, the
 * expected square of this difference is
 *   E (o₁ − (o₀ + o₂)/2)² = 1.5 σ² + e₁² + (e₀² + e₂²)/4. */
static void find_flicker(const struct problem *p, struct tile_fit *ret) {
    for (int l = 0; l < p->rig->n_lamps; l++) {
        int last[2] = {-1, -1}, n = 0;
        double squares = 0;
        for (int s = 0; s < p->n_shots; s++) {
            if (p->shots[s].lamp != l)
                continue;
            if (last[0] >= 0) {
                const double *o = ret->output, *e = ret->output_error;
                squares += pow(o[last[1]] - 0.5 * (o[last[0]] + o[s]), 2) - pow(e[last[1]], 2) -
                           0.25 * (pow(e[last[0]], 2) + pow(e[s], 2));
                n++;
            }
            last[0] = last[1];
            last[1] = s;
        }
        ret->lamps[l].flicker = n > 0 ? sqrt(MAX(squares / (1.5 * n), 0)) : 0;
    }
}

static gboolean finish(struct problem *p, struct tile_fit *ret, GError **error) {
    /* must come first, because the solution is relative to the rig before it is changed */
    tell_residuals(p, ret);
    if (!factor(p, error))
        return FALSE;
    LAPACKE_dpotri(LAPACK_ROW_MAJOR, 'L', p->n, p->matrix, p->n);
    ret->degrees = MAX(p->n_used - p->n, 1);
    ret->quality = p->chi2 / ret->degrees;
    ret->residual = sqrt(p->sum2 / p->n_used);
    double worse = sqrt(MAX(ret->quality, 1));
    for (int c = 0; c < p->rig->n_cameras; c++) {
        /* Write the camera's response, colours and flat field, with their standard errors. */
        struct radiometry_camera *to = &ret->cameras[c];
        int at = camera_at(p, c);
        double mean;
        for (int i = 0; i < p->n_cells; i++)
            to->cells += p->cells[i].camera == c && !p->bad[i];
        to->known = to->cells > 0;
        split_colours(p, at, worse, &mean, &to->response_error, to->colour, to->colour_error);
        p->rig->cameras[c].response *= exp(mean);
        for (int i = 0; i < RADIOMETRY_FLAT; i++) {
            to->flat[i] = p->x[at + 3 + i];
            to->flat_error[i] = sqrt(covariance(p, at + 3 + i, at + 3 + i)) * worse;
        }
    }
    int n_known = 0;
    for (int l = 0; l < p->rig->n_lamps; l++) {
        store_lamp(p, l, worse, ret);
        n_known += ret->lamps[l].known;
    }
    ret->exponent_off = sqrt(ret->exponent_off / MAX(n_known, 1));
    ret->aim_off_rad = sqrt(ret->aim_off_rad / MAX(n_known, 1));
    ret->output = g_new(double, p->n_shots);
    ret->output_error = g_new(double, p->n_shots);
    for (int s = 0; s < p->n_shots; s++) {
        ret->output[s] = exp(p->x[shot_at(p, s)]);
        ret->output_error[s] = sqrt(covariance(p, shot_at(p, s), shot_at(p, s))) * worse;
    }
    find_flicker(p, ret);
    return check_errors(p->rig, ret, error);
}

void tile_fit_clear(struct tile_fit *fit) {
    g_clear_pointer(&fit->output, g_free);
    g_clear_pointer(&fit->output_error, g_free);
}

static gboolean run(struct problem *p, struct tile_fit *ret, GError **error) {
    if (!check_cells(p, error) || !check_shots(p, error) || !solve(p, error))
        return FALSE;
    /* Flag the cells whose residual exceeds OUTLIER standard deviations, scaled by √(χ² per degree
     * of freedom). */
    double scale = sqrt(MAX(p->chi2 / MAX(p->n_used - p->n, 1), 1));
    struct row row;
    for (int i = 0; i < p->n_cells; i++) {
        cell_row(p, &p->cells[i], &row);
        p->bad[i] = fabs(row.off) * sqrt(row.weight) > OUTLIER * scale;
        ret->rejected += p->bad[i];
    }
    if (!solve(p, error))
        return FALSE;
    double rms = sqrt(p->sum2 / MAX(p->n_used, 1));
    if (ret->rejected <= MAX_OUTLIERS * p->n_cells && rms < MAX_RESIDUAL)
        return finish(p, ret, error);
    g_set_error(
        error, RADIOMETRY_ERROR, RADIOMETRY_ERROR_MISFIT,
        "the pictures do not show a matt white tile under these lamps: the cells differ from the "
        "fitted model by %.1f %% (RMS), and %d of %d cells are outliers; check that the tile is "
        "clean, matt, level, and where the session says, and that no other light falls on the tile",
        100 * rms, ret->rejected, p->n_cells);
    return FALSE;
}

gboolean tile_fit(struct rig *rig, const struct tile_shot *shots, int n_shots,
                  const struct tile_cell *cells, int n_cells, struct tile_fit *ret,
                  GError **error) {
    struct rig found = *rig;
    struct problem p = {
        .rig = &found, .shots = shots, .cells = cells, .n_shots = n_shots, .n_cells = n_cells};
    p.n = shot_at(&p, n_shots);
    g_autofree gboolean *bad = p.bad = g_new0(gboolean, n_cells);
    g_autofree double *x = g_new0(double, p.n), *right = g_new0(double, p.n);
    p.x = x;
    p.right = right;
    g_autofree double *matrix = p.matrix = g_new0(double, (gsize)p.n *(gsize)p.n);
    memset(ret, 0, sizeof *ret);
    gboolean ok = run(&p, ret, error);
    if (ok)
        *rig = found;
    else
        tile_fit_clear(ret);
    return ok;
}
