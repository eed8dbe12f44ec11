#include "prediction_product.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/data_error.h"
#include "btf/btf_matrix.h"
#include "btf/btf_sigma.h"
#include "exr/exr_half.h"
#include "selection/prediction.h"

#define PROBES 256 /* number of texels to which the prediction is fitted */
#define BLOCK  32  /* number of texels that are predicted together */

struct product_view {
    char *relative, *path, *inputs;
    /* n_lights: for each light, its index among the lights left out in this view; −1 if not left
     * out */
    int *slots;
    int n_left_out;
    guint16 *values, *sigma; /* n_left_out × n_texels × 3, half floats */
};

struct product_job {
    const struct catalogue *catalogue;
    int n_views, n_lights;
    gsize n_texels;
    struct product_view *views;
    struct vec3 *view, *light, *view_mm, *light_mm;
    int *groups;
    struct btf_matrix *btf;
    Prediction *prediction;
    GMutex lock;
    GError *error; /* the first error */
};

void prediction_product_clear(struct prediction_product *product) {
    g_clear_pointer(&product->inputs, g_free);
}

static void product_clear(struct product_job *job) {
    for (int v = 0; v < job->n_views; v++) {
        g_free(job->views[v].relative);
        g_free(job->views[v].path);
        g_free(job->views[v].inputs);
        g_free(job->views[v].slots);
        g_free(job->views[v].values);
        g_free(job->views[v].sigma);
    }
    g_free(job->views);
    g_free(job->view);
    g_free(job->light);
    g_free(job->view_mm);
    g_free(job->light_mm);
    g_free(job->groups);
    btf_matrix_free(job->btf);
    prediction_free(job->prediction);
    g_clear_error(&job->error);
    g_mutex_clear(&job->lock);
}

static struct vec3 product_unit(const struct exr_part *part, const char *of) {
    float theta_deg, phi_deg;
    btf_direction(part, of, &theta_deg, &phi_deg);
    const double theta = (double)theta_deg * (G_PI / 180), phi = (double)phi_deg * (G_PI / 180);
    return vec3(sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta));
}

/* Reads the directions and positions of a part, and whether it was left out. One position of each
 * light is used for all views: that in the last view. This is precise enough, because only a tilt
 * or an offset of the arc's axis moves the light in the sample frame. */
static gboolean product_take_part(struct product_job *job, int view, int light,
                                  const struct exr_part *part, GError **error) {
    struct product_view *to = &job->views[view];
    const char *inputs = NULL;
    double eye[3], lamp[3];
    int left_out = 0;
    if (!exr_get_v3d(part, "view.centre_mm", eye, error) ||
        !exr_get_v3d(part, "light.position_mm", lamp, error) ||
        !exr_get_string(part, "mesorig.inputs", &inputs, error)) {
        g_prefix_error(error, "%s: part %s: ", to->path, part->name);
        return FALSE;
    }
    exr_get_int(part, "mesorig.left_out", &left_out, NULL);
    to->slots[light] = left_out ? to->n_left_out++ : -1;
    if (!to->inputs)
        to->inputs = g_strdup(inputs);
    job->view[view] = product_unit(part, "view");
    job->light[light] = product_unit(part, "light");
    job->view_mm[view] = vec3(eye[0], eye[1], eye[2]);
    job->light_mm[light] = vec3(lamp[0], lamp[1], lamp[2]);
    return TRUE;
}

static gboolean product_take_view(struct product_job *job, int view, GError **error) {
    g_autoptr(ExrFile) file = exr_read_headers(job->views[view].path, error);
    if (!file)
        return FALSE;
    if ((int)file->parts->len != job->n_lights)
        return data_error_fail(
            job->views[view].path, 0, error,
            "the file has %u parts, but there are %d lights; delete the file and process "
            "again",
            file->parts->len, job->n_lights);
    for (int light = 0; light < job->n_lights; light++)
        if (!product_take_part(job, view, light, g_ptr_array_index(file->parts, (guint)light),
                               error))
            return FALSE;
    return TRUE;
}

/* Puts the pairs that the cameras take together into one group: those with the same angle of the
 * turntable and the same light. */
static void product_set_groups(struct product_job *job, const int *views) {
    for (int v = 0; v < job->n_views; v++) {
        const struct session_direction *view = job->catalogue->views->pdata[views[v]];
        int first = 0;
        while (fabs(((const struct session_direction *)job->catalogue->views->pdata[views[first]])
                        ->turntable_deg -
                    view->turntable_deg) > 1e-6)
            first++;
        for (int l = 0; l < job->n_lights; l++)
            job->groups[v * job->n_lights + l] = first * job->n_lights + l;
    }
}

