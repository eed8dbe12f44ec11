/* Each photograph gives two observations: the distances r = n·X − d of two points X of its line
 * from the plane. V (2 × 2) is their covariance. Parameters are the offset and two tilts relative
 * to a first plane, which is found from pairs of photographs. The solution minimises Σ rᵀ V⁻¹ r.
 * The residuals are linear in small parameters. */
#include "laser_plane.h"

#include "base/robust.h"

#include <lapacke.h>
#include <math.h>
#include <string.h>

G_DEFINE_QUARK(laser_plane_error, laser_plane_error)

#define BLOCKS   16 /* number of pieces of a line whose scatter is measured */
#define MIN_DOTS 12
#define DOT_PX   0.03 /* part of a dot's error that noise does not cause */
#define SCATTER  4.0  /* number of robust standard deviations above which dots are left out */
#define ROUNDS   5
/* χ² (2 degrees of freedom) from which a photograph is rejected, relative to the median */
#define REJECT 20.0
/* smallest spread of the lines about one line, relative to their length */
#define MIN_SPREAD 0.02
/* largest standard error of the tilt of a plane that counts as determined */
#define MAX_TILT_DEG 1.0
#define MIN_SIGMA_MM 1e-6
#define DEG          (180 / G_PI)

struct view { /* a photograph, with one set of camera parameters */
    struct laser_pose pose;
    double share[2][2]; /* the two points of the line on the board: middle ± h along the line, mm */
    double across[2];   /* unit vector on the board, perpendicular to the line */
    /* Standard errors across the line: that of its middle, and that which the error of its slope
     * causes at the distance h from the middle. */
    double offset_sigma_mm, slope_sigma_mm;
    struct vec3 ends[2]; /* rig frame */
};

static gboolean refuse(GError **error, enum laser_plane_error code, const char *format, ...)
    G_GNUC_PRINTF(3, 4);

static gboolean refuse(GError **error, enum laser_plane_error code, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    g_propagate_error(error, g_error_new_valist(LASER_PLANE_ERROR, (int)code, format, arguments));
    va_end(arguments);
    return FALSE;
}

static struct vec3 to_rig(const struct rig_camera *camera, const struct laser_pose *pose,
                          const double mm[2]) {
    const struct vec3 seen =
        vec3_add(mat3_mul_vec(&pose->rotation, vec3(mm[0], mm[1], 0)), pose->shift_mm);
    return mat3_mul_transposed(&camera->rotation, vec3_sub(seen, camera->translation_mm));
}

/* Sums over points (x, y) on the board: of the weights w (n), and of w x, w y, w x², w x y and w
 * y². */
struct moments {
    double n, x, y, xx, xy, yy;
};

static void add_point(struct moments *to, const double mm[2], double weight) {
    to->n += weight;
    to->x += weight * mm[0];
    to->y += weight * mm[1];
    to->xx += weight * mm[0] * mm[0];
    to->xy += weight * mm[0] * mm[1];
    to->yy += weight * mm[1] * mm[1];
}

/* Fits the line with the smallest squared distances: its middle, and a unit vector along it.
 * Returns half its length, which is the RMS distance of the points from the middle. */
static double line_of(const struct moments *m, double ret_middle[2], double ret_along[2]) {
    const double x = m->x / m->n, y = m->y / m->n;
    const double xx = m->xx / m->n - x * x, xy = m->xy / m->n - x * y, yy = m->yy / m->n - y * y;
    const double angle = 0.5 * atan2(2 * xy, xx - yy);
    ret_middle[0] = x;
    ret_middle[1] = y;
    ret_along[0] = cos(angle);
    ret_along[1] = sin(angle);
    return sqrt(MAX((xx + yy) / 2 + hypot((xx - yy) / 2, xy), 0));
}

/* Fits a straight line to the dots on the board. The errors of the line are estimated from the
 * scatter of the means of pieces of the line, because the errors of neighbouring dots are
 * correlated. mm has the dots' places on the board. Returns FALSE if there are too few dots, or if
 * fewer than four pieces have dots. */
