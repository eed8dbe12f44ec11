/* Processes the frames in three steps. First, the tile gives the radiometry of cameras and lamps.
 * Then the dark surroundings of the tile give the veiling glare. Finally, the fiducials next to the
 * tile are calibrated with this radiometry. */
#include "tile_session.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

#include "radiometry/fiducials.h"
#include "session/inputs.h"
#include "tile_noise.h"

/* maximum reflectance of a fiducial; above 1, because the measured level and colour have errors */
#define MAX_WHITE 1.1
/* an aim that deviates from the nominal aim by more than this is doubted */
#define ASIDE_RAD (8 * G_PI / 180)
/* Two lamps count as exchanged if the deviation of the aims is smaller by at least this factor when
 * the lamps are exchanged. */
#define ASIDE_LESS 4.0
/* error of the model of tiles, lamps and lenses, relative to the signal */
#define MODEL_ERROR 5e-4
/* If there are more lamps than this, only neighbouring lamps are tested for an exchange. */
#define MAX_PAIRED 16

/* A frame that was captured under a lamp. */
struct lit_frame {
    struct input input;
    /* camera: index of the camera in the rig
     * shot: index into tile_shots */
    int camera, shot;
};

struct run {
    Session *session;
    struct calibration *calibration;
    const struct tile_options *options;
    struct tile tile;
    GPtrArray *shots;   /* all shots of the session */
    GArray *frames;     /* of struct lit_frame, in planned order */
    GArray *tile_shots; /* of struct tile_shot */
    GArray *taken_s;    /* of double: time of each element of tile_shots */
    GPtrArray *rejected;
    GArray *cells;
    struct tile_fit fit;
    struct tile_result *ret;
    gint64 begun_us;
    gboolean stopped;
};

static void clear_frame(gpointer frame) {
    input_clear(&((struct lit_frame *)frame)->input);
}

/* Collects the committed frames of lamp shots. */
static gboolean find_frames(struct run *run, GError **error) {
    const struct rig *rig = &run->calibration->rig;
    run->shots = session_shots(run->session, error);
    g_autoptr(GPtrArray) rows = run->shots ? session_frames(run->session, error) : NULL;
    gint64 last = 0;
    if (!rows)
        return FALSE;
    for (guint i = 0; i < rows->len; i++) {
        const struct session_frame *row = rows->pdata[i];
        if (row->shot < 1 || row->shot > (gint64)run->shots->len || row->camera >= rig->n_cameras)
            continue;
        const struct session_shot *shot = run->shots->pdata[row->shot - 1];
        if (shot->kind != SHOT_LAMP || shot->state != SHOT_DONE || shot->device >= rig->n_lamps)
            continue;
        if (run->frames->len == 0 || last != shot->id) {
            struct tile_shot taken = {shot->device, shot->arc_deg * G_PI / 180,
                                      session_frame_turntable_deg(row, shot) * G_PI / 180};
            g_array_append_val(run->tile_shots, taken);
            g_array_append_val(run->taken_s, row->captured_s);
        }
        last = shot->id;
        struct lit_frame frame = {{.path = session_file(run->session, row->path),
                                   .sha256 = g_strdup(row->sha256),
                                   .shot = shot->id,
                                   .width = rig->cameras[row->camera].width,
                                   .height = rig->cameras[row->camera].height},
                                  row->camera,
                                  (int)run->tile_shots->len - 1};
        g_array_append_val(run->frames, frame);
    }
    if (run->frames->len > 0)
        return TRUE;
    g_set_error(error, RADIOMETRY_ERROR, RADIOMETRY_ERROR_TOO_FEW,
                "%s: no frame of a lamp shot has been captured; mesorig resume captures the rest",
                session_path(run->session));
    return FALSE;
}

/* Reports progress before frame i, or after the last frame. Returns FALSE when cancelled. */
static gboolean tell(struct run *run, const char *stage, guint i) {
    run->stopped |=
        !work_tell(run->options->work, stage, (int)i, (int)run->frames->len, run->begun_us, NULL);
    return !run->stopped;
}

