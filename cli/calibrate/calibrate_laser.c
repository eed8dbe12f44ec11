/* calibrate laser: finds the sheets and sweep axes of lasers. The sessions show flat plates of
 * different heights. */
#include "base/residual.h"
#include "calibrate.h"
#include "calibrate_laser_images.h"
#include "exr/exr.h"
#include "laser/laser.h"

#include <math.h>
#include <string.h>

/* largest number of points of all sweeps; more do not improve the result */
#define ALL_POINTS 60000
#define MIN_POINTS 40   /* minimum number of points of each sweep */
#define MAX_POINTS 2000 /* maximum number of points of each sweep */
#define EDGE_MM    1.0  /* width of the plate's edge that is ignored */
#define UNEVEN_MM  0.03
#define RAD(deg)   ((deg) * (G_PI / 180))

static char *planes_option;
static const GOptionEntry entries[] = {
    CALIBRATE_OUTPUT("Write the calibration here"),
    CALIBRATE_FROM("Start from this calibration, in which cameras and arc are calibrated"),
    CALIBRATE_INCOMPLETE,
    CALIBRATE_FOUND,
    {"planes", 0, 0, G_OPTION_ARG_STRING, &planes_option,
     "Heights of the plates' tops above the turntable, one for each session; default: each "
     "session's reference plane",
     "MM;MM…"},
    {"images", 'i', 0, G_OPTION_ARG_FILENAME, &laser_images_folder,
     "Instead of sessions: a folder of photographs of a board with the line of a laser that stands "
     "still",
     "DIR"},
    {"board", 'b', 0, G_OPTION_ARG_STRING, &laser_images_board,
     "With --images: the board, as measured, in mm", "8x8,square=9,marker=6.75"},
    {"dark-images", 0, 0, G_OPTION_ARG_FILENAME, &laser_images_dark,
     "With --images: the same photographs without the laser, under the same file names", "DIR"},
    {"name", 0, 0, G_OPTION_ARG_STRING, &laser_images_name, "With --images: the laser's name",
     "NAME"},
    {"plane", 0, 0, G_OPTION_ARG_FILENAME, &laser_images_plane,
     "With --images: also write the plane and its covariance to this file, a table of numbers",
     "FILE"},
    {NULL},
};

struct plate {
    double height_mm, radius_mm;
};

struct job {
    struct calibrate_job base;
    GArray *plates; /* of struct plate, one per frame */
    GArray *points;
    GPtrArray *names; /* paths, borrowed */
    struct laser_result result;
    int uneven;
    double worst_mm, worst_rad;
};

/* Adds the sweeps of session i. planes has the height of the plate in each session, in mm. If
 * planes is NULL, the height is that of the session's reference plane. */
static gboolean gather_session(struct job *job, int i, const double *planes, GError **error) {
    struct session_grid grid;
    g_autoptr(Session) session = calibrate_open(&job->base, i, error);
    if (!session || !session_grid(session, &grid, error))
        return FALSE;
    const struct rig *rig = &job->base.calibration->rig;
    const struct plate plate = {planes ? planes[i] : grid.reference_mm,
                                MIN(grid.width_mm, grid.height_mm) / 2 - EDGE_MM};
    g_autoptr(GPtrArray) frames = calibrate_frames(session, SHOT_SWEEP, error);
    for (guint k = 0; frames && k < frames->len; k++) {
        struct calibrate_frame *frame = frames->pdata[k];
        if (frame->camera >= rig->n_cameras || frame->laser < 0 || frame->laser >= rig->n_lasers)
            continue;
        frames->pdata[k] = NULL;
        g_ptr_array_add(job->base.frames, frame);
        g_ptr_array_add(job->names, frame->path);
        g_array_append_val(job->plates, plate);
    }
    return frames != NULL;
}

