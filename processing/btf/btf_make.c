/* All pictures are loaded as half floats first, because the sum of the pictures in the view's pose
 * is the guide of the rectification (rectify.h). Then each picture is rectified (n_texels × 3),
 * divided by its irradiance and written as one part. Pictures of lights that were not captured are
 * predicted from the parts of other lights. */
#include "btf.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "btf_missing.h"
#include "btf_sigma.h"
#include "exr/exr_half.h"

/* The guide is made from the pictures, and used for the pictures, in which every corner of the
 * sample is within this many pixels of its place in the view's pose. */
#define GUIDE_PX 0.25

/* Pictures of at most this number of texels are not compressed. PIZ has tables for each block of 32
 * rows. At 64² texels, these tables take most of the time, and files are only a tenth smaller. */
#define SMALL_TEXELS (64 * 64)

#define MAX_HOLES 0.5 /* maximum share of holes among the texels of an accepted picture */

static gsize btf_texels(const struct btf_view *view) {
    return (gsize)view->grid.width * (gsize)view->grid.height;
}

/* Sets an attribute to a point. The point is given in the rig frame and stored in the sample frame
 * at the angle turntable_rad of the turntable. */
static void set_point(struct exr_part *part, double turntable_rad, const char *name,
                      struct vec3 rig_mm) {
    const struct vec3 p = rig_turn(rig_mm, -turntable_rad);
    exr_set_v3d(part, name, p.x, p.y, p.z);
}

/* Makes a part with the attributes of one light's picture. The part has a channel "mark" if any
 * texel has a flag, and a channel "sigma" if sigma is TRUE. */
static struct exr_part *light_part(const struct btf_view *view, const struct btf_light *light,
                                   const guint8 *flags, gboolean sigma) {
    const gsize n = btf_texels(view);
    guint8 any = 0;
    for (gsize i = 0; i < n; i++)
        any |= flags[i];
    const char *const last = sigma ? "sigma" : NULL;
    const char *const channels[] = {"B", "G", "R", any ? "mark" : last, any ? last : NULL, NULL};
    g_autofree char *name = g_strdup_printf("light_%04d", light->index);
    struct exr_part *part =
        exr_part_new(name, view->grid.width, view->grid.height, channels, EXR_HALF);
    for (gsize i = 0; any && i < n; i++)
        part->planes[3][i] = flags[i];
    btf_set_flag_counts(part, flags, n);
    exr_set_double(part, "view.theta_deg", view->theta_deg);
    exr_set_double(part, "view.phi_deg", view->phi_deg);
    exr_set_double(part, "light.theta_deg", light->theta_deg);
    exr_set_double(part, "light.phi_deg", light->phi_deg);
    set_point(part, light->turntable_rad, "view.centre_mm", rig_camera_centre_mm(view->camera));
    set_point(part, light->turntable_rad, "light.position_mm",
              rig_lamp_position_mm(light->arc, light->lamp, light->arc_rad));
    const struct vec3 aim =
        rig_turn(rig_lamp_aim(light->arc, light->lamp, light->arc_rad), -light->turntable_rad);
    exr_set_v3d(part, "light.aim", aim.x, aim.y, aim.z);
    exr_set_double(part, "light.exponent", light->lamp->exponent);
    exr_set_string(part, "mesorig.inputs", view->inputs);
    return part;
}

/* Converts radiance to reflectance relative to a white Lambertian diffuser, ρ = π L / (o E):
 *   L   radiance (rgb: n × 3)
 *   E   irradiance of the texel on a plane that faces the lamp
 *   o   light of the lamp in this colour and shot, relative to rig_lamp_irradiance()
 * The cosine n·l stays in ρ. Where E is 0, ρ is 0. variance (n × 3; may be NULL) is the variance of
 * rgb on input and of ρ on output. */
