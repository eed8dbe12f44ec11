/*
 * Reads the format that Relight publishes for OpenLIME (cnr-isti-vclab): info.json, and planes of
 * coefficients as pictures plane_0, plane_1, … next to it. The values are computed like those of
 * OpenLIME's ShaderRTI. c is byte / 255 of a channel. Each channel of a plane has a scale and a
 * bias. b_j (l) are the terms of a PTM or of HSH.
 *
 *   rgb   f(l) = Σ_j b_j(l) (c_j − bias_j) scale_j
 *         Plane j has term j of R, G and B.
 *   lrgb  f(l) = (c_0 − bias_0) scale_0 · Σ_j b_j(l) (c − bias) scale
 *         Plane 0 is a colour. Each channel of the other planes has one term.
 *   ptm   b = 1, lx, ly, lx², lx ly, ly²
 *   hsh   b of hsh.h. Lights lower than 0.15 rad above the horizon are raised to this elevation.
 *
 * f is encoded as sRGB, and is converted to linear values. The material is f under the lights that
 * info.json lists.
 */
#include "import_private.h"

#include <json-glib/json-glib.h>
#include <math.h>

#include "base/data_error.h"
#include "base/input_file.h"
#include "base/srgb.h"
#include "btf/btf_directions.h"
#include "codecs/hsh/hsh.h"

#define MAX_LIGHTS     65536
#define MAX_INFO_BYTES (64 << 20)
#define LOWEST_RAD     0.15
#define PTM_TERMS      6
#define MAX_PLANES     (HSH_MAX_TERMS + 1)

struct relight {
    const char *path;
    const struct import_wish *wish;
    JsonObject *info; /* owned by the parser */
    gboolean hsh, lrgb;
    /* n_terms: number of terms b_j
     * n_planes: number of planes; each plane is one picture */
    int n_terms, n_planes;
    int width, height, n_lights;
    /* lights: n_lights × 3
     * scale, bias: n_planes × 3 each */
    double *lights, *scale, *bias;
    guint8 *planes[MAX_PLANES]; /* pixels of each plane: height × width × 3 */
};

static void relight_clear(struct relight *relight) {
    for (int i = 0; i < MAX_PLANES; i++)
        g_free(relight->planes[i]);
    g_free(relight->lights);
    g_free(relight->scale);
    g_free(relight->bias);
}

static const char *relight_word(const struct relight *relight, const char *key) {
    JsonNode *node = json_object_get_member(relight->info, key);
    return node && JSON_NODE_HOLDS_VALUE(node) && json_node_get_value_type(node) == G_TYPE_STRING
               ? json_node_get_string(node)
               : "none";
}

static gboolean relight_number(JsonNode *node, double *ret) {
    if (!node || !JSON_NODE_HOLDS_VALUE(node) ||
        (json_node_get_value_type(node) != G_TYPE_INT64 &&
         json_node_get_value_type(node) != G_TYPE_DOUBLE))
        return FALSE;
    *ret = json_node_get_double(node);
    return isfinite(*ret);
}

/* Reads an array of n numbers. n = 0 allows any multiple of three, up to MAX_LIGHTS × 3. Returns
 * NULL with an error if there is no such array. g_free() */
static double *relight_numbers(const struct relight *relight, JsonObject *of, const char *key,
                               guint n, guint *ret_n, GError **error) {
    JsonNode *node = json_object_get_member(of, key);
    JsonArray *array = node && JSON_NODE_HOLDS_ARRAY(node) ? json_node_get_array(node) : NULL;
    const guint length = array ? json_array_get_length(array) : 0;
    g_autofree double *ret = g_new(double, length + 1);
    gboolean good = n ? length == n : length > 0 && length % 3 == 0 && length / 3 <= MAX_LIGHTS;
    const gboolean counted = good;
    guint i = 0;
    while (good && i < length)
        if ((good = relight_number(json_array_get_element(array, i), &ret[i])))
            i++;
    if (ret_n)
        *ret_n = length;
    if (good)
        return g_steal_pointer(&ret);
    if (!array)
        data_error_set(relight->path, 0, error,
                       "“%s” is missing or no array; build the set again in Relight", key);
    else if (counted)
        data_error_set(
            relight->path, 0, error,
            "value %u of “%s”, counted from 0, is not a number; build the set again in Relight", i,
            key);
    else if (n)
        data_error_set(relight->path, 0, error,
                       "“%s” has %u values, but needs %u numbers; build the set again in Relight",
                       key, length, n);
    else
        data_error_set(relight->path, 0, error,
                       "“%s” has %u values, but needs x, y and z of 1 to %d lights, under which "
                       "the material is evaluated; correct this list",
                       key, length, MAX_LIGHTS);
    return NULL;
}