static gboolean check_stopped(const struct run *run, GError **error) {
    if (run->stopped)
        g_set_error_literal(error, G_IO_ERROR, G_IO_ERROR_CANCELLED, "cancelled");
    return !run->stopped;
}

/* Reads a frame and its mosaic. Returns NULL if the frame is rejected; the reason is then
 * recorded. */
static struct exr_part *read_frame(struct run *run, const struct input *input,
                                   const float **ret_mosaic, const char **ret_cfa) {
    static const char *const any[] = {NULL};
    g_autoptr(GError) error = NULL;
    int saturated = 0;
    struct exr_part *part = input_read(input, any, &error);
    if (part && (*ret_mosaic = input_mosaic(input->path, part, ret_cfa, &error)) != NULL) {
        exr_get_int(part, "mesorig.saturated", &saturated, NULL);
        if (saturated == 0)
            return part;
        g_set_error(&error, RADIOMETRY_ERROR, RADIOMETRY_ERROR_MISFIT,
                    "%s: %d pixels are saturated; use shorter exposures", input->path, saturated);
    }
    exr_part_free(part);
    g_ptr_array_add(run->rejected, g_strdup(error->message));
    return NULL;
}

static gboolean measure_tile(struct run *run, GError **error) {
    const struct tile_shot *shots = (const struct tile_shot *)(void *)run->tile_shots->data;
    for (guint i = 0; i < run->frames->len && tell(run, "tile", i); i++) {
        const struct lit_frame *frame = &g_array_index(run->frames, struct lit_frame, i);
        const char *cfa = NULL;
        const float *mosaic = NULL;
        struct exr_part *part = read_frame(run, &frame->input, &mosaic, &cfa);
        if (!part)
            continue;
        tile_measure(&run->calibration->rig, frame->camera, cfa, mosaic, &run->tile, shots,
                     frame->shot, run->cells);
        run->ret->pictures++;
        exr_part_free(part);
    }
    tell(run, "tile", run->frames->len);
    return check_stopped(run, error);
}

/* Returns the irradiance of a lamp at a point of the tile's face, without the lamp's output. */
static double light_at(const struct rig *rig, int lamp, double arc_rad, struct vec3 p) {
    const struct rig_lamp *l = &rig->lamps[lamp];
    const struct vec3 path = vec3_sub(rig_lamp_position_mm(&rig->arc, l, arc_rad), p);
    return MAX(path.z / vec3_length(path), 1e-3) * rig_lamp_irradiance(&rig->arc, l, arc_rad, p);
}

/* A fit. The lamps' fitted aims differ by angles from the aims in the rig file. aside_rad is the
 * RMS of these angles over the shots, and most_aside_rad is their maximum. */
struct light_fit {
    double residual, aside_rad, most_aside_rad;
};

static void light_fit_set(const struct run *run, const struct rig *found, double residual,
                          struct light_fit *ret) {
    const struct rig *rig = &run->calibration->rig;
    double sum = 0;
    *ret = (struct light_fit){.residual = residual};
    for (guint s = 0; s < run->tile_shots->len; s++) {
        const int lamp = g_array_index(run->tile_shots, struct tile_shot, s).lamp;
        const double off = vec3_length(vec3_sub(found->lamps[lamp].aim, rig->lamps[lamp].aim));
        sum += off * off;
        ret->most_aside_rad = MAX(ret->most_aside_rad, off);
    }
    ret->aside_rad = sqrt(sum / MAX(run->tile_shots->len, 1));
}

/* Fits under two assumptions: the lamp recorded as i was in truth lamps[i], and the arc stood at
 * `arc` times the recorded angles. The expected value of a cell is changed in proportion to the
 * light at its centre; this is sufficient because cells are small. Returns FALSE if the fit
 * fails. */