static gboolean fit_line(const GArray *dots, const double *mm, struct view *ret) {
    const int n = (int)dots->len, most = MIN(BLOCKS, n / 2);
    g_autofree double *off = g_new(double, n + 1), *sorted = g_new(double, n + 1);
    g_autofree double *weight = g_new(double, n + 1);
    g_autofree gboolean *used = g_new(gboolean, n + 1);
    double middle[2], along[2], half = 0;
    for (int i = 0; i < n; i++) {
        const double sigma = g_array_index(dots, struct laser_dot, i).sigma_px;
        weight[i] = 1 / (sigma * sigma + DOT_PX * DOT_PX);
        used[i] = TRUE;
    }
    for (int round = 0; round < ROUNDS; round++) {
        struct moments moments = {0};
        int left = 0;
        for (int i = 0; i < n; i++)
            if (used[i]) {
                add_point(&moments, mm + (gsize)2 * (gsize)i, weight[i]);
                left++;
            }
        if (left < MIN_DOTS)
            return FALSE;
        half = line_of(&moments, middle, along);
        for (int i = 0; i < n; i++) {
            off[i] = (mm[2 * i + 1] - middle[1]) * along[0] - (mm[2 * i] - middle[0]) * along[1];
            sorted[i] = fabs(off[i]) * sqrt(weight[i]);
        }
        const double sigma = MAX(1.4826 * robust_median(sorted, n), MIN_SIGMA_MM);
        for (int i = 0; i < n; i++)
            used[i] = fabs(off[i]) * sqrt(weight[i]) < SCATTER * sigma;
    }
    double sum[BLOCKS] = {0}, place[BLOCKS] = {0}, weights[BLOCKS] = {0};
    double all = 0, squares = 0, spread = 0;
    int blocks = 0;
    for (int i = 0; i < n; i++) {
        const int block = i * most / n;
        if (!used[i])
            continue;
        sum[block] += weight[i] * off[i];
        place[block] += weight[i] * ((mm[2 * i] - middle[0]) * along[0] +
                                     (mm[2 * i + 1] - middle[1]) * along[1]);
        weights[block] += weight[i];
    }
    for (int b = 0; b < most; b++) {
        if (weights[b] == 0)
            continue;
        squares += sum[b] * sum[b] / weights[b];
        spread += place[b] * place[b] / weights[b];
        all += weights[b];
        blocks++;
    }
    if (blocks < 4 || !(half > 0))
        return FALSE;
    const double variance = squares / (blocks - 2); /* variance of an observation of weight 1 */
    ret->offset_sigma_mm = sqrt(variance / all);
    ret->slope_sigma_mm = sqrt(variance / spread) * half;
    for (int k = 0; k < 2; k++) {
        ret->share[0][k] = middle[k] - half * along[k];
        ret->share[1][k] = middle[k] + half * along[k];
    }
    ret->across[0] = -along[1];
    ret->across[1] = along[0];
    return TRUE;
}

/* Measures the line in a photograph. start is a view with nearly the same camera parameters, or
 * NULL. Returns FALSE if corners or dots fit no pose or no line. */
static gboolean view_of(const struct rig_camera *camera, const struct board *board,
                        const struct laser_photograph *photograph, const struct view *start,
                        struct view *ret) {
    const int n = (int)photograph->dots->len;
    g_autofree double *mm = g_new(double, 2 * n + 2);
    if (!laser_pose_fit(camera, board, photograph->corners, start ? &start->pose : NULL,
                        &ret->pose))
        return FALSE;
    for (int i = 0; i < n; i++) {
        const struct laser_dot *dot = &g_array_index(photograph->dots, struct laser_dot, i);
        if (!laser_board_point(camera, &ret->pose, dot->x_px, dot->y_px, mm + (gsize)2 * (gsize)i))
            return FALSE;
    }
    if (!fit_line(photograph->dots, mm, ret))
        return FALSE;
    for (int k = 0; k < 2; k++)
        ret->ends[k] = to_rig(camera, &ret->pose, ret->share[k]);
    return TRUE;
}