static void to_reflectance(const struct btf_view *view, const struct btf_light *light,
                           const float *rgb, struct exr_part *part, float *variance) {
    const gsize n = btf_texels(view);
    const struct radiometry_lamp *lamp = light->radiometry;
    g_autofree float *irradiance = g_new(float, n);
    rectify_irradiance(light->arc, light->lamp, light->arc_rad, light->turntable_rad, &view->grid,
                       irradiance);
    for (gsize c = 0; c < 3; c++) {
        const float output = (float)((lamp && lamp->known ? lamp->colour[c] : 1) * light->output);
        const float scale = (float)G_PI / output;
        for (gsize i = 0; i < n; i++)
            part->planes[2 - c][i] = irradiance[i] > 0 ? rgb[3 * i + c] * scale / irradiance[i] : 0;
        for (gsize i = 0; variance && i < n; i++)
            variance[3 * i + c] *=
                irradiance[i] > 0 ? scale * scale / (irradiance[i] * irradiance[i]) : 0;
    }
}

/* The picture of a light. All members are 0 if the light is missing. */
struct mosaic {
    guint16 *half; /* n_values half floats: the picture, without the glare */
    guint8 *bound; /* n_pixels: whether a pixel is saturated; NULL without such a channel */
    /* Values from this one on, in DN/ms, come from shorter exposures; 0 if no shorter exposures
     * were used. */
    float shorter;
    int saturated; /* number of saturated pixels; −1 if unknown */
    /* DN/ms: mean of red, green and blue pixels before the glare was subtracted; 0 if unknown */
    double mean[3];
    struct btf_exposures exposures;
};

/* The pictures of a view. */
struct mosaics {
    struct mosaic *lights;
    /* n_values: sum of the pictures in the view's pose, from which the guide is made */
    double *sum;
    gboolean guided; /* whether any picture was added to sum */
    gsize n_pixels;
    /* number of values of a picture: n_pixels, or 3 n_pixels for "rgb"; set by the first picture */
    gsize n_values;
    char *cfa;
};

/* The last rectification, or NULL before the first light. turntable_rad is the angle for which it
 * was made. guided says whether it uses the guide. */
struct posed {
    Rectify *rectify;
    double turntable_rad;
    gboolean guided;
};

static void clear_mosaic(struct mosaic *mosaic) {
    g_clear_pointer(&mosaic->half, g_free);
    g_clear_pointer(&mosaic->bound, g_free);
}

/* Checks that a picture belongs to its shot and has the colour filter *cfa. The first picture sets
 * *cfa. */
static gboolean check_frame(const struct input *input, const struct exr_part *frame, char **cfa,
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
                "%s: the colour filter is %s, but that of the view's first frame is %s; capture or "
                "import the shot with the wrong filter again",
                input->path, found, *cfa);
    return FALSE;
}

/* Reads which pixels are saturated, how many these are, and the value from which shorter exposures
 * were used. */
static void load_saturation(const struct exr_part *frame, gsize n_pixels, struct mosaic *to) {
    const float *saturated = exr_part_plane(frame, "saturated");
    double shorter = 0;
    to->saturated = -1;
    exr_get_int(frame, "mesorig.saturated", &to->saturated, NULL);
    if (exr_get_double(frame, "mesorig.shorter_from", &shorter, NULL) && shorter > 0)
        to->shorter = (float)shorter;
    if (!saturated)
        return;
    to->bound = g_new(guint8, n_pixels);
    for (gsize k = 0; k < n_pixels; k++)
        to->bound[k] = saturated[k] != 0;
}

/* Returns whether the turntable stood so close to the view's angle (GUIDE_PX) that the guide fits
 * the picture. */
static gboolean is_in_pose(const struct btf_view *view, const struct btf_light *light) {
    const double r_mm = hypot(view->grid.width_mm, view->grid.height_mm) / 2;
    const double px_mm = vec3_length(rig_camera_centre_mm(view->camera)) / view->camera->fx_px;
    return fabs(light->turntable_rad - view->turntable_rad) * r_mm <= GUIDE_PX * px_mm;
}

/* Subtracts the camera's glare from a plane of a picture, and stores the mean value of each colour
 * in to->mean. Does nothing if the radiometry of the camera is not calibrated, or if the error of
 * the glare is not above 0. */