static gboolean try_light(const struct run *run, const int *lamps, double arc,
                          struct light_fit *ret) {
    const guint n_shots = run->tile_shots->len, n_cells = run->cells->len;
    struct rig rig = run->calibration->rig;
    g_autofree struct tile_shot *shots =
        g_memdup2(run->tile_shots->data, n_shots * sizeof(struct tile_shot));
    g_autofree struct tile_cell *cells =
        g_memdup2(run->cells->data, n_cells * sizeof(struct tile_cell));
    struct tile_fit fit = {.output = NULL};
    for (guint i = 0; i < n_cells; i++) {
        const struct tile_shot *shot = &shots[cells[i].shot];
        cells[i].expected *=
            light_at(&rig, lamps[shot->lamp], arc * shot->arc_rad, cells[i].point_mm) /
            light_at(&rig, shot->lamp, shot->arc_rad, cells[i].point_mm);
    }
    for (guint s = 0; s < n_shots; s++) {
        shots[s].lamp = lamps[shots[s].lamp];
        shots[s].arc_rad *= arc;
    }
    if (!tile_fit(&rig, shots, (int)n_shots, cells, (int)n_cells, &fit, NULL))
        return FALSE;
    light_fit_set(run, &rig, fit.residual, ret);
    tile_fit_clear(&fit);
    return TRUE;
}

/* Checks whether two lamps are exchanged. The light of an exchanged lamp falls on the tile from
 * another side than recorded, and a fit finds lamps that point elsewhere. `is` is the fit with the
 * recorded lamps, or NULL if that fit failed. Returns FALSE with an error that names the exchanged
 * lamps, or TRUE if none are found. */
static gboolean check_lamps(struct run *run, const struct light_fit *is, GError **error) {
    const struct rig *rig = &run->calibration->rig;
    const int n = rig->n_lamps;
    struct light_fit best = {.aside_rad = ASIDE_RAD}, other;
    int a = -1, b = -1, lamps[RIG_MAX_LAMPS];
    gboolean used[RIG_MAX_LAMPS] = {FALSE};
    if (is && is->most_aside_rad < ASIDE_RAD)
        return TRUE;
    if (is)
        best.aside_rad = MIN(best.aside_rad, is->aside_rad / ASIDE_LESS);
    for (guint s = 0; s < run->tile_shots->len; s++)
        used[g_array_index(run->tile_shots, struct tile_shot, s).lamp] = TRUE;
    for (int i = 0; i < n; i++)
        for (int k = i + 1; k < (n > MAX_PAIRED ? MIN(i + 2, n) : n); k++) {
            for (int l = 0; l < n; l++)
                lamps[l] = l == i ? k : l == k ? i : l;
            if (!(used[i] || used[k]) || !try_light(run, lamps, 1, &other) ||
                other.aside_rad >= best.aside_rad)
                continue;
            best = other;
            a = i;
            b = k;
        }
    if (a < 0)
        return TRUE;
    g_autofree char *fit =
        is ? g_strdup_printf("the fitted lamps point up to %.0f° away from their aim; with the two "
                             "exchanged, %.1f°",
                             is->most_aside_rad * 180 / G_PI, best.most_aside_rad * 180 / G_PI)
           : g_strdup_printf(
                 "the pictures do not fit a tile; with the two exchanged, they fit it to %.2g %%",
                 100 * best.residual);
    g_clear_error(error);
    g_set_error(error, RADIOMETRY_ERROR, RADIOMETRY_ERROR_MISFIT,
                "%s: lamps %s and %s are exchanged (%s). Exchange the indexes of [lamp %s] and "
                "[lamp %s] in the rig file, or their wiring, or, for imported pictures, their "
                "names in the table, and capture or import again",
                session_path(run->session), rig->lamps[a].name, rig->lamps[b].name, fit,
                rig->lamps[a].name, rig->lamps[b].name);
    return FALSE;
}

