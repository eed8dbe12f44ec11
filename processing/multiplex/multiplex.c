#include "multiplex.h"

#include <math.h>

/*
 * The row of pattern 0, d; s_kj = d[(j − k) mod n]. It is the complement of a cyclic difference set
 * of (n − 1)/2 elements, any two of whose shifts meet in (n − 3)/4: of the non-residues modulo a
 * prime n = 4t + 3 (Paley), of the zeros of a maximal-length sequence for 15 and 63 (Singer), and
 * of twin primes for 35 = 5 · 7. Each is turned so that d[0] = 1.
 */
#define BLOCK 4096 /* pixels that are solved together */

static gboolean multiplex_is_prime(int n) {
    for (int d = 2; d * d <= n; d++)
        if (n % d == 0)
            return FALSE;
    return n > 1;
}

static gboolean multiplex_is_residue(int x, int n) {
    for (int i = 1; i < n; i++)
        if (i * i % n == x)
            return TRUE;
    return FALSE;
}

/* 1: a residue, −1: none, 0: a multiple of the prime n. */
static int multiplex_legendre(int x, int n) {
    return x % n == 0 ? 0 : multiplex_is_residue(x % n, n) ? 1 : -1;
}

static gboolean multiplex_is_order(int n) {
    return n >= MULTIPLEX_LEAST && n <= MULTIPLEX_MOST && n % 4 == 3 &&
           (multiplex_is_prime(n) || n == 15 || n == 35 || n == 63);
}

int multiplex_order(int most) {
    int n = MIN(most, MULTIPLEX_MOST);
    while (n >= MULTIPLEX_LEAST && !multiplex_is_order(n))
        n--;
    return n >= MULTIPLEX_LEAST ? n : 0;
}

/* x^bits + x + 1 is primitive for 4 and 6 bits. */
static void multiplex_sequence(int bits, guint8 *ret) {
    const int n = (1 << bits) - 1;
    for (int i = 0; i < n; i++)
        ret[i] = i < bits ? i == 0 : ret[i - bits] ^ ret[i - bits + 1];
}

/* Turned by 1: 35's own set has 0, so that its complement has not. */
static void multiplex_twin_primes(guint8 *ret) {
    for (int i = 0; i < 35; i++) {
        const int x = (i + 5) % 35;
        ret[i] = multiplex_legendre(x, 7) != 0 &&
                 multiplex_legendre(x, 5) * multiplex_legendre(x, 7) != 1;
    }
}

static void multiplex_make_row(int n, guint8 *ret) {
    if (n == 15 || n == 63)
        multiplex_sequence(n == 15 ? 4 : 6, ret);
    else if (n == 35)
        multiplex_twin_primes(ret);
    else
        for (int i = 0; i < n; i++)
            ret[i] = multiplex_legendre(i, n) >= 0;
}

/* Of each order, made when it is first wanted. */
static const guint8 *multiplex_row(int n) {
    static guint8 rows[MULTIPLEX_MOST + 1][MULTIPLEX_MOST];
    static gsize made[MULTIPLEX_MOST + 1];
    g_return_val_if_fail(multiplex_is_order(n), rows[0]);
    if (g_once_init_enter(&made[n])) {
        multiplex_make_row(n, rows[n]);
        g_once_init_leave(&made[n], 1);
    }
    return rows[n];
}

gboolean multiplex_lit(int n, int pattern, int lamp) {
    return multiplex_row(n)[(lamp - pattern + n) % n];
}

void multiplex_solve(int n, float *const *pictures, gsize n_pixels) {
    const guint8 *row = multiplex_row(n);
    const double scale = 2.0 / (n + 1);
    g_autofree double *sums = g_new(double, (gsize)(n + 1) * BLOCK);
    double *all = sums + (gsize)n * BLOCK;
    for (gsize from = 0; from < n_pixels; from += BLOCK) {
        const gsize count = MIN(n_pixels - from, (gsize)BLOCK);
        for (gsize i = 0; i < (gsize)(n + 1) * BLOCK; i++)
            sums[i] = 0;
        for (int k = 0; k < n; k++) {
            const float *picture = pictures[k] + from;
            for (gsize i = 0; i < count; i++)
                all[i] += (double)picture[i];
            for (int j = 0; j < n; j++) {
                double *sum = sums + (gsize)j * BLOCK;
                if (row[(j - k + n) % n])
                    for (gsize i = 0; i < count; i++)
                        sum[i] += (double)picture[i];
            }
        }
        for (int j = 0; j < n; j++)
            for (gsize i = 0; i < count; i++)
                pictures[j][from + i] = (float)(scale * (2 * sums[(gsize)j * BLOCK + i] - all[i]));
    }
}

double multiplex_variance(int n) {
    return 4.0 * n / ((n + 1.0) * (n + 1.0));
}

double multiplex_part_variance(int n, double part, double floor, double slope) {
    const double lit = (n + 1) / 2.0;
    return multiplex_variance(n) * (floor / (part * part) + slope * lit / part);
}

/* A/r² + B/r = a + b·x, A and B being the two terms at r = 1. */
double multiplex_part(int n, double floor, double slope) {
    const double a = multiplex_part_variance(n, 1, floor, 0);
    const double b = multiplex_part_variance(n, 1, 0, slope);
    const double wanted = floor + slope;
    g_return_val_if_fail(wanted > 0, 1);
    return (b + sqrt(b * b + 4 * a * wanted)) / (2 * wanted);
}