static void subtract_glare(const struct btf_view *view, const char *cfa, gsize plane, float *values,
                           struct mosaic *to) {
    double mean[3];
    float glare[3];
    const int width = view->camera->width;
    const gboolean rgb = strcmp(cfa, "rgb") == 0;
    if (!view->radiometry || !view->radiometry->known || !(view->radiometry->glare_error > 0))
        return;
    const char *filters = rgb ? "mono" : cfa;
    radiometry_glare(view->radiometry, filters, width, view->camera->height, values, mean, glare);
    for (int i = 0; i < width * view->camera->height && view->radiometry->glare > 0; i++)
        values[i] -= glare[radiometry_colour_at(filters, i % width, i / width)];
    if (rgb)
        to->mean[plane] = mean[1];
    for (int c = 0; c < 3 && !rgb; c++)
        to->mean[c] = strcmp(cfa, "mono") == 0 ? mean[1] : mean[c];
}

/* Subtracts the glare from a picture's planes and stores them as half floats. If guides is TRUE,
 * adds the finite values to the sum for the guide. Fails if a channel is missing. */
static gboolean store_planes(const struct btf_view *view, const struct input *input,
                             const struct exr_part *frame, guint i, gboolean guides,
                             struct mosaics *to, GError **error) {
    static const char *const grey[] = {"Y", NULL}, *const rgb[] = {"R", "G", "B", NULL};
    const char *const *channels = strcmp(to->cfa, "rgb") == 0 ? rgb : grey;
    const gsize n = to->n_pixels;
    to->n_values = channels == rgb ? 3 * n : n;
    to->sum = to->sum ? to->sum : g_new0(double, to->n_values);
    guint16 *half = to->lights[i].half = g_new(guint16, to->n_values);
    double *sum = to->sum;
    for (; *channels; channels++, half += n, sum += n) {
        float *plane = exr_part_plane(frame, *channels);
        if (!plane)
            return data_error_fail(
                input->path, 0, error,
                "part %s lacks channel %s, which frames with the colour filter %s "
                "have: the file is damaged; capture or import this shot again",
                frame->name, *channels, to->cfa);
        subtract_glare(view, to->cfa, (gsize)(half - to->lights[i].half) / n, plane,
                       &to->lights[i]);
        exr_half_from_floats(half, plane, n);
        for (gsize k = 0; guides && k < n; k++)
            sum[k] += isfinite(plane[k]) ? (double)plane[k] : 0;
    }
    to->guided |= guides;
    return TRUE;
}

/* Reads the picture of light i into to->lights[i]. A picture in the view's pose is also added to
 * the sum for the guide. */
static gboolean load_mosaic(const struct btf_view *view, guint i, struct mosaics *to,
                            GError **error) {
    static const char *const any[] = {NULL};
    const struct btf_light *light = &g_array_index(view->lights, struct btf_light, i);
    const struct input *input = &light->input;
    struct exr_part *frame = input_read(input, any, error);
    const gboolean ok =
        frame && check_frame(input, frame, &to->cfa, error) &&
        store_planes(view, input, frame, i, is_in_pose(view, light), to, error) &&
        (!view->noise || btf_exposures_read(frame, input->path, &to->lights[i].exposures, error));
    if (ok)
        load_saturation(frame, to->n_pixels, &to->lights[i]);
    exr_part_free(frame);
    return ok;
}

/* Sets the flags of n texels. On input, a flag says whether the texel is a hole. On output, it
 * holds bits of enum btf_flag. */
static void set_flags(const Rectify *rectify, const struct mosaic *mosaic, const float *values,
                      const struct mosaics *mosaics, gsize n, guint8 *flags) {
    const gsize n_pixels = mosaics->n_pixels;
    g_autofree guint8 *pixels = g_new0(guint8, n_pixels), *found = g_new0(guint8, n);
    guint8 any = 0;
    for (gsize at = 0; mosaic->shorter > 0 && at < mosaics->n_values; at += n_pixels)
        for (gsize k = 0; k < n_pixels; k++)
            pixels[k] |= values[at + k] >= mosaic->shorter ? BTF_FLAG_SHORTER : 0;
    for (gsize k = 0; mosaic->bound && k < n_pixels; k++)
        if (mosaic->bound[k])
            pixels[k] = BTF_FLAG_BOUND;
    for (gsize k = 0; k < n_pixels; k++)
        any |= pixels[k];
    if (any)
        rectify_flags(rectify, pixels, found);
    for (gsize k = 0; k < n; k++)
        flags[k] = flags[k] ? BTF_FLAG_HOLE : found[k];
}