static gboolean gather(struct job *job, GError **error) {
    const int n = job->base.n_sessions;
    g_autofree double *planes = planes_option ? g_new(double, n) : NULL;
    gboolean ok = !planes || calibrate_parse(planes_option, ";", n, planes);
    for (int i = 0; planes && i < n; i++)
        ok = ok && planes[i] >= 0 && planes[i] < 1000;
    if (!ok) {
        g_set_error(error, LASER_ERROR, LASER_ERROR_PICTURES,
                    "--planes %s: give one height of at least 0 and less than 1000 mm for each "
                    "session (%d), with ';' between them",
                    planes_option, n);
        return FALSE;
    }
    for (int i = 0; i < n; i++)
        if (!gather_session(job, i, planes, error))
            return FALSE;
    if (job->base.frames->len > 0)
        return TRUE;
    g_autoptr(GString) sessions = g_string_new(NULL);
    for (int i = 0; i < n; i++)
        g_string_append_printf(sessions, "%s%s", i ? ", " : "", job->base.sessions[i]);
    g_set_error(error, LASER_ERROR, LASER_ERROR_PICTURES,
                "%s: no laser sweeps were captured: give laser positions in the section [lasers] "
                "of the session file, and capture again",
                sessions->str);
    return FALSE;
}

static gboolean read_sweep(struct job *job, int i, struct exr_part *part, GError **error) {
    const struct calibrate_frame *frame = job->base.frames->pdata[i];
    const struct plate *plate = &g_array_index(job->plates, struct plate, i);
    const struct rig_camera *camera = &job->base.calibration->rig.cameras[frame->camera];
    double from = 0, to = 0;
    int steps = 0;
    if (!exr_get_double(part, "sweep.from_deg", &from, error) ||
        !exr_get_double(part, "sweep.to_deg", &to, error) ||
        !exr_get_int(part, "sweep.steps", &steps, error))
        return FALSE;
    if (steps < 3 || !exr_part_plane(part, "peak") || part->width != camera->width ||
        part->height != camera->height) {
        g_set_error(error, LASER_ERROR, LASER_ERROR_PICTURES,
                    "%s: the file is not a sweep of camera %s with %d × %d pixels: it has %d × %d "
                    "pixels and %d steps; capture the session again",
                    frame->path, camera->name, camera->width, camera->height, part->width,
                    part->height, steps);
        return FALSE;
    }
    const struct laser_plate_sweep sweep = {
        .sweep = i,
        .laser = frame->laser,
        .camera = frame->camera,
        .arc_rad = RAD(frame->arc_deg),
        .from_rad = RAD(from),
        .step_rad = RAD(to - from) / (steps - 1),
        .plane_mm = plate->height_mm,
        .radius_mm = plate->radius_mm,
        .peak = exr_part_plane(part, "peak"),
        .most = CLAMP(ALL_POINTS / job->base.frames->len, MIN_POINTS, MAX_POINTS),
    };
    /* The plate is level in the frame in which the turntable's axis is z. */
    const struct rig *rig = &job->base.calibration->rig;
    g_autofree struct rig *at = g_new(struct rig, 1);
    const guint before = job->points->len;
    double tilt_rad[2];
    rig_at(rig, RAD(frame->turntable_deg), at);
    rig_wobble_tilt(&rig->wobble, RAD(frame->turntable_deg), tilt_rad);
    const int n = laser_points(at, &sweep, job->points);
    for (guint k = before; k < job->points->len; k++) {
        struct laser_point *point = &g_array_index(job->points, struct laser_point, k);
        point->point_mm = rig_tilt_point(tilt_rad, point->point_mm, 1);
    }
    if (n == 0)
        g_ptr_array_add(
            job->base.rejected,
            g_strdup_printf("%s: laser %s draws no line on the plate that this camera sees",
                            frame->path, job->base.calibration->rig.lasers[frame->laser].name));
    return TRUE;
}

/* Keeps the residuals of single steps of the sweeps for the report. Finds the largest of them, and
 * counts the steps that are off by more than UNEVEN_MM. */
