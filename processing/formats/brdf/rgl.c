#include "rgl_private.h"

#include <string.h>

#include "base/data_error.h"
#include "tensor_file.h"
#include "warp.h"

#define MAX_NODES  4096
#define MIN_COSINE 1e-6

struct rgl {
    TensorFile *file;
    int n_phi, n_theta, n_channels;
    const float *phi, *theta; /* n_phi and n_theta nodes in the file, radians */
    struct warp_table ndf, sigma, values;
    Warp *vndf;
    double *colours; /* n_channels × 3: R, G, B of each channel */
    gboolean isotropic, jacobian;
    /* 1 if the file has all azimuths, 2 if it has half of them, 4 if it has a quarter */
    int reduction;
};

void rgl_free(struct rgl *rgl) {
    if (!rgl)
        return;
    tensor_file_free(rgl->file);
    warp_free(rgl->vndf);
    g_free(rgl->colours);
    g_free(rgl);
}

/* Returns a field of finite float32 ("jacobian" is of bytes) with the given number of dimensions.
 * The size of each dimension is 1 … MAX_NODES. Returns NULL with an error if there is no such
 * field. */
static const struct tensor_field *rgl_field(const struct rgl *rgl, const char *path,
                                            const char *name, int n_dimensions, GError **error) {
    const struct tensor_field *field = tensor_file_field(rgl->file, name);
    const enum tensor_type type = strcmp(name, "jacobian") == 0 ? TENSOR_UINT8 : TENSOR_FLOAT32;
    if (!field) {
        data_error_set(path, 0, error,
                       "the file lacks the field “%s”; give a BRDF file in RGL's format (.bsdf)",
                       name);
        return NULL;
    }
    if (field->type != type || field->n_dimensions != n_dimensions) {
        data_error_set(path, 0, error,
                       "the field “%s” has %d dimensions of %s, but must have %d of %s; copy the "
                       "file again, or give another file of the RGL database",
                       name, field->n_dimensions, tensor_type_name(field->type), n_dimensions,
                       tensor_type_name(type));
        return NULL;
    }
    for (int i = 0; i < n_dimensions; i++)
        if (field->shape[i] < 1 || field->shape[i] > MAX_NODES) {
            data_error_set(path, 0, error,
                           "dimension %d of the field “%s” has %zu numbers, but must have 1 to %d; "
                           "copy the file again",
                           i + 1, name, field->shape[i], MAX_NODES);
            return NULL;
        }
    const float *values = field->values;
    for (gsize i = 0; type == TENSOR_FLOAT32 && i < field->n_values; i++)
        if (!isfinite(values[i])) {
            data_error_set(path, 0, error,
                           "number %zu of the field “%s” is not finite; copy the file again", i + 1,
                           name);
            return NULL;
        }
    return field;
}

static gboolean read_nodes(const struct rgl *rgl, const char *path, const char *name,
                           const float **ret, int *ret_n, GError **error) {
    const struct tensor_field *field = rgl_field(rgl, path, name, 1, error);
    if (!field)
        return FALSE;
    *ret = field->values;
    *ret_n = (int)field->shape[0];
    for (int i = 1; i < *ret_n; i++)
        if ((*ret)[i] <= (*ret)[i - 1])
            return data_error_fail(path, 0, error,
                                   "the numbers of the field “%s” must ascend, but number %d does "
                                   "not; copy the file again",
                                   name, i + 1);
    return TRUE;
}

static gboolean read_table(const struct rgl *rgl, const char *path, const char *name,
                           struct warp_table *ret, GError **error) {
    const struct tensor_field *field = rgl_field(rgl, path, name, 2, error);
    if (!field)
        return FALSE;
    *ret = (struct warp_table){.width = (int)field->shape[1],
                               .height = (int)field->shape[0],
                               .n_slices = 1,
                               .values = field->values};
    return TRUE;
}