struct frame { /* the frame of the parameters: a plane, a point in it, and two directions in it */
    struct vec3 normal, point, u, v;
};

/* Computes the eigenvectors of a symmetric matrix, in increasing order of their eigenvalues. */
static void eigen3(const double m[3][3], double ret_values[3], struct vec3 ret_vectors[3]) {
    double a[9];
    memcpy(a, m, sizeof a);
    LAPACKE_dsyev(LAPACK_ROW_MAJOR, 'V', 'U', 3, a, 3, ret_values);
    for (int k = 0; k < 3; k++)
        ret_vectors[k] = vec3(a[k], a[3 + k], a[6 + k]);
}

/* Fits the plane with the smallest squared distances to the ends of the views that are used.
 * *ret_spread is the RMS distance of the ends from the straight line nearest to them, and
 * *ret_length the RMS distance along it. */
static void frame_of(const struct view *views, const gboolean *out, int n, struct frame *ret,
                     double *ret_spread, double *ret_length) {
    struct vec3 sum = vec3(0, 0, 0), vectors[3];
    double m[3][3] = {{0}}, values[3];
    int points = 0;
    for (int i = 0; i < n; i++)
        for (int k = 0; k < 2 && !out[i]; k++, points++)
            sum = vec3_add(sum, views[i].ends[k]);
    ret->point = vec3_scale(sum, 1.0 / points);
    for (int i = 0; i < n; i++)
        for (int k = 0; k < 2 && !out[i]; k++) {
            const struct vec3 d = vec3_sub(views[i].ends[k], ret->point);
            const double p[3] = {d.x, d.y, d.z};
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++)
                    m[a][b] += p[a] * p[b] / points;
        }
    eigen3((const double(*)[3])m, values, vectors);
    ret->normal = vectors[0];
    ret->u = vectors[2];
    ret->v = vec3_cross(ret->normal, ret->u);
    *ret_spread = sqrt(MAX(values[1], 0));
    *ret_length = sqrt(MAX(values[2], 0));
}

/* Computes the covariance of a view's two distances from a plane with this normal. It includes the
 * error of the line, across itself on the board, and the error of the pose. */
static void distances_covariance(const struct rig_camera *camera, const struct view *view,
                                 struct vec3 normal, double ret[2][2]) {
    const struct mat3 *r = &view->pose.rotation;
    const struct vec3 on_board = mat3_mul_vec(r, vec3(view->across[0], view->across[1], 0));
    /* n is the normal in the camera's frame. */
    const struct vec3 n = mat3_mul_vec(&camera->rotation, normal);
    const struct vec3 board_normal = vec3(r->m[0][2], r->m[1][2], r->m[2][2]);
    const double share = vec3_dot(n, on_board);
    const double o = pow(share * view->offset_sigma_mm, 2),
                 s = pow(share * view->slope_sigma_mm, 2);
    double j[2][6];
    ret[0][0] = ret[1][1] = o + s;
    ret[0][1] = ret[1][0] = o - s;
    /* X is on the ray r, and b is the board's normal. If the board moves by m there, X moves by r
     * (b·m) / (b·r). */
    for (int k = 0; k < 2; k++) {
        const struct vec3 x = vec3_add(
            mat3_mul_vec(r, vec3(view->share[k][0], view->share[k][1], 0)), view->pose.shift_mm);
        const struct vec3 arm = vec3_sub(x, view->pose.shift_mm);
        const double by = vec3_dot(n, x) / vec3_dot(board_normal, x);
        for (int p = 0; p < 6; p++) {
            const struct vec3 unit = vec3(p % 3 == 0, p % 3 == 1, p % 3 == 2);
            const struct vec3 move = p < 3 ? vec3_cross(unit, arm) : unit;
            j[k][p] = by * vec3_dot(board_normal, move);
        }
    }
    for (int a = 0; a < 2; a++)
        for (int b = 0; b < 2; b++)
            for (int p = 0; p < 6; p++)
                for (int q = 0; q < 6; q++)
                    ret[a][b] += j[a][p] * view->pose.covariance[p][q] * j[b][q];
    for (int k = 0; k < 2; k++)
        ret[k][k] += MIN_SIGMA_MM * MIN_SIGMA_MM;
}