static void keep_steps(struct job *job) {
    static const struct calibrate_column columns[] = {{"laser", "%.0f"},
                                                      {"arc_deg", "%.3f"},
                                                      {"sweep_deg", "%.3f"},
                                                      {"tilt_deg", "%.5f"},
                                                      {"offset_mm", "%.4f"}};
    g_autoptr(GArray) rows = g_array_new(FALSE, FALSE, sizeof(double));
    for (guint i = 0; i < job->result.steps->len; i++) {
        const struct laser_step *s = &g_array_index(job->result.steps, struct laser_step, i);
        const double row[5] = {s->laser, s->arc_rad * 180 / G_PI, s->sweep_rad * 180 / G_PI,
                               s->tilt_rad * 180 / G_PI, s->offset_mm};
        g_array_append_vals(rows, row, 5);
        job->worst_mm = MAX(job->worst_mm, fabs(s->offset_mm));
        job->worst_rad = MAX(job->worst_rad, fabs(s->tilt_rad));
        job->uneven += fabs(s->offset_mm) > UNEVEN_MM;
    }
    calibrate_keep(&job->base, "laser steps", columns, 5, rows);
}

/* Rejects a sweep if most of its points were left out. Such a sweep does not show this laser on
 * this plate. */
static void reject_sweeps(struct job *job) {
    const guint n = job->base.frames->len;
    g_autofree int *all = g_new0(int, n), *out = g_new0(int, n);
    for (guint i = 0; i < job->points->len; i++) {
        const struct laser_point *p = &g_array_index(job->points, struct laser_point, i);
        all[p->sweep]++;
        out[p->sweep] += job->result.rejected[i];
    }
    for (guint i = 0; i < n; i++)
        if (2 * out[i] > all[i])
            g_ptr_array_add(job->base.rejected,
                            g_strdup_printf("%s: %d of %d points do not fit the other sweeps",
                                            (char *)job->names->pdata[i], out[i], all[i]));
}

/* Marks the points of the lines on the page of --found. No lines of errors are drawn, because an
 * error is a distance from the sheet in mm. */
static void mark_points(struct job *job) {
    const struct rig *rig = &job->base.calibration->rig;
    for (guint i = 0; i < job->points->len; i++) {
        const struct laser_point *p = &g_array_index(job->points, struct laser_point, i);
        struct found_mark mark = {.frame = p->sweep, .is_left_out = job->result.rejected[i] != 0};
        if (rig_project(&rig->cameras[p->camera], p->point_mm, &mark.x_px, &mark.y_px))
            calibrate_found_add(&job->base, &mark);
    }
}

static void keep(struct job *job) {
    struct calibration *calibration = job->base.calibration;
    const struct laser_result *found = &job->result;
    job->base.marks_say = "The brightness of a pixel is the time at which the line passed it. A "
                          "circle is a point of the line that was used. A cross did not fit the "
                          "others.";
    if (job->base.found)
        mark_points(job);
    reject_sweeps(job);
    calibration->rig = found->rig;
    for (int i = 0; i < found->rig.n_lasers; i++)
        if (found->seen[i]) {
            struct calibration_laser *to = &calibration->lasers[i];
            *to = (struct calibration_laser){
                .known = TRUE,
                .position_mm = {found->source_error_mm[i], found->source_error_mm[i],
                                found->source_error_mm[i]},
                .axis_rad = found->axis_error_rad[i],
                .normal_rad = found->zero_error_rad[i],
                .stretch = found->stretch_error[i],
                .bend_rad = found->bend_error_rad[i],
                .sheet = found->sheet[i],
                .residual_rms_mm = found->rms_mm[i],
                .expected_rms_mm = found->expected_mm[i],
                .line_rad = found->line_rad[i],
            };
            for (int k = 0; k < CALIBRATION_LASER_VALUES; k++)
                to->from_prior[k] = found->from_prior[i][k];
        }
    calibration->arc.known = TRUE;
    for (int k = 0; k < 2; k++) {
        calibration->arc.tilt_rad[k] = found->tilt_error_rad[k];
        calibration->arc.centre_mm[k] = found->centre_error_mm[k];
    }
    calibrate_set_part(&job->base, CALIBRATION_LASER,
                       "lines on plates of different height, all together", found->rms_all_mm, "mm",
                       found->degrees_of_freedom);
    keep_steps(job);
}