static gboolean product_open(struct product_job *job, Session *session,
                             const struct catalogue *catalogue, const int *views, int n_views,
                             GError **error) {
    job->catalogue = catalogue;
    job->n_views = n_views;
    job->n_lights = (int)catalogue->lights->len;
    job->n_texels = (gsize)catalogue->grid.width * (gsize)catalogue->grid.height;
    job->views = g_new0(struct product_view, n_views);
    job->view = g_new0(struct vec3, n_views);
    job->light = g_new0(struct vec3, job->n_lights);
    job->view_mm = g_new0(struct vec3, n_views);
    job->light_mm = g_new0(struct vec3, job->n_lights);
    job->groups = g_new(int, n_views * job->n_lights);
    for (int v = 0; v < n_views; v++) {
        const struct session_direction *view = catalogue->views->pdata[views[v]];
        job->views[v].relative = g_strdup_printf("products/btf/view_%04d.exr", view->index);
        job->views[v].path = session_file(session, job->views[v].relative);
        job->views[v].slots = g_new(int, job->n_lights);
        if (!product_take_view(job, v, error))
            return FALSE;
    }
    product_set_groups(job, views);
    return TRUE;
}

/* Returns whether the parts of all left-out pictures were predicted from these inputs (attribute
 * mesorig.prediction). */
static gboolean product_is_fresh(const struct product_job *job, const char *inputs) {
    for (int v = 0; v < job->n_views; v++) {
        g_autoptr(ExrFile) file =
            job->views[v].n_left_out > 0 ? exr_read_headers(job->views[v].path, NULL) : NULL;
        for (int l = 0; file && l < job->n_lights; l++) {
            const char *found = NULL;
            if (job->views[v].slots[l] >= 0 &&
                (!exr_get_string(g_ptr_array_index(file->parts, (guint)l), "mesorig.prediction",
                                 &found, NULL) ||
                 strcmp(found, inputs) != 0))
                return FALSE;
        }
    }
    return TRUE;
}

/* Returns the centre of a texel in the reference plane (pipeline.h). */
static struct vec3 product_place(const struct product_job *job, gsize texel) {
    const struct session_grid *grid = &job->catalogue->grid;
    const gsize row = texel / (gsize)grid->width;
    const double i = (double)(texel % (gsize)grid->width), j = (double)row;
    return vec3((i + 0.5) * grid->width_mm / grid->width - grid->width_mm / 2,
                grid->height_mm / 2 - (j + 0.5) * grid->height_mm / grid->height,
                grid->reference_mm);
}

/* Gathers the measured values of n texels, beginning with the texel first. The order is by texel,
 * colour and pair: n × 3 × n_pairs values. Left-out pictures have NaN. */
static gboolean product_gather(const struct product_job *job, int first, int n, float *ret,
                               GError **error) {
    const gsize lights = (gsize)job->n_lights, pairs = (gsize)job->n_views * lights;
    g_autofree float *buffer = g_new(float, (gsize)n *lights * 3);
    for (gsize v = 0; v < (gsize)job->n_views; v++) {
        gsize stride;
        const float *rows = btf_matrix_rows(job->btf, (int)v, first, n, buffer, &stride, error);
        if (!rows)
            return FALSE;
        for (gsize t = 0; t < (gsize)n; t++)
            for (gsize l = 0; l < lights; l++)
                for (gsize c = 0; c < 3; c++)
                    ret[(t * 3 + c) * pairs + v * lights + l] =
                        job->views[v].slots[l] >= 0 ? NAN : rows[t * stride + 3 * l + c];
    }
    return TRUE;
}

/* Removes captured pictures from the probes (n_rows × n_pairs) if there are more than the
 * prediction can use. */
static void product_thin(const struct product_job *job, int n_rows, float *probes) {
    const int n_pairs = job->n_views * job->n_lights;
    int captured = n_pairs, k = 0;
    for (int v = 0; v < job->n_views; v++)
        captured -= job->views[v].n_left_out;
    for (int pair = 0; pair < n_pairs; pair++)
        if (job->views[pair / job->n_lights].slots[pair % job->n_lights] < 0 &&
            !prediction_uses(k++, captured))
            for (int row = 0; row < n_rows; row++)
                probes[(gsize)row * (gsize)n_pairs + (gsize)pair] = NAN;
}