/* V⁻¹ of each view, and whether the view is left out. Both are kept while the camera's parameters
 * are varied. */
struct weights {
    double (*inverse)[2][2];
    gboolean *out;
};

static double chi2_of(const double w[2][2], const double r[2]) {
    return r[0] * r[0] * w[0][0] + 2 * r[0] * r[1] * w[0][1] + r[1] * r[1] * w[1][1];
}

static void distances(const struct view *view, struct vec3 normal, double offset, double ret[2]) {
    for (int k = 0; k < 2; k++)
        ret[k] = vec3_dot(normal, view->ends[k]) - offset;
}

/* Fits the plane by weighted least squares. The parameters are the offset and two tilts relative to
 * a frame, and ret_covariance is their covariance. ret gets normal and offset. Returns FALSE if the
 * equations are singular. */
static gboolean solve(const struct view *views, const struct weights *weights, int n,
                      const struct frame *frame, struct rig_plane *ret,
                      double ret_covariance[3][3]) {
    double h[3][3] = {{0}}, g[3] = {0};
    for (int i = 0; i < n; i++) {
        double r[2], a[2][3];
        if (weights->out[i])
            continue;
        distances(&views[i], frame->normal, vec3_dot(frame->normal, frame->point), r);
        for (int k = 0; k < 2; k++) {
            const struct vec3 d = vec3_sub(views[i].ends[k], frame->point);
            a[k][0] = -1;
            a[k][1] = vec3_dot(frame->u, d);
            a[k][2] = vec3_dot(frame->v, d);
        }
        for (int p = 0; p < 3; p++)
            for (int k = 0; k < 2; k++)
                for (int l = 0; l < 2; l++) {
                    g[p] -= a[k][p] * weights->inverse[i][k][l] * r[l];
                    for (int q = 0; q < 3; q++)
                        h[p][q] += a[k][p] * weights->inverse[i][k][l] * a[l][q];
                }
    }
    double identity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    if (LAPACKE_dposv(LAPACK_COL_MAJOR, 'U', 3, 3, &h[0][0], 3, identity, 3) != 0)
        return FALSE;
    double x[3] = {0};
    for (int p = 0; p < 3; p++)
        for (int q = 0; q < 3; q++) {
            ret_covariance[p][q] = identity[3 * p + q];
            x[p] += identity[3 * p + q] * g[q];
        }
    const struct vec3 turned =
        vec3_add(frame->normal, vec3_add(vec3_scale(frame->u, x[1]), vec3_scale(frame->v, x[2])));
    ret->normal = vec3_unit(turned);
    ret->offset_mm = (vec3_dot(turned, frame->point) + x[0]) / vec3_length(turned);
    return TRUE;
}

/* Sets V⁻¹ of each view for a plane with this normal. *ret_expected_mm is the expected RMS distance
 * of the views that are used. */
static void weigh(const struct rig_camera *camera, const struct view *views, int n,
                  struct vec3 normal, struct weights *to, double *ret_expected_mm) {
    double sum = 0;
    int used = 0;
    for (int i = 0; i < n; i++) {
        double v[2][2];
        distances_covariance(camera, &views[i], normal, v);
        const double det = v[0][0] * v[1][1] - v[0][1] * v[1][0];
        to->inverse[i][0][0] = v[1][1] / det;
        to->inverse[i][1][1] = v[0][0] / det;
        to->inverse[i][0][1] = to->inverse[i][1][0] = -v[0][1] / det;
        sum += to->out[i] ? 0 : v[0][0] + v[1][1];
        used += to->out[i] ? 0 : 2;
    }
    *ret_expected_mm = sqrt(sum / MAX(used, 1));
}

/* Computes χ² of each view with respect to a plane. Returns their median divided by the median of
 * the χ² distribution with two degrees of freedom. */
