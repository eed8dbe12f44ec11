/* Looks up the inputs of each view: the frames of all its lights and sweeps. A hash of these inputs
 * decides whether a product is up to date. It covers the checksums of the frames, the calibration
 * and the version of the method. */
#include "catalogue.h"

#include "base/data_error.h"
#include "btf/btf_sigma.h"

#include <math.h>
#include <string.h>

/* turntable angles are compared in steps of 1/ANGLES_PER_DEG degrees */
#define ANGLES_PER_DEG 10000

static gpointer frame_key(gint64 shot, int camera) {
    return GSIZE_TO_POINTER((gsize)shot * RIG_MAX_CAMERAS + (gsize)camera);
}

static gpointer source_key(enum session_shot_kind kind, int source, double turntable_deg) {
    gint64 turn = 360 * ANGLES_PER_DEG;
    gint64 angle = llround(remainder(turntable_deg, 360) * ANGLES_PER_DEG);
    angle = (angle % turn + turn) % turn;
    return GSIZE_TO_POINTER((((gsize)source * 4 + kind) * (gsize)turn) + (gsize)angle);
}

static void clear_rows(struct catalogue *catalogue) {
    g_clear_pointer(&catalogue->shots, g_ptr_array_unref);
    g_clear_pointer(&catalogue->frames, g_hash_table_unref);
    g_clear_pointer(&catalogue->by_source, g_hash_table_unref);
    g_clear_pointer(&catalogue->frame_rows, g_ptr_array_unref);
    g_clear_pointer(&catalogue->outputs, outputs_free);
}

void catalogue_free(struct catalogue *catalogue) {
    if (!catalogue)
        return;
    clear_rows(catalogue);
    g_clear_pointer(&catalogue->views, g_ptr_array_unref);
    g_clear_pointer(&catalogue->lights, g_ptr_array_unref);
    g_clear_pointer(&catalogue->lasers, g_ptr_array_unref);
    g_clear_pointer(&catalogue->rigs, g_hash_table_unref);
    g_free(catalogue->calibration);
    calibration_free(catalogue->known);
    calibration_free(catalogue->captured);
    g_free(catalogue);
}

static gboolean check_devices(const GPtrArray *directions, int n, const char *what,
                              const char *path, GError **error) {
    for (guint i = 0; i < directions->len; i++) {
        const struct session_direction *direction = g_ptr_array_index(directions, i);
        if (direction->device < 0 || direction->device >= n)
            return data_error_fail(path, 0, error,
                                   "the session's plan names %s %d, counted from 0, but the "
                                   "calibration has only %d; restore the session from a copy",
                                   what, direction->device, n);
    }
    return TRUE;
}

/* Checks a shot, and adds it to catalogue->by_source if it has a source. */
static gboolean add_shot(struct catalogue *catalogue, struct session_shot *shot, GError **error) {
    const int n = shot->kind == SHOT_LAMP    ? catalogue->rig.n_lamps
                  : shot->kind == SHOT_SWEEP ? catalogue->rig.n_lasers
                                             : G_MAXINT;
    const gboolean sweeps = shot->kind == SHOT_SWEEP && shot->state != SHOT_SKIPPED;
    if (shot->kind != SHOT_DARK && (shot->device < 0 || shot->device >= n))
        return data_error_fail(catalogue->directory, 0, error,
                               "shot %" G_GINT64_FORMAT " uses %s %d, counted from 0, but the "
                               "calibration has only %d; restore the session from a copy",
                               shot->id, shot->kind == SHOT_LAMP ? "lamp" : "laser", shot->device,
                               n);
    if (sweeps && shot->sweep_steps < 2)
        return data_error_fail(catalogue->directory, 0, error,
                               "the sweep of shot %" G_GINT64_FORMAT " has %d steps, but needs at "
                               "least 2; restore the session from a copy",
                               shot->id, shot->sweep_steps);
    if (shot->source < 0)
        return TRUE;
    gpointer key = source_key(shot->kind, shot->source, shot->turntable_deg);
    GPtrArray *shots = g_hash_table_lookup(catalogue->by_source, key);
    if (!shots) {
        shots = g_ptr_array_new();
        g_hash_table_insert(catalogue->by_source, key, shots);
    }
    g_ptr_array_add(shots, shot);
    return TRUE;
}