/* Chooses the lights under which the material is evaluated, if the file lists none. */
static gboolean relight_take_directions(struct relight *relight, GError **error) {
    const char *path = relight->wish->directions;
    struct btf_directions *from = path ? btf_directions_read(path, error) : btf_directions_81();
    if (!from)
        return FALSE;
    relight->n_lights = (int)from->lights.n;
    relight->lights = g_new(double, 3 * from->lights.n);
    for (gsize i = 0; i < from->lights.n; i++) {
        const double theta = (double)from->lights.theta_deg[i] * G_PI / 180;
        const double phi = (double)from->lights.phi_deg[i] * G_PI / 180;
        relight->lights[3 * i] = sin(theta) * cos(phi);
        relight->lights[3 * i + 1] = sin(theta) * sin(phi);
        relight->lights[3 * i + 2] = cos(theta);
    }
    if (relight->wish->notes)
        g_ptr_array_add(
            relight->wish->notes,
            g_strdup_printf(
                "%s lists no lights; the material is evaluated under the %d lights of %s",
                relight->path, relight->n_lights, path ? path : "the papers"));
    btf_directions_free(from);
    return TRUE;
}

static gboolean relight_read_info(struct relight *relight, GError **error) {
    const char *type = relight_word(relight, "type"), *space = relight_word(relight, "colorspace");
    JsonNode *materials = json_object_get_member(relight->info, "materials");
    double width = 0, height = 0, planes = 0;
    guint n;
    relight->hsh = g_str_equal(type, "hsh");
    relight->lrgb = g_str_equal(space, "lrgb");
    if ((!relight->hsh && !g_str_equal(type, "ptm")) ||
        (!relight->lrgb && !g_str_equal(space, "rgb")))
        return data_error_fail(
            relight->path, 0, error,
            "type is %s and colorspace is %s; only ptm or hsh with rgb or lrgb can be read", type,
            space);
    relight_number(json_object_get_member(relight->info, "width"), &width);
    relight_number(json_object_get_member(relight->info, "height"), &height);
    relight_number(json_object_get_member(relight->info, "nplanes"), &planes);
    if (!(width >= 1 && width <= 65536) || !(height >= 1 && height <= 65536))
        return data_error_fail(relight->path, 0, error,
                               "width is %g and height is %g; both must be 1 to 65536 pixels",
                               width, height);
    relight->width = (int)width;
    relight->height = (int)height;
    relight->n_planes = (int)CLAMP(planes / 3, 0, MAX_PLANES);
    relight->n_terms = relight->lrgb ? 3 * (relight->n_planes - 1) : relight->n_planes;
    if (relight->n_planes * 3 != planes ||
        (relight->hsh ? relight->n_terms != 4 && relight->n_terms != 9 && relight->n_terms != 16
                      : relight->n_terms != PTM_TERMS))
        return data_error_fail(
            relight->path, 0, error,
            "nplanes is %g, which is not possible for %s in %s; build the set again in Relight",
            planes, type, space);
    JsonArray *list =
        materials && JSON_NODE_HOLDS_ARRAY(materials) ? json_node_get_array(materials) : NULL;
    JsonNode *first = list && json_array_get_length(list) ? json_array_get_element(list, 0) : NULL;
    if (!first || !JSON_NODE_HOLDS_OBJECT(first))
        return data_error_fail(relight->path, 0, error,
                               "“materials” is missing, or is not a list that begins with an "
                               "object; it must have scale and bias");
    n = (guint)relight->n_planes * 3;
    JsonObject *material = json_node_get_object(first);
    if (!(relight->scale = relight_numbers(relight, material, "scale", n, NULL, error)) ||
        !(relight->bias = relight_numbers(relight, material, "bias", n, NULL, error)))
        return FALSE;
    if (!json_object_has_member(relight->info, "lights"))
        return relight_take_directions(relight, error);
    relight->lights = relight_numbers(relight, relight->info, "lights", 0, &n, error);
    relight->n_lights = (int)n / 3;
    return relight->lights != NULL;
}