static double all_chi2(const struct view *views, const struct weights *weights, int n,
                       const struct rig_plane *plane, double *ret) {
    g_autofree double *sorted = g_new(double, n);
    for (int i = 0; i < n; i++) {
        double r[2];
        distances(&views[i], plane->normal, plane->offset_mm, r);
        sorted[i] = ret[i] = chi2_of((const double(*)[2])weights->inverse[i], r);
    }
    return robust_median(sorted, n) / (2 * G_LN2);
}

/* Finds the plane through a pair of views that agrees best with all views, by the median of χ².
 * Returns FALSE if the two lines of every pair are nearly one line. */
static gboolean first_plane(const struct rig_camera *camera, const struct view *views, int n,
                            struct weights *weights, struct rig_plane *ret) {
    g_autofree double *chi2 = g_new(double, n);
    g_autofree gboolean *others = g_new(gboolean, n);
    double least = INFINITY, expected;
    for (int a = 0; a < n; a++)
        for (int b = a + 1; b < n; b++) {
            struct frame frame;
            double spread, length;
            for (int i = 0; i < n; i++)
                others[i] = i != a && i != b;
            frame_of(views, others, n, &frame, &spread, &length);
            if (spread < MIN_SPREAD * length)
                continue;
            const struct rig_plane plane = {frame.normal, vec3_dot(frame.normal, frame.point)};
            weigh(camera, views, n, plane.normal, weights, &expected);
            const double median = all_chi2(views, weights, n, &plane, chi2);
            if (median >= least)
                continue;
            least = median;
            *ret = plane;
        }
    return least < INFINITY;
}

/* Fits in rounds, and leaves out views that contradict the others. The first rounds leave out only
 * views with very large deviations, because the plane of a pair fits that pair better than the
 * others. If there are only LASER_PLANE_MIN views, none is left out. *ret_chi2 is χ² of the views
 * used. Returns FALSE if the lines do not determine a plane. */
static gboolean fit_plane(const struct rig_camera *camera, const struct view *views, int n,
                          struct weights *weights, struct frame *ret_frame, struct rig_plane *plane,
                          double ret_covariance[3][3], double *ret_chi2, double *ret_expected_mm) {
    static const double lenient[ROUNDS] = {100, 30, 10, 3, 1};
    g_autofree double *chi2 = g_new(double, n);
    double spread, length;
    if (!first_plane(camera, views, n, weights, plane))
        return FALSE;
    for (int round = 0; round < ROUNDS; round++) {
        weigh(camera, views, n, plane->normal, weights, ret_expected_mm);
        const double median = MAX(all_chi2(views, weights, n, plane, chi2), 1);
        for (int i = 0; i < n; i++)
            weights->out[i] = n > LASER_PLANE_MIN && chi2[i] > REJECT * lenient[round] * median;
        frame_of(views, weights->out, n, ret_frame, &spread, &length);
        /* Moves the frame to the plane of the last round. */
        const double away = vec3_dot(plane->normal, ret_frame->point) - plane->offset_mm;
        ret_frame->point = vec3_sub(ret_frame->point, vec3_scale(plane->normal, away));
        ret_frame->normal = plane->normal;
        ret_frame->u = vec3_unit(vec3_sub(
            ret_frame->u, vec3_scale(plane->normal, vec3_dot(plane->normal, ret_frame->u))));
        ret_frame->v = vec3_cross(plane->normal, ret_frame->u);
        if (!solve(views, weights, n, ret_frame, plane, ret_covariance))
            return FALSE;
    }
    weigh(camera, views, n, plane->normal, weights, ret_expected_mm);
    all_chi2(views, weights, n, plane, chi2);
    *ret_chi2 = 0;
    for (int i = 0; i < n; i++)
        *ret_chi2 += weights->out[i] ? 0 : chi2[i];
    return TRUE;
}

/* Returns the square of the ratio of the 97.5 % quantiles of Student's t with f degrees of freedom
 * and of the normal distribution (Cornish-Fisher expansion). */