static gboolean fits(const struct rgl *rgl, const char *path, const struct tensor_field *field,
                     GError **error) {
    return (field->shape[0] == (gsize)rgl->n_phi && field->shape[1] == (gsize)rgl->n_theta) ||
           data_error_fail(path, 0, error,
                           "the field “%s” has %zu × %zu directions of incidence, but phi_i and "
                           "theta_i have %d × %d; copy the file again",
                           field->name, field->shape[0], field->shape[1], rgl->n_phi, rgl->n_theta);
}

static gboolean read_colours(struct rgl *rgl, const char *path, const struct tensor_field *field,
                             GError **error) {
    rgl->n_channels = (int)field->shape[2];
    rgl->colours = g_new0(double, 3 * (gsize)rgl->n_channels);
    if (strcmp(field->name, "rgb") == 0) {
        for (int c = 0; c < 3 && rgl->n_channels == 3; c++)
            rgl->colours[3 * c + c] = 1;
        return rgl->n_channels == 3 ||
               data_error_fail(path, 0, error,
                               "the field “rgb” has %d channels instead of 3; copy the file again",
                               rgl->n_channels);
    }
    const float *wavelengths;
    int n;
    if (!read_nodes(rgl, path, "wavelengths", &wavelengths, &n, error))
        return FALSE;
    if (n != rgl->n_channels)
        return data_error_fail(path, 0, error,
                               "the field “spectra” has %d wavelengths, but the field "
                               "“wavelengths” has %d; copy the file again",
                               rgl->n_channels, n);
    rgl_colour_weights(wavelengths, n, rgl->colours);
    return TRUE;
}

static gboolean read_values(struct rgl *rgl, const char *path, GError **error) {
    const char *name = tensor_file_field(rgl->file, "rgb") ? "rgb" : "spectra";
    const struct tensor_field *field = rgl_field(rgl, path, name, 5, error);
    const struct tensor_field *vndf = rgl_field(rgl, path, "vndf", 4, field ? error : NULL);
    if (!field || !vndf || !fits(rgl, path, field, error) || !fits(rgl, path, vndf, error))
        return FALSE;
    const gsize slices = (gsize)rgl->n_phi * (gsize)rgl->n_theta;
    rgl->values = (struct warp_table){.width = (int)field->shape[4],
                                      .height = (int)field->shape[3],
                                      .n_slices = (int)(slices * field->shape[2]),
                                      .values = field->values};
    if (vndf->shape[2] < 2 || vndf->shape[3] < 2 ||
        !(rgl->vndf =
              warp_new((int)vndf->shape[3], (int)vndf->shape[2], (int)slices, vndf->values)))
        return data_error_fail(
            path, 0, error,
            "the field “vndf” is not a density, because each direction of incidence needs at least "
            "2 × 2 numbers, none negative and not all 0; copy the file again");
    return read_colours(rgl, path, field, error);
}

static gboolean read_fields(struct rgl *rgl, const char *path, GError **error) {
    if (!read_nodes(rgl, path, "phi_i", &rgl->phi, &rgl->n_phi, error) ||
        !read_nodes(rgl, path, "theta_i", &rgl->theta, &rgl->n_theta, error) ||
        !read_table(rgl, path, "ndf", &rgl->ndf, error) ||
        !read_table(rgl, path, "sigma", &rgl->sigma, error))
        return FALSE;
    const struct tensor_field *jacobian = rgl_field(rgl, path, "jacobian", 1, error);
    if (!jacobian || !read_values(rgl, path, error))
        return FALSE;
    rgl->jacobian = *(const guint8 *)jacobian->values != 0;
    rgl->isotropic = rgl->n_phi <= 2;
    rgl->reduction = 1;
    if (!rgl->isotropic) {
        const double range = (double)rgl->phi[rgl->n_phi - 1] - (double)rgl->phi[0];
        rgl->reduction = (int)CLAMP(lround(2 * G_PI / range), 1, 5);
        if (rgl->reduction == 3 || rgl->reduction == 5)
            return data_error_fail(
                path, 0, error,
                "phi_i covers %.0f degrees, but must cover 360, 180 or 90; copy the file again",
                range * 180 / G_PI);
    }
    return TRUE;
}