static double radians(double deg) {
    return deg * (G_PI / 180);
}

/* Returns the factor that converts the output of the lamp in a shot. The stored output is relative
 * to the calibration of the capture. The converted output is relative to the calibration that is
 * used. */
static double output_factor(const struct session_shot *shot, const char *camera, gpointer data) {
    const struct catalogue *catalogue = data;
    const struct rig *rig = &catalogue->rig;
    const gboolean lit =
        shot->kind == SHOT_LAMP && shot->device >= 0 && shot->device < rig->n_lamps;
    for (int i = 0; lit && i < rig->n_cameras; i++)
        if (strcmp(rig->cameras[i].name, camera) == 0)
            return calibration_output_factor(catalogue->captured, catalogue->known, i, shot->device,
                                             radians(shot->turntable_deg), radians(shot->arc_deg));
    return 1;
}

/* Reads shots and frames again, with all members that follow from them. The other members of the
 * catalogue never change. */
gboolean catalogue_refresh(struct catalogue *catalogue, Session *session, GError **error) {
    clear_rows(catalogue);
    catalogue->frames = g_hash_table_new(NULL, NULL);
    catalogue->by_source =
        g_hash_table_new_full(NULL, NULL, NULL, (GDestroyNotify)g_ptr_array_unref);
    catalogue->frame_rows = session_frames(session, error);
    catalogue->shots = catalogue->frame_rows ? session_shots(session, error) : NULL;
    catalogue->outputs =
        catalogue->shots
            ? outputs_load_relative(session, catalogue->shots,
                                    catalogue->captured ? output_factor : NULL, catalogue, error)
            : NULL;
    if (!catalogue->outputs)
        return FALSE;
    for (guint i = 0; i < catalogue->frame_rows->len; i++) {
        struct session_frame *frame = g_ptr_array_index(catalogue->frame_rows, i);
        g_hash_table_insert(catalogue->frames, frame_key(frame->shot, frame->camera), frame);
    }
    for (guint i = 0; i < catalogue->shots->len; i++)
        if (!add_shot(catalogue, g_ptr_array_index(catalogue->shots, i), error))
            return FALSE;
    return TRUE;
}

int catalogue_planned(const struct catalogue *catalogue) {
    int n = 0;
    for (guint i = 0; i < catalogue->shots->len; i++)
        n += ((const struct session_shot *)catalogue->shots->pdata[i])->state == SHOT_PLANNED;
    return n;
}

static gboolean load_calibration(struct catalogue *catalogue, Session *session, const char *path,
                                 const char *instead, GError **error) {
    catalogue->calibration = session_text(session, "calibration.conf", error);
    if (!catalogue->calibration ||
        !(catalogue->known = calibration_from_text(catalogue->calibration, path, error)))
        return FALSE;
    if (!instead)
        return TRUE;
    struct calibration *other =
        calibration_from_text(instead, "the calibration to process with", error);
    if (!other || !calibration_check_rig(other, "the calibration to process with",
                                         &catalogue->known->rig, error)) {
        calibration_free(other);
        return FALSE;
    }
    g_free(catalogue->calibration);
    catalogue->captured = catalogue->known;
    catalogue->known = other;
    catalogue->calibration = g_strdup(instead);
    return TRUE;
}