static double student(int f) {
    const double z = 1.96, z3 = z * z * z;
    const double t = z + (z3 + z) / (4.0 * f) + (5 * z3 * z * z + 16 * z3 + 3 * z) / (96.0 * f * f);
    return t * t / (z * z);
}

/* Adds J C Jᵀ with J = ∂(n, d) / ∂(offset, tilts). */
static void add_own_covariance(const struct frame *frame, const double c[3][3], double to[4][4]) {
    const double j[4][3] = {
        {0, frame->u.x, frame->v.x},
        {0, frame->u.y, frame->v.y},
        {0, frame->u.z, frame->v.z},
        {1, vec3_dot(frame->u, frame->point), vec3_dot(frame->v, frame->point)}};
    for (int a = 0; a < 4; a++)
        for (int b = 0; b < 4; b++)
            for (int p = 0; p < 3; p++)
                for (int q = 0; q < 3; q++)
                    to[a][b] += j[a][p] * c[p][q] * j[b][q];
}

/* Returns the camera with all its parameters changed by the given amounts, in the order of
 * CALIBRATION_FX … */
static struct rig_camera changed(const struct rig_camera *camera,
                                 const double by[CALIBRATION_ALL_CAMERA_PARAMETERS]) {
    struct rig_camera to = *camera;
    double *const members[] = {&to.fx_px, &to.fy_px, &to.cx_px, &to.cy_px, &to.k1,
                               &to.k2,    &to.k3,    &to.p1,    &to.p2};
    for (gsize i = 0; i < G_N_ELEMENTS(members); i++)
        *members[i] += by[i];
    to.k4 += by[CALIBRATION_K4];
    to.k5 += by[CALIBRATION_K5];
    to.k6 += by[CALIBRATION_K6];
    /* The rotation R becomes R (1 + [ω]×). Its rows stay orthogonal up to terms of second order. */
    const struct vec3 omega =
        vec3(by[CALIBRATION_TURN_X], by[CALIBRATION_TURN_Y], by[CALIBRATION_TURN_Z]);
    for (int i = 0; i < 3; i++) {
        const double *m = camera->rotation.m[i];
        const struct vec3 row = vec3(m[0], m[1], m[2]), add = vec3_cross(row, omega);
        to.rotation.m[i][0] += add.x;
        to.rotation.m[i][1] += add.y;
        to.rotation.m[i][2] += add.z;
    }
    to.translation_mm =
        vec3_add(to.translation_mm,
                 vec3(by[CALIBRATION_SHIFT_X], by[CALIBRATION_SHIFT_Y], by[CALIBRATION_SHIFT_Z]));
    return to;
}

/* Adds Σ δ δᵀ to the covariance, for the camera's errors, which are the same in all photographs. δ
 * is the change of the plane when the camera's parameters change by one standard deviation along a
 * principal axis of their covariance. Returns FALSE if the plane cannot be fitted with changed
 * parameters. */
