/* Makes one view of the BTF. All frames are loaded as half floats first, since the sum over all
 * lights is the guide of the rectification (rectify.h); then each is rectified (n_texels × 3),
 * divided by its irradiance and written as one part. Lights that were not captured are predicted
 * from the parts of the others. */
#include "btf.h"

#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "btf_missing.h"
#include "exr/exr_half.h"

#define MOST_HOLES 0.5 /* of the texels: if more are holes, the frame is refused */

static const char *const rgb_channels[] = {"B", "G", "R", NULL};
static const char *const flagged_channels[] = {"B", "G", "R", "mark", NULL};

void btf_view_free(struct btf_view *view) {
    if (!view)
        return;
    for (guint i = 0; view->lights && i < view->lights->len; i++)
        input_clear(&g_array_index(view->lights, struct btf_light, i).input);
    g_clear_pointer(&view->lights, g_array_unref);
    g_free(view->inputs);
    g_free(view);
}

/* Sets an attribute to a point of the rig frame, transformed to the sample frame of this view. */
static void set_point(struct exr_part *part, const struct btf_view *view, const char *name,
                      struct vec3 rig_mm) {
    struct vec3 p = rig_turn(rig_mm, -view->turntable_rad);
    exr_set_v3d(part, name, p.x, p.y, p.z);
}

/* A new part with the attributes of one light's picture. The channel "mark" is there if any texel
 * has a flag. */
static struct exr_part *btf_light_part(const struct btf_view *view, const struct btf_light *light,
                                       const guint8 *marks) {
    static const struct {
        const char *name;
        enum btf_mark mark;
    } counts[] = {{"mesorig.holes", BTF_MARK_HOLE},
                  {"mesorig.bounds", BTF_MARK_BOUND},
                  {"mesorig.shorter", BTF_MARK_SHORTER},
                  {"mesorig.predicted", BTF_MARK_PREDICTED}};
    const int n = view->grid.width * view->grid.height;
    guint8 any = 0;
    for (int i = 0; i < n; i++)
        any |= marks[i];
    g_autofree char *name = g_strdup_printf("light_%04d", light->index);
    struct exr_part *part = exr_part_new(name, view->grid.width, view->grid.height,
                                         any ? flagged_channels : rgb_channels, EXR_HALF);
    for (int i = 0; any && i < n; i++)
        part->planes[3][i] = marks[i];
    for (gsize k = 0; k < G_N_ELEMENTS(counts); k++) {
        int count = 0;
        for (int i = 0; i < n; i++)
            count += (marks[i] & counts[k].mark) != 0;
        exr_set_int(part, counts[k].name, count);
    }
    exr_set_double(part, "view.theta_deg", view->theta_deg);
    exr_set_double(part, "view.phi_deg", view->phi_deg);
    exr_set_double(part, "light.theta_deg", light->theta_deg);
    exr_set_double(part, "light.phi_deg", light->phi_deg);
    set_point(part, view, "view.centre_mm", rig_camera_centre_mm(view->camera));
    set_point(part, view, "light.position_mm",
              rig_lamp_position_mm(light->arc, light->lamp, light->arc_rad));
    exr_set_string(part, "mesorig.inputs", view->inputs);
    return part;
}

/* Output of the lamp in a colour during this shot, relative to rig_lamp_irradiance(). */
static float output_of(const struct btf_light *light, int colour) {
    double own =
        light->radiometry && light->radiometry->known ? light->radiometry->colour[colour] : 1;
    return (float)(own * light->output);
}

/* Reflectance ρ = π L / E relative to a white Lambertian diffuser: L radiance (rgb: n × 3), E
 * irradiance of the texel facing the lamp. The cosine n·l stays in ρ. */
static void to_reflectance(const struct btf_view *view, const struct btf_light *light, float *rgb,
                           struct exr_part *part) {
    int n = view->grid.width * view->grid.height;
    g_autofree float *irradiance = g_new(float, n);
    rectify_irradiance(light->arc, light->lamp, light->arc_rad, view->turntable_rad, &view->grid,
                       irradiance);
    for (int c = 0; c < 3; c++) {
        float scale = (float)G_PI / output_of(light, c);
        for (int i = 0; i < n; i++)
            part->planes[2 - c][i] = irradiance[i] > 0 ? rgb[3 * i + c] * scale / irradiance[i] : 0;
    }
}

