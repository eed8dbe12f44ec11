#include "rgl_private.h"

#include <string.h>

#include "base/data_error.h"
#include "base/direction.h"
#include "tensor_file.h"
#include "warp.h"

#define N_THETA  18 /* number of directions of incidence: 0°, 5° … 85° */
#define STEP_DEG 5.0
#define N_PHI    25 /* number of azimuths of incidence in an anisotropic file: −180° … 180° */
#define N_A      64 /* number of columns (elevations) of ndf, sigma and vndf */
/* number of azimuths of ndf, sigma and vndf; the tables have one more row, because the last row
 * repeats the first */
#define N_B        48
#define ROWS       (N_B + 1)
#define SIDE       32   /* number of nodes of the sample space along an axis */
#define ITERATIONS 8    /* number of steps of the power iteration; Dupuy et al. 2015 need 4 */
#define MIN_D      0.3  /* minimum of D, relative to D of the uniform hemisphere, which is 1/π */
#define UNIFORM    0.5  /* share of a constant in vndf, so that the whole square is sampled */
#define MIN_SHARE  1e-4 /* minimum of the table luminance, relative to its mean */
#define HORIZON    0.01 /* cos θ of the direction that replaces directions below the surface */

static const struct warp_slices only = {1, {0}, {1}};

struct rgl_writing {
    BrdfFunction f;
    gpointer data;
    const struct rgl_options *options;
    int n_phi, n_turns;
    float phi[N_PHI], theta[N_THETA];
    float ndf[ROWS * N_A], sigma[ROWS * N_A];
    double spectra[RGL_WAVELENGTHS][3];
    double directions[N_B * N_A][3],
        solid[N_B * N_A];                      /* direction m and solid angle dm of each node */
    double d[N_B * N_A], projected[N_B * N_A]; /* D and σ of each node */
    /* tables of the file; the table “spectra” is in values */
    float *vndf, *luminance, *rgb, *values;
};

static void direction(double theta, double phi, double ret[3]) {
    ret[0] = sin(theta) * cos(phi);
    ret[1] = sin(theta) * sin(phi);
    ret[2] = cos(theta);
}

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Evaluates f or, for an isotropic file, its mean over rotations about the normal. */
static void function(const struct rgl_writing *writing, const double in[3], const double out[3],
                     double ret[3]) {
    ret[0] = ret[1] = ret[2] = 0;
    for (int turn = 0; turn < writing->n_turns; turn++) {
        const double angle = 2 * G_PI * turn / writing->n_turns, c = cos(angle), s = sin(angle);
        const float light[3] = {(float)(c * in[0] - s * in[1]), (float)(s * in[0] + c * in[1]),
                                (float)in[2]};
        const float view[3] = {(float)(c * out[0] - s * out[1]), (float)(s * out[0] + c * out[1]),
                               (float)out[2]};
        float rgb[3];
        writing->f(light, view, rgb, writing->data);
        for (int k = 0; k < 3; k++)
            ret[k] += (double)rgb[k] / writing->n_turns;
    }
}

static double rgl_luminance(const double rgb[3]) {
    return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
}

/* Sets the direction of each node and its solid angle: dm = sin θ dθ dφ with dθ = π u du, by the
 * trapezoidal rule in u. */
static void place_nodes(struct rgl_writing *writing) {
    for (int b = 0; b < N_B; b++)
        for (int a = 0; a < N_A; a++) {
            const double u = a / (N_A - 1.0), theta = rgl_theta_of_u(u);
            const double step = (a == 0 || a == N_A - 1 ? 0.5 : 1) / (N_A - 1.0);
            direction(theta, rgl_phi_of_u((double)b / N_B), writing->directions[b * N_A + a]);
            writing->solid[b * N_A + a] = sin(theta) * G_PI * u * step * 2 * G_PI / N_B;
        }
}

/* Computes σ of the directions of row b. If D is isotropic, all rows are equal, and only row 0 is
 * computed. */
static void project(int b, gpointer data) {
    struct rgl_writing *writing = data;
    const int row = writing->options->isotropic ? 0 : b;
    if (row != b)
        return;
    for (int a = 0; a < N_A; a++) {
        double sum = 0;
        for (int k = 0; k < N_B * N_A; k++)
            sum += MAX(dot(writing->directions[b * N_A + a], writing->directions[k]), 0) *
                   writing->d[k] * writing->solid[k];
        writing->projected[b * N_A + a] = sum;
    }
}

static void project_all(struct rgl_writing *writing, const struct work *work) {
    work_for_each(work->n_threads, N_B, project, writing);
    for (int k = N_A; k < N_B * N_A && writing->options->isotropic; k++)
        writing->projected[k] = writing->projected[k % N_A];
}