static gboolean
add_camera_covariance(const struct rig_camera *camera, const struct calibration_camera *errors,
                      const struct board *board, const struct laser_photograph *photographs, int n,
                      const struct view *views, const struct weights *weights,
                      const struct frame *frame, const struct rig_plane *plane, double to[4][4]) {
    enum { KNOWN = CALIBRATION_CAMERA_PARAMETERS, ALL = CALIBRATION_ALL_CAMERA_PARAMETERS };
    double c[ALL][ALL], values[ALL];
    g_autofree struct view *moved = g_new0(struct view, n);
    for (int i = 0; i < ALL; i++)
        for (int k = 0; k < ALL; k++)
            c[i][k] = i >= KNOWN   ? errors->further_covariance[i - KNOWN][k]
                      : k >= KNOWN ? errors->further_covariance[k - KNOWN][i]
                                   : errors->covariance[i][k];
    /* The parameters differ much in size, so the principal axes are those of the correlation
     * matrix. */
    double sigma[ALL];
    for (int i = 0; i < ALL; i++)
        sigma[i] = sqrt(MAX(c[i][i], 0));
    for (int i = 0; i < ALL; i++)
        for (int k = 0; k < ALL; k++)
            c[i][k] = sigma[i] > 0 && sigma[k] > 0 ? c[i][k] / (sigma[i] * sigma[k]) : 0;
    if (LAPACKE_dsyev(LAPACK_ROW_MAJOR, 'V', 'U', ALL, &c[0][0], ALL, values) != 0)
        return FALSE;
    for (int axis = 0; axis < ALL; axis++) {
        double by[ALL], own[3][3];
        struct rig_plane other;
        if (!(values[axis] > 1e-12))
            continue;
        for (int i = 0; i < ALL; i++)
            by[i] = sqrt(values[axis]) * c[i][axis] * sigma[i];
        const struct rig_camera there = changed(camera, by);
        for (int i = 0; i < n; i++)
            if (!weights->out[i] && !view_of(&there, board, &photographs[i], &views[i], &moved[i]))
                return FALSE;
        if (!solve(moved, weights, n, frame, &other, own))
            return FALSE;
        const double d[4] = {other.normal.x - plane->normal.x, other.normal.y - plane->normal.y,
                             other.normal.z - plane->normal.z, other.offset_mm - plane->offset_mm};
        for (int i = 0; i < 4; i++)
            for (int k = 0; k < 4; k++)
                to[i][k] += d[i] * d[k];
    }
    return TRUE;
}

/* Sets the standard error of the plane at the point, and that of the normal in the direction in
 * which it is largest. */
static void set_errors(struct laser_plane *to) {
    const struct vec3 p = to->point_mm;
    const double at[4] = {p.x, p.y, p.z, -1};
    double sum = 0, m[3][3], values[3];
    struct vec3 vectors[3];
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 4; k++)
            sum += at[i] * to->covariance[i][k] * at[k];
    for (int i = 0; i < 3; i++)
        memcpy(m[i], to->covariance[i], sizeof m[i]);
    eigen3((const double(*)[3])m, values, vectors);
    to->offset_error_mm = sqrt(MAX(sum, 0));
    to->tilt_error_rad = sqrt(MAX(values[2], 0));
}

/* Sets an error that the positions of the n boards do not determine a plane. Returns FALSE. */
static gboolean refuse_degenerate(const struct laser_plane *plane, int n, GError **error) {
    return refuse(
        error, LASER_PLANE_ERROR_DEGENERATE,
        "the laser's lines on %d boards are at %.2f mm (RMS) from one straight line, which "
        "does not determine a plane; take photographs with the board nearer, farther away and "
        "at other tilts",
        n, plane->spread_mm);
}

void laser_plane_free(struct laser_plane *plane) {
    if (!plane)
        return;
    g_free(plane->off_mm);
    g_free(plane->left_out);
    g_free(plane);
}

