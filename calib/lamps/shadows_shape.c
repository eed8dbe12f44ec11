/* The shape of a shadow's end is value = lit + (dark − lit) · coverage. An edge at the signed
 * distance d covers ½ erfc(d / (√2 σ)) of a quarter of a pixel. σ is the blur across the edge. */
#include "shadows_private.h"

#include <math.h>
#include <string.h>

#define PART_PX2   (0.25 / 12) /* variance of a quarter of a pixel */
#define LENS_PX2   0.05        /* prior variance of the lens's blur */
#define LENS_ERROR 0.1         /* prior standard deviation of that variance */
#define MAX_PX2    4
#define STEPS      25
#define N          SHADOW_SHAPE

/* Blur of a quarter of a pixel: the variance in px², and an additional blur in mm. */
struct blur {
    double px2, mm;
};

/* Returns the distance from the nearest point t (0 … 1) of the axis, minus the radius there, which
 * is interpolated between the discs. */
double shadow_outside_mm(const struct streak *s, double x, double y) {
    double ax = s->to.x - s->from.x, ay = s->to.y - s->from.y;
    double px = x - s->from.x, py = y - s->from.y, length2 = ax * ax + ay * ay;
    double t = length2 > 0 ? CLAMP((px * ax + py * ay) / length2, 0, 1) : 0;
    return hypot(px - t * ax, py - t * ay) - (s->from_mm + t * (s->to_mm - s->from_mm));
}

gboolean shadow_streak(const struct lamp_target *target, int mark, double turntable_rad,
                       struct vec3 source_mm, struct streak *ret) {
    ret->from = lamp_mark_mm(target, mark, turntable_rad);
    ret->from_mm = target->radius_mm;
    return lamp_shadow_mm(target, mark, ret->from, source_mm, &ret->to, &ret->to_mm);
}

/* Returns the coverage of a quarter of a pixel. Blur along an edge with the curvature κ shifts the
 * edge towards its concave side by ½ κ σ_along². */
static double cover_part(const struct window *w, const struct streak *streak, double x, double y,
                         const struct blur *blur) {
    const double h = 0.02, *s = w->slope;
    double d = shadow_outside_mm(streak, x, y);
    double gx = (shadow_outside_mm(streak, x + h, y) - d) / h;
    double gy = (shadow_outside_mm(streak, x, y + h) - d) / h;
    double across = hypot(gx * s[0] + gy * s[2], gx * s[1] + gy * s[3]);
    double along = hypot(gx * s[2] - gy * s[0], gx * s[3] - gy * s[1]);
    double sigma = sqrt(blur->px2 * across * across + blur->mm * blur->mm);
    /* Curvature of the edge in 1/mm: that of the disc around the end, or 0 along the sides. */
    const double ax = streak->to.x - streak->from.x, ay = streak->to.y - streak->from.y;
    const double px = x - streak->to.x, py = y - streak->to.y;
    const double curvature = px * ax + py * ay > 0 ? 1 / MAX(hypot(px, py), streak->to_mm / 2) : 0;
    d += curvature * blur->px2 * along * along / 2;
    return erfc(d / (sigma * G_SQRT2)) / 2;
}

/* Returns the coverage of a pixel as the mean of four quarters, because an obliquely seen pixel is
 * not small compared with a post. */
static double cover(const struct window *w, const struct streak *streak, const struct pixel *p,
                    const struct blur *blur) {
    double d = shadow_outside_mm(streak, p->x, p->y), sum = 0;
    if (fabs(d) > (0.7 + 4 * sqrt(blur->px2)) * w->long_mm + 4 * blur->mm)
        return d < 0;
    for (int k = 0; k < 4; k++) {
        double i = k & 1 ? 0.25 : -0.25, j = k & 2 ? 0.25 : -0.25;
        sum += cover_part(w, streak, p->x + i * w->slope[0] + j * w->slope[1],
                          p->y + i * w->slope[2] + j * w->slope[3], blur);
    }
    return sum / 4;
}

/* Computes the normal equations of Gauss-Newton at p: a = Σ j jᵀ, b = Σ j r, with the residual r of
 * a pixel and its derivatives j. meat, which may be NULL, gets Σ r² j jᵀ for the sandwich
 * estimator. Returns Σ r². */
