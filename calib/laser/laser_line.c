/* The board is sampled on a grid with a step of about a pixel. The background is subtracted from
 * each sample. If the reflectance is known, the background is proportional to it. Otherwise the
 * background is the median of the samples on the same print (white or black). A sheet of light
 * meets a plane in a straight line, so bright samples vote for a straight line (RANSAC). The line's
 * middle is then measured in profiles across it in the picture. */
#include "laser_line.h"

#include "base/robust.h"
#include "geometry/fit.h"
#include "pictures/vision.h"

#include <lapacke.h>
#include <math.h>
#include <string.h>

#define MIN_SIGMA_PX 0.02 /* added in quadrature to the standard deviation of a corner */
#define REJECT       4.0  /* number of standard deviations from which a corner is rejected */
#define MIN_CORNERS  6
#define MAX_GRID     1200 /* largest number of samples in a row or column of the board */
/* number of parts in a row and column of the board, for the background */
#define CELLS 12
/* smallest brightness above the background of a sample that votes, in units of the noise */
#define BRIGHT    6.0
#define MAX_VOTES 4000 /* largest number of votes: the brightest samples */
#define TRIES     2000 /* number of lines that are tried */
#define WITHIN_PX 2.0  /* largest distance of samples that vote for a line */
/* smallest share of a line's places on white print that must be bright */
#define MIN_SHARE     0.35
#define MIN_DOTS      20
#define HALF_PX       12  /* largest half length of a profile */
#define WIDE          3.0 /* half the length of a profile, in standard deviations of the line */
#define FIRST_HALF_PX 5   /* half length of the first profiles, which show the line's width */
#define MIN_HALF_PX   2
#define MIN_WIDTH_PX  0.3
#define STEPS         20
#define MIN_SIGNAL    5.0 /* smallest width of a line, in standard errors of its middle */
#define CLEAR_PX      1.2 /* smallest distance of a profile from an edge of the print */
/* smallest number of samples that give the background of a part of the board */
#define FEWEST 8

static GArray *refuse(GError **error, const char *format, ...) G_GNUC_PRINTF(2, 3);

static GArray *refuse(GError **error, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    g_propagate_error(error, g_error_new_valist(BOARD_ERROR, BOARD_ERROR_SPEC, format, arguments));
    va_end(arguments);
    return NULL;
}

/* Returns exp([ω]×) · from, by Rodrigues' formula. */
static struct mat3 rotation_of(const double omega[3], const struct mat3 *from) {
    const struct vec3 w = vec3(omega[0], omega[1], omega[2]);
    const double angle = vec3_length(w);
    const struct vec3 a = angle > 0 ? vec3_scale(w, 1 / angle) : vec3(1, 0, 0);
    struct mat3 ret;
    for (int k = 0; k < 3; k++) {
        const struct vec3 v = vec3(from->m[0][k], from->m[1][k], from->m[2][k]);
        const struct vec3 turned =
            vec3_add(vec3_add(vec3_scale(v, cos(angle)), vec3_scale(vec3_cross(a, v), sin(angle))),
                     vec3_scale(a, vec3_dot(a, v) * (1 - cos(angle))));
        ret.m[0][k] = turned.x;
        ret.m[1][k] = turned.y;
        ret.m[2][k] = turned.z;
    }
    return ret;
}