/* Fits the prediction to PROBES texels, or to all texels if there are fewer. The texels are taken
 * in steps of the golden section, so that their distances do not match the period of a weave. */
static gboolean product_learn(struct product_job *job, const struct work *work, GError **error) {
    const int n = (int)MIN(job->n_texels, PROBES);
    const gsize pairs = (gsize)job->n_views * (gsize)job->n_lights;
    const struct prediction_pairs of = {job->n_views, job->n_lights, job->view,  job->light,
                                        job->view_mm, job->light_mm, job->groups};
    g_autofree float *probes = g_new(float, (gsize)n * 3 * pairs);
    g_autofree struct vec3 *at_mm = g_new(struct vec3, n);
    for (int i = 0; i < n; i++) {
        const double part = fmod(i * 0.6180339887498949, 1);
        const gsize texel =
            n == (int)job->n_texels ? (gsize)i : (gsize)(part * (double)job->n_texels);
        at_mm[i] = product_place(job, texel);
        if (!product_gather(job, (int)texel, 1, probes + (gsize)i * 3 * pairs, error))
            return FALSE;
    }
    product_thin(job, 3 * n, probes);
    job->prediction = prediction_new(&of, probes, at_mm, n, work, error);
    return job->prediction != NULL;
}

static void product_predict(int block, gpointer data) {
    struct product_job *job = data;
    const gsize lights = (gsize)job->n_lights, pairs = (gsize)job->n_views * lights;
    const gsize first = (gsize)block * BLOCK, n = MIN(BLOCK, job->n_texels - first);
    g_autofree float *values = g_new(float, n * 3 * pairs), *sigma = g_new(float, n * 3 * pairs);
    struct vec3 at_mm[BLOCK];
    g_autoptr(GError) error = NULL;
    if (!product_gather(job, (int)first, (int)n, values, &error)) {
        g_mutex_lock(&job->lock);
        if (!job->error)
            job->error = g_steal_pointer(&error);
        g_mutex_unlock(&job->lock);
        return;
    }
    for (gsize t = 0; t < n; t++)
        at_mm[t] = product_place(job, first + t);
    prediction_fill(job->prediction, values, at_mm, (int)n, sigma);
    for (gsize v = 0; v < (gsize)job->n_views; v++)
        for (gsize l = 0; l < lights; l++)
            for (gsize k = 0; job->views[v].slots[l] >= 0 && k < 3 * n; k++) {
                const gsize from = k * pairs + v * lights + l;
                const gsize to = ((gsize)job->views[v].slots[l] * job->n_texels + first) * 3 + k;
                exr_half_from_floats(job->views[v].values + to, values + from, 1);
                exr_half_from_floats(job->views[v].sigma + to, sigma + from, 1);
            }
}

/* Returns a part with the predicted values and error bars, and with the other attributes of the old
 * part. */
static struct exr_part *product_part(const struct product_job *job, struct exr_part *old,
                                     const guint16 *values, const guint16 *sigma,
                                     const char *inputs) {
    static const char *const channels[] = {"B", "G", "R", "mark", "sigma", NULL};
    const gsize n = job->n_texels;
    struct exr_part *part = exr_part_new(old->name, old->width, old->height, channels, EXR_HALF);
    g_autofree float *rgb = g_new(float, 3 * n), *variances = g_new(float, 3 * n);
    g_autofree guint8 *holes = g_new0(guint8, n);
    GPtrArray *attributes = old->attributes;
    old->attributes = part->attributes;
    part->attributes = attributes;
    exr_half_to_floats(rgb, values, 3 * n);
    exr_half_to_floats(variances, sigma, 3 * n);
    for (gsize i = 0; i < 3 * n; i++)
        variances[i] *= variances[i];
    for (gsize i = 0; i < n; i++) {
        for (gsize c = 0; c < 3; c++)
            part->planes[2 - c][i] = rgb[3 * i + c];
        part->planes[3][i] = BTF_FLAG_PREDICTED;
    }
    exr_set_int(part, "mesorig.predicted", (int)n);
    exr_set_int(part, "mesorig.holes", 0);
    exr_set_string(part, "mesorig.prediction", inputs);
    btf_sigma_fill(part, variances, holes);
    return part;
}

