#include "light_normals.h"

#include <gio/gio.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/data_error.h"
#include "base/plural.h"
#include "btf/btf.h"
#include "btf/near_field.h"
#include "exr/exr.h"
#include "exr/exr_half.h"
#include "integrate_normals.h"
#include "session/session.h"

struct pictures {
    const struct near_field *near_field;
    int view;
    const float **planes; /* n_lights × 3: the channels R, G, B of the view's pictures */
    /* n_lights: the channel "mark" of each picture, or NULL for a picture without flags */
    const float **marks;
};

gboolean light_normals_applies(const char *path) {
    g_autofree char *mdf = g_build_filename(path, "products", "mdf.exr", NULL);
    g_autofree char *btf = g_build_filename(path, "products", "btf", NULL);
    return g_file_test(btf, G_FILE_TEST_IS_DIR) && !g_file_test(mdf, G_FILE_TEST_EXISTS);
}

/* Gives the values and lights of a texel. Values that are no measurements (lower bounds of
 * saturated pixels, values cut at the largest half, holes, predictions) become NaN. */
static void read_texel(int texel, float *ret_rgb, struct vec3 *ret_lights, gpointer data) {
    const struct pictures *pictures = data;
    const int n = (int)pictures->near_field->lights.n;
    for (int light = 0; light < n; light++) {
        const float *marks = pictures->marks[light];
        const gboolean known =
            !marks ||
            ((int)marks[texel] & (BTF_FLAG_BOUND | BTF_FLAG_HOLE | BTF_FLAG_PREDICTED)) == 0;
        for (int c = 0; c < 3; c++) {
            const float value = pictures->planes[3 * light + c][texel];
            ret_rgb[3 * light + c] = known && value < EXR_HALF_LARGEST ? value : NAN;
        }
        ret_lights[light] = near_field_light(pictures->near_field, pictures->view, light, texel);
    }
}

static gboolean take_planes(const ExrFile *file, const char *path, int n_texels,
                            struct pictures *to, GError **error) {
    static const char *const channels[] = {"R", "G", "B"};
    for (guint light = 0; light < file->parts->len; light++) {
        const struct exr_part *part = file->parts->pdata[light];
        to->marks[light] = exr_part_plane(part, "mark");
        for (int c = 0; c < 3; c++)
            to->planes[3 * light + (guint)c] = exr_part_plane(part, channels[c]);
        if (part->width * part->height != n_texels || !to->planes[3 * light] ||
            !to->planes[3 * light + 1] || !to->planes[3 * light + 2])
            return data_error_fail(
                path, 0, error,
                "the picture under light %u, counted from 0, lacks channel R, G or B, or does not "
                "have the size of the session; delete the file and process the session again, or "
                "import it again",
                light);
    }
    return TRUE;
}