static void find_d(struct rgl_writing *writing, const struct work *work) {
    g_autofree double *back = g_new(double, N_B *N_A); /* 4 f (ω, ω) cos θ */
    for (int k = 0; k < N_B * N_A; k++) {
        const double *w = writing->directions[k];
        double rgb[3] = {0};
        writing->d[k] = 1 / G_PI;
        if (writing->options->isotropic && k >= N_A)
            back[k] = back[k % N_A];
        else if (w[2] > HORIZON) {
            function(writing, w, w, rgb);
            back[k] = 4 * MAX(rgl_luminance(rgb), 0) * w[2];
        } else
            back[k] = 0;
    }
    for (int i = 0; i < ITERATIONS; i++) {
        double whole = 0;
        project_all(writing, work);
        for (int k = 0; k < N_B * N_A; k++) {
            writing->d[k] = back[k] * writing->projected[k];
            whole += writing->d[k] * MAX(writing->directions[k][2], 0) * writing->solid[k];
        }
        for (int k = 0; k < N_B * N_A; k++)
            writing->d[k] = whole > 0 ? writing->d[k] / whole : 1 / G_PI;
    }
    for (int k = 0; k < N_B * N_A; k++)
        writing->d[k] = MAX(writing->d[k], MIN_D / G_PI);
    project_all(writing, work);
    for (int k = 0; k < ROWS * N_A; k++) {
        writing->ndf[k] = (float)writing->d[k % (N_B * N_A)];
        writing->sigma[k] = (float)writing->projected[k % (N_B * N_A)];
    }
}

/* Computes vndf of rgl.h: the mean of a constant and of the density of visible normals over the
 * unit square. dm/du is 2π² u sin θ. */
static void fill_vndf(const struct rgl_writing *writing, const double in[3], double phi_i,
                      double area, float *ret) {
    const struct warp_table ndf = {N_A, ROWS, 1, writing->ndf};
    for (int b = 0; b < ROWS; b++)
        for (int a = 0; a < N_A; a++) {
            const double u = a / (N_A - 1.0), u_phi = (double)b / N_B, theta = rgl_theta_of_u(u);
            const double phi = rgl_phi_of_u(u_phi) + (writing->options->isotropic ? phi_i : 0);
            double m[3];
            direction(theta, phi, m);
            const double d = warp_table_value(&ndf, &only, u, u_phi);
            const double visible = d * MAX(dot(in, m), 0) / area;
            ret[b * N_A + a] =
                (float)((1 - UNIFORM) * visible * 2 * G_PI * G_PI * u * sin(theta) + UNIFORM);
        }
}

/* Gives the direction from which the microfacet m reflects light into `in`, and returns cos θ of
 * this direction. If the direction is below the surface, returns 0 and gives a direction just above
 * the horizon. */
static double reflect(const double in[3], const double m[3], double ret[3]) {
    const double twice = 2 * dot(in, m);
    for (int k = 0; k < 3; k++)
        ret[k] = twice * m[k] - in[k];
    const double cosine = MAX(ret[2], 0);
    if (cosine >= HORIZON)
        return cosine;
    ret[2] = HORIZON;
    const double length = sqrt(dot(ret, ret));
    for (int k = 0; k < 3; k++)
        ret[k] /= length;
    return cosine;
}

/* Fills the tables of one direction of incidence. */
static void fill(int slice, gpointer data) {
    struct rgl_writing *writing = data;
    const double phi_i = (double)writing->phi[slice / N_THETA];
    const double theta_i = (double)writing->theta[slice % N_THETA];
    const struct warp_table ndf = {N_A, ROWS, 1, writing->ndf};
    const struct warp_table sigma = {N_A, ROWS, 1, writing->sigma};
    float *vndf = writing->vndf + (gsize)slice * ROWS * N_A;
    float *luminance = writing->luminance + (gsize)slice * SIDE * SIDE;
    float *rgb = writing->rgb + (gsize)slice * 3 * SIDE * SIDE;
    float *values = writing->values + (gsize)slice * RGL_WAVELENGTHS * SIDE * SIDE;
    double in[3], mean = 0;
    direction(theta_i, phi_i, in);
    const double area =
        warp_table_value(&sigma, &only, rgl_u_of_theta(theta_i), (phi_i + G_PI) / (2 * G_PI));
    fill_vndf(writing, in, phi_i, area, vndf);
    g_autoptr(Warp) warp = warp_new(N_A, ROWS, 1, vndf);
    for (int i = 0; i < SIDE * SIDE; i++) {
        const int row = i / SIDE, column = i % SIDE;
        double u[2], m[3], out[3], f[3];
        warp_sample(warp, &only, column / (SIDE - 1.0), row / (SIDE - 1.0), u);
        direction(rgl_theta_of_u(u[0]),
                  rgl_phi_of_u(u[1]) + (writing->options->isotropic ? phi_i : 0), m);
        const double cosine = reflect(in, m, out);
        function(writing, out, in, f);
        const double factor = 4 * area * cosine / warp_table_value(&ndf, &only, u[0], u[1]);
        for (int c = 0; c < 3; c++)
            rgb[c * SIDE * SIDE + i] = (float)(f[c] * factor);
        for (int k = 0; k < RGL_WAVELENGTHS; k++) {
            const double *mix = writing->spectra[k];
            values[k * SIDE * SIDE + i] =
                (float)(factor * (mix[0] * f[0] + mix[1] * f[1] + mix[2] * f[2]));
        }
        luminance[i] = (float)(MAX(rgl_luminance(f), 0) * factor);
        mean += (double)luminance[i] / (SIDE * SIDE);
    }
    for (int i = 0; i < SIDE * SIDE; i++)
        luminance[i] = MAX(luminance[i], (float)(mean > 0 ? MIN_SHARE * mean : 1));
}