static gboolean product_write(const struct product_job *job, const struct product_view *view,
                              const char *inputs, GError **error) {
    g_autoptr(ExrFile) file = exr_read(view->path, error), made = exr_file_new();
    for (int l = 0; file && l < job->n_lights; l++) {
        struct exr_part *part = g_ptr_array_index(file->parts, (guint)l);
        const gsize from = 3 * job->n_texels * (gsize)MAX(view->slots[l], 0);
        if (view->slots[l] >= 0)
            exr_file_add(made,
                         product_part(job, part, view->values + from, view->sigma + from, inputs));
        else
            exr_file_add(made, part);
        file->parts->pdata[l] = view->slots[l] >= 0 ? part : NULL;
    }
    return file && exr_write(view->path, made, btf_compression(&job->catalogue->grid), TRUE, error);
}

static gboolean product_set(Session *session, const char *key, double value, GError **error) {
    char text[G_ASCII_DTOSTR_BUF_SIZE];
    return session_set_value(session, key, g_ascii_dtostr(text, sizeof text, value), error);
}

static gboolean product_make(struct product_job *job, Session *session,
                             const struct prediction_product *product, const struct work *work,
                             GError **error) {
    for (int v = 0; v < job->n_views; v++) {
        const gsize n = (gsize)job->views[v].n_left_out * job->n_texels * 3;
        job->views[v].values = g_new(guint16, MAX(n, 1));
        job->views[v].sigma = g_new(guint16, MAX(n, 1));
    }
    job->btf =
        btf_matrix_read_within(PREDICTION_PRODUCT_MEMORY, session_path(session), work, error);
    if (!job->btf)
        return FALSE;
    if ((int)job->btf->layout.views.n != job->n_views)
        return data_error_fail(session_path(session), 0, error,
                               "products/btf has %zu views, but the session has %d; delete "
                               "products/btf and process again",
                               job->btf->layout.views.n, job->n_views);
    if (!product_learn(job, work, error) ||
        !work_parallel(work, "prediction", (int)((job->n_texels + BLOCK - 1) / BLOCK),
                       product_predict, job, error))
        return FALSE;
    if (job->error) {
        g_propagate_error(error, g_steal_pointer(&job->error));
        return FALSE;
    }
    for (int v = 0; v < job->n_views; v++)
        if (job->views[v].n_left_out > 0 &&
            (!product_write(job, &job->views[v], product->inputs, error) ||
             !session_add_product(session, job->views[v].relative, job->views[v].inputs, error)))
            return FALSE;
    g_autofree char *pictures =
        g_strdup_printf("%d of %d", product->n_left_out, product->n_pictures);
    return session_set_value(session, "prediction_pictures", pictures, error) &&
           product_set(session, "prediction_error", prediction_error(job->prediction), error) &&
           product_set(session, "prediction_left_out_error",
                       prediction_left_out_error(job->prediction), error) &&
           product_set(session, "prediction_left_out_share",
                       prediction_left_out_share(job->prediction), error);
}

static double product_number(Session *session, const char *key) {
    g_autofree char *text = session_value(session, key);
    return text ? g_ascii_strtod(text, NULL) : NAN;
}

void prediction_product_read(Session *session, struct prediction_known *ret) {
    g_autofree char *pictures = session_value(session, "prediction_pictures");
    *ret = (struct prediction_known){0};
    if (!pictures || sscanf(pictures, "%d of %d", &ret->left_out, &ret->pictures) != 2)
        return;
    ret->error = product_number(session, "prediction_error");
    ret->left_out_error = product_number(session, "prediction_left_out_error");
    ret->left_out_share = product_number(session, "prediction_left_out_share");
}

gboolean prediction_product_make(Session *session, const struct catalogue *catalogue,
                                 const int *views, int n_views, const struct work *work,
                                 struct prediction_product *ret, GError **error) {
    struct product_job job = {0};
    *ret = (struct prediction_product){.n_pictures = n_views * (int)catalogue->lights->len};
    if (ret->n_pictures == 0)
        return TRUE;
    g_mutex_init(&job.lock);
    gboolean ok = product_open(&job, session, catalogue, views, n_views, error);
    g_autoptr(GChecksum) sum = catalogue_checksum(catalogue, "prediction");
    input_hash(sum, "%d", PREDICTION_METHOD);
    for (int v = 0; ok && v < n_views; v++) {
        ret->n_left_out += job.views[v].n_left_out;
        input_hash(sum, "%s", job.views[v].inputs);
    }
    ret->n_used = MIN(ret->n_pictures - ret->n_left_out, PREDICTION_MAX_MEASURED);
    if (ok && ret->n_left_out > 0) {
        ret->inputs = g_strdup(g_checksum_get_string(sum));
        ret->made = !product_is_fresh(&job, ret->inputs);
        ok = !ret->made || product_make(&job, session, ret, work, error);
    }
    product_clear(&job);
    return ok;
}