static gboolean relight_read_plane(struct relight *relight, int plane, GError **error) {
    const char *format = relight_word(relight, "format");
    g_autofree char *folder = g_path_get_dirname(relight->path);
    g_autofree char *name =
        g_strdup_printf("plane_%d.%s", plane, g_str_equal(format, "png") ? "png" : "jpg");
    g_autofree char *path = g_build_filename(folder, name, NULL);
    const gsize n = (gsize)relight->width * (gsize)relight->height * 3;
    if (!g_file_test(path, G_FILE_TEST_EXISTS))
        return data_error_fail(
            relight->path, 0, error,
            "there is no %s in the same folder. Planes that are cut into tiles (.dzi, .tzi, "
            "planes.tzi) cannot be read; build the set again in Relight as plain pictures without "
            "tiles, or import the photographs from which it was made (mesorig import rti)",
            name);
    g_autoptr(ImportPicture) picture = import_picture_read_codes(path, error);
    if (!picture)
        return FALSE;
    if (picture->width != relight->width || picture->height != relight->height)
        return data_error_fail(path, 0, error,
                               "it has %d × %d pixels, but info.json states %d × %d; build the set "
                               "again in Relight, or correct info.json",
                               picture->width, picture->height, relight->width, relight->height);
    if (picture->bits != 8)
        return data_error_fail(
            path, 0, error,
            "its numbers have %d bits (0: floating-point), but those of planes must "
            "have 8; build the set again in Relight",
            picture->bits);
    relight->planes[plane] = g_new(guint8, n);
    for (gsize i = 0; i < n; i++)
        relight->planes[plane][i] = isfinite(picture->rgb[i]) ? (guint8)picture->rgb[i] : 0;
    return TRUE;
}

/* Computes b_j of a light, which is a unit vector. */
static void relight_terms(const struct relight *relight, const float l[3], float *ret) {
    const float ptm[PTM_TERMS] = {1, l[0], l[1], l[0] * l[0], l[0] * l[1], l[1] * l[1]};
    if (!relight->hsh) {
        for (int i = 0; i < PTM_TERMS; i++)
            ret[i] = ptm[i];
        return;
    }
    const float z = MAX(l[2], (float)sin(LOWEST_RAD)), flat = hypotf(l[0], l[1]);
    const float wide = flat > 0 ? sqrtf(1 - MIN(z * z, 1)) / flat : 0;
    hsh_basis((const float[]){l[0] * wide, l[1] * wide, z}, relight->n_terms, ret);
}

static gboolean relight_give_picture(int view, int light, const struct import_region *region,
                                     float *const *ret_planes, int *ret_holes, gpointer data,
                                     GError **error) {
    const struct relight *relight = data;
    const double *d = relight->lights + 3 * light;
    const double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    const float l[3] = {(float)(d[0] / length), (float)(d[1] / length), (float)(d[2] / length)};
    const gsize n = (gsize)region->width * (gsize)region->height;
    float terms[HSH_MAX_TERMS];
    relight_terms(relight, l, terms);
    *ret_holes = 0;
    for (gsize i = 0; ret_planes && i < n; i++) {
        const gsize x = (gsize)region->x + i % (gsize)region->width;
        const gsize y = (gsize)region->y + i / (gsize)region->width;
        const gsize at = 3 * (y * (gsize)relight->width + x);
        double f[3] = {0}, lit = 0;
        for (int k = 0; k < 3 * relight->n_planes; k++) {
            const guint8 *plane = relight->planes[k / 3];
            const double c = plane[at + (gsize)k % 3] / 255.0;
            const double value = (c - relight->bias[k]) * relight->scale[k];
            if (!relight->lrgb)
                f[k % 3] += value * (double)terms[k / 3];
            else if (k < 3)
                f[k] = value;
            else if (k - 3 < relight->n_terms)
                lit += value * (double)terms[k - 3];
        }
        for (int c = 0; c < 3; c++) {
            const double v = MAX(relight->lrgb ? f[c] * lit : f[c], 0);
            ret_planes[c][i] = (float)srgb_decode(v);
        }
    }
    return TRUE;
}