struct rgl *rgl_read(const char *path, GError **error) {
    struct rgl *rgl = g_new0(struct rgl, 1);
    rgl->file = tensor_file_read(path, error);
    if (!rgl->file || !read_fields(rgl, path, error))
        g_clear_pointer(&rgl, rgl_free);
    return rgl;
}

/* Returns the angle of d from the normal. acos() would lose digits near the normal. */
static double elevation(const double d[3]) {
    return 2 * asin(MIN(0.5 * sqrt(d[0] * d[0] + d[1] * d[1] + (d[2] - 1) * (d[2] - 1)), 1));
}

/* Mirrors both directions so that `in` lies in the azimuths of the file: y ≤ 0 for a half, x ≤ 0
 * and y ≤ 0 for a quarter. For a half, x and y change their signs together. */
static void mirror(const struct rgl *rgl, double in[3], double out[3]) {
    if (rgl->reduction < 2)
        return;
    const double sy = in[1] > 0 ? -1 : 1;
    const double sx = rgl->reduction == 4 ? (in[0] > 0 ? -1 : 1) : sy;
    in[0] *= sx, out[0] *= sx;
    in[1] *= sy, out[1] *= sy;
}

/* Returns the slices of the directions of incidence around the direction (phi, theta), with their
 * weights. */
static struct warp_slices rgl_slices(const struct rgl *rgl, double phi, double theta) {
    struct warp_slices ret = {.n = 0};
    int i, j;
    double a, b;
    warp_interval(rgl->phi, rgl->n_phi, phi, &i, &a);
    warp_interval(rgl->theta, rgl->n_theta, theta, &j, &b);
    for (int k = 0; k < 4; k++) {
        const double weight = (k / 2 ? a : 1 - a) * (k % 2 ? b : 1 - b);
        if (weight == 0)
            continue;
        ret.index[ret.n] = (i + k / 2) * rgl->n_theta + j + k % 2;
        ret.weight[ret.n++] = weight;
    }
    return ret;
}

void rgl_evaluate(const struct rgl *rgl, const float light[3], const float view[3], float ret[3]) {
    static const struct warp_slices only = {1, {0}, {1}};
    double in[3], out[3], m[3], length = 0, sample[2];
    for (int k = 0; k < 3; k++)
        in[k] = (double)view[k], out[k] = (double)light[k];
    mirror(rgl, in, out);
    for (int k = 0; k < 3; k++) {
        m[k] = in[k] + out[k];
        length += m[k] * m[k];
    }
    for (int k = 0; k < 3; k++)
        m[k] /= sqrt(length);
    const double theta_i = elevation(in), phi_i = atan2(in[1], in[0]);
    const double phi_m = atan2(m[1], m[0]) - (rgl->isotropic ? phi_i : 0);
    const double u = rgl_u_of_theta(elevation(m)), u_phi = rgl_u_of_phi(phi_m);
    const struct warp_slices slices = rgl_slices(rgl, phi_i, theta_i);
    double factor = 1 / MAX(out[2], MIN_COSINE), rgb[3] = {0};
    warp_invert(rgl->vndf, &slices, u, u_phi, sample);
    if (rgl->jacobian) {
        const double sigma = warp_table_value(&rgl->sigma, &only, rgl_u_of_theta(theta_i),
                                              (phi_i + G_PI) / (2 * G_PI));
        factor *= warp_table_value(&rgl->ndf, &only, u, u_phi) / (4 * sigma);
    }
    for (int k = 0; k < rgl->n_channels; k++) {
        struct warp_slices channel = slices;
        for (int i = 0; i < slices.n; i++)
            channel.index[i] = slices.index[i] * rgl->n_channels + k;
        const double value = warp_table_value(&rgl->values, &channel, sample[0], sample[1]);
        for (int c = 0; c < 3; c++)
            rgb[c] += rgl->colours[3 * k + c] * value;
    }
    for (int c = 0; c < 3; c++)
        ret[c] = (float)(rgb[c] * factor);
}
