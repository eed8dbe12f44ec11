#include "shadows_private.h"

#include <math.h>
#include <string.h>

#define PART_BLUR_PX 0.16 /* of a quarter of a pixel, and some of the lens; standard deviation */
#define STEPS        25

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

/* How much of a part of a pixel the streak covers: its edge is taken to be straight in it. */
static double cover_part(const struct window *w, const struct streak *streak, double x, double y,
                         double blur_mm) {
    const double h = 0.02;
    double d = shadow_outside_mm(streak, x, y);
    double gx = (shadow_outside_mm(streak, x + h, y) - d) / h;
    double gy = (shadow_outside_mm(streak, x, y + h) - d) / h;
    double across = hypot(gx * w->slope[0] + gy * w->slope[2], gx * w->slope[1] + gy * w->slope[3]);
    double sigma = hypot(PART_BLUR_PX * across, blur_mm);
    return erfc(d / (sigma * G_SQRT2)) / 2;
}

/* Of a pixel: in four parts, since seen at a slant it is not small beside a post. */
static double cover(const struct window *w, const struct streak *streak, const struct pixel *p,
                    double blur_mm) {
    double d = shadow_outside_mm(streak, p->x, p->y), sum = 0;
    if (fabs(d) > w->long_mm + 4 * blur_mm)
        return d < 0;
    for (int k = 0; k < 4; k++) {
        double i = k & 1 ? 0.25 : -0.25, j = k & 2 ? 0.25 : -0.25;
        sum += cover_part(w, streak, p->x + i * w->slope[0] + j * w->slope[1],
                          p->y + i * w->slope[2] + j * w->slope[3], blur_mm);
    }
    return sum / 4;
}

/* Gauss and Newton's normal equations at p; returns the sum of squares. */
static double normal_equations(const struct window *w, const double p[4], double blur_mm,
                               double a[4][4], double b[4]) {
    const double h = 0.01;
    double sum = 0;
    struct streak s[3] = {w->streak, w->streak, w->streak};
    for (int k = 0; k < 3; k++) {
        s[k].to.x = p[0] + (k == 1 ? h : 0);
        s[k].to.y = p[1] + (k == 2 ? h : 0);
        if (!w->near)
            s[k].from = vec3_add(w->streak.from, vec3_sub(s[k].to, w->streak.to));
    }
    memset(a, 0, 16 * sizeof(double));
    memset(b, 0, 4 * sizeof(double));
    for (guint i = 0; i < w->pixels->len; i++) {
        const struct pixel *pixel = &g_array_index(w->pixels, struct pixel, i);
        double c = cover(w, &s[0], pixel, blur_mm), drop = p[3] - p[2];
        double j[4] = {(cover(w, &s[1], pixel, blur_mm) - c) / h * drop,
                       (cover(w, &s[2], pixel, blur_mm) - c) / h * drop, 1 - c, c};
        double r = pixel->value - (p[2] + drop * c);
        sum += r * r;
        for (int m = 0; m < 4; m++) {
            b[m] += j[m] * r;
            for (int n = 0; n < 4; n++)
                a[m][n] += j[m] * j[n];
        }
    }
    return sum;
}

/* Solves a·x = b for each of n right sides, by Cholesky; FALSE: a is not positive definite. */
static gboolean solve4(double a[4][4], double x[4]) {
    for (int j = 0; j < 4; j++) {
        for (int k = 0; k < j; k++)
            a[j][j] -= a[j][k] * a[j][k];
        if (!(a[j][j] > 1e-14))
            return FALSE;
        a[j][j] = sqrt(a[j][j]);
        for (int i = j + 1; i < 4; i++) {
            for (int k = 0; k < j; k++)
                a[i][j] -= a[i][k] * a[j][k];
            a[i][j] /= a[j][j];
        }
    }
    for (int i = 0; i < 4; i++) {
        for (int k = 0; k < i; k++)
            x[i] -= a[i][k] * x[k];
        x[i] /= a[i][i];
    }
    for (int i = 3; i >= 0; i--) {
        for (int k = i + 1; k < 4; k++)
            x[i] -= a[k][i] * x[k];
        x[i] /= a[i][i];
    }
    return TRUE;
}

gboolean shadow_fit_shape(const struct window *w, double blur_mm, struct shape_fit *f) {
    double a[4][4], x[4], copy[4][4], step = HUGE_VAL;
    for (int i = 0; i < STEPS && step > 2e-4; i++) {
        normal_equations(w, f->p, blur_mm, a, x);
        for (int k = 0; k < 4; k++)
            a[k][k] *= 1 + 1e-3;
        if (!solve4(a, x))
            return FALSE;
        step = hypot(x[0], x[1]);
        double most = w->streak.to_mm / 2, scale = step > most ? most / step : 1;
        f->p[0] += scale * x[0];
        f->p[1] += scale * x[1];
        f->p[2] += x[2];
        f->p[3] += x[3];
    }
    double sum = normal_equations(w, f->p, blur_mm, a, x);
    double noise = sum / MAX((int)w->pixels->len - 4, 1);
    for (int k = 0; k < 2; k++) {
        double unit[4] = {k == 0, k == 1, 0, 0};
        memcpy(copy, a, sizeof copy);
        if (!solve4(copy, unit))
            return FALSE;
        f->variance[k] = unit[k] * noise;
    }
    f->rms = sqrt(noise);
    return step <= 0.05 && isfinite(f->p[0]) && isfinite(f->p[1]);
}