/* Looks for a mistake in the lamps or angles that explains the misfit. The mistakes are tried one
 * at a time. If the tile's pictures fit after a mistake is corrected, sets the error that describes
 * it. */
static void find_mistake(struct run *run, GError **error) {
    static const struct {
        double turntable, arc;
        const char *what, *fix;
    } all[] = {{1, -1, "the arc turns the wrong way",
                "the sign of steps_per_deg or units_per_deg of [axis arc]"},
               {1, 180 / G_PI, "the arc's angles are in radians, not in degrees",
                "steps_per_deg or units_per_deg of [axis arc]"},
               {-1, 1, "the turntable turns the wrong way",
                "the sign of steps_per_deg or units_per_deg of [axis turntable]"},
               {-1, -1, "turntable and arc turn the wrong way",
                "the signs of steps_per_deg or units_per_deg of [axis turntable] and [axis arc]"},
               {180 / G_PI, 1, "the turntable's angles are in radians, not in degrees",
                "steps_per_deg or units_per_deg of [axis turntable]"},
               {180 / G_PI, 180 / G_PI,
                "the angles of turntable and arc are in radians, not in degrees",
                "steps_per_deg or units_per_deg of [axis turntable] and [axis arc]"}};
    struct tile_shot *shots = (struct tile_shot *)(void *)run->tile_shots->data;
    const gsize n = run->tile_shots->len;
    g_autofree struct tile_shot *noted = g_memdup2(shots, n * sizeof *shots);
    double measured = 1; /* factor by which the turntable's angles are multiplied at present */
    struct light_fit fit;
    int lamps[RIG_MAX_LAMPS];
    for (int l = 0; l < RIG_MAX_LAMPS; l++)
        lamps[l] = l;
    if (!check_lamps(run, NULL, error))
        return;
    for (gsize i = 0; i < G_N_ELEMENTS(all); i++) {
        if (all[i].turntable != measured) { /* with other angles, other pixels show the tile */
            measured = all[i].turntable;
            for (gsize s = 0; s < n; s++)
                shots[s].turntable_rad = noted[s].turntable_rad * measured;
            g_array_set_size(run->cells, 0);
            if (!measure_tile(run, NULL))
                return;
        }
        if (!try_light(run, lamps, all[i].arc, &fit))
            continue;
        g_clear_error(error);
        g_set_error(
            error, RADIOMETRY_ERROR, RADIOMETRY_ERROR_MISFIT,
            "%s: %s; the pictures fit a tile, to %.2g %%, only if this is corrected. "
            "Correct %s in the rig file (units_per_deg for a G-code board) or, for imported "
            "pictures, the angles in the table, and capture or import again",
            session_path(run->session), all[i].what, 100 * fit.residual, all[i].fix);
        return;
    }
}

/* Finds the veiling glare of each camera, subtracts the glare from the cells' signals, and fits
 * again. The glare is found with the radiometry in run->fit and the rig of that fit. found is the
 * rig of the first fit on input, and the rig of the new fit on output. */
