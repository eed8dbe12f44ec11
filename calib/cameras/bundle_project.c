/* This file has the projection of the bundle adjustment, and its derivatives by the chain rule. */
#include "bundle_private.h"

#include "geometry/rig.h"

#include <stdlib.h>
#include <string.h>

#define MIN_Z 1e-6 /* smallest z of a point that counts as in front of the camera */
/* smallest denominator of a rational lens; where the denominator is negative, the image would be
 * mirrored */
#define MIN_BELOW 1e-3

static struct mat3 product(const double a[9], const struct mat3 *b) {
    struct mat3 ret;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            ret.m[i][k] =
                a[3 * i] * b->m[0][k] + a[3 * i + 1] * b->m[1][k] + a[3 * i + 2] * b->m[2][k];
    return ret;
}

/* Rodrigues' formula: exp([ω]×) = I + a [ω]× + b [ω]×², with t = |ω|, a = sin t / t and b = (1 −
 * cos t) / t². ret_j gets the columns of J = I − b [ω]× + c [ω]×² with c = (t − sin t) / t³. To
 * first order, exp([ω + d]×) = exp([ω]×) exp([J d]×) (Chirikjian 2011 §10.8). */
static void exponential(const double omega[3], struct mat3 *ret, struct vec3 ret_j[3]) {
    const struct vec3 w = vec3(omega[0], omega[1], omega[2]);
    const double s = vec3_dot(w, w), t = sqrt(s);
    const gboolean small = s < 1e-4;
    const double a = small ? 1 - s / 6 + s * s / 120 : sin(t) / t;
    const double b = small ? 0.5 - s / 24 + s * s / 720 : (1 - cos(t)) / s;
    const double c = small ? 1.0 / 6 - s / 120 + s * s / 5040 : (t - sin(t)) / (s * t);
    for (int k = 0; k < 3; k++) {
        const struct vec3 e = vec3(k == 0, k == 1, k == 2), x = vec3_cross(w, e);
        const struct vec3 xx = vec3_cross(w, x);
        const struct vec3 r =
            vec3_add(e, vec3_add(vec3_scale(x, a), vec3_scale(xx, b))); /* column k */
        ret->m[0][k] = r.x;
        ret->m[1][k] = r.y;
        ret->m[2][k] = r.z;
        ret_j[k] = vec3_add(e, vec3_add(vec3_scale(x, -b), vec3_scale(xx, c)));
    }
}

gboolean bundle_has(enum rig_lens lens, int i) {
    return lens == RIG_LENS_RATIONAL ? TRUE : lens == RIG_LENS_FISHEYE ? i < 7 || i == 9 : i < 9;
}

/* The fisheye of lens.h: u = X d(θ) / a, with a = |(X, Y)| and tan θ = a / Z. j has the
 * derivatives of u, v with respect to X, Y, Z. k has the derivatives with respect to the
 * coefficients of distortion, in the order of the intrinsics. Returns FALSE only for a point at
 * the camera's centre or straight behind it. */
static gboolean fisheye(const double *c, struct vec3 q, double uv[2], double j[2][3],
                        double k[2][8]) {
    const double a = hypot(q.x, q.y), xy[2] = {q.x, q.y};
    memset(k, 0, sizeof(double) * 16);
    if (!(a > 1e-9)) {
        for (int i = 0; i < 2; i++) {
            uv[i] = xy[i] / q.z;
            j[i][0] = i == 0 ? 1 / q.z : 0;
            j[i][1] = i == 1 ? 1 / q.z : 0;
            j[i][2] = -uv[i] / q.z;
        }
        return q.z > MIN_Z;
    }
    const double theta = atan2(a, q.z), s = theta * theta, r2 = a * a + q.z * q.z;
    const double d = theta * (1 + s * (c[4] + s * (c[5] + s * (c[6] + s * c[9]))));
    const double slope = 1 + s * (3 * c[4] + s * (5 * c[5] + s * (7 * c[6] + s * 9 * c[9])));
    /* derivative of d / a with respect to a */
    const double by_a = slope * q.z / r2 / a - d / (a * a);
    for (int i = 0; i < 2; i++) {
        uv[i] = xy[i] * d / a;
        j[i][0] = xy[i] * by_a * q.x / a + (i == 0 ? d / a : 0);
        j[i][1] = xy[i] * by_a * q.y / a + (i == 1 ? d / a : 0);
        j[i][2] = -xy[i] * slope / r2;
        k[i][0] = xy[i] / a * theta * s;
        k[i][1] = k[i][0] * s;
        k[i][2] = k[i][1] * s;
        k[i][5] = k[i][2] * s; /* derivative with respect to k4 */
    }
    return TRUE;
}