static gboolean do_load(struct catalogue *catalogue, Session *session, const char *calibration,
                        GError **error) {
    g_autofree char *path = session_file(session, "session.db (calibration.conf)");
    g_autofree char *reference = NULL;
    const struct session_grid *grid = &catalogue->grid;
    catalogue->directory = session_path(session);
    if (!session_read_value(session, LASER_REFERENCE_KEY, &reference, error) ||
        !load_calibration(catalogue, session, path, calibration, error) ||
        !session_grid(session, &catalogue->grid, error))
        return FALSE;
    if (grid->width < 1 || grid->height < 1 || grid->width > 8192 || grid->height > 8192 ||
        !(grid->width_mm > 0) || !(grid->height_mm > 0) || !isfinite(grid->width_mm) ||
        !isfinite(grid->height_mm) || !isfinite(grid->reference_mm) || !isfinite(grid->depth_mm))
        return data_error_fail(
            catalogue->directory, 0, error,
            "the session's grid has %d × %d texels (each must be 1 to 8192) on %g × "
            "%g mm (each must be above 0), reference_mm %g and depth_mm %g (must "
            "be finite); restore the session from a copy",
            grid->width, grid->height, grid->width_mm, grid->height_mm, grid->reference_mm,
            grid->depth_mm);
    if (reference && !laser_reference_from_text(reference, &catalogue->reference))
        return data_error_fail(
            catalogue->directory, 0, error,
            "the session's value %s is “%s”, but must be five numbers of at least 0 "
            "with “;” between them: height, error of the height, x and y of the "
            "hole, radius; restore the session from a copy",
            LASER_REFERENCE_KEY, reference);
    catalogue->reference.top_mm = grid->reference_mm;
    catalogue->rig = catalogue->known->rig;
    catalogue->rigs = g_hash_table_new_full(g_double_hash, g_double_equal, g_free, g_free);
    catalogue->views = session_views(session, error);
    catalogue->lights = catalogue->views ? session_lights(session, error) : NULL;
    catalogue->lasers = catalogue->lights ? session_lasers(session, error) : NULL;
    const struct rig *rig = &catalogue->rig;
    return catalogue->lasers &&
           check_devices(catalogue->views, rig->n_cameras, "camera", path, error) &&
           check_devices(catalogue->lights, rig->n_lamps, "lamp", path, error) &&
           check_devices(catalogue->lasers, rig->n_lasers, "laser", path, error) &&
           catalogue_refresh(catalogue, session, error);
}

struct catalogue *catalogue_load(Session *session, const char *calibration, GError **error) {
    struct catalogue *catalogue = g_new0(struct catalogue, 1);
    if (!do_load(catalogue, session, calibration, error))
        g_clear_pointer(&catalogue, catalogue_free);
    return catalogue;
}

static const struct session_shot *find_shot(const struct catalogue *catalogue,
                                            enum session_shot_kind kind,
                                            const struct session_direction *view, int source) {
    const GPtrArray *shots =
        g_hash_table_lookup(catalogue->by_source, source_key(kind, source, view->turntable_deg));
    for (guint i = 0; shots && i < shots->len; i++) {
        const struct session_shot *shot = g_ptr_array_index(shots, i);
        if (camera_set_has(shot->cameras, view->device))
            return shot;
    }
    return NULL;
}

/* Returns whether the frame of a shot is ready, awaited or impossible. It is ready if the shot is
 * done. It is impossible if the plan skips the shot or has no such shot. Sets ret only if the frame
 * is ready. */
static enum catalogue_state find_input(const struct catalogue *catalogue,
                                       const struct session_shot *shot,
                                       const struct session_direction *view, struct input *ret) {
    if (!shot || shot->state == SHOT_SKIPPED)
        return CATALOGUE_IMPOSSIBLE;
    const struct session_frame *frame =
        g_hash_table_lookup(catalogue->frames, frame_key(shot->id, view->device));
    if (!frame || shot->state != SHOT_DONE)
        return CATALOGUE_WAITING;
    ret->path = g_build_filename(catalogue->directory, frame->path, NULL);
    ret->sha256 = g_strdup(frame->sha256);
    ret->shot = shot->id;
    ret->turntable_deg = session_frame_turntable_deg(frame, shot);
    ret->width = catalogue->rig.cameras[view->device].width;
    ret->height = catalogue->rig.cameras[view->device].height;
    return CATALOGUE_READY;
}