static gboolean correct_glare(struct run *run, struct rig *found, GError **error) {
    const struct tile_shot *shots = (const struct tile_shot *)(void *)run->tile_shots->data;
    g_autoptr(GArray) cells = g_array_new(FALSE, FALSE, sizeof(struct glare_cell));
    struct radiometry_camera known[RIG_MAX_CAMERAS] = {{0}};
    const guint rejected = run->rejected->len;
    gboolean any = FALSE;
    for (guint i = 0; i < run->frames->len && tell(run, "glare", i); i++) {
        const struct lit_frame *frame = &g_array_index(run->frames, struct lit_frame, i);
        const char *cfa = NULL;
        const float *mosaic = NULL;
        struct exr_part *part = read_frame(run, &frame->input, &mosaic, &cfa);
        if (part && run->fit.cameras[frame->camera].known)
            glare_measure(found, frame->camera, &run->fit.cameras[frame->camera], run->fit.lamps,
                          cfa, mosaic, &run->tile, shots, frame->shot, run->fit.output[frame->shot],
                          cells);
        exr_part_free(part);
    }
    /* the rejected frames are already in the list */
    g_ptr_array_set_size(run->rejected, (int)rejected);
    for (int c = 0; c < found->n_cameras; c++)
        any |= glare_fit((struct glare_cell *)(void *)cells->data, (int)cells->len, c, shots,
                         &known[c].glare, &known[c].glare_error) ||
               known[c].glare_error > 0;
    if (!any)
        return check_stopped(run, error);
    for (guint i = 0; i < run->cells->len; i++) {
        struct tile_cell *cell = &g_array_index(run->cells, struct tile_cell, i);
        const double glare = known[cell->camera].glare;
        cell->signal -= glare / (1 + glare) * cell->mean;
    }
    tile_fit_clear(&run->fit);
    *found = run->calibration->rig;
    if (!check_stopped(run, error) || !tile_fit(found, shots, (int)run->tile_shots->len,
                                                (const struct tile_cell *)(void *)run->cells->data,
                                                (int)run->cells->len, &run->fit, error))
        return FALSE;
    for (int c = 0; c < found->n_cameras; c++) {
        run->fit.cameras[c].glare = known[c].glare;
        run->fit.cameras[c].glare_error = known[c].glare_error;
    }
    return TRUE;
}

/* Fits the cells of all frames, checks the lamps, corrects the glare, and stores the results in the
 * calibration and in run->ret. */
static gboolean fit_tile(struct run *run, GError **error) {
    if (run->ret->pictures == 0) {
        g_set_error(error, RADIOMETRY_ERROR, RADIOMETRY_ERROR_TOO_FEW,
                    "%s: none of the %u pictures can be used; the first is rejected: %s",
                    session_path(run->session), run->frames->len,
                    run->rejected->len > 0 ? (char *)run->rejected->pdata[0]
                                           : "no reason is known");
        return FALSE;
    }
    struct calibration *to = run->calibration;
    struct rig found = to->rig;
    struct light_fit light;
    g_autoptr(GError) cause = NULL;
    if (!tile_fit(&found, (const struct tile_shot *)(void *)run->tile_shots->data,
                  (int)run->tile_shots->len, (const struct tile_cell *)(void *)run->cells->data,
                  (int)run->cells->len, &run->fit, &cause)) {
        if (g_error_matches(cause, RADIOMETRY_ERROR, RADIOMETRY_ERROR_MISFIT) ||
            g_error_matches(cause, RADIOMETRY_ERROR, RADIOMETRY_ERROR_TOO_FEW))
            find_mistake(run, &cause);
        g_propagate_error(error, g_steal_pointer(&cause));
        return FALSE;
    }
    light_fit_set(run, &found, run->fit.residual, &light);
    if (!check_lamps(run, &light, error) || !correct_glare(run, &found, error))
        return FALSE;
    to->rig = found;
    memcpy(to->camera_radiometry, run->fit.cameras, sizeof to->camera_radiometry);
    memcpy(to->lamp_radiometry, run->fit.lamps, sizeof to->lamp_radiometry);
    run->ret->cells = (int)run->cells->len;
    run->ret->expected = hypot(run->fit.expected, MODEL_ERROR);
    run->ret->exponent_off = run->fit.exponent_off;
    run->ret->aim_off_rad = run->fit.aim_off_rad;
    run->ret->residual = run->fit.residual;
    run->ret->quality = run->fit.quality;
    double least = HUGE_VAL, most = -HUGE_VAL;
    for (guint s = 0; s < run->tile_shots->len; s++) {
        least = MIN(least, run->fit.output[s]);
        most = MAX(most, run->fit.output[s]);
    }
    run->ret->drift = most - least;
    return TRUE;
}