static gboolean fields(const char *path, const struct rgl_writing *writing,
                       const struct rgl_options *options, GError **error) {
    const gsize phis = (gsize)writing->n_phi, rows = options->isotropic ? 2 : ROWS;
    const char *text = options->description ? options->description : "";
    const guint8 jacobian = 1;
    g_autoptr(TensorFile) file = tensor_file_new();
    tensor_file_add(file, "description", TENSOR_UINT8, 1, (const gsize[]){strlen(text)}, text);
    tensor_file_add(file, "phi_i", TENSOR_FLOAT32, 1, (const gsize[]){phis}, writing->phi);
    tensor_file_add(file, "theta_i", TENSOR_FLOAT32, 1, (const gsize[]){N_THETA}, writing->theta);
    tensor_file_add(file, "ndf", TENSOR_FLOAT32, 2, (const gsize[]){rows, N_A}, writing->ndf);
    tensor_file_add(file, "sigma", TENSOR_FLOAT32, 2, (const gsize[]){rows, N_A}, writing->sigma);
    tensor_file_add(file, "vndf", TENSOR_FLOAT32, 4, (const gsize[]){phis, N_THETA, ROWS, N_A},
                    writing->vndf);
    tensor_file_add(file, "luminance", TENSOR_FLOAT32, 4,
                    (const gsize[]){phis, N_THETA, SIDE, SIDE}, writing->luminance);
    tensor_file_add(file, "rgb", TENSOR_FLOAT32, 5, (const gsize[]){phis, N_THETA, 3, SIDE, SIDE},
                    writing->rgb);
    if (!options->rgb_only) {
        tensor_file_add(file, "wavelengths", TENSOR_FLOAT32, 1, (const gsize[]){RGL_WAVELENGTHS},
                        rgl_wavelengths_nm);
        tensor_file_add(file, "spectra", TENSOR_FLOAT32, 5,
                        (const gsize[]){phis, N_THETA, RGL_WAVELENGTHS, SIDE, SIDE},
                        writing->values);
    }
    tensor_file_add(file, "jacobian", TENSOR_UINT8, 1, (const gsize[]){1}, &jacobian);
    return tensor_file_write(path, file, error);
}

gboolean rgl_write(const char *path, BrdfFunction f, gpointer data,
                   const struct rgl_options *options, const struct work *work,
                   struct rgl_result *ret, GError **error) {
    g_autofree struct rgl_writing *writing = g_new0(struct rgl_writing, 1);
    writing->f = f;
    writing->data = data;
    writing->options = options;
    writing->n_phi = options->isotropic ? 1 : N_PHI;
    writing->n_turns = options->isotropic ? MAX(options->n_turns, 1) : 1;
    for (int i = 0; i < writing->n_phi && !options->isotropic; i++)
        writing->phi[i] = (float)(2 * G_PI * i / (N_PHI - 1) - G_PI);
    for (int i = 0; i < N_THETA; i++)
        writing->theta[i] = (float)(i * STEP_DEG * G_PI / 180);
    const gsize slices = (gsize)writing->n_phi * N_THETA, samples = slices * SIDE * SIDE;
    g_autofree float *vndf = writing->vndf = g_new(float, slices *ROWS *N_A);
    g_autofree float *luminance = writing->luminance = g_new(float, samples);
    g_autofree float *rgb = writing->rgb = g_new(float, 3 * samples);
    g_autofree float *values = writing->values = g_new(float, RGL_WAVELENGTHS *samples);
    rgl_colour_spectra(writing->spectra);
    place_nodes(writing);
    find_d(writing, work);
    *ret = (struct rgl_result){writing->n_phi, N_THETA, SIDE};
    return work_parallel(work, "export", (int)slices, fill, writing, error) &&
           fields(path, writing, options, error);
}