/* Computes the variance var of the radiance L of each texel and colour:
 *   var = noise + detail + ½ δ² · shift + (γ · L̄)² + (ε · L)²
 *   noise, detail, shift   from rectify_errors()
 *   δ                      misregistration of the camera in pixels (RMS distance)
 *   γ                      error of the glare
 *   L̄                      mean radiance of the picture
 *   ε                      the white tile's residuals in excess of noise
 * ret: n_texels × 3. */
static void add_up_variance(const struct btf_view *view, const Rectify *rectify,
                            const struct mosaic *mosaic, const float *values, gsize n_values,
                            const float *rgb, float *ret) {
    const gsize n = 3 * btf_texels(view);
    const struct radiometry_camera *camera =
        view->radiometry && view->radiometry->known ? view->radiometry : NULL;
    const float excess = camera ? (float)camera->excess : 0;
    float glare[3] = {0};
    for (int c = 0; camera && c < 3; c++)
        glare[c] = (float)(camera->glare_error * mosaic->mean[c] * 1000 /
                           (view->camera->response * camera->colour[c]));
    const float half = 0.5f * (float)(view->misregistration_px * view->misregistration_px);
    g_autofree float *pixels = g_new(float, n_values);
    g_autofree float *detail = g_new(float, n), *shift = g_new(float, n);
    btf_sigma_pixels(view->noise, &mosaic->exposures, values, n_values, pixels);
    rectify_errors(rectify, values, pixels, ret, detail, shift);
    for (gsize i = 0; i < n; i++)
        ret[i] += detail[i] + half * shift[i] + glare[i % 3] * glare[i % 3] +
                  excess * excess * rgb[i] * rgb[i];
}

/* Makes the part of light i from its picture. Returns NULL with an error if more than the share
 * MAX_HOLES of the texels are holes. */
static struct exr_part *make_light(const struct btf_view *view, guint i, const Rectify *rectify,
                                   const struct mosaics *mosaics, GError **error) {
    const struct btf_light *light = &g_array_index(view->lights, struct btf_light, i);
    const struct mosaic *mosaic = &mosaics->lights[i];
    const gsize n = btf_texels(view);
    g_autofree float *rgb = g_new(float, 3 * n), *values = g_new(float, mosaics->n_values);
    g_autofree guint8 *flags = g_new(guint8, n);
    exr_half_to_floats(values, mosaic->half, mosaics->n_values);
    const int holes = rectify_apply(rectify, values, rgb, flags);
    if (holes > MAX_HOLES * (double)n) {
        g_set_error(
            error, DATA_ERROR, DATA_ERROR_INVALID,
            "%s: %d of %zu texels lie outside of the frame or on pixels that are not finite "
            "numbers; check the calibration of camera and sample, or capture this shot again",
            light->input.path, holes, n);
        return NULL;
    }
    set_flags(rectify, mosaic, values, mosaics, n, flags);
    g_autofree float *variance = mosaic->exposures.n > 0 ? g_new(float, 3 * n) : NULL;
    struct exr_part *part = light_part(view, light, flags, variance != NULL);
    if (mosaic->saturated >= 0)
        exr_set_int(part, "mesorig.saturated", mosaic->saturated);
    if (variance)
        add_up_variance(view, rectify, mosaic, values, mosaics->n_values, rgb, variance);
    to_reflectance(view, light, rgb, part, variance);
    if (variance) {
        double scale[3];
        for (gsize k = 0; k < n; k++)
            flags[k] &= BTF_FLAG_HOLE;
        btf_sigma_fill(part, variance, flags);
        btf_sigma_scale(view->radiometry, light->radiometry, light->output_error, scale);
        exr_set_v3d(part, "sigma.scale", scale[0], scale[1], scale[2]);
    }
    return part;
}

/* Makes the parts of missing lights by prediction from the parts of the lights around them. Makes
 * none if no light was captured. */