static double normal_equations(const struct window *w, const double p[N], double blur_mm,
                               double a[N][N], double b[N], double (*meat)[N]) {
    const double h = 0.01;
    double sum = 0;
    const struct blur blur = {PART_PX2 + p[4], blur_mm}, more = {PART_PX2 + p[4] + h, blur_mm};
    struct streak s[3] = {w->streak, w->streak, w->streak};
    for (int k = 0; k < 3; k++) {
        s[k].to.x = p[0] + (k == 1 ? h : 0);
        s[k].to.y = p[1] + (k == 2 ? h : 0);
        if (!w->near)
            s[k].from = vec3_add(w->streak.from, vec3_sub(s[k].to, w->streak.to));
    }
    memset(a, 0, N * N * sizeof(double));
    memset(b, 0, N * sizeof(double));
    for (guint i = 0; i < w->pixels->len; i++) {
        const struct pixel *pixel = &g_array_index(w->pixels, struct pixel, i);
        double c = cover(w, &s[0], pixel, &blur), drop = p[3] - p[2];
        double j[N] = {(cover(w, &s[1], pixel, &blur) - c) / h * drop,
                       (cover(w, &s[2], pixel, &blur) - c) / h * drop, 1 - c, c,
                       (cover(w, &s[0], pixel, &more) - c) / h * drop};
        double r = pixel->value - (p[2] + drop * c);
        sum += r * r;
        for (int m = 0; m < N; m++) {
            b[m] += j[m] * r;
            for (int n = 0; n < N; n++) {
                a[m][n] += j[m] * j[n];
                if (meat)
                    meat[m][n] += j[m] * j[n] * r * r;
            }
        }
    }
    return sum;
}

/* Adds a prior for the blur of the lens to a and b. A shadow as small as a pixel hardly determines
 * the blur by itself. sum is Σ r². */
static void add_usual(const struct window *w, double sum, const double p[N], double a[N][N],
                      double b[N]) {
    const double noise = sum / MAX((int)w->pixels->len - N, 1);
    a[4][4] += noise / (LENS_ERROR * LENS_ERROR);
    b[4] += noise * (LENS_PX2 - p[4]) / (LENS_ERROR * LENS_ERROR);
}

/* Solves a·x = b in place by Cholesky decomposition. Returns FALSE if a is not positive
 * definite. */
static gboolean solve(double a[N][N], double x[N]) {
    for (int j = 0; j < N; j++) {
        for (int k = 0; k < j; k++)
            a[j][j] -= a[j][k] * a[j][k];
        if (!(a[j][j] > 1e-14))
            return FALSE;
        a[j][j] = sqrt(a[j][j]);
        for (int i = j + 1; i < N; i++) {
            for (int k = 0; k < j; k++)
                a[i][j] -= a[i][k] * a[j][k];
            a[i][j] /= a[j][j];
        }
    }
    for (int i = 0; i < N; i++) {
        for (int k = 0; k < i; k++)
            x[i] -= a[i][k] * x[k];
        x[i] /= a[i][i];
    }
    for (int i = N - 1; i >= 0; i--) {
        for (int k = i + 1; k < N; k++)
            x[i] -= a[k][i] * x[k];
        x[i] /= a[i][i];
    }
    return TRUE;
}

/* Returns the heteroscedasticity-consistent variance uᵀ meat u of a parameter (White 1980), where u
 * = unit is its column of a⁻¹. Residuals are larger on edges, and only the edges determine the
 * end. */
static double sandwich(double meat[N][N], const double unit[N]) {
    double sum = 0;
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++)
            sum += unit[i] * meat[i][j] * unit[j];
    return sum;
}

gboolean shadow_fit_shape(const struct window *w, double blur_mm, struct shape_fit *f) {
    double a[N][N], x[N], copy[N][N], step = HUGE_VAL;
    for (int i = 0; i < STEPS && step > 2e-4; i++) {
        add_usual(w, normal_equations(w, f->p, blur_mm, a, x, NULL), f->p, a, x);
        for (int k = 0; k < N; k++)
            a[k][k] *= 1 + 1e-3;
        if (!solve(a, x))
            return FALSE;
        step = hypot(x[0], x[1]);
        double most = w->streak.to_mm / 2, scale = step > most ? most / step : 1;
        f->p[0] += scale * x[0];
        f->p[1] += scale * x[1];
        f->p[2] += x[2];
        f->p[3] += x[3];
        f->p[4] = CLAMP(f->p[4] + x[4], 0, MAX_PX2);
    }
    double meat[N][N] = {{0}};
    double sum = normal_equations(w, f->p, blur_mm, a, x, meat);
    double noise = sum / MAX((int)w->pixels->len - N, 1);
    add_usual(w, sum, f->p, a, x);
    for (int k = 0; k < 2; k++) {
        double unit[N] = {k == 0, k == 1};
        memcpy(copy, a, sizeof copy);
        if (!solve(copy, unit))
            return FALSE;
        f->variance[k] = MAX(sandwich(meat, unit), unit[k] * noise);
    }
    f->rms = sqrt(noise);
    return step <= 0.05 && isfinite(f->p[0]) && isfinite(f->p[1]);
}
