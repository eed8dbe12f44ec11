/* Makes products/mdf.exr from sweep files. The views are first made independently of each other.
 * Then D and P of all views are set together. */
#include "mdf_product.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "frames/laser_pictures.h"
#include "mdf/mdf_views.h"

static const char *const channels[] = {"D", "M", "N", "O", "P", "S", NULL};
enum { PLANE_D, PLANE_M, PLANE_N, PLANE_O, PLANE_P, PLANE_S, N_PLANES };

void mdf_result_free(struct mdf_result *result) {
    if (!result)
        return;
    for (int i = 0; i < N_PLANES; i++)
        g_free(result->planes[i]);
    g_free(result->inputs);
    g_free(result->agreed);
    g_free(result);
}

static struct mdf_result *new_result(const struct session_direction *view, const char *inputs,
                                     int n_texels) {
    struct mdf_result *result = g_new0(struct mdf_result, 1);
    result->index = view->index;
    result->theta_deg = view->theta_deg;
    result->phi_deg = view->phi_deg;
    result->inputs = g_strdup(inputs);
    result->agreed = g_strdup("");
    result->lines.worst_position = -1;
    for (int i = 0; i < N_PLANES; i++)
        result->planes[i] = g_new0(float, n_texels);
    return result;
}

/* Fails if the sweep in the file is not the sweep of the plan, because depths would then be
 * wrong. */
static gboolean check_sweep(const struct mdf_input *input, const struct exr_part *part,
                            GError **error) {
    double from = 0, to = 0, degree = G_PI / 180;
    int steps = 0;
    if (!exr_get_double(part, "sweep.from_deg", &from, error) ||
        !exr_get_double(part, "sweep.to_deg", &to, error) ||
        !exr_get_int(part, "sweep.steps", &steps, error)) {
        g_prefix_error(error, "%s: ", input->input.path);
        return FALSE;
    }
    if (fabs(from * degree - input->from_rad) < 1e-9 && fabs(to * degree - input->to_rad) < 1e-9 &&
        steps == input->steps)
        return TRUE;
    return data_error_fail(
        input->input.path, 0, error,
        "the sweep goes from %g° to %g° in %d steps, but the session's plan has %g° to %g° in %d "
        "steps; delete this file, and `mesorig resume` captures the sweep again",
        from, to, steps, input->from_rad / degree, input->to_rad / degree, input->steps);
}

/* Minimum height in DN of a line above the median of the reference region. */
#define LINE_DN 12

#define AGAIN "; delete %s, and `mesorig resume` captures the sweep again"

/* Finds lines in each frame, as the paper does (Wang et al. 2005). Reads the frames that the
 * session has kept in the folder of the sweep's file. */
static gboolean find_in_pictures(const LaserRegion *region, const struct mdf_input *input,
                                 const struct laser_sweep *sweep, const struct exr_part *size,
                                 struct laser_lines *ret, GError **error) {
    g_autoptr(LaserPictures) pictures =
        laser_pictures_new(region, sweep, size->width, size->height, input->steps, LINE_DN);
    const gsize n = (gsize)size->width * size->height;
    g_autofree guint16 *pixels = g_new(guint16, n);
    const int stem = (int)strlen(input->input.path) - (int)strlen(".exr");
    for (int k = 0; k < input->steps; k++) {
        g_autofree char *path = g_strdup_printf("%.*s/%04d.exr", stem, input->input.path, k);
        g_autoptr(ExrPart) frame = exr_read_part(path, "frame", error);
        const float *values = frame ? exr_part_plane(frame, "Y") : NULL;
        if (!frame) {
            if (!g_file_test(path, G_FILE_TEST_EXISTS))
                g_prefix_error(error, "--laser-lines=pictures needs a session that was captured "
                                      "with keep_laser_frames = yes; leave this option out: ");
            return FALSE;
        }
        if (!values)
            return data_error_fail(path, 0, error, "part frame lacks channel Y" AGAIN,
                                   input->input.path);
        if ((gsize)frame->width * frame->height != n)
            return data_error_fail(
                path, 0, error, "the frame has %d × %d pixels, but the sweep has %d × %d" AGAIN,
                frame->width, frame->height, size->width, size->height, input->input.path);
        for (gsize i = 0; i < n; i++)
            pixels[i] = (guint16)CLAMP(values[i], 0.0F, 65535.0F);
        laser_pictures_add(pictures, pixels);
    }
    laser_pictures_finish(pictures, ret);
    return TRUE;
}

/* Finds the laser's lines in the reference region first, then intersects rays with the corrected
 * sheets. */