/* Returns the camera in its own frame: at the origin, not rotated. */
static struct rig_camera at_origin(const struct rig_camera *camera) {
    struct rig_camera own = *camera;
    own.rotation = (struct mat3){{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    own.translation_mm = vec3(0, 0, 0);
    return own;
}

static struct vec3 in_camera(const struct laser_pose *pose, const double mm[2]) {
    return vec3_add(mat3_mul_vec(&pose->rotation, vec3(mm[0], mm[1], 0)), pose->shift_mm);
}

struct pose_problem {
    struct rig_camera camera; /* at the origin */
    const struct board *board;
    const GArray *corners;
    struct laser_pose start;
};

static struct laser_pose moved(const struct laser_pose *from, const double p[6]) {
    struct laser_pose pose = *from;
    pose.rotation = rotation_of(p, &from->rotation);
    pose.shift_mm = vec3_add(from->shift_mm, vec3(p[3], p[4], p[5]));
    return pose;
}

/* Computes the residuals of the corners. The inverse of the Cholesky factor of a corner's
 * covariance scales its residual, so that each number has variance 1. */
static void pose_residuals(const double *p, double *ret, gconstpointer data) {
    const struct pose_problem *problem = data;
    const struct laser_pose pose = moved(&problem->start, p);
    for (guint i = 0; i < problem->corners->len; i++) {
        const struct corner *corner = &g_array_index(problem->corners, struct corner, i);
        double mm[2], px[2];
        board_corner_mm(problem->board, corner->id, mm);
        ret[2 * i] = ret[2 * i + 1] = FIT_LOST;
        if (!rig_project(&problem->camera, in_camera(&pose, mm), &px[0], &px[1]))
            continue;
        const double(*c)[2] = corner->covariance_px2;
        const double l = sqrt(c[0][0] + MIN_SIGMA_PX * MIN_SIGMA_PX), m = c[0][1] / l;
        const double n = sqrt(MAX(c[1][1] + MIN_SIGMA_PX * MIN_SIGMA_PX - m * m, 1e-12));
        const double dx = px[0] - corner->x_px, dy = px[1] - corner->y_px;
        ret[2 * i] = dx / l;
        ret[2 * i + 1] = (dy - m / l * dx) / n;
    }
}

/* Sets problem->start to a first pose, from the viewing rays of the corners. Returns FALSE if no
 * pose is found. */
static gboolean first_pose(struct pose_problem *problem) {
    const guint n = problem->corners->len;
    g_autofree double *points = g_new(double, 4 * n);
    double rotation[9], shift[3];
    for (guint i = 0; i < n; i++) {
        const struct corner *corner = &g_array_index(problem->corners, struct corner, i);
        const struct vec3 ray = rig_pixel_ray(&problem->camera, corner->x_px, corner->y_px);
        board_corner_mm(problem->board, corner->id, points + (gsize)4 * i);
        points[4 * i + 2] = ray.x / ray.z;
        points[4 * i + 3] = ray.y / ray.z;
    }
    if (!vision_pose(points, (int)n, rotation, shift))
        return FALSE;
    memcpy(problem->start.rotation.m, rotation, sizeof rotation);
    problem->start.shift_mm = vec3(shift[0], shift[1], shift[2]);
    return TRUE;
}

gboolean laser_pose_fit(const struct rig_camera *camera, const struct board *board,
                        const GArray *corners, const struct laser_pose *start,
                        struct laser_pose *ret) {
    struct pose_problem problem = {.camera = at_origin(camera), .board = board, .corners = corners};
    double p[6] = {0};
    struct fit_result found;
    if (corners->len < MIN_CORNERS)
        return FALSE;
    if (start)
        problem.start = *start;
    else if (!first_pose(&problem))
        return FALSE;
    const struct fit fit = {.n_parameters = 6,
                            .n_observations = (int)corners->len,
                            .dimension = 2,
                            .residuals = pose_residuals,
                            .data = &problem,
                            .reject = REJECT};
    if (!fit_solve(&fit, p, &found))
        return FALSE;
    const gboolean ok = found.undetermined < 0 && 2 * found.n_used > (int)corners->len;
    *ret = moved(&problem.start, p);
    memcpy(ret->covariance, found.covariance, sizeof ret->covariance);
    fit_result_clear(&found);
    return ok;
}

gboolean laser_board_point(const struct rig_camera *camera, const struct laser_pose *pose,
                           double x_px, double y_px, double ret_mm[2]) {
    const struct rig_camera own = at_origin(camera);
    const struct vec3 ray = rig_pixel_ray(&own, x_px, y_px);
    const struct vec3 normal =
        vec3(pose->rotation.m[0][2], pose->rotation.m[1][2], pose->rotation.m[2][2]);
    const double t = vec3_dot(normal, pose->shift_mm) / vec3_dot(normal, ray);
    if (!(t > 0) || !isfinite(t))
        return FALSE;
    const struct vec3 at =
        mat3_mul_transposed(&pose->rotation, vec3_sub(vec3_scale(ray, t), pose->shift_mm));
    ret_mm[0] = at.x;
    ret_mm[1] = at.y;
    return TRUE;
}

/* Returns how strongly a laser of this colour lights a pixel: the colour minus the mean of the
 * other two. Returns the mean of all colours if colour is −1. A clipped colour is used with its
 * clipped value. */
static float strength_of(const float rgb[3], int colour) {
    return colour < 0 ? (rgb[0] + rgb[1] + rgb[2]) / 3
                      : rgb[colour] - (rgb[0] + rgb[1] + rgb[2] - rgb[colour]) / 2;
}

void laser_strength(const float *rgb, const float *dark, gsize n, int colour, float *ret,
                    float *ret_reflectance) {
    for (gsize i = 0; i < n; i++) {
        const float *lit = rgb + 3 * i;
        if (dark) { /* the difference contains only the laser, so that all colours can be used */
            const float *unlit = dark + 3 * i;
            ret[i] = MAX(lit[0] - unlit[0], MAX(lit[1] - unlit[1], lit[2] - unlit[2]));
            ret_reflectance[i] = strength_of(unlit, -1);
        } else {
            ret[i] = strength_of(lit, colour);
            ret_reflectance[i] = colour < 0 ? NAN : (lit[0] + lit[1] + lit[2] - lit[colour]) / 2;
        }
    }
}

int laser_colour(const float *rgb, const float *dark, gsize n) {
    double most = 0;
    int colour = -1;
    if (dark)
        return -1;
    for (int c = 0; c < 3; c++) {
        /* The 99.9th percentile minus the median. */
        g_autofree double *all = g_new(double, n);
        for (gsize i = 0; i < n; i++)
            all[i] = (double)strength_of(rgb + 3 * i, c);
        const double median = robust_select(all, (int)n, (int)(n / 2));
        const double excess = robust_select(all, (int)n, (int)(n - 1 - n / 1000)) - median;
        if (excess > most && excess > 1e-6) {
            most = excess;
            colour = c;
        }
    }
    return colour;
}

static double value_at(const struct picture *picture, double x, double y) {
    const int i = (int)floor(x), j = (int)floor(y);
    if (!(i >= 0 && j >= 0 && i + 1 < picture->width && j + 1 < picture->height))
        return NAN;
    const float *at = picture->values + (gsize)j * (gsize)picture->width + (gsize)i;
    const double u = x - i, v = y - j;
    return (1 - v) * ((1 - u) * (double)at[0] + u * (double)at[1]) +
           v * ((1 - u) * (double)at[picture->width] + u * (double)at[picture->width + 1]);
}

struct look {                                    /* the view of the board in the picture */
    const struct picture *picture, *reflectance; /* reflectance may be NULL */
    struct rig_camera camera;                    /* at the origin */
    const struct board *board;
    const struct laser_pose *pose;
    /* smaller of the millimetres per pixel along the board's x and y, in the middle of the board */
    double mm_a_px;
    double noise; /* standard deviation of a sample's brightness */
    /* Background of each part of the board, for black and for white print. It is relative to the
     * reflectance if that is known. */
    double background[2 * CELLS * CELLS];
    double white; /* reflectance of white print; 1 if it is not known */
};

static gboolean pixel_of(const struct look *look, const double mm[2], double ret_px[2]) {
    return rig_project(&look->camera, in_camera(look->pose, mm), &ret_px[0], &ret_px[1]);
}

struct sample {
    double mm[2];
    double value;       /* brightness above the background */
    double reflectance; /* 1 if it is not known */
    int cell;
    guint8 white;
};

static int by_value(gconstpointer a, gconstpointer b) {
    const struct sample *x = a, *y = b;
    return x->value < y->value ? 1 : x->value > y->value ? -1 : 0;
}

/* Returns the median of an array of doubles, or 0 if the array is empty. */
static double median_of(GArray *values) {
    return values->len ? robust_median((double *)(gpointer)values->data, (int)values->len) : 0;
}

/* Returns the number of the part of the board that a point lies in, for black or white print. */
static int cell_of(const struct board *board, const double mm[2], gboolean white) {
    double size[2];
    board_size_mm(board, size);
    const int x = (int)floor((mm[0] / size[0] + 0.5) * CELLS);
    const int y = (int)floor((mm[1] / size[1] + 0.5) * CELLS);
    return 2 * (CLAMP(y, 0, CELLS - 1) * CELLS + CLAMP(x, 0, CELLS - 1)) + (white ? 1 : 0);
}

/* Returns samples (struct sample) of the whole board, except at places that are next to an edge
 * between black and white. */
static GArray *gather(const struct look *look) {
    double size[2];
    board_size_mm(look->board, size);
    const double step = MAX(look->mm_a_px, MAX(size[0], size[1]) / MAX_GRID);
    const int nx = (int)(size[0] / step), ny = (int)(size[1] / step);
    g_autofree double *at = g_new(double, 2 * nx * ny + 2);
    g_autofree float *printed = g_new(float, nx *ny + 1);
    GArray *samples = g_array_new(FALSE, FALSE, sizeof(struct sample));
    for (int i = 0; i < nx * ny; i++) {
        const int x = i % nx, y = i / nx;
        at[2 * i] = (x + 0.5) * step - size[0] / 2;
        at[2 * i + 1] = (y + 0.5) * step - size[1] / 2;
    }
    board_values(look->board, at, nx * ny, printed);
    for (int i = 0; i < nx * ny; i++) {
        const int x = i % nx, y = i / nx;
        double px[2];
        if (printed[i] < 0 || !pixel_of(look, at + 2 * i, px))
            continue;
        const gboolean white = printed[i] > 0.5f;
        const struct sample sample = {{at[2 * i], at[2 * i + 1]},
                                      value_at(look->picture, px[0], px[1]),
                                      look->reflectance ? value_at(look->reflectance, px[0], px[1])
                                                        : 1,
                                      cell_of(look->board, at + 2 * i, white),
                                      white};
        gboolean clear = isfinite(sample.value) && sample.reflectance > 0;
        for (int k = -2; k <= 2 && clear; k++) {
            const int j = CLAMP(x + k, 0, nx - 1) + y * nx, l = x + CLAMP(y + k, 0, ny - 1) * nx;
            clear = printed[j] == printed[i] && printed[l] == printed[i];
        }
        if (clear)
            g_array_append_val(samples, sample);
    }
    return samples;
}

/* Subtracts the background from the samples. The background is the median of each part of the
 * board, or of the whole board if a part has few samples. Stores the background and the noise in
 * look. */
static void take_background(struct look *look, GArray *samples) {
    g_autoptr(GPtrArray) cells = g_ptr_array_new_with_free_func((GDestroyNotify)g_array_unref);
    g_autoptr(GArray) off = g_array_new(FALSE, FALSE, sizeof(double));
    g_autoptr(GArray) whites = g_array_new(FALSE, FALSE, sizeof(double));
    const int whole = 2 * CELLS * CELLS; /* the last two are for the whole board */
    for (int i = 0; i < whole + 2; i++)
        g_ptr_array_add(cells, g_array_new(FALSE, FALSE, sizeof(double)));
    for (guint i = 0; i < samples->len; i++) {
        const struct sample *s = &g_array_index(samples, struct sample, i);
        const double ratio = s->value / s->reflectance;
        g_array_append_val((GArray *)cells->pdata[s->cell], ratio);
        g_array_append_val((GArray *)cells->pdata[whole + s->white], ratio);
        if (s->white)
            g_array_append_val(whites, s->reflectance);
    }
    const double of_all[2] = {median_of(cells->pdata[whole]), median_of(cells->pdata[whole + 1])};
    for (int i = 0; i < whole; i++) {
        GArray *cell = cells->pdata[i];
        look->background[i] = cell->len < FEWEST ? of_all[i % 2] : median_of(cell);
    }
    /* The ratio of background to reflectance is the same for white and black print, and white print
     * shows it best. */
    for (int i = 0; i < whole && look->reflectance; i += 2)
        look->background[i] = look->background[i + 1];
    look->white = whites->len ? median_of(whites) : 1;
    for (guint i = 0; i < samples->len; i++) {
        struct sample *s = &g_array_index(samples, struct sample, i);
        s->value -= look->background[s->cell] * s->reflectance;
        const double size = fabs(s->value);
        g_array_append_val(off, size);
    }
    look->noise = MAX(1.4826 * median_of(off), 1e-9);
}

struct straight { /* points p with n·p = d, in the board's frame */
    double n[2], d;
};

static struct straight through(const double a[2], const double b[2]) {
    const double dx = b[0] - a[0], dy = b[1] - a[1], length = hypot(dx, dy);
    const struct straight line = {{-dy / length, dx / length}, (a[1] * dx - a[0] * dy) / length};
    return line;
}

/* Examines TRIES lines, each through two random votes. Finds the line with the largest sum of the
 * values of the votes within within_mm of it. Returns FALSE if there is none. */
static gboolean vote(const GArray *votes, double within_mm, struct straight *ret) {
    GRand *rand = g_rand_new_with_seed(1);
    double best = 0;
    for (int k = 0; k < TRIES && votes->len >= 2; k++) {
        const struct sample *a =
            &g_array_index(votes, struct sample, g_rand_int_range(rand, 0, (gint32)votes->len));
        const struct sample *b =
            &g_array_index(votes, struct sample, g_rand_int_range(rand, 0, (gint32)votes->len));
        if (hypot(a->mm[0] - b->mm[0], a->mm[1] - b->mm[1]) < 10 * within_mm)
            continue;
        const struct straight line = through(a->mm, b->mm);
        double sum = 0;
        for (guint i = 0; i < votes->len; i++) {
            const struct sample *s = &g_array_index(votes, struct sample, i);
            if (fabs(line.n[0] * s->mm[0] + line.n[1] * s->mm[1] - line.d) < within_mm)
                sum += s->value;
        }
        if (sum <= best)
            continue;
        best = sum;
        *ret = line;
    }
    g_rand_free(rand);
    return best > 0;
}

/* Returns the share of the places on white print along the line that are bright, or 0 if there is
 * no white print. A place is within_mm long. */
static double share_of(const GArray *samples, const struct straight *line, double within_mm,
                       double bright) {
    g_autoptr(GHashTable) all = g_hash_table_new(NULL, NULL), lit = g_hash_table_new(NULL, NULL);
    for (guint i = 0; i < samples->len; i++) {
        const struct sample *s = &g_array_index(samples, struct sample, i);
        if (!s->white || fabs(line->n[0] * s->mm[0] + line->n[1] * s->mm[1] - line->d) > within_mm)
            continue;
        const double along = line->n[1] * s->mm[0] - line->n[0] * s->mm[1];
        gpointer place = GINT_TO_POINTER((int)floor(along / within_mm));
        g_hash_table_add(all, place);
        if (s->value > bright)
            g_hash_table_add(lit, place);
    }
    return g_hash_table_size(all) ? (double)g_hash_table_size(lit) / g_hash_table_size(all) : 0;
}

/* Returns whether the print is all white or all black along a profile and up to CLEAR_PX beyond its
 * ends. *ret_white is then TRUE for white. Also returns FALSE if the profile leaves the board.
 * middle and across are in the picture. */
static gboolean is_even(const struct look *look, const double middle[2], const double across[2],
                        double half_px, gboolean *ret_white) {
    double at[2 * (4 * HALF_PX + 9)];
    float printed[4 * HALF_PX + 9];
    int n = 0;
    for (double u = -half_px - CLEAR_PX; u <= half_px + CLEAR_PX; u += 0.5, n++)
        if (!laser_board_point(&look->camera, look->pose, middle[0] + u * across[0],
                               middle[1] + u * across[1], at + (gsize)2 * (gsize)n))
            return FALSE;
    board_values(look->board, at, n, printed);
    for (int i = 0; i < n; i++)
        if (printed[i] < 0 || printed[i] != printed[0])
            return FALSE;
    *ret_white = printed[0] > 0.5f;
    return TRUE;
}

/* Parameters A, c and w of a profile; see profile_sum(). */
enum { HEIGHT, MIDDLE, WIDTH, N };

struct profile {
    int n;
    double u[4 * HALF_PX + 1], value[4 * HALF_PX + 1], reflectance[4 * HALF_PX + 1];
};

/* Reads a profile every half pixel, and subtracts the background. Returns FALSE if the profile
 * leaves the picture. */
static gboolean read_profile(const struct look *look, const double from[2], const double across[2],
                             double half, double background, struct profile *ret) {
    ret->n = 0;
    for (double u = -half; u <= half && ret->n <= 4 * HALF_PX; u += 0.5, ret->n++) {
        const double x = from[0] + u * across[0], y = from[1] + u * across[1];
        const double r = look->reflectance ? value_at(look->reflectance, x, y) : 1;
        const double v = value_at(look->picture, x, y) - background * r;
        if (!isfinite(v) || !isfinite(r))
            return FALSE;
        ret->u[ret->n] = u;
        ret->value[ret->n] = v;
        ret->reflectance[ret->n] = MAX(r, 0) / look->white;
    }
    return TRUE;
}

/* Returns Σ (v − A ρ exp(−(u − c)² / 2 w²))², where ρ is the reflectance, and computes its normal
 * equations. `free` is the number of free parameters: 2 for A and c, or 3 for A, c and w. */
static double profile_sum(const struct profile *profile, const double p[N], int free,
                          double h[N * N], double g[N]) {
    double sum = 0;
    memset(h, 0, sizeof(double) * N * N);
    memset(g, 0, sizeof(double) * N);
    for (int i = 0; i < profile->n; i++) {
        const double t = (profile->u[i] - p[MIDDLE]) / p[WIDTH];
        const double shape = profile->reflectance[i] * exp(-t * t / 2);
        const double d[N] = {shape, p[HEIGHT] * shape * t / p[WIDTH],
                             p[HEIGHT] * shape * t * t / p[WIDTH]};
        const double r = profile->value[i] - p[HEIGHT] * shape;
        sum += r * r;
        for (int a = 0; a < free; a++) {
            g[a] += d[a] * r;
            for (int b = 0; b < free; b++)
                h[a * free + b] += d[a] * d[b];
        }
    }
    return sum;
}

/* Fits a Gaussian times the reflectance to a profile (Levenberg-Marquardt). If width is 0, the
 * width is fitted as well. Returns FALSE if the profile shows no line, or if the line is too weak.
 * p gets the parameters, and *ret_sigma the standard error of the middle in px. */
static gboolean fit_profile(const struct profile *profile, double half, double noise, double width,
                            double p[N], double *ret_sigma) {
    const int free = width > 0 ? 2 : 3;
    double h[N * N], g[N], next_h[N * N], next_g[N], damping = 1e-3;
    p[MIDDLE] = 0;
    p[WIDTH] = width > 0 ? width : 1.2;
    p[HEIGHT] = 0;
    for (int i = 0; i < profile->n; i++)
        p[HEIGHT] = MAX(p[HEIGHT], profile->value[i] / MAX(profile->reflectance[i], 0.05));
    double sum = profile_sum(profile, p, free, h, g);
    for (int step = 0; step < STEPS; step++) {
        double a[N * N], d[N], next[N];
        memcpy(a, h, sizeof a);
        memcpy(d, g, sizeof d);
        for (int k = 0; k < free; k++)
            a[k * free + k] *= 1 + damping;
        if (LAPACKE_dposv(LAPACK_COL_MAJOR, 'U', free, 1, a, free, d, free) != 0)
            return FALSE;
        memcpy(next, p, sizeof next);
        for (int k = 0; k < free; k++)
            next[k] += d[k];
        next[WIDTH] = CLAMP(next[WIDTH], MIN_WIDTH_PX, half);
        const double then =
            fabs(next[MIDDLE]) < half ? profile_sum(profile, next, free, next_h, next_g) : INFINITY;
        if (!(then < sum)) {
            damping *= 10;
            if (damping > 1e6)
                break;
            continue;
        }
        const gboolean settled = fabs(next[MIDDLE] - p[MIDDLE]) < 1e-4;
        memcpy(p, next, sizeof next);
        memcpy(h, next_h, sizeof h);
        memcpy(g, next_g, sizeof g);
        sum = then;
        damping = MAX(damping / 10, 1e-9);
        if (settled)
            break;
    }
    double inverse[N] = {0};
    inverse[MIDDLE] = 1;
    if (LAPACKE_dposv(LAPACK_COL_MAJOR, 'U', free, 1, h, free, inverse, free) != 0)
        return FALSE;
    /* A profile has two samples per pixel, which share the noise of the pixel. Speckle adds to the
     * noise. */
    const double variance = MAX(noise * noise, sum / MAX(profile->n - free, 1));
    *ret_sigma = sqrt(2 * variance * MAX(inverse[MIDDLE], 0));
    return p[HEIGHT] > 0 && *ret_sigma < p[WIDTH] / MIN_SIGNAL;
}

/* Finds dots along the line, about a pixel apart. Places whose profile cannot be read or fitted
 * have no dot. width is the width of the line, or 0 to measure it. *ret_width is the median of the
 * measured widths. */
static GArray *dots_along(const struct look *look, const struct straight *line, double half,
                          double width, double *ret_width) {
    double size[2];
    board_size_mm(look->board, size);
    const double reach = hypot(size[0], size[1]) / 2, step = look->mm_a_px;
    GArray *dots = g_array_new(FALSE, FALSE, sizeof(struct laser_dot));
    g_autoptr(GArray) widths = g_array_new(FALSE, FALSE, sizeof(double));
    for (double along = -reach; along <= reach; along += step) {
        const double mm[2] = {line->d * line->n[0] + along * line->n[1],
                              line->d * line->n[1] - along * line->n[0]};
        const double next[2] = {mm[0] + step * line->n[1], mm[1] - step * line->n[0]};
        double px[2], to[2], p[N];
        if (fabs(mm[0]) > size[0] / 2 || fabs(mm[1]) > size[1] / 2 || !pixel_of(look, mm, px) ||
            !pixel_of(look, next, to))
            continue;
        const double length = hypot(to[0] - px[0], to[1] - px[1]);
        const double across[2] = {-(to[1] - px[1]) / length, (to[0] - px[0]) / length};
        struct laser_dot dot;
        struct profile profile;
        gboolean white = TRUE;
        if ((!look->reflectance && !is_even(look, px, across, half, &white)) ||
            !read_profile(look, px, across, half, look->background[cell_of(look->board, mm, white)],
                          &profile) ||
            !fit_profile(&profile, half, look->noise, width, p, &dot.sigma_px))
            continue;
        dot.x_px = px[0] + p[MIDDLE] * across[0];
        dot.y_px = px[1] + p[MIDDLE] * across[1];
        g_array_append_val(dots, dot);
        g_array_append_val(widths, p[WIDTH]);
    }
    *ret_width = median_of(widths);
    return dots;
}

GArray *laser_line_find(const struct picture *strength, const struct picture *reflectance,
                        const struct rig_camera *camera, const struct board *board,
                        const struct laser_pose *pose, GError **error) {
    static const double middle[2] = {0, 0};
    struct look look = {.picture = strength,
                        .reflectance = reflectance,
                        .camera = at_origin(camera),
                        .board = board,
                        .pose = pose};
    struct straight line;
    double width, a[2], b[2];
    if (!pixel_of(&look, middle, a) || !pixel_of(&look, (const double[]){1, 0}, b))
        return refuse(error, "the camera cannot see the middle of the board; hold the board nearer "
                             "to the middle of the picture");
    look.mm_a_px = 1 / hypot(b[0] - a[0], b[1] - a[1]);
    pixel_of(&look, (const double[]){0, 1}, b);
    look.mm_a_px = MIN(look.mm_a_px, 1 / hypot(b[0] - a[0], b[1] - a[1]));
    g_autoptr(GArray) samples = gather(&look);
    g_autoptr(GArray) votes = g_array_new(FALSE, FALSE, sizeof(struct sample));
    take_background(&look, samples);
    for (guint i = 0; i < samples->len; i++)
        if (g_array_index(samples, struct sample, i).value > BRIGHT * look.noise)
            g_array_append_val(votes, g_array_index(samples, struct sample, i));
    g_array_sort(votes, by_value);
    g_array_set_size(votes, MIN(votes->len, MAX_VOTES));
    const double within_mm = WITHIN_PX * look.mm_a_px;
    if (votes->len < MIN_DOTS || !vote(votes, within_mm, &line))
        return refuse(
            error,
            "no line on the board is %g times brighter than the noise; let the laser be the "
            "brightest light on the board, or give photographs without the laser (--dark-images)",
            BRIGHT);
    const double share = share_of(samples, &line, within_mm, BRIGHT * look.noise);
    if (share < MIN_SHARE)
        return refuse(error,
                      "the bright spots on the board do not form a line across it: only %.0f %% of "
                      "the white print along the best line is bright, and at least %.0f %% must "
                      "be; remove other lights",
                      100 * share, 100 * MIN_SHARE);
    g_autoptr(GArray) first = dots_along(&look, &line, FIRST_HALF_PX, 0, &width);
    const double half = CLAMP(WIDE * width, MIN_HALF_PX, HALF_PX);
    GArray *dots =
        first->len ? dots_along(&look, &line, half, width, &width) : g_steal_pointer(&first);
    if (dots->len >= MIN_DOTS)
        return dots;
    const guint n = dots->len;
    g_array_unref(dots);
    return refuse(error,
                  "the laser's line is clear at only %u places away from the print's edges, and at "
                  "least %d are needed: turn the board so that the line crosses the squares askew, "
                  "or take a board with larger squares",
                  n, MIN_DOTS);
}