/* Projects with the polynomial or the rational lens (lens.h). j and k are as in fisheye(). Returns
 * FALSE if the point is behind the camera, or beyond the range of the rational lens. */
static gboolean polynomial(enum rig_lens lens, const double *c, struct vec3 q, double uv[2],
                           double j[2][3], double k[2][8]) {
    const double x = q.x / q.z, y = q.y / q.z, s = x * x + y * y, xy[2] = {x, y};
    const double above = 1 + s * (c[4] + s * (c[5] + s * c[6]));
    const double above_slope = c[4] + s * (2 * c[5] + s * 3 * c[6]);
    const gboolean rational = lens == RIG_LENS_RATIONAL;
    const double below = rational ? 1 + s * (c[9] + s * (c[10] + s * c[11])) : 1;
    const double below_slope = rational ? c[9] + s * (2 * c[10] + s * 3 * c[11]) : 0;
    const double g = above / below, slope = (above_slope - g * below_slope) / below;
    const double p1 = c[7], p2 = c[8], across = 2 * x * y * slope + 2 * (p1 * x + p2 * y);
    uv[0] = x * g + 2 * p1 * x * y + p2 * (s + 2 * x * x);
    uv[1] = y * g + p1 * (s + 2 * y * y) + 2 * p2 * x * y;
    const double by[2][2] = {{g + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x, across},
                             {across, g + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x}};
    for (int i = 0; i < 2; i++) {
        j[i][0] = by[i][0] / q.z;
        j[i][1] = by[i][1] / q.z;
        j[i][2] = -(by[i][0] * x + by[i][1] * y) / q.z;
        double power = xy[i] / below;
        for (int n = 0; n < 3; n++) {
            power *= s;
            k[i][n] = power;
            k[i][5 + n] = rational ? -g * power : 0;
        }
        k[i][3] = i == 0 ? 2 * x * y : s + 2 * y * y;
        k[i][4] = i == 0 ? s + 2 * x * x : 2 * x * y;
    }
    return q.z > MIN_Z && below > MIN_BELOW;
}

/* Multiplies both rows of a by v. */
static void along(const double a[2][3], struct vec3 v, double *ret_x, double *ret_y) {
    *ret_x = a[0][0] * v.x + a[0][1] * v.y + a[0][2] * v.z;
    *ret_y = a[1][0] * v.x + a[1][1] * v.y + a[1][2] * v.z;
}

/* Returns the order n (bundle.h) of the wobble's parameters 2 i and 2 i + 1. */
static int wobble_order(int i) {
    return i == 0 ? -1 : i % 2 ? (i + 3) / 2 : -(i + 2) / 2;
}

/* Computes the tilt x + i y = Σ z_n exp(i n τ) of the bearing (bundle.h) at τ = angle. */
static void wobble_tilt(const double *z, double angle, double ret[2]) {
    ret[0] = ret[1] = 0;
    for (int i = 0; i < BUNDLE_WOBBLE / 2; i++) {
        const double c = cos(wobble_order(i) * angle), s = sin(wobble_order(i) * angle);
        ret[0] += z[2 * i] * c - z[2 * i + 1] * s;
        ret[1] += z[2 * i] * s + z[2 * i + 1] * c;
    }
}

G_STATIC_ASSERT(BUNDLE_HARMONICS == RIG_WOBBLE_HARMONICS);

void bundle_wobble(const double wobble[BUNDLE_WOBBLE], struct rig_wobble *ret) {
    memset(ret, 0, sizeof *ret);
    for (int i = 0; i < BUNDLE_WOBBLE / 2; i++) {
        const int n = wobble_order(i), sign = n < 0 ? -1 : 1;
        const double a = wobble[2 * i], b = wobble[2 * i + 1];
        double *of = ret->rad[abs(n) - 1];
        of[0] += a;
        of[1] -= sign * b;
        of[2] += b;
        of[3] += sign * a;
    }
}

