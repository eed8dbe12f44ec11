#include "mdf_product.h"

#include <math.h>
#include <string.h>

static const char *const channels[] = {"D", "N", "S", NULL};
enum { N_PLANES = 3 };

void mdf_result_free(struct mdf_result *result) {
    if (!result)
        return;
    for (int i = 0; i < N_PLANES; i++)
        g_free(result->planes[i]);
    g_free(result->inputs);
    g_free(result);
}

static struct mdf_result *new_result(const struct session_direction *view, const char *inputs,
                                     int n_texels) {
    struct mdf_result *result = g_new0(struct mdf_result, 1);
    result->index = view->index;
    result->theta_deg = view->theta_deg;
    result->phi_deg = view->phi_deg;
    result->inputs = g_strdup(inputs);
    result->lines.worst_position = -1;
    for (int i = 0; i < N_PLANES; i++)
        result->planes[i] = g_new0(float, n_texels);
    return result;
}

/* The file's word against the plan's: a sweep that ran otherwise would give wrong depths. */
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
    g_set_error(error, PIPELINE_ERROR, PIPELINE_ERROR_DATA,
                "%s: swept from %g° to %g° in %d steps, but the session's plan says %g° to %g° in "
                "%d",
                input->input.path, from, to, steps, input->from_rad / degree,
                input->to_rad / degree, input->steps);
    return FALSE;
}

void mdf_lines_add(struct mdf_lines *to, const struct mdf_lines *more) {
    const gboolean graver = to->disagree == 0 && more->disagree > 0;
    const gboolean alike = (to->disagree > 0) == (more->disagree > 0);
    if (more->found > 0 &&
        (to->found == 0 || graver || (alike && fabs(more->worst_deg) > fabs(to->worst_deg)))) {
        to->worst_deg = more->worst_deg;
        to->worst_position = more->worst_position;
    }
    to->sweeps += more->sweeps;
    to->found += more->found;
    to->disagree += more->disagree;
    to->squares_deg2 += more->squares_deg2;
}

static void count_lines(struct mdf_lines *to, const struct laser_lines *lines, int position) {
    const double deg = lines->offset_rad * 180 / G_PI;
    const struct mdf_lines one = {1,   lines->turn_rad != NULL,        lines->disagrees, deg * deg,
                                  deg, lines->turn_rad ? position : -1};
    mdf_lines_add(to, &one);
}

static gboolean add_sweep(MdfView *view, const LaserRegion *region, const struct mdf_input *input,
                          struct mdf_lines *count, GError **error) {
    static const char *const sweep_channels[] = {"intensity", "peak", "width", NULL};
    struct exr_part *part = input_read(&input->input, sweep_channels, error);
    if (!part)
        return FALSE;
    gboolean ok = check_sweep(input, part, error);
    if (ok) {
        struct mdf_sweep sweep = {.arc = input->arc,
                                  .laser = input->laser,
                                  .arc_rad = input->arc_rad,
                                  .from_rad = input->from_rad,
                                  .step_rad =
                                      (input->to_rad - input->from_rad) / (input->steps - 1),
                                  .peak = exr_part_plane(part, "peak"),
                                  .width = exr_part_plane(part, "width"),
                                  .intensity = exr_part_plane(part, "intensity"),
                                  .second_peak = exr_part_plane(part, "second_peak"),
                                  .second_intensity = exr_part_plane(part, "second_intensity")};
        struct laser_lines lines;
        laser_lines_find(region, &sweep, input->steps, &input->known, &lines);
        sweep.lines = &lines;
        count_lines(count, &lines, input->position);
        mdf_view_add(view, &sweep);
        laser_lines_clear(&lines);
    }
    exr_part_free(part);
    return ok;
}

struct mdf_result *mdf_make_view(const struct mdf_job *job, const struct session_grid *grid,
                                 GCancellable *cancellable, GError **error) {
    g_autoptr(MdfView) view = mdf_view_new(job->camera, job->turntable_rad, grid);
    g_autoptr(LaserRegion) region =
        laser_region_new(job->rig, job->camera, job->turntable_rad, job->reference);
    struct mdf_lines lines = {.worst_position = -1};
    for (guint i = 0; i < job->sweeps->len; i++)
        if (g_cancellable_set_error_if_cancelled(cancellable, error) ||
            !add_sweep(view, region, &g_array_index(job->sweeps, struct mdf_input, i), &lines,
                       error))
            return NULL;
    struct mdf_result *result = new_result(job->view, job->inputs, grid->width * grid->height);
    struct vec3 centre = rig_turn(rig_camera_centre_mm(job->camera), -job->turntable_rad);
    memcpy(result->centre_mm, (double[3]){centre.x, centre.y, centre.z}, sizeof result->centre_mm);
    result->lines = lines;
    mdf_view_merge(view, result->planes[0], result->planes[1], result->planes[2]);
    return result;
}