/* Returns the standard errors of the arc's axis. If the lamps are calibrated, their calibration
 * gives the errors, but they are at least 0.005° and 0.05 mm. Otherwise the errors are 0.5° and 1
 * mm. */
static struct laser_arc arc_known(const struct calibration *calibration) {
    const struct calibration_arc *arc = &calibration->arc;
    if (!arc->known || !(arc->centre_mm[0] > 0))
        return (struct laser_arc){RAD(0.5), 1};
    return (struct laser_arc){MAX(hypot(arc->tilt_rad[0], arc->tilt_rad[1]), RAD(0.005)),
                              MAX(hypot(arc->centre_mm[0], arc->centre_mm[1]), 0.05)};
}

static gboolean find(struct calibrate_job *base, GError **error) {
    struct job *job = (struct job *)base;
    if (!gather(job, error))
        return FALSE;
    for (int i = 0, n = (int)base->frames->len; i < n; i++) {
        const struct calibrate_frame *frame = base->frames->pdata[i];
        struct exr_part *part =
            calibrate_check_sum(frame, error) ? exr_read_part(frame->path, "sweep", error) : NULL;
        const gboolean ok = part && read_sweep(job, i, part, error) &&
                            work_tell(base->work, "laser", i + 1, n, base->begun_us, error);
        exr_part_free(part);
        if (!ok)
            return FALSE;
    }
    const struct laser_arc known = arc_known(base->calibration);
    if (!laser_fit(&base->calibration->rig, (const struct laser_point *)(gpointer)job->points->data,
                   (int)job->points->len, &known, (const char *const *)job->names->pdata,
                   &job->result, error))
        return FALSE;
    keep(job);
    return TRUE;
}

static void tell_laser(Record *to, const struct laser_result *found, int i) {
    static const char *const names[] = {"position", "axis", "zero", "stretch"};
    const struct rig_laser *laser = &found->rig.lasers[i];
    const struct vec3 p = laser->position_mm;
    const double bend_mm = calibrate_bend_mm(laser, laser->bend_rad);
    const double bend_error_mm = calibrate_bend_mm(laser, found->bend_error_rad[i]);
    g_autoptr(GPtrArray) from_prior = g_ptr_array_new();
    for (gsize k = 0; k < G_N_ELEMENTS(names); k++)
        if (found->from_prior[i][k])
            g_ptr_array_add(from_prior, (gpointer)names[k]);
    record_begin(to, NULL);
    record_say(to,
               "  %-12s{name} sheet ± %.4f{sheet_error_mm} mm over the plates, sweeps "
               "%+.3f{stretch:%%}, %s %+.4f{bend_mm} ± %.4f{bend_error_mm} mm at %g mm, "
               "%.4f{rms_mm} mm RMS",
               laser->name, found->sheet_error_mm[i], laser->stretch,
               laser->bend_rad == 0 ? "flat:" : "bent by", bend_mm, bend_error_mm,
               CALIBRATE_BEND_AT_MM, found->rms_mm[i]);
    record_say_if(to, found->expected_mm[i] > 0, ", noise explains %.4f{expected_mm} mm",
                  found->expected_mm[i]);
    record_int(to, "points", found->points[i]);
    record_say(to, "\n  %-12s at ", "");
    record_say_doubles(to, "position_mm", "%.2f", (double[]){p.x, p.y, p.z}, 3);
    record_say(to, " mm ± %.2f{source_error_mm} mm across its axis, zero ± %.4f°",
               found->source_error_mm[i], found->zero_error_rad[i] * 180 / G_PI);
    record_strings(to, "from_prior", from_prior);
    record_end(to);
    if (from_prior->len) {
        g_ptr_array_add(from_prior, NULL);
        g_autofree char *list = g_strjoinv(", ", (char **)from_prior->pdata);
        record_say(to,
                   "; these values were not measured, and are only as accurate as the earlier axis "
                   "of the arc: %s (the accuracy of the sheets does not depend on them)",
                   list);
    }
    record_say(to, "\n");
}