/* The frames of a view, one a light, n_pixels each. */
struct mosaics {
    guint16 **half; /* of each light, half floats; NULL: missing */
    guint8 **bound; /* of each light, whether a pixel is saturated; NULL: no channel for it */
    float *shorter; /* of each light: values from here on come from shorter exposures; 0: there are
                       none */
    int *saturated; /* saturated pixels of each light's frame; −1: unknown */
    double *sum;    /* sum over all lights: the guide */
    gsize n_pixels;
    char *cfa;
};

static void clear_mosaics(struct mosaics *mosaics, guint n) {
    for (guint i = 0; i < n; i++) {
        g_free(mosaics->half[i]);
        g_free(mosaics->bound[i]);
    }
    g_free(mosaics->half);
    g_free(mosaics->bound);
    g_free(mosaics->shorter);
    g_free(mosaics->saturated);
    g_free(mosaics->sum);
    g_free(mosaics->cfa);
}

/* Checks that a frame belongs to the shot, and has the colour filter of the other frames. */
static gboolean btf_check_frame(const struct input *input, const struct exr_part *frame, char **cfa,
                                GError **error) {
    const char *found = "mono";
    int shot = (int)input->shot;
    if (!exr_get_string(frame, "mesorig.cfa", &found, error)) {
        g_prefix_error(error, "%s: ", input->path);
        return FALSE;
    }
    if (exr_get_int(frame, "mesorig.shot", &shot, NULL) && shot != (int)input->shot) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "%s: the frame is of shot %d, but the session records it as shot %d; check "
                    "which file was moved or replaced",
                    input->path, shot, (int)input->shot);
        return FALSE;
    }
    *cfa = *cfa ? *cfa : g_strdup(found);
    if (strcmp(found, *cfa) == 0)
        return TRUE;
    g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                "%s: its colour filter is %s, other frames of this camera have %s", input->path,
                found, *cfa);
    return FALSE;
}

/* Reads which of a frame's pixels are saturated, and from which value on shorter exposures were
 * used. */
static void btf_load_saturation(const struct exr_part *frame, guint i, struct mosaics *to) {
    const float *saturated = exr_part_plane(frame, "saturated");
    double shorter = 0;
    to->saturated[i] = -1;
    exr_get_int(frame, "mesorig.saturated", &to->saturated[i], NULL);
    if (exr_get_double(frame, "mesorig.shorter_from", &shorter, NULL) && shorter > 0)
        to->shorter[i] = (float)shorter;
    if (!saturated)
        return;
    to->bound[i] = g_new(guint8, to->n_pixels);
    for (gsize k = 0; k < to->n_pixels; k++)
        to->bound[i][k] = saturated[k] != 0;
}

/* Loads one light's frame and adds its finite pixels to the guide. */
static gboolean load_mosaic(const struct btf_view *view, guint i, struct mosaics *to,
                            GError **error) {
    static const char *const channels[] = {"Y", NULL};
    const struct input *input = &g_array_index(view->lights, struct btf_light, i).input;
    struct exr_part *frame = input_read(input, channels, error);
    gboolean ok = frame && btf_check_frame(input, frame, &to->cfa, error);
    if (ok) {
        const float *mosaic = exr_part_plane(frame, "Y");
        btf_load_saturation(frame, i, to);
        to->half[i] = g_new(guint16, to->n_pixels);
        exr_half_from_floats(to->half[i], mosaic, to->n_pixels);
        for (gsize k = 0; k < to->n_pixels; k++)
            to->sum[k] += isfinite(mosaic[k]) ? (double)mosaic[k] : 0;
    }
    exr_part_free(frame);
    return ok;
}

static Rectify *new_rectify(const struct btf_view *view, const struct mosaics *mosaics,
                            GError **error) {
    Rectify *rectify = rectify_new(view->camera, view->radiometry, mosaics->cfa,
                                   view->turntable_rad, &view->grid, error);
    if (!rectify)
        return NULL;
    g_autofree float *guide = g_new(float, mosaics->n_pixels);
    for (gsize i = 0; i < mosaics->n_pixels; i++)
        guide[i] = (float)mosaics->sum[i];
    rectify_guide(rectify, guide);
    return rectify;
}