GChecksum *catalogue_checksum(const struct catalogue *catalogue, const char *kind) {
    const struct session_grid *grid = &catalogue->grid;
    GChecksum *sum = g_checksum_new(G_CHECKSUM_SHA256);
    int method = strcmp(kind, "btf") == 0 ? BTF_METHOD : MDF_METHOD;
    input_hash(sum, "%s %s %d", kind, MESORIG_VERSION, method);
    input_hash(sum, "%s", catalogue->calibration);
    input_hash(sum, "%d %d %.17g %.17g %.17g %.17g", grid->width, grid->height, grid->width_mm,
               grid->height_mm, grid->reference_mm, grid->depth_mm);
    return sum;
}

/* Begins the hash of the inputs of a view. So far the hash contains the inputs that all views
 * share, and the direction of this view. */
static GChecksum *view_checksum(const struct catalogue *catalogue, const char *kind,
                                const struct session_direction *view) {
    GChecksum *sum = catalogue_checksum(catalogue, kind);
    input_hash(sum, "%d %d %.17g %.17g %.17g", view->index, view->device, view->theta_deg,
               view->phi_deg, view->turntable_deg);
    return sum;
}

/* Returns the rig as the sample sees it at an angle of the turntable (rig_at()). The rig is owned
 * by the catalogue and made once for each angle. */
static const struct rig *rig_at_angle(const struct catalogue *catalogue, double turntable_deg) {
    if (!(rig_wobble_most_rad(&catalogue->rig.wobble) > 0))
        return &catalogue->rig;
    struct rig *at = g_hash_table_lookup(catalogue->rigs, &turntable_deg);
    if (at)
        return at;
    at = g_new(struct rig, 1);
    rig_at(&catalogue->rig, radians(turntable_deg), at);
    g_hash_table_insert(catalogue->rigs, g_memdup2(&turntable_deg, sizeof turntable_deg), at);
    return at;
}

/* Adds a light and its input to a view, and the input to the hash. input is NULL for a light that
 * the plan left out for this view. shot is then the skipped shot, which gives the lamp's
 * position. */
static void add_light(struct btf_view *btf, const struct catalogue *catalogue,
                      const struct session_direction *direction, const struct session_shot *shot,
                      const struct input *input, GChecksum *sum) {
    const struct radiometry_lamp *lamp = &catalogue->known->lamp_radiometry[shot->device];
    const struct rig *rig =
        rig_at_angle(catalogue, input ? input->turntable_deg : shot->turntable_deg);
    struct btf_light light = {.index = direction->index,
                              .theta_deg = direction->theta_deg,
                              .phi_deg = direction->phi_deg,
                              .arc = &rig->arc,
                              .lamp = &rig->lamps[shot->device],
                              .arc_rad = radians(shot->arc_deg),
                              .turntable_rad = btf->turntable_rad,
                              .missing = input == NULL};
    if (input) {
        light.radiometry = lamp;
        light.output = lamp->known ? outputs_of(catalogue->outputs, shot->id) : 1;
        light.output_error = outputs_error(catalogue->outputs, shot->id);
        light.input = *input;
        if (input->turntable_deg != shot->turntable_deg) {
            light.turntable_rad = radians(input->turntable_deg);
            input_hash(sum, "turned %.17g", input->turntable_deg);
        }
        input_hash(sum, "%d %.17g %.17g %d %.17g %.17g %s", light.index, light.theta_deg,
                   light.phi_deg, shot->device, shot->arc_deg, light.output, input->sha256);
    } else {
        btf->n_missing++;
        light.left_out = shot->note && g_str_has_prefix(shot->note, SESSION_LEFT_OUT);
        input_hash(sum, "%d %s %.17g %.17g", light.index, light.left_out ? "left out" : "missing",
                   light.theta_deg, light.phi_deg);
    }
    g_array_append_val(btf->lights, light);
}