/* Let M = R₀ exp([ω]×), for a lay (M_l) and for a camera (M_c). Then ∂(M x)/∂ω_k = M (J_k × x),
 * where J_k is column k of the J of exponential(). Without wobble, the board's point X is at p =
 * Rz(τ) (M_l X + t). With the board's normal n = M_l (0, 0, 1), t_z = h − (n_x t_x + n_y t_y) /
 * n_z. The camera sees q = M_c p + shift. */
gboolean bundle_image(const struct bundle_camera *camera, const struct bundle_lay *lay,
                      const struct bundle_parameters *at, const double board_mm[2],
                      double ret_px[2], struct bundle_slopes *ret) {
    static const struct vec3 up = {0, 0, 1};
    const double *c = at->lens, *t = at->lay + 3;
    const double squares[3] = {board_mm[0] * board_mm[0], board_mm[0] * board_mm[1],
                               board_mm[1] * board_mm[1]};
    const double *b = at->bend;
    const struct vec3 x = vec3(board_mm[0], board_mm[1],
                               b ? b[0] * squares[0] + b[1] * squares[1] + b[2] * squares[2] : 0);
    struct mat3 turn, m_lay, m_camera;
    struct vec3 j_lay[3], j_camera[3];
    double uv[2], j[2][3], k[2][8];
    exponential(at->lay, &turn, j_lay);
    m_lay = product(lay->rotation, &turn);
    const struct vec3 n = mat3_mul_vec(&m_lay, up);
    const double off = n.x * t[0] + n.y * t[1];
    const struct vec3 from = vec3_add(mat3_mul_vec(&m_lay, x), vec3(t[0], t[1], t[2] - off / n.z));
    const double cosine = cos(at->angle), sine = sin(at->angle);
    const struct vec3 level =
        vec3(cosine * from.x - sine * from.y, sine * from.x + cosine * from.y, from.z);
    double tilt[3] = {0, 0, 0};
    struct mat3 w = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    struct vec3 j_tilt[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    if (at->wobble)
        wobble_tilt(at->wobble, at->commanded, tilt);
    if (tilt[0] != 0 || tilt[1] != 0)
        exponential(tilt, &w, j_tilt);
    const struct vec3 p = mat3_mul_vec(&w, level);
    exponential(at->pose, &turn, j_camera);
    m_camera = product(camera->rotation, &turn);
    const struct vec3 q =
        vec3_add(mat3_mul_vec(&m_camera, p), vec3(at->pose[3], at->pose[4], at->pose[5]));
    if (!(camera->lens == RIG_LENS_FISHEYE ? fisheye(c, q, uv, j, k)
                                           : polynomial(camera->lens, c, q, uv, j, k)))
        return FALSE;
    for (int i = 0; i < 2; i++)
        ret_px[i] = c[i] * uv[i] + c[2 + i];
    if (!ret)
        return TRUE;
    memset(ret->lens, 0, sizeof ret->lens);
    double by_p[2][3], by_level[2][3],
        by_from[2][3]; /* derivatives of the picture's x, y with respect to p, level and from */
    double by_tilt[2][2];
    for (int i = 0; i < 2; i++) {
        ret->lens[i][i] = uv[i];
        ret->lens[i][2 + i] = 1;
        for (int l = 0; l < 8; l++)
            ret->lens[i][4 + l] = c[i] * k[i][l];
        for (int l = 0; l < 3; l++)
            j[i][l] *= c[i];
        for (int l = 0; l < 3; l++)
            by_p[i][l] = j[i][0] * m_camera.m[0][l] + j[i][1] * m_camera.m[1][l] +
                         j[i][2] * m_camera.m[2][l];
        for (int l = 0; l < 3; l++)
            by_level[i][l] =
                by_p[i][0] * w.m[0][l] + by_p[i][1] * w.m[1][l] + by_p[i][2] * w.m[2][l];
        by_from[i][0] = cosine * by_level[i][0] + sine * by_level[i][1];
        by_from[i][1] = cosine * by_level[i][1] - sine * by_level[i][0];
        by_from[i][2] = by_level[i][2];
        ret->pose[i][3] = j[i][0];
        ret->pose[i][4] = j[i][1];
        ret->pose[i][5] = j[i][2];
        ret->lay[i][3] = by_from[i][0] - by_from[i][2] * n.x / n.z;
        ret->lay[i][4] = by_from[i][1] - by_from[i][2] * n.y / n.z;
        ret->lay[i][5] = by_from[i][2];
        const double along_n = by_from[i][0] * n.x + by_from[i][1] * n.y + by_from[i][2] * n.z;
        for (int l = 0; l < 3; l++)
            ret->bend[i][l] = along_n * squares[l];
        ret->angle[i] = -by_level[i][0] * level.y + by_level[i][1] * level.x;
    }
    for (int l = 0; l < 3; l++) {
        along((const double(*)[3])by_p, vec3_cross(j_camera[l], p), &ret->pose[0][l],
              &ret->pose[1][l]);
        struct vec3 moved = mat3_mul_vec(&m_lay, vec3_cross(j_lay[l], x));
        const struct vec3 dn = mat3_mul_vec(&m_lay, vec3_cross(j_lay[l], up));
        moved.z -= (dn.x * t[0] + dn.y * t[1] - off * dn.z / n.z) / n.z;
        along((const double(*)[3])by_from, moved, &ret->lay[0][l], &ret->lay[1][l]);
        if (l < 2) /* ∂(W x)/∂tilt = W (J × x) */
            along((const double(*)[3])by_level, vec3_cross(j_tilt[l], level), &by_tilt[0][l],
                  &by_tilt[1][l]);
    }
    for (int i = 0; i < BUNDLE_WOBBLE / 2; i++) {
        const double along_x = cos(wobble_order(i) * at->commanded);
        const double along_y = sin(wobble_order(i) * at->commanded);
        for (int l = 0; l < 2; l++) {
            ret->wobble[l][2 * i] = by_tilt[l][0] * along_x + by_tilt[l][1] * along_y;
            ret->wobble[l][2 * i + 1] = by_tilt[l][1] * along_x - by_tilt[l][0] * along_y;
        }
    }
    return TRUE;
}

void bundle_centre(const struct bundle_camera *camera, const double pose[6], double ret_mm[3],
                   double ret_slopes[3][6]) {
    const double *r0 = camera->rotation, minus[3] = {-pose[0], -pose[1], -pose[2]};
    struct mat3 turn;
    struct vec3 j[3], columns[6];
    struct vec3 v = vec3(0, 0, 0);
    exponential(minus, &turn, j);
    for (int k = 0; k < 3; k++) { /* rows of R₀ are columns of R₀ᵀ */
        const struct vec3 row = vec3(r0[3 * k], r0[3 * k + 1], r0[3 * k + 2]);
        v = vec3_add(v, vec3_scale(row, pose[3 + k]));
        columns[3 + k] = mat3_mul_vec(&turn, row);
    }
    for (int k = 0; k < 3; k++)
        columns[k] = vec3_scale(mat3_mul_vec(&turn, vec3_cross(j[k], v)), -1);
    const struct vec3 centre = mat3_mul_vec(&turn, v);
    ret_mm[0] = -centre.x;
    ret_mm[1] = -centre.y;
    ret_mm[2] = -centre.z;
    for (int k = 0; k < 6; k++) {
        ret_slopes[0][k] = -columns[k].x;
        ret_slopes[1][k] = -columns[k].y;
        ret_slopes[2][k] = -columns[k].z;
    }
}

/* Rounding errors accumulate over many solves. R (3 I − Rᵀ R) / 2 is a Newton step from R towards
 * the nearest rotation. It reduces a deviation ε from a rotation to the order of ε². */
void bundle_turn(double rotation[9], const double omega[3]) {
    struct mat3 turn, r;
    struct vec3 j[3];
    exponential(omega, &turn, j);
    r = product(rotation, &turn);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            double sum = 1.5 * r.m[i][k];
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++)
                    sum -= 0.5 * r.m[i][a] * r.m[b][a] * r.m[b][k];
            rotation[3 * i + k] = sum;
        }
}