/* Sets the flags of n texels. marks: on input whether each is a hole, on output bits of enum
 * btf_mark. */
static void set_marks(const Rectify *rectify, const struct mosaics *mosaics, guint i,
                      const float *mosaic, int n, guint8 *marks) {
    g_autofree guint8 *pixels = g_new(guint8, mosaics->n_pixels), *found = g_new(guint8, n);
    const guint8 *bound = mosaics->bound[i];
    const float from = mosaics->shorter[i];
    for (gsize k = 0; k < mosaics->n_pixels; k++)
        pixels[k] = bound && bound[k]               ? BTF_MARK_BOUND
                    : from > 0 && mosaic[k] >= from ? BTF_MARK_SHORTER
                                                    : 0;
    rectify_flags(rectify, pixels, found);
    for (int k = 0; k < n; k++)
        marks[k] = marks[k] ? BTF_MARK_HOLE : found[k];
}

/* Rectifies one light's frame. An error if most of its texels are holes. */
static struct exr_part *make_light(const struct btf_view *view, guint i, const Rectify *rectify,
                                   const struct mosaics *mosaics, GError **error) {
    const struct btf_light *light = &g_array_index(view->lights, struct btf_light, i);
    int n = view->grid.width * view->grid.height;
    g_autofree float *rgb = g_new(float, 3 * n), *mosaic = g_new(float, mosaics->n_pixels);
    g_autofree guint8 *marks = g_new(guint8, n);
    exr_half_to_floats(mosaic, mosaics->half[i], mosaics->n_pixels);
    int holes = rectify_apply(rectify, mosaic, rgb, marks);
    if (holes > MOST_HOLES * n) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "%s: pixels of %d of %d texels are not finite numbers; capture this shot again",
                    light->input.path, holes, n);
        return NULL;
    }
    set_marks(rectify, mosaics, i, mosaic, n, marks);
    struct exr_part *part = btf_light_part(view, light, marks);
    if (mosaics->saturated[i] >= 0)
        exr_set_int(part, "mesorig.saturated", mosaics->saturated[i]);
    to_reflectance(view, light, rgb, part);
    return part;
}

/* Predicts the pictures of missing lights from the lights around them. */
static void predict_missing(const struct btf_view *view, struct exr_part **parts) {
    const gsize n = (gsize)view->grid.width * (gsize)view->grid.height;
    g_autofree guint8 *marks = g_new(guint8, n);
    g_autofree struct exr_part **taken = g_new(struct exr_part *, view->lights->len);
    for (guint i = 0; i < view->lights->len; i++)
        taken[i] = parts[i];
    for (guint i = 0; i < view->lights->len; i++) {
        const struct btf_light *light = &g_array_index(view->lights, struct btf_light, i);
        g_autofree double *weights = light->missing ? btf_missing_weights(view, taken, i) : NULL;
        if (!weights)
            continue;
        btf_missing_marks(weights, taken, view->lights->len, n, marks);
        parts[i] = btf_light_part(view, light, marks);
        btf_missing_fill(weights, taken, view->lights->len, marks, parts[i]);
    }
}

static gboolean load_mosaics(const struct btf_view *view, struct mosaics *to,
                             GCancellable *cancellable, GError **error) {
    gboolean ok = TRUE;
    for (guint i = 0; ok && i < view->lights->len; i++)
        if (!g_array_index(view->lights, struct btf_light, i).missing)
            ok = !g_cancellable_set_error_if_cancelled(cancellable, error) &&
                 load_mosaic(view, i, to, error);
    return ok;
}