static void set_lines(struct exr_part *part, const struct mdf_lines *lines) {
    exr_set_int(part, "lines.sweeps", lines->sweeps);
    exr_set_int(part, "lines.found", lines->found);
    exr_set_int(part, "lines.disagree", lines->disagree);
    exr_set_double(part, "lines.rms_deg", sqrt(lines->squares_deg2 / MAX(lines->found, 1)));
    exr_set_double(part, "lines.worst_deg", lines->worst_deg);
    exr_set_int(part, "lines.worst_position", lines->worst_position);
}

gboolean mdf_lines_read(const struct exr_part *part, struct mdf_lines *ret) {
    double rms;
    *ret = (struct mdf_lines){.worst_position = -1};
    if (!exr_get_int(part, "lines.sweeps", &ret->sweeps, NULL) ||
        !exr_get_int(part, "lines.found", &ret->found, NULL) ||
        !exr_get_int(part, "lines.disagree", &ret->disagree, NULL) ||
        !exr_get_double(part, "lines.rms_deg", &rms, NULL) ||
        !exr_get_double(part, "lines.worst_deg", &ret->worst_deg, NULL) ||
        !exr_get_int(part, "lines.worst_position", &ret->worst_position, NULL))
        return FALSE;
    ret->squares_deg2 = rms * rms * ret->found;
    return TRUE;
}

static struct exr_part *result_part(const struct mdf_result *result,
                                    const struct session_grid *grid) {
    g_autofree char *name = g_strdup_printf("view_%04d", result->index);
    struct exr_part *part = exr_part_new(name, grid->width, grid->height, channels, EXR_FLOAT);
    for (int i = 0; i < N_PLANES; i++)
        memcpy(part->planes[i], result->planes[i],
               sizeof(float) * (gsize)grid->width * (gsize)grid->height);
    exr_set_double(part, "view.theta_deg", result->theta_deg);
    exr_set_double(part, "view.phi_deg", result->phi_deg);
    const double *centre = result->centre_mm;
    exr_set_v3d(part, "view.centre_mm", centre[0], centre[1], centre[2]);
    exr_set_double(part, "reference_mm", grid->reference_mm);
    exr_set_double(part, "texel_mm", grid->width_mm / grid->width);
    exr_set_string(part, "mesorig.inputs", result->inputs);
    set_lines(part, &result->lines);
    return part;
}

gboolean mdf_write(const char *path, struct mdf_result *const *results, int n,
                   const struct session_grid *grid, GError **error) {
    struct exr_file *file = exr_file_new();
    for (int i = 0; i < n; i++)
        if (results[i])
            exr_file_add(file, result_part(results[i], grid));
    gboolean ok = exr_write(path, file, EXR_PIZ, TRUE, error);
    exr_file_free(file);
    return ok;
}

static struct mdf_result *result_of(const struct exr_file *file, const struct catalogue *catalogue,
                                    const struct session_direction *view) {
    const struct session_grid *grid = &catalogue->grid;
    g_autofree char *name = g_strdup_printf("view_%04d", view->index);
    const struct exr_part *part = exr_file_part(file, name);
    const char *inputs = NULL;
    double centre_mm[3];
    struct mdf_lines lines;
    if (!part || !mdf_lines_read(part, &lines) || part->width != grid->width ||
        part->height != grid->height || !exr_get_string(part, "mesorig.inputs", &inputs, NULL) ||
        !exr_get_v3d(part, "view.centre_mm", centre_mm, NULL))
        return NULL;
    struct mdf_result *result = new_result(view, inputs, grid->width * grid->height);
    memcpy(result->centre_mm, centre_mm, sizeof centre_mm);
    result->lines = lines;
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
    struct exr_file *file = exr_read(path, NULL);
    if (!file)
        return TRUE;
    guint taken = 0;
    for (guint i = 0; i < catalogue->views->len; i++) {
        ret_results[i] = result_of(file, catalogue, g_ptr_array_index(catalogue->views, i));
        taken += ret_results[i] != NULL;
    }
    gboolean other = taken != file->parts->len;
    exr_file_free(file);
    return other;
}

double mdf_coverage(struct mdf_result *const *results, int n, int n_texels) {
    gint64 seen = 0, all = 0;
    for (int view = 0; view < n; view++)
        for (int i = 0; results[view] && i < n_texels; i++, all++)
            seen += results[view]->planes[0][i] >= 0;
    return all > 0 ? (double)seen / (double)all : 0;
}
