#include "merl.h"

#include <math.h>
#include <string.h>
#include <unistd.h>

#include "base/data_error.h"
#include "base/input_file.h"
#include "base/output_file.h"

#define THETA_H 90
#define THETA_D 90
#define PHI_D   180
/* the number that the file gets for a bin with a direction below the surface */
#define BELOW (-1.0)

static const double scales[3] = {1 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0};

struct merl {
    int n_phi;     /* PHI_D, or 2 · PHI_D if the BRDF is not reciprocal */
    float *values; /* 3 × THETA_H × THETA_D × n_phi: f_r, or a negative number */
};

/* Reads the three colours. The numbers of one colour are converted before the next colour is read,
 * so that the doubles of only one colour are in memory. */
static gboolean read_colours(struct merl *merl, int fd, const char *path, GError **error) {
    const gsize n = (gsize)THETA_H * THETA_D * (gsize)merl->n_phi;
    g_autofree double *row = g_new(double, n);
    gsize bad = 0;
    merl->values = g_new(float, 3 * n);
    for (gsize c = 0; c < 3; c++) {
        GError *found = NULL;
        if (!input_file_read_at(fd, path, row, n * sizeof *row, 12 + c * n * sizeof *row, &found)) {
            input_file_propagate(found, DATA_ERROR, DATA_ERROR_IO, DATA_ERROR_INVALID, error);
            return FALSE;
        }
        for (gsize i = 0; i < n; i++) {
            bad += !(fabs(row[i]) < 1e30);
            merl->values[c * n + i] = (float)(row[i] * scales[c]);
        }
    }
    return bad == 0 || data_error_fail(path, 0, error,
                                       "%zu of the %zu numbers are not finite; copy the file again",
                                       bad, 3 * n);
}

struct merl *merl_read(const char *path, GError **error) {
    gint32 sizes[3] = {0};
    guint64 length;
    GError *found = NULL;
    const guint64 most = 12 + (guint64)3 * 8 * THETA_H * THETA_D * 2 * PHI_D;
    const int fd = input_file_open(path, most, &length, &found);
    if (fd < 0) {
        input_file_propagate(found, DATA_ERROR, DATA_ERROR_IO, DATA_ERROR_INVALID, error);
        return NULL;
    }
    struct merl *merl = g_new0(struct merl, 1);
    gboolean ok =
        length >= sizeof sizes && input_file_read_at(fd, path, sizes, sizeof sizes, 0, NULL) &&
        sizes[0] == THETA_H && sizes[1] == THETA_D && (sizes[2] == PHI_D || sizes[2] == 2 * PHI_D);
    if (length < sizeof sizes)
        data_error_set(path, 0, error,
                       "the file has only %" G_GUINT64_FORMAT
                       " bytes, which is too short for MERL's format; copy it again",
                       length);
    else if (!ok)
        data_error_set(path, 0, error,
                       "the file begins with the numbers %d, %d, %d, but a file in MERL's format "
                       "begins with 90, 90, 180 (or 360); give a file of the MERL database",
                       sizes[0], sizes[1], sizes[2]);
    const guint64 expected = 12 + (guint64)3 * 8 * THETA_H * THETA_D * (guint64)MAX(sizes[2], 0);
    if (ok && length != expected)
        ok = data_error_fail(path, 0, error,
                             "the file has %" G_GUINT64_FORMAT
                             " bytes instead of %" G_GUINT64_FORMAT "; copy it again",
                             length, expected);
    if (ok) {
        merl->n_phi = sizes[2];
        ok = read_colours(merl, fd, path, error);
    }
    close(fd);
    if (!ok)
        g_clear_pointer(&merl, merl_free);
    return merl;
}

void merl_free(struct merl *merl) {
    if (!merl)
        return;
    g_free(merl->values);
    g_free(merl);
}

void merl_evaluate(const struct merl *merl, const float light[3], const float view[3],
                   float ret[3]) {
    double h[3], length = 0;
    for (int k = 0; k < 3; k++) {
        h[k] = (double)light[k] + (double)view[k];
        length += h[k] * h[k];
    }
    length = sqrt(length);
    const double flat = hypot(h[0], h[1]);
    const double theta_h = atan2(flat, h[2]), sine = flat / length, cosine = h[2] / length;
    const double cos_phi = flat > 0 ? h[0] / flat : 1, sin_phi = flat > 0 ? h[1] / flat : 0;
    /* Computes d = R_y(−θ_h) R_z(−φ_h) l (merl.h). */
    const double x = cos_phi * (double)light[0] + sin_phi * (double)light[1];
    const double y = cos_phi * (double)light[1] - sin_phi * (double)light[0];
    const double z = (double)light[2];
    const double d[3] = {cosine * x - sine * z, y, sine * x + cosine * z};
    const double theta_d = atan2(hypot(d[0], d[1]), d[2]);
    double phi_d = atan2(d[1], d[0]);
    if (phi_d < 0)
        phi_d += merl->n_phi == PHI_D ? G_PI : 2 * G_PI;
    const int i = CLAMP((int)(sqrt(MAX(theta_h, 0) * 2 / G_PI) * THETA_H), 0, THETA_H - 1);
    const int j = CLAMP((int)(theta_d * 2 / G_PI * THETA_D), 0, THETA_D - 1);
    const int k = CLAMP((int)(phi_d / G_PI * PHI_D), 0, merl->n_phi - 1);
    const gsize n = (gsize)THETA_H * THETA_D * (gsize)merl->n_phi;
    const gsize at = ((gsize)i * THETA_D + (gsize)j) * (gsize)merl->n_phi + (gsize)k;
    gboolean there = TRUE;
    for (gsize c = 0; c < 3; c++)
        there = there && merl->values[c * n + at] >= 0;
    for (gsize c = 0; c < 3; c++)
        ret[c] = there ? merl->values[c * n + at] : 0;
}