static void warn_residual(const struct calibrate_job *base, const struct laser_result *found,
                          int i) {
    g_autofree char *of = g_strdup_printf("the sheet of laser %s", found->rig.lasers[i].name);
    const struct residual residual = {
        of, found->rms_mm[i], found->expected_mm[i], "mm",
        "a sheet whose bend is not a parabola, a plate that is not flat, plates into whose "
        "material light enters, a turntable or sweep axis whose bearing wobbles, errors in the "
        "calibration of the cameras; the MDF's error bars contain the rest"};
    calibrate_warn_residual(base, &residual);
}

static void tell(Record *to, const struct calibrate_job *base) {
    const struct job *job = (const struct job *)base;
    const struct calibration_part *part = &base->calibration->parts[CALIBRATION_LASER];
    const struct laser_result *found = &job->result;
    record_say(to, "%d{sweeps} sweeps, %d{points} points, %.3f{rms_mm} mm RMS from their sheets\n",
               part->pictures, found->n_used, found->rms_all_mm);
    record_strings(to, "rejected", part->rejected);
    record_begin_list(to, "lasers");
    for (int i = 0; i < found->rig.n_lasers; i++)
        if (found->seen[i])
            tell_laser(to, found, i);
    record_end(to);
    record_say(to,
               "  each of %u{steps} steps was also measured separately: at most "
               "%.3f{worst_step_mm} mm and %.4f{worst_step_deg}° from the model",
               found->steps->len, job->worst_mm, job->worst_rad * 180 / G_PI);
    record_double(to, "real_s", base->seconds);
    if (job->uneven)
        record_say(to,
                   "; %d steps by more than %g mm: check that the sweep runs evenly, and that the "
                   "heights of the plates are right",
                   job->uneven, UNEVEN_MM);
    record_say(to, "\n");
    calibrate_say_doubts(to, base, part, "sweeps");
    for (int i = 0; i < found->rig.n_lasers; i++)
        if (found->seen[i])
            warn_residual(base, found, i);
}

static int run(const struct call *call, GError **error) {
    static const struct calibrate_method method = {find, tell};
    struct job job = {0};
    if (laser_images_folder && calibrate_found)
        return cli_usage(call->command, "--found is for sessions, not for --images");
    if (laser_images_folder)
        return laser_images_calibrate(call, error);
    if (call->n_arguments < 1)
        return cli_usage(call->command, "give captured sessions, or --images DIR");
    if (laser_images_board || laser_images_dark || laser_images_name || laser_images_plane)
        return cli_usage(call->command,
                         "--board, --dark-images, --name and --plane are for --images");
    job.names = g_ptr_array_new();
    job.plates = g_array_new(FALSE, FALSE, sizeof(struct plate));
    job.points = g_array_new(FALSE, FALSE, sizeof(struct laser_point));
    const int code = calibrate_run(call, &method, &job.base, error);
    laser_result_clear(&job.result);
    g_ptr_array_unref(job.names);
    g_array_unref(job.plates);
    g_array_unref(job.points);
    return code;
}

const struct command calibrate_laser = {
    .name = "calibrate laser",
    .arguments = "SESSION SESSION… -o FILE",
    .examples =
        "  mesorig calibrate laser plate1.session plate8.session -c rig.calibration -o "
        "rig.calibration\n"
        "  mesorig calibrate laser --images photographs -b 10x7,square=25 -c lens.calibration "
        "-o scanner.calibration\n",
    .help = "Calibrate the laser sheets and their sweep axes, from sessions of flat plates of "
            "different height; or the plane of a laser that stands still, from photographs of a "
            "board with its line.",
    .options = entries,
    .writes = TRUE,
    .max = 64,
    .run = run};