static void predict_missing(const struct btf_view *view, struct exr_part **parts) {
    const gsize n = btf_texels(view);
    g_autofree guint8 *flags = g_new(guint8, n);
    g_autofree struct exr_part **taken =
        g_memdup2(parts, sizeof(struct exr_part *) * view->lights->len);
    for (guint i = 0; i < view->lights->len; i++) {
        const struct btf_light *light = &g_array_index(view->lights, struct btf_light, i);
        g_autofree double *weights = light->missing ? btf_missing_weights(view, taken, i) : NULL;
        if (!weights)
            continue;
        btf_missing_flags(weights, taken, view->lights->len, n, flags);
        parts[i] = light_part(view, light, flags, FALSE);
        btf_missing_fill(weights, taken, view->lights->len, flags, parts[i]);
        if (light->left_out)
            exr_set_int(parts[i], "mesorig.left_out", 1);
    }
}

/* Makes the rectification for the pictures of one pose. guided says whether it uses the guide. */
static Rectify *btf_rectify_new(const struct btf_view *view, const struct mosaics *mosaics,
                                double turntable_rad, gboolean guided, GError **error) {
    Rectify *rectify = rectify_new(view->camera, view->radiometry, mosaics->cfa, turntable_rad,
                                   &view->grid, error);
    if (!rectify || !guided || !mosaics->guided)
        return rectify;
    g_autofree float *guide = g_new(float, mosaics->n_values);
    for (gsize i = 0; i < mosaics->n_values; i++)
        guide[i] = (float)mosaics->sum[i];
    rectify_guide(rectify, guide);
    return rectify;
}

/* Loads all pictures. The sum of the pictures in the view's pose becomes the guide. */
static gboolean load_mosaics(const struct btf_view *view, struct mosaics *to,
                             GCancellable *cancellable, GError **error) {
    for (guint i = 0; i < view->lights->len; i++)
        if (!g_array_index(view->lights, struct btf_light, i).missing &&
            (g_cancellable_set_error_if_cancelled(cancellable, error) ||
             !load_mosaic(view, i, to, error)))
            return FALSE;
    return TRUE;
}

/* Makes a light's part. Keeps the rectification in *posed, because the next light often has the
 * same pose. */
static struct exr_part *make_posed(const struct btf_view *view, guint i,
                                   const struct mosaics *mosaics, struct posed *posed,
                                   GError **error) {
    const struct btf_light *light = &g_array_index(view->lights, struct btf_light, i);
    const gboolean guided = is_in_pose(view, light);
    if (posed->rectify && (posed->turntable_rad != light->turntable_rad || posed->guided != guided))
        g_clear_pointer(&posed->rectify, rectify_free);
    if (!posed->rectify)
        posed->rectify = btf_rectify_new(view, mosaics, light->turntable_rad, guided, error);
    posed->turntable_rad = light->turntable_rad;
    posed->guided = guided;
    return posed->rectify ? make_light(view, i, posed->rectify, mosaics, error) : NULL;
}

enum exr_compression btf_compression(const struct session_grid *grid) {
    return (gint64)grid->width * grid->height <= SMALL_TEXELS ? EXR_NONE : EXR_PIZ;
}

gboolean btf_make_view(const struct btf_view *view, const char *path, GCancellable *cancellable,
                       GError **error) {
    const guint n = view->lights->len;
    const gsize n_pixels = (gsize)view->camera->width * (gsize)view->camera->height;
    g_autofree struct mosaic *lights = g_new0(struct mosaic, n);
    g_autofree struct exr_part **parts = g_new0(struct exr_part *, n);
    struct mosaics mosaics = {.lights = lights, .n_pixels = n_pixels};
    struct exr_file *file = exr_file_new();
    struct posed posed = {0};
    gboolean ok = load_mosaics(view, &mosaics, cancellable, error);
    for (guint i = 0; ok && i < n; i++) {
        if (g_array_index(view->lights, struct btf_light, i).missing)
            continue;
        ok = !g_cancellable_set_error_if_cancelled(cancellable, error) &&
             (parts[i] = make_posed(view, i, &mosaics, &posed, error)) != NULL;
        clear_mosaic(&lights[i]);
    }
    predict_missing(view, parts);
    for (guint i = 0; i < n; i++)
        if (parts[i])
            exr_file_add(file, parts[i]);
    ok = ok && exr_write(path, file, btf_compression(&view->grid), TRUE, error);
    for (guint i = 0; i < n; i++)
        clear_mosaic(&lights[i]);
    rectify_free(posed.rectify);
    g_free(mosaics.cfa);
    g_free(mosaics.sum);
    exr_file_free(file);
    return ok;
}