static gboolean relight_import(struct relight *relight, const char *path,
                               const struct import_wish *wish, const struct work *work,
                               struct import_result *ret, GError **error) {
    g_autofree float *theta = NULL, *phi = NULL;
    const float straight = 0;
    double texel_mm = 0;
    if (!relight_read_info(relight, error))
        return FALSE;
    for (int i = 0; i < relight->n_planes; i++)
        if (!relight_read_plane(relight, i, error))
            return FALSE;
    relight_number(json_object_get_member(relight->info, "pixelSizeInMM"), &texel_mm);
    theta = g_new(float, relight->n_lights);
    phi = g_new(float, relight->n_lights);
    for (int i = 0; i < relight->n_lights; i++) {
        const double *d = relight->lights + 3 * i, flat = hypot(d[0], d[1]);
        if (!(d[2] > 0))
            return data_error_fail(relight->path, 0, error,
                                   "light %d is %g %g %g, but its third number must be above 0, "
                                   "because lights are above the sample; correct “lights”",
                                   i + 1, d[0], d[1], d[2]);
        theta[i] = (float)(atan2(flat, d[2]) * 180 / G_PI);
        phi[i] = flat > 0 ? (float)(fmod(atan2(d[1], d[0]) * 180 / G_PI + 360, 360)) : 0;
    }
    const struct import_material material = {
        .source = relight->path,
        .width = relight->width,
        .height = relight->height,
        .texel_mm = wish->texel_mm > 0 ? wish->texel_mm
                    : texel_mm > 0     ? texel_mm
                                       : 1,
        .region = wish->region,
        .n_views = 1,
        .n_lights = relight->n_lights,
        .view_theta_deg = &straight,
        .view_phi_deg = &straight,
        .light_theta_deg = theta,
        .light_phi_deg = phi,
        .picture = relight_give_picture,
        .data = relight,
    };
    return import_material(path, &material, work, ret, error);
}

gboolean import_relight(const char *path, const char *file, const struct import_wish *wish,
                        const struct work *work, struct import_result *ret, GError **error) {
    g_autofree char *info = g_file_test(file, G_FILE_TEST_IS_DIR)
                                ? g_build_filename(file, "info.json", NULL)
                                : g_strdup(file);
    struct relight relight = {.path = info, .wish = wish};
    g_autofree char *folder = g_path_get_dirname(info);
    g_autofree char *other = g_build_filename(folder, "info.xml", NULL);
    if (g_str_has_suffix(info, ".xml") ||
        (!g_file_test(info, G_FILE_TEST_EXISTS) && g_file_test(other, G_FILE_TEST_EXISTS)))
        return data_error_fail(g_str_has_suffix(info, ".xml") ? info : other, 0, error,
                               "it is a file of WebRTI, whose tiles cannot be read; import the "
                               ".ptm or .rti file from which it was made (mesorig import ptm)");
    GError *found = NULL;
    g_autofree char *text = input_file_read_text(info, MAX_INFO_BYTES, &found);
    g_autoptr(JsonParser) parser = json_parser_new_immutable();
    if (!text) {
        input_file_propagate(found, DATA_ERROR, DATA_ERROR_INVALID, DATA_ERROR_INVALID, error);
        return FALSE;
    }
    if (!json_parser_load_from_data(parser, text, -1, &found)) {
        data_error_set(info, 0, error,
                       "the file is not JSON (%s); copy it or build it again in Relight",
                       found->message);
        g_error_free(found);
        return FALSE;
    }
    JsonNode *root = json_parser_get_root(parser);
    if (!root || !JSON_NODE_HOLDS_OBJECT(root))
        return data_error_fail(
            info, 0, error,
            "the file is not a JSON object; give the info.json of a set that Relight has built");
    relight.info = json_node_get_object(root);
    const gboolean ok = relight_import(&relight, path, wish, work, ret, error);
    relight_clear(&relight);
    return ok;
}