gboolean btf_make_view(const struct btf_view *view, const char *path, GCancellable *cancellable,
                       GError **error) {
    g_autoptr(Rectify) rectify = NULL;
    struct exr_file *file = exr_file_new();
    gsize n_pixels = (gsize)view->camera->width * (gsize)view->camera->height;
    struct mosaics mosaics = {.half = g_new0(guint16 *, view->lights->len),
                              .bound = g_new0(guint8 *, view->lights->len),
                              .shorter = g_new0(float, view->lights->len),
                              .saturated = g_new0(int, view->lights->len),
                              .sum = g_new0(double, n_pixels),
                              .n_pixels = n_pixels};
    gboolean ok = load_mosaics(view, &mosaics, cancellable, error) &&
                  (rectify = new_rectify(view, &mosaics, error)) != NULL;
    g_autofree struct exr_part **parts = g_new0(struct exr_part *, view->lights->len);
    for (guint i = 0; ok && i < view->lights->len; i++) {
        if (g_array_index(view->lights, struct btf_light, i).missing)
            continue;
        ok = !g_cancellable_set_error_if_cancelled(cancellable, error) &&
             (parts[i] = make_light(view, i, rectify, &mosaics, error)) != NULL;
        g_clear_pointer(&mosaics.half[i], g_free);
        g_clear_pointer(&mosaics.bound[i], g_free);
    }
    predict_missing(view, parts);
    for (guint i = 0; i < view->lights->len; i++)
        if (parts[i])
            exr_file_add(file, parts[i]);
    ok = ok && exr_write(path, file, EXR_PIZ, TRUE, error);
    clear_mosaics(&mosaics, view->lights->len);
    exr_file_free(file);
    return ok;
}

/* Compares the hash of the inputs in every part: only headers are read. */
gboolean btf_is_made(const struct btf_view *view, const char *path) {
    if (!g_file_test(path, G_FILE_TEST_IS_REGULAR))
        return FALSE;
    struct exr_file *file = exr_read_headers(path, NULL);
    gboolean made = file && file->parts->len == view->lights->len;
    for (guint i = 0; made && i < file->parts->len; i++) {
        const char *inputs = NULL;
        made = exr_get_string(g_ptr_array_index(file->parts, i), "mesorig.inputs", &inputs, NULL) &&
               strcmp(inputs, view->inputs) == 0;
    }
    exr_file_free(file);
    return made;
}

static gint64 btf_count_of(const struct exr_part *part, const char *name) {
    int count = 0;
    exr_get_int(part, name, &count, NULL);
    return count;
}

void btf_add_marks(const struct exr_part *part, struct btf_marks *sums) {
    sums->texels += (gint64)part->width * part->height;
    sums->holes += btf_count_of(part, "mesorig.holes");
    sums->bounds += btf_count_of(part, "mesorig.bounds");
    sums->shorter += btf_count_of(part, "mesorig.shorter");
    sums->predicted += btf_count_of(part, "mesorig.predicted");
}

static gboolean copy_light(const struct exr_part *part, const struct session_grid *grid,
                           float *ret_rgb) {
    if (!part || part->width != grid->width || part->height != grid->height)
        return FALSE;
    const float *r = exr_part_plane(part, "R"), *g = exr_part_plane(part, "G");
    const float *b = exr_part_plane(part, "B");
    if (!r || !g || !b)
        return FALSE;
    for (int i = 0; i < grid->width * grid->height; i++) {
        ret_rgb[3 * i] = r[i];
        ret_rgb[3 * i + 1] = g[i];
        ret_rgb[3 * i + 2] = b[i];
    }
    return TRUE;
}

gboolean btf_read_view(const char *path, const int *lights, int n_lights,
                       const struct session_grid *grid, float *ret_rgb, GError **error) {
    struct exr_file *file = exr_read(path, error);
    if (!file)
        return FALSE;
    gboolean ok = TRUE;
    gsize size = (gsize)grid->width * (gsize)grid->height * 3;
    for (int i = 0; ok && i < n_lights; i++) {
        g_autofree char *name = g_strdup_printf("light_%04d", lights[i]);
        ok = copy_light(exr_file_part(file, name), grid, ret_rgb + size * (gsize)i);
        if (!ok)
            g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                        "%s: part %s is missing or is not %d × %d texels; delete the file and "
                        "process again",
                        path, name, grid->width, grid->height);
    }
    exr_file_free(file);
    return ok;
}

gboolean btf_direction(const struct exr_part *part, const char *of, float *ret_theta_deg,
                       float *ret_phi_deg) {
    g_autofree char *theta_name = g_strconcat(of, ".theta_deg", NULL);
    g_autofree char *phi_name = g_strconcat(of, ".phi_deg", NULL);
    double theta = NAN, phi = NAN;
    exr_get_double(part, theta_name, &theta, NULL);
    exr_get_double(part, phi_name, &phi, NULL);
    *ret_theta_deg = (float)theta;
    *ret_phi_deg = (float)phi;
    return isfinite(theta) && isfinite(phi);
}