static void add_marks(struct run *run, const struct lit_frame *frame, GArray *seen) {
    const struct calibration *known = run->calibration;
    const struct tile_shot *shot = &g_array_index(run->tile_shots, struct tile_shot, frame->shot);
    const char *cfa = NULL;
    const float *mosaic = NULL;
    struct exr_part *part = read_frame(run, &frame->input, &mosaic, &cfa);
    if (!part)
        return;
    struct fiducial_scene scene = {&known->rig,
                                   frame->camera,
                                   shot->lamp,
                                   shot->turntable_rad,
                                   shot->arc_rad,
                                   &known->camera_radiometry[frame->camera],
                                   &known->lamp_radiometry[shot->lamp]};
    guint first = seen->len;
    fiducials_measure(&scene, cfa, mosaic, seen);
    /* The signals are divided by the lamp's output in their shots, so that only the fiducial's
     * white is left. */
    for (guint k = first; k < seen->len; k++) {
        g_array_index(seen, struct fiducial_seen, k).output /= run->fit.output[frame->shot];
        g_array_index(seen, struct fiducial_seen, k).output_error /= run->fit.output[frame->shot];
    }
    exr_part_free(part);
}

/* Estimates the position and the white of each fiducial from all frames. */
static gboolean calibrate_marks(struct run *run, GError **error) {
    struct calibration *to = run->calibration;
    g_autoptr(GArray) seen = g_array_new(FALSE, FALSE, sizeof(struct fiducial_seen));
    guint rejected = run->rejected->len;
    double squares = 0;
    int n = 0;
    for (guint i = 0; to->rig.n_fiducials > 0 && i < run->frames->len; i++)
        if (tell(run, "marks", i))
            add_marks(run, &g_array_index(run->frames, struct lit_frame, i), seen);
    /* the rejected frames are already in the list */
    g_ptr_array_set_size(run->rejected, (int)rejected);
    for (int l = 0; l < to->rig.n_lamps; l++)
        if (to->lamp_radiometry[l].known) {
            squares +=
                to->lamp_radiometry[l].intensity_error * to->lamp_radiometry[l].intensity_error;
            n++;
        }
    /* relative standard error of the absolute level, which is the same for all cameras and lamps */
    const double level_error = n > 0 ? sqrt(squares / n) : 0;
    for (int m = 0; m < to->rig.n_fiducials; m++) {
        struct fiducial_fit fit;
        if (!fiducials_fit(&to->rig, (const struct fiducial_seen *)(void *)seen->data,
                           (int)seen->len, m, to->parts[CALIBRATION_CAMERAS].done, &fit))
            continue;
        to->fiducials[m].known = TRUE;
        to->rig.fiducials[m].centre_mm = fit.centre_mm;
        memcpy(to->fiducials[m].centre_mm, fit.centre_error_mm, sizeof fit.centre_error_mm);
        for (int k = 0; k < 3; k++) {
            to->rig.fiducials[m].reflectance[k] *= fit.white;
            to->fiducials[m].reflectance[k] = hypot(fit.white_error / fit.white, level_error) *
                                              to->rig.fiducials[m].reflectance[k];
            if (to->rig.fiducials[m].reflectance[k] <= MAX_WHITE)
                continue;
            g_set_error(error, RADIOMETRY_ERROR, RADIOMETRY_ERROR_MISFIT,
                        "with the tile's reflectance of %.3g, [mark %s] would reflect %.3g times "
                        "the light that falls on it. The tile is darker than --reflectance says, "
                        "or not clean; measure the tile, or give the number that its maker states",
                        run->options->reflectance[k], to->rig.fiducials[m].name,
                        to->rig.fiducials[m].reflectance[k]);
            return FALSE;
        }
        run->ret->marks++;
    }
    return check_stopped(run, error);
}