struct laser_plane *laser_plane_fit(const struct rig_camera *camera,
                                    const struct calibration_camera *errors,
                                    const struct board *board,
                                    const struct laser_photograph *photographs, int n,
                                    GError **error) {
    g_autoptr(LaserPlane) to = g_new0(struct laser_plane, 1);
    g_autofree struct view *views = g_new0(struct view, n + 1);
    g_autofree double(*inverse)[2][2] = g_malloc0_n((gsize)n + 1, sizeof *inverse);
    struct frame frame;
    double own[3][3], chi2, length, squares = 0;
    to->off_mm = g_new0(double, n + 1);
    to->left_out = g_new0(gboolean, n + 1);
    struct weights weights = {inverse, to->left_out};
    if (n < LASER_PLANE_MIN) {
        refuse(error, LASER_PLANE_ERROR_PICTURES,
               "only %d photographs show both the board and the line, and at least %d are needed, "
               "with the board at different distances and tilts",
               n, LASER_PLANE_MIN);
        return NULL;
    }
    for (int i = 0; i < n; i++)
        if (!view_of(camera, board, &photographs[i], NULL, &views[i])) {
            refuse(error, LASER_PLANE_ERROR_PICTURES,
                   "%s: the pose of the board, or the laser's line on the board, cannot be "
                   "computed; leave this photograph out",
                   photographs[i].name);
            return NULL;
        }
    frame_of(views, to->left_out, n, &frame, &to->spread_mm, &length);
    if (to->spread_mm < MIN_SPREAD * length) {
        refuse_degenerate(to, n, error);
        return NULL;
    }
    if (!fit_plane(camera, views, n, &weights, &frame, &to->plane, own, &chi2,
                   &to->expected_rms_mm)) {
        refuse(error, LASER_PLANE_ERROR_DEGENERATE,
               "the laser's lines on %d boards do not determine a plane; hold the board nearer, "
               "farther away and at other tilts",
               n);
        return NULL;
    }
    for (int i = 0; i < n; i++) {
        double r[2];
        distances(&views[i], to->plane.normal, to->plane.offset_mm, r);
        to->off_mm[i] = sqrt((r[0] * r[0] + r[1] * r[1]) / 2);
        to->used += !to->left_out[i];
        to->dots += to->left_out[i] ? 0 : (int)photographs[i].dots->len;
        squares += to->left_out[i] ? 0 : r[0] * r[0] + r[1] * r[1];
    }
    if (to->used < LASER_PLANE_MIN || 2 * to->used <= n) {
        refuse(
            error, LASER_PLANE_ERROR_PICTURES,
            "the lines of only %d of %d photographs lie in one plane, probably because the laser "
            "or the camera has moved between photographs; take the photographs again",
            to->used, n);
        return NULL;
    }
    const int freedom = 2 * to->used - 3;
    const double scale = chi2 > freedom ? chi2 / freedom * student(freedom) : 1;
    for (int i = 0; i < 9; i++)
        own[i / 3][i % 3] *= scale;
    to->rms_mm = sqrt(squares / (2 * to->used));
    /* frame must stay the frame of the parameters, so frame_of() writes to another one. */
    struct frame scratch;
    frame_of(views, to->left_out, n, &scratch, &to->spread_mm, &length);
    if (to->spread_mm < MIN_SPREAD * length) {
        refuse_degenerate(to, to->used, error);
        return NULL;
    }
    to->point_mm =
        vec3_sub(frame.point, vec3_scale(to->plane.normal, vec3_dot(to->plane.normal, frame.point) -
                                                               to->plane.offset_mm));
    struct vec3 along = vec3(0, 0, 0);
    for (int i = 0; i < n; i++) {
        const struct vec3 d = vec3_sub(views[i].ends[1], views[i].ends[0]);
        along = to->left_out[i] ? along
                                : vec3_add(along, vec3_scale(d, vec3_dot(d, along) < 0 ? -1 : 1));
    }
    to->along =
        vec3_unit(vec3_sub(along, vec3_scale(to->plane.normal, vec3_dot(to->plane.normal, along))));
    add_own_covariance(&frame, (const double(*)[3])own, to->covariance);
    if (errors && errors->known &&
        !add_camera_covariance(camera, errors, board, photographs, n, views, &weights, &frame,
                               &to->plane, to->covariance)) {
        refuse(error, LASER_PLANE_ERROR_PICTURES,
               "the errors of the camera's calibration are too large to determine the plane; "
               "calibrate the camera's lens from more photographs");
        return NULL;
    }
    /* Let the normal point away from the camera. */
    const struct vec3 eye = rig_camera_centre_mm(camera);
    if (vec3_dot(to->plane.normal, eye) > to->plane.offset_mm) {
        to->plane.normal = vec3_scale(to->plane.normal, -1);
        to->plane.offset_mm = -to->plane.offset_mm;
    }
    set_errors(to);
    if (to->tilt_error_rad * DEG > MAX_TILT_DEG) {
        refuse(error, LASER_PLANE_ERROR_DEGENERATE,
               "the photographs determine the laser's plane only to ± %.1f°, and ± %g° is needed; "
               "hold the board nearer, farther away and at other tilts",
               to->tilt_error_rad * DEG, MAX_TILT_DEG);
        return NULL;
    }
    return g_steal_pointer(&to);
}