struct writing {
    BrdfBothFunction f;
    gpointer data;
    int n_turns;
    const double (*turns)[2]; /* n_turns: cosine and sine of each rotation */
    double *values;           /* 3 × THETA_H × THETA_D × PHI_D */
    /* Sums over the bins of each θ_h.
     * [0]: squared differences between f and the mean of its bin
     * [1]: squared means */
    double squares[THETA_H][2];
};

/* Gives the directions at the centre of the bin (i of θ_h, j of θ_d, k of φ_d) for φ_h = 0. */
static void directions(int i, int j, int k, double light[3], double view[3]) {
    const double root = (i + 0.5) / THETA_H, theta_h = root * root * G_PI / 2;
    const double theta_d = (j + 0.5) / THETA_D * G_PI / 2, phi_d = (k + 0.5) / PHI_D * G_PI;
    const double x = sin(theta_d) * cos(phi_d), y = sin(theta_d) * sin(phi_d), z = cos(theta_d);
    const double c = cos(theta_h), s = sin(theta_h);
    light[0] = c * x + s * z, light[1] = y, light[2] = c * z - s * x;
    view[0] = s * z - c * x, view[1] = -y, view[2] = c * z + s * x;
}

static void merl_turn(const double from[3], const double turn[2], float ret[3]) {
    const double c = turn[0], s = turn[1];
    ret[0] = (float)(c * from[0] - s * from[1]);
    ret[1] = (float)(s * from[0] + c * from[1]);
    ret[2] = (float)from[2];
}

static void fill_bin(struct writing *writing, int i, gsize at, const double light[3],
                     const double view[3]) {
    const gsize n = (gsize)THETA_H * THETA_D * PHI_D;
    const int count = 2 * writing->n_turns;
    double sum[3] = {0}, squares = 0;
    for (int turn = 0; turn < writing->n_turns; turn++) {
        float l[3], v[3], both[2][3];
        merl_turn(light, writing->turns[turn], l);
        merl_turn(view, writing->turns[turn], v);
        writing->f(l, v, both, writing->data);
        for (int c = 0; c < 6; c++) {
            const double value = (double)both[c / 3][c % 3];
            sum[c % 3] += value;
            squares += value * value;
        }
    }
    for (gsize c = 0; c < 3; c++) {
        const double mean = sum[c] / count;
        writing->values[c * n + at] = MAX(mean, 0) / scales[c];
        squares -= count * mean * mean;
        writing->squares[i][1] += count * mean * mean;
    }
    writing->squares[i][0] += MAX(squares, 0);
}

static void fill(int i, gpointer data) {
    struct writing *writing = data;
    const gsize n = (gsize)THETA_H * THETA_D * PHI_D;
    for (int j = 0; j < THETA_D; j++)
        for (int k = 0; k < PHI_D; k++) {
            const gsize at = ((gsize)i * THETA_D + (gsize)j) * PHI_D + (gsize)k;
            double light[3], view[3];
            directions(i, j, k, light, view);
            if (light[2] > 0 && view[2] > 0)
                fill_bin(writing, i, at, light, view);
            else
                for (gsize c = 0; c < 3; c++)
                    writing->values[c * n + at] = BELOW;
        }
}

gboolean merl_write(const char *path, BrdfBothFunction f, gpointer data, int n_turns,
                    const struct work *work, struct merl_result *ret, GError **error) {
    const gint32 sizes[3] = {THETA_H, THETA_D, PHI_D};
    const gsize n = (gsize)3 * THETA_H * THETA_D * PHI_D, bytes = sizeof sizes + n * sizeof(double);
    g_autofree guint8 *out = g_malloc(bytes);
    g_autofree double *values = g_new(double, n);
    g_autofree double(*turns)[2] = g_malloc_n((gsize)MAX(n_turns, 1), sizeof *turns);
    struct writing writing = {f, data, MAX(n_turns, 1), turns, values, {{0}}};
    double differences = 0, squares = 0;
    for (int turn = 0; turn < writing.n_turns; turn++) {
        turns[turn][0] = cos(2 * G_PI * turn / writing.n_turns);
        turns[turn][1] = sin(2 * G_PI * turn / writing.n_turns);
    }
    if (!work_parallel(work, "export", THETA_H, fill, &writing, error))
        return FALSE;
    for (int i = 0; i < THETA_H; i++) {
        differences += writing.squares[i][0];
        squares += writing.squares[i][1];
    }
    ret->spread = squares > 0 ? sqrt(differences / squares) : 0;
    memcpy(out, sizes, sizeof sizes);
    memcpy(out + sizeof sizes, values, n * sizeof(double));
    return output_file_write(path, out, bytes, error);
}