static int by_size(const void *a, const void *b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

static void summarize(const struct photometric_texel *found, struct light_normals_result *ret) {
    g_autofree float *sigma = g_new(float, ret->texels), *used = g_new(float, ret->texels);
    int n = 0;
    for (int i = 0; i < ret->texels; i++) {
        ret->causes[found[i].cause]++;
        if (found[i].cause != PHOTOMETRIC_FOUND)
            continue;
        sigma[n] = found[i].sigma_deg;
        used[n++] = (float)found[i].used;
    }
    ret->holes = ret->texels - n;
    if (n == 0)
        return;
    qsort(sigma, (gsize)n, sizeof *sigma, by_size);
    qsort(used, (gsize)n, sizeof *used, by_size);
    ret->sigma_deg[0] = (double)sigma[n / 2];
    ret->sigma_deg[1] = (double)sigma[(int)(0.95 * (n - 1))];
    ret->used = (double)used[n / 2];
}

static struct exr_part *add_part(ExrFile *file, const char *name, const char *const *channels,
                                 const struct session_grid *grid,
                                 const struct light_normals_result *result) {
    struct exr_part *part = exr_part_new(name, grid->width, grid->height, channels, EXR_FLOAT);
    exr_file_add(file, part);
    exr_set_string(part, "mesorig.kind", name);
    exr_set_string(part, "mesorig.model", "lights");
    exr_set_double(part, "texel_mm", grid->width_mm / grid->width);
    exr_set_double(part, "reference_mm", grid->reference_mm);
    exr_set_int(part, "holes", result->holes);
    return part;
}

static gboolean write_maps(const struct photometric_texel *found, const struct session_grid *grid,
                           const char *path, gboolean heights,
                           const struct light_normals_result *result, GError **error) {
    static const char *const nz[] = {"N", "Z", NULL}, *const xyz[] = {"X", "Y", "Z", NULL},
                             *const y[] = {"Y", NULL}, *const bgr[] = {"B", "G", "R", NULL},
                             *const n[] = {"N", NULL};
    g_autoptr(ExrFile) file = exr_file_new();
    if (heights) {
        g_autofree float *normals = g_new(float, 3 * (gsize)result->texels);
        struct exr_part *part = add_part(file, "height", nz, grid, result);
        for (int i = 0; i < result->texels; i++) {
            const float normal[3] = {(float)found[i].normal.x, (float)found[i].normal.y,
                                     (float)found[i].normal.z};
            memcpy(normals + 3 * (gsize)i, normal, sizeof normal);
        }
        integrate_normals_of(normals, grid->width, grid->height, grid->width_mm / grid->width,
                             exr_part_plane(part, "Z"), exr_part_plane(part, "N"));
        return exr_write(path, file, EXR_ZIP, TRUE, error);
    }
    float *const *normal = add_part(file, "normals", xyz, grid, result)->planes;
    float *sigma = add_part(file, "sigma", y, grid, result)->planes[0];
    float *const *albedo = add_part(file, "albedo", bgr, grid, result)->planes;
    float *used = add_part(file, "used", n, grid, result)->planes[0];
    for (int i = 0; i < result->texels; i++) {
        const struct photometric_texel *t = &found[i];
        normal[0][i] = (float)t->normal.x;
        normal[1][i] = (float)t->normal.y;
        normal[2][i] = (float)t->normal.z;
        sigma[i] = t->sigma_deg;
        used[i] = t->cause == PHOTOMETRIC_FOUND ? (float)t->used : -(float)t->cause;
        for (int c = 0; c < 3; c++)
            albedo[c][i] = t->albedo[2 - c];
    }
    return exr_write(path, file, EXR_ZIP, TRUE, error);
}

/* Returns the most frequent cause of holes. */
static enum photometric_cause usual_cause(const struct light_normals_result *result) {
    int usual = PHOTOMETRIC_DARK;
    for (int cause = PHOTOMETRIC_DARK; cause < PHOTOMETRIC_CAUSES; cause++)
        if (result->causes[cause] > result->causes[usual])
            usual = cause;
    return (enum photometric_cause)usual;
}

/* Returns whether most values of the green planes are the largest half float. */
static gboolean are_cut(const struct pictures *pictures, int n_texels) {
    const int n_lights = (int)pictures->near_field->lights.n;
    gsize cut = 0;
    for (int i = 0; i < n_lights; i++)
        for (int texel = 0; texel < n_texels; texel++)
            cut += pictures->planes[3 * i + 1][texel] >= EXR_HALF_LARGEST;
    return 2 * cut > (gsize)n_lights * (gsize)n_texels;
}

static gboolean solve_view(const struct near_field *near_field, const char *path, const char *file,
                           gboolean heights, const struct work *work,
                           struct light_normals_result *ret, GError **error) {
    g_autoptr(ExrFile) exr = exr_read(path, error);
    const int n = (int)near_field->lights.n;
    g_autofree const float **planes = g_new0(const float *, 3 * (gsize)n);
    g_autofree const float **marks = g_new0(const float *, n);
    struct pictures pictures = {near_field, ret->view, planes, marks};
    const struct photometric_input input = {n, ret->texels, read_texel, &pictures};
    if (!exr || !take_planes(exr, path, ret->texels, &pictures, error))
        return FALSE;
    g_autofree struct photometric_texel *found =
        g_new0(struct photometric_texel, (gsize)ret->texels);
    if (!photometric_solve(&input, work, found, error))
        return FALSE;
    summarize(found, ret);
    if (ret->holes == ret->texels && are_cut(&pictures, ret->texels))
        return data_error_fail(path, 0, error,
                               "no texel has a normal, because most values are cut at %g, the "
                               "largest that the file can hold: response in the rig file "
                               "(for imported pictures, in the file of nominal values) is missing "
                               "or too small; write a larger one (“mesorig check” says how much), "
                               "and capture or import again",
                               (double)EXR_HALF_LARGEST);
    if (ret->holes == ret->texels)
        return data_error_fail(path, 0, error,
                               "no texel has a normal, because most texels %s; check the pictures "
                               "and the directions of the lights",
                               photometric_cause_text(usual_cause(ret)));
    return write_maps(found, &near_field->grid, file, heights, ret, error);
}

gboolean light_normals(const char *path, const char *file, gboolean heights,
                       const struct work *work, struct light_normals_result *ret, GError **error) {
    g_autoptr(Session) session = session_open(path, SESSION_READ, error);
    g_autoptr(GPtrArray) files = session ? session_btf_files(session, error) : NULL;
    struct near_field *near_field = files ? near_field_read(path, error) : NULL;
    gboolean ok = near_field != NULL;
    *ret = (struct light_normals_result){0};
    if (ok && near_field->lights.n < PHOTOMETRIC_MIN_LIGHTS)
        ok = data_error_fail(path, 0, error,
                             "the session has %d %s; normals need at least three lights, and at "
                             "least five to detect shadows and highlights",
                             PLURAL((int)near_field->lights.n, "light"));
    if (ok) {
        for (gsize v = 1; v < near_field->views.n; v++)
            if (near_field->views.theta_deg[v] < near_field->views.theta_deg[ret->view])
                ret->view = (int)v;
        ret->n_lights = (int)near_field->lights.n;
        ret->width = near_field->grid.width;
        ret->height = near_field->grid.height;
        ret->texels = ret->width * ret->height;
        ok = solve_view(near_field, files->pdata[ret->view], file, heights, work, ret, error);
    }
    near_field_free(near_field);
    return ok;
}