enum catalogue_state catalogue_btf(const struct catalogue *catalogue, int index,
                                   struct btf_view **ret) {
    const struct session_direction *view = g_ptr_array_index(catalogue->views, index);
    struct btf_view *btf = g_new0(struct btf_view, 1);
    btf->index = view->index;
    btf->theta_deg = view->theta_deg;
    btf->phi_deg = view->phi_deg;
    btf->camera = &rig_at_angle(catalogue, view->turntable_deg)->cameras[view->device];
    btf->radiometry = &catalogue->known->camera_radiometry[view->device];
    const struct calibration_noise *noise = &catalogue->known->noise[view->device];
    const struct calibration_camera *camera = &catalogue->known->cameras[view->device];
    btf->noise = noise->known ? &noise->transfer : NULL;
    btf->misregistration_px = camera->known ? camera->residual_rms_px : 0;
    btf->turntable_rad = radians(view->turntable_deg);
    btf->grid = catalogue->grid;
    btf->lights = g_array_new(FALSE, FALSE, sizeof(struct btf_light));
    g_autoptr(GChecksum) sum = view_checksum(catalogue, "btf", view);
    if (btf->noise)
        input_hash(sum, "sigma %d", BTF_SIGMA_METHOD);
    enum catalogue_state state = catalogue->lights->len ? CATALOGUE_READY : CATALOGUE_IMPOSSIBLE;
    for (guint i = 0; i < catalogue->lights->len; i++) {
        const struct session_direction *direction = g_ptr_array_index(catalogue->lights, i);
        const struct session_shot *shot = find_shot(catalogue, SHOT_LAMP, view, direction->index);
        struct input input = {0};
        enum catalogue_state one = find_input(catalogue, shot, view, &input);
        if (one == CATALOGUE_READY)
            add_light(btf, catalogue, direction, shot, &input, sum);
        else if (one == CATALOGUE_IMPOSSIBLE && shot)
            add_light(btf, catalogue, direction, shot, NULL, sum);
        if (one == CATALOGUE_WAITING || !shot)
            state = MAX(state, one);
    }
    int left_out = 0;
    for (guint i = 0; i < btf->lights->len; i++)
        left_out += g_array_index(btf->lights, struct btf_light, i).left_out;
    if (btf->n_missing - left_out > BTF_MAX_MISSING * catalogue->lights->len ||
        btf->n_missing == (int)catalogue->lights->len)
        state = CATALOGUE_IMPOSSIBLE;
    btf->inputs = g_strdup(g_checksum_get_string(sum));
    if (state == CATALOGUE_READY && ret)
        *ret = g_steal_pointer(&btf);
    btf_view_free(btf);
    return state;
}

void mdf_job_free(struct mdf_job *job) {
    if (!job)
        return;
    for (guint i = 0; job->sweeps && i < job->sweeps->len; i++)
        input_clear(&g_array_index(job->sweeps, struct mdf_input, i).input);
    g_clear_pointer(&job->sweeps, g_array_unref);
    g_free(job->inputs);
    g_free(job);
}

/* Standard error of turn and roll of a laser that was not calibrated. The error is large because
 * lasers are mounted by hand. */
#define UNKNOWN_RAD 0.02

static gboolean has_sheet(const struct calibration_laser *known) {
    return known->known && known->sheet.covariance[RIG_SHEET_OFFSET][RIG_SHEET_OFFSET] > 0;
}

/* Returns the standard errors of a laser's turn and roll. The error of the turn is the error of the
 * sheet's offset at the sample, divided by the distance of the laser. Calibrations of earlier
 * versions do not have the errors of the sheet. The errors of the laser's normal and axis are then
 * used. */