static gboolean add_sweep(MdfView *view, const LaserRegion *region, const struct mdf_input *input,
                          gboolean in_pictures, struct mdf_lines *count, GError **error) {
    static const char *const sweep_channels[] = {"intensity", "peak", "width", NULL};
    g_autoptr(ExrPart) part = input_read(&input->input, sweep_channels, error);
    if (!part || !check_sweep(input, part, error))
        return FALSE;
    struct laser_sweep sweep = {.arc = input->arc,
                                .laser = input->laser,
                                .arc_rad = input->arc_rad,
                                .from_rad = input->from_rad,
                                .step_rad = (input->to_rad - input->from_rad) / (input->steps - 1),
                                .peak = exr_part_plane(part, "peak"),
                                .width = exr_part_plane(part, "width"),
                                .intensity = exr_part_plane(part, "intensity"),
                                .second_peak = exr_part_plane(part, "second_peak"),
                                .second_intensity = exr_part_plane(part, "second_intensity"),
                                .errors = input->errors,
                                .line_rad = input->line_rad};
    struct laser_lines lines;
    if (!in_pictures)
        laser_lines_find(region, &sweep, input->steps, &input->known, &lines);
    else if (!find_in_pictures(region, input, &sweep, part, &lines, error))
        return FALSE;
    const double deg = lines.offset_rad * 180 / G_PI;
    const gboolean found = lines.turn_rad != NULL;
    const struct mdf_lines one = {.sweeps = 1,
                                  .found = found,
                                  .disagree = lines.disagrees,
                                  .squares_deg2 = deg * deg,
                                  .worst_deg = deg,
                                  .worst_position = found ? input->position : -1};
    mdf_lines_add(count, &one);
    sweep.lines = &lines;
    mdf_view_add(view, &sweep);
    laser_lines_clear(&lines);
    return TRUE;
}

struct mdf_result *mdf_make_view(const struct mdf_job *job, const struct session_grid *grid,
                                 GCancellable *cancellable, GError **error) {
    g_autoptr(MdfView) view = mdf_view_new(job->camera, job->turntable_rad, grid);
    g_autoptr(LaserRegion) region =
        laser_region_new(job->rig, job->camera, job->turntable_rad, job->reference);
    struct mdf_lines lines = {.worst_position = -1};
    struct mdf_light light;
    mdf_view_set_sight(view, job->sight_px2);
    if (job->plain_merge)
        mdf_view_set_plain(view);
    for (guint i = 0; i < job->sweeps->len; i++)
        if (g_cancellable_set_error_if_cancelled(cancellable, error) ||
            !add_sweep(view, region, &g_array_index(job->sweeps, struct mdf_input, i),
                       job->lines_in_pictures, &lines, error))
            return NULL;
    struct mdf_result *result = new_result(job->view, job->inputs, grid->width * grid->height);
    struct vec3 centre = rig_turn(rig_camera_centre_mm(job->camera), -job->turntable_rad);
    memcpy(result->centre_mm, (double[3]){centre.x, centre.y, centre.z}, sizeof result->centre_mm);
    mdf_view_light(view, &light);
    lines.width = light.width;
    lines.widths = light.width > 0;
    lines.scatter = light.scatter;
    lines.scatters = light.scatter > 0;
    result->lines = lines;
    float *const *p = result->planes;
    mdf_view_merge(view, p[PLANE_M], p[PLANE_N], p[PLANE_S]);
    mdf_view_other(view, p[PLANE_M], p[PLANE_O]);
    result->above = mdf_view_above(view, p[PLANE_M]);
    for (int i = 0; i < grid->width * grid->height; i++) {
        p[PLANE_D][i] = p[PLANE_M][i];
        p[PLANE_P][i] = p[PLANE_M][i] >= 0 ? MDF_MEASURED : MDF_UNSEEN;
    }
    return result;
}

/* Does nothing if D and P of all views were already set from the same views, according to the hash
 * in agreed. */
gboolean mdf_settle(struct mdf_result *const *results, int n, const struct session_grid *grid,
                    GCancellable *cancellable, void (*settled)(gpointer data), gpointer data) {
    g_autoptr(GChecksum) sum = g_checksum_new(G_CHECKSUM_SHA256);
    for (int i = 0; i < n; i++)
        input_hash(sum, "%s", results[i] ? results[i]->inputs : "");
    const char *agreed = g_checksum_get_string(sum);
    gboolean all = TRUE;
    for (int i = 0; i < n; i++)
        all &= !results[i] || strcmp(results[i]->agreed, agreed) == 0;
    if (all)
        return FALSE;
    const int n_texels = grid->width * grid->height;
    const struct mdf_plane plane = {grid->width, grid->height, grid->width_mm / grid->width,
                                    grid->reference_mm};
    g_autofree struct mdf_eye *eyes = g_new0(struct mdf_eye, n);
    g_autofree struct mdf_result **of = g_new0(struct mdf_result *, n);
    g_autofree guint8 *source = g_new(guint8, n_texels);
    int seen = 0;
    for (int i = 0; i < n; i++) {
        if (!results[i])
            continue;
        of[seen] = results[i];
        memcpy(eyes[seen].centre_mm, results[i]->centre_mm, sizeof eyes->centre_mm);
        eyes[seen].distance = results[i]->planes[PLANE_M];
        eyes[seen].other = results[i]->planes[PLANE_O];
        eyes[seen++].lasers = results[i]->planes[PLANE_N];
    }
    for (int v = 0; v < seen && !g_cancellable_is_cancelled(cancellable); v++) {
        mdf_views_settle(eyes, seen, v, &plane, of[v]->planes[PLANE_D], source);
        for (int i = 0; i < n_texels; i++)
            of[v]->planes[PLANE_P][i] = source[i];
        g_free(of[v]->agreed);
        of[v]->agreed = g_strdup(agreed);
        settled(data);
    }
    return TRUE;
}