/* Sets size, height and reflectance of the tile, from the options and the session's grid. */
static gboolean set_tile(struct run *run, GError **error) {
    const struct tile_options *o = run->options;
    struct session_grid grid;
    if (!session_grid(run->session, &grid, error))
        return FALSE;
    run->tile = (struct tile){.width_mm = o->width_mm > 0 ? o->width_mm : grid.width_mm,
                              .height_mm = o->height_mm > 0 ? o->height_mm : grid.height_mm,
                              .top_mm = grid.reference_mm};
    memcpy(run->tile.reflectance, o->reflectance, sizeof o->reflectance);
    return TRUE;
}

/* Stores each lamp's relative output over time for reports. */
static void keep_drift(struct run *run) {
    static const char *const keys[] = {"taken_s", "lamp", "output", "output_error"};
    for (guint k = 0; k < G_N_ELEMENTS(keys); k++) {
        g_autoptr(GString) list = g_string_new(NULL);
        for (guint s = 0; s < run->tile_shots->len; s++) {
            const double values[] = {g_array_index(run->taken_s, double, s),
                                     g_array_index(run->tile_shots, struct tile_shot, s).lamp,
                                     run->fit.output[s], run->fit.output_error[s]};
            char text[G_ASCII_DTOSTR_BUF_SIZE];
            g_string_append_printf(list, "%s;",
                                   g_ascii_formatd(text, sizeof text, "%.7g", values[k]));
        }
        g_key_file_set_value(run->calibration->extra, "lamp drift", keys[k], list->str);
    }
}

/* Writes the description of the calibration into its part. */
static void set_part(struct run *run) {
    g_autoptr(GPtrArray) checksums = g_ptr_array_new();
    for (guint i = 0; i < run->frames->len; i++)
        g_ptr_array_add(checksums, g_array_index(run->frames, struct lit_frame, i).input.sha256);
    g_autofree char *sum =
        calibration_checksum((const char *const *)checksums->pdata, (int)checksums->len);
    struct calibration_part *part = calibration_set_part(
        run->calibration, CALIBRATION_RADIOMETRY, "white tile under every lamp", run->ret->pictures,
        sum, g_steal_pointer(&run->rejected));
    g_free(part->residual_unit);
    part->residual_unit = g_strdup("%");
    part->residual_rms = 100 * run->ret->residual;
    part->residual_expected = 100 * run->ret->expected;
    part->degrees_of_freedom = run->fit.degrees;
}

gboolean tile_session(Session *session, struct calibration *calibration,
                      const struct tile_options *options, struct tile_result *ret, GError **error) {
    struct run run = {.session = session,
                      .calibration = calibration,
                      .options = options,
                      .frames = g_array_new(FALSE, FALSE, sizeof(struct lit_frame)),
                      .tile_shots = g_array_new(FALSE, FALSE, sizeof(struct tile_shot)),
                      .taken_s = g_array_new(FALSE, FALSE, sizeof(double)),
                      .rejected = g_ptr_array_new_with_free_func(g_free),
                      .cells = g_array_new(FALSE, FALSE, sizeof(struct tile_cell)),
                      .begun_us = g_get_monotonic_time(),
                      .ret = ret};
    struct rig before = calibration->rig;
    memset(ret, 0, sizeof *ret);
    g_array_set_clear_func(run.frames, clear_frame);
    gboolean ok = set_tile(&run, error) && find_frames(&run, error) && measure_tile(&run, error) &&
                  fit_tile(&run, error) &&
                  tile_noise(session, calibration, run.shots, &ret->transfers, error) &&
                  calibrate_marks(&run, error);
    if (ok) {
        keep_drift(&run);
        set_part(&run);
    } else {
        calibration->rig = before;
    }
    g_clear_pointer(&run.shots, g_ptr_array_unref);
    g_array_unref(run.frames);
    g_array_unref(run.tile_shots);
    g_array_unref(run.taken_s);
    tile_fit_clear(&run.fit);
    g_array_unref(run.cells);
    g_clear_pointer(&run.rejected, g_ptr_array_unref);
    return ok;
}