static struct laser_known catalogue_laser(const struct calibration_laser *known,
                                          const struct rig_laser *laser) {
    const double(*c)[RIG_SHEET_PARAMETERS] = known->sheet.covariance;
    if (!known->known)
        return (struct laser_known){UNKNOWN_RAD, UNKNOWN_RAD};
    if (!has_sheet(known))
        return (struct laser_known){known->normal_rad, known->axis_rad};
    return (struct laser_known){sqrt(c[RIG_SHEET_OFFSET][RIG_SHEET_OFFSET]) /
                                    vec3_length(laser->position_mm),
                                sqrt(c[RIG_SHEET_ALONG][RIG_SHEET_ALONG])};
}

static void add_sweep(struct mdf_job *job, const struct catalogue *catalogue,
                      const struct session_shot *shot, const struct input *input, GChecksum *sum) {
    const struct calibration_laser *known = &catalogue->known->lasers[shot->device];
    struct mdf_input sweep = {.arc = &job->rig->arc,
                              .laser = &job->rig->lasers[shot->device],
                              .arc_rad = radians(shot->arc_deg),
                              .from_rad = radians(shot->sweep_from_deg),
                              .to_rad = radians(shot->sweep_to_deg),
                              .steps = shot->sweep_steps,
                              .position = shot->source,
                              .known = catalogue_laser(known, &catalogue->rig.lasers[shot->device]),
                              .errors = has_sheet(known) ? &known->sheet : NULL,
                              .line_rad = known->line_rad,
                              .input = *input};
    g_array_append_val(job->sweeps, sweep);
    input_hash(sum, "%d %d %.17g %.17g %.17g %d %s", shot->source, shot->device, shot->arc_deg,
               shot->sweep_from_deg, shot->sweep_to_deg, shot->sweep_steps, input->sha256);
}

enum catalogue_state catalogue_mdf(const struct catalogue *catalogue, int index,
                                   struct mdf_job **ret) {
    const struct session_direction *view = g_ptr_array_index(catalogue->views, index);
    struct mdf_job *job = g_new0(struct mdf_job, 1);
    job->view = view;
    job->rig = rig_at_angle(catalogue, view->turntable_deg);
    job->camera = &job->rig->cameras[view->device];
    job->turntable_rad = radians(view->turntable_deg);
    job->reference = &catalogue->reference;
    calibration_sight(catalogue->known, view->device, vec3(0, 0, catalogue->grid.reference_mm),
                      job->sight_px2);
    job->sweeps = g_array_new(FALSE, FALSE, sizeof(struct mdf_input));
    g_autoptr(GChecksum) sum = view_checksum(catalogue, "mdf", view);
    g_autofree char *reference = laser_reference_to_text(&catalogue->reference);
    input_hash(sum, "%s", reference);
    job->lines_in_pictures = catalogue->lines_in_pictures;
    if (job->lines_in_pictures)
        input_hash(sum, "lines in pictures");
    job->plain_merge = catalogue->plain_merge;
    if (job->plain_merge)
        input_hash(sum, "plain merge");
    gboolean waiting = FALSE;
    for (guint i = 0; i < catalogue->lasers->len && job->sweeps->len < MDF_MAX_SWEEPS; i++) {
        const struct session_direction *direction = g_ptr_array_index(catalogue->lasers, i);
        const struct session_shot *shot = find_shot(catalogue, SHOT_SWEEP, view, direction->index);
        struct input input = {0};
        enum catalogue_state one = find_input(catalogue, shot, view, &input);
        if (one == CATALOGUE_READY)
            add_sweep(job, catalogue, shot, &input, sum);
        waiting |= one == CATALOGUE_WAITING;
    }
    enum catalogue_state state = waiting            ? CATALOGUE_WAITING
                                 : job->sweeps->len ? CATALOGUE_READY
                                                    : CATALOGUE_IMPOSSIBLE;
    job->inputs = g_strdup(g_checksum_get_string(sum));
    if (state == CATALOGUE_READY && ret)
        *ret = g_steal_pointer(&job);
    mdf_job_free(job);
    return state;
}