/* Writes one part per view, with the attributes in pipeline.h. */
gboolean mdf_write(const char *path, struct mdf_result *const *results, int n,
                   const struct session_grid *grid, GError **error) {
    g_autoptr(ExrFile) file = exr_file_new();
    for (int k = 0; k < n; k++) {
        const struct mdf_result *result = results[k];
        if (!result)
            continue;
        g_autofree char *name = g_strdup_printf("view_%04d", result->index);
        struct exr_part *part = exr_part_new(name, grid->width, grid->height, channels, EXR_FLOAT);
        for (int i = 0; i < N_PLANES; i++)
            memcpy(part->planes[i], result->planes[i],
                   sizeof(float) * (gsize)grid->width * (gsize)grid->height);
        const double *centre = result->centre_mm;
        exr_set_double(part, "view.theta_deg", result->theta_deg);
        exr_set_double(part, "view.phi_deg", result->phi_deg);
        exr_set_v3d(part, "view.centre_mm", centre[0], centre[1], centre[2]);
        exr_set_double(part, "reference_mm", grid->reference_mm);
        exr_set_double(part, "texel_mm", grid->width_mm / grid->width);
        exr_set_string(part, "mesorig.inputs", result->inputs);
        exr_set_string(part, "mesorig.views", result->agreed);
        mdf_lines_write(part, &result->lines);
        exr_set_int(part, "mesorig.above", result->above);
        exr_file_add(file, part);
    }
    return exr_write(path, file, EXR_PIZ, TRUE, error);
}

static struct mdf_result *result_of(const struct exr_file *file, const struct catalogue *catalogue,
                                    const struct session_direction *view) {
    const struct session_grid *grid = &catalogue->grid;
    g_autofree char *name = g_strdup_printf("view_%04d", view->index);
    const struct exr_part *part = exr_file_part(file, name);
    const char *inputs = NULL, *agreed = NULL;
    double centre_mm[3];
    struct mdf_lines lines;
    if (!part || !mdf_lines_read(part, &lines) || part->width != grid->width ||
        part->height != grid->height || !exr_get_string(part, "mesorig.inputs", &inputs, NULL) ||
        !exr_get_string(part, "mesorig.views", &agreed, NULL) ||
        !exr_get_v3d(part, "view.centre_mm", centre_mm, NULL))
        return NULL;
    struct mdf_result *result = new_result(view, inputs, grid->width * grid->height);
    memcpy(result->centre_mm, centre_mm, sizeof centre_mm);
    result->lines = lines;
    exr_get_int(part, "mesorig.above", &result->above, NULL);
    g_free(result->agreed);
    result->agreed = g_strdup(agreed);
    for (int i = 0; i < N_PLANES; i++) {
        const float *plane = exr_part_plane(part, channels[i]);
        if (!plane) {
            mdf_result_free(result);
            return NULL;
        }
        memcpy(result->planes[i], plane, sizeof(float) * (gsize)grid->width * (gsize)grid->height);
    }
    return result;
}

gboolean mdf_read(const char *path, const struct catalogue *catalogue,
                  struct mdf_result **ret_results) {
    if (!g_file_test(path, G_FILE_TEST_IS_REGULAR))
        return FALSE;
    g_autoptr(ExrFile) file = exr_read(path, NULL);
    guint taken = 0;
    if (!file)
        return TRUE;
    for (guint i = 0; i < catalogue->views->len; i++) {
        ret_results[i] = result_of(file, catalogue, g_ptr_array_index(catalogue->views, i));
        taken += ret_results[i] != NULL;
    }
    return taken != file->parts->len;
}

double mdf_coverage(struct mdf_result *const *results, int n, int n_texels, double *ret_predicted) {
    gint64 seen = 0, predicted = 0, all = 0;
    for (int view = 0; view < n; view++)
        for (int i = 0; results[view] && i < n_texels; i++, all++) {
            const int source = (int)results[view]->planes[PLANE_P][i];
            seen += source == MDF_MEASURED || source == MDF_OTHER;
            predicted += source == MDF_PREDICTED;
        }
    *ret_predicted = all > 0 ? (double)predicted / (double)all : 0;
    return all > 0 ? (double)seen / (double)all : 0;
}
