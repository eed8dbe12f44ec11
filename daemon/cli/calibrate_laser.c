/* calibrate laser: sheets and sweeps from sessions of flat plates of different height. */
#include "calibrate.h"
#include "exr/exr.h"
#include "laser/laser.h"
#include "work.h"

#include <math.h>
#include <string.h>

#define ALL_POINTS   60000 /* of all sweeps; more tell no more */
#define LEAST_POINTS 40    /* of each */
#define MOST_POINTS  2000
#define EDGE_MM      1.0 /* of the plate, that is not looked at */
#define UNEVEN_MM    0.03
#define UNEVEN_RAD   (0.02 * G_PI / 180)
#define RAD(deg)     ((deg) * (G_PI / 180))

static char *output_option, *calibration_option, *planes_option;
static const GOptionEntry entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output_option, "Write the calibration here", "FILE"},
    {"calibration", 'c', 0, G_OPTION_ARG_FILENAME, &calibration_option,
     "Start from this calibration, which knows cameras and arc", "FILE"},
    {"planes", 'p', 0, G_OPTION_ARG_STRING, &planes_option,
     "Heights of the plates' tops above the turntable, one a session; default: each session's "
     "reference plane",
     "MM;MM…"},
    {NULL},
};

struct plate {
    double height_mm, radius_mm;
};

struct job {
    char *const *sessions;
    int n_sessions;
    struct calibration *calibration;
    GPtrArray *frames; /* struct calibrate_frame, of all sessions */
    GArray *plates;    /* struct plate, one a frame */
    GArray *points;
    GPtrArray *names; /* paths, borrowed */
    GPtrArray *rejected;
    struct laser_result result;
    int uneven;
    double worst_mm, worst_rad;
};

static gboolean parse_planes(const char *text, int n, double *ret) {
    g_auto(GStrv) words = g_strsplit(text, ";", n + 1);
    if ((int)g_strv_length(words) != n)
        return FALSE;
    for (int i = 0; i < n; i++) {
        char *end;
        ret[i] = g_ascii_strtod(words[i], &end);
        if (end == words[i] || *end || !(ret[i] >= 0) || !(ret[i] < 1000))
            return FALSE;
    }
    return TRUE;
}

static gboolean add_frames(struct job *job, Session *session, const struct plate *plate,
                           GError **error) {
    const struct rig *rig = &job->calibration->rig;
    g_autoptr(GPtrArray) frames = calibrate_frames(session, SHOT_SWEEP, error);
    for (guint i = 0; frames && i < frames->len; i++) {
        struct calibrate_frame *frame = frames->pdata[i];
        if (frame->camera >= rig->n_cameras || frame->laser < 0 || frame->laser >= rig->n_lasers)
            continue;
        frames->pdata[i] = NULL;
        g_ptr_array_add(job->frames, frame);
        g_ptr_array_add(job->names, frame->path);
        g_array_append_val(job->plates, *plate);
    }
    return frames != NULL;
}

static gboolean cli_calibrate_laser_add_session(struct job *job, int i, const double *planes,
                                                GError **error) {
    const char *path = job->sessions[i];
    struct session_grid grid;
    g_autoptr(Session) session = session_open(path, SESSION_READ, error);
    if (!session || !session_grid(session, &grid, error))
        return FALSE;
    g_autoptr(Calibration) own = calibrate_begin(calibration_option, session, error);
    if (!own ||
        (job->calibration && !calibration_check_rig(job->calibration, path, &own->rig, error)))
        return FALSE;
    if (!job->calibration)
        job->calibration = g_steal_pointer(&own);
    const struct plate plate = {planes ? planes[i] : grid.reference_mm,
                                MIN(grid.width_mm, grid.height_mm) / 2 - EDGE_MM};
    return add_frames(job, session, &plate, error);
}

static gboolean cli_calibrate_laser_gather(struct job *job, GError **error) {
    g_autofree double *planes = planes_option ? g_new(double, job->n_sessions) : NULL;
    if (planes && !parse_planes(planes_option, job->n_sessions, planes)) {
        g_set_error(error, LASER_ERROR, LASER_ERROR_PICTURES,
                    "--planes %s: give one height in mm for each of the %d sessions, with ';' "
                    "between them",
                    planes_option, job->n_sessions);
        return FALSE;
    }
    for (int i = 0; i < job->n_sessions; i++)
        if (!cli_calibrate_laser_add_session(job, i, planes, error))
            return FALSE;
    if (job->frames->len > 0)
        return TRUE;
    g_set_error(error, LASER_ERROR, LASER_ERROR_PICTURES,
                "%s: there are no laser sweeps in it; plan laser positions and capture it",
                job->sessions[0]);
    return FALSE;
}

static gboolean read_sweep(struct job *job, int i, struct exr_part *part, GError **error) {
    const struct calibrate_frame *frame = job->frames->pdata[i];
    const struct plate *plate = &g_array_index(job->plates, struct plate, i);
    const struct rig_camera *camera = &job->calibration->rig.cameras[frame->camera];
    double from = 0, to = 0;
    int steps = 0;
    if (!exr_get_double(part, "sweep.from_deg", &from, error) ||
        !exr_get_double(part, "sweep.to_deg", &to, error) ||
        !exr_get_int(part, "sweep.steps", &steps, error))
        return FALSE;
    if (steps < 3 || !exr_part_plane(part, "peak") || part->width != camera->width ||
        part->height != camera->height) {
        g_set_error(error, LASER_ERROR, LASER_ERROR_PICTURES,
                    "%s: is no sweep of %d × %d pixels as camera %s has them", frame->path,
                    camera->width, camera->height, camera->name);
        return FALSE;
    }
    const struct laser_sweep sweep = {
        .sweep = i,
        .laser = frame->laser,
        .camera = frame->camera,
        .arc_rad = RAD(frame->arc_deg),
        .from_rad = RAD(from),
        .step_rad = RAD(to - from) / (steps - 1),
        .plane_mm = plate->height_mm,
        .radius_mm = plate->radius_mm,
        .peak = exr_part_plane(part, "peak"),
        .most = CLAMP(ALL_POINTS / job->frames->len, LEAST_POINTS, MOST_POINTS),
    };
    if (laser_points(&job->calibration->rig, &sweep, job->points) == 0)
        g_ptr_array_add(job->rejected,
                        g_strdup_printf("%s: laser %s draws no line on the plate that this camera "
                                        "sees",
                                        frame->path,
                                        job->calibration->rig.lasers[frame->laser].name));
    return TRUE;
}

static gboolean cli_calibrate_laser_measure(struct job *job, const struct work *work,
                                            GError **error) {
    const gint64 begun_us = g_get_monotonic_time();
    for (guint i = 0; i < job->frames->len; i++) {
        const struct calibrate_frame *frame = job->frames->pdata[i];
        if (g_cancellable_set_error_if_cancelled(work->cancellable, error) ||
            !calibrate_check_sum(frame, error))
            return FALSE;
        struct exr_part *part = exr_read_part(frame->path, "sweep", error);
        const gboolean ok = part && read_sweep(job, (int)i, part, error);
        exr_part_free(part);
        if (!ok)
            return FALSE;
        work_tell(work, "laser", (int)i + 1, (int)job->frames->len, begun_us, NULL);
    }
    return TRUE;
}

static void cli_calibrate_laser_append(GString *to, double value, const char *format) {
    char text[G_ASCII_DTOSTR_BUF_SIZE];
    g_ascii_formatd(text, sizeof text, format, value);
    g_string_append_printf(to, "%s%s", to->len ? ";" : "", text);
}

/* What single steps differ by, for reports; and the worst of them. */
static void keep_steps(struct job *job) {
    static const char *const keys[5] = {"laser", "arc_deg", "sweep_deg", "tilt_deg", "offset_mm"};
    GString *lists[5];
    for (int k = 0; k < 5; k++)
        lists[k] = g_string_new(NULL);
    for (guint i = 0; i < job->result.steps->len; i++) {
        const struct laser_step *s = &g_array_index(job->result.steps, struct laser_step, i);
        cli_calibrate_laser_append(lists[0], s->laser, "%.0f");
        cli_calibrate_laser_append(lists[1], s->arc_rad * 180 / G_PI, "%.3f");
        cli_calibrate_laser_append(lists[2], s->sweep_rad * 180 / G_PI, "%.3f");
        cli_calibrate_laser_append(lists[3], s->tilt_rad * 180 / G_PI, "%.5f");
        cli_calibrate_laser_append(lists[4], s->offset_mm, "%.4f");
        job->worst_mm = MAX(job->worst_mm, fabs(s->offset_mm));
        job->worst_rad = MAX(job->worst_rad, fabs(s->tilt_rad));
        job->uneven += fabs(s->offset_mm) > UNEVEN_MM;
    }
    for (int k = 0; k < 5; k++) {
        g_key_file_set_value(job->calibration->extra, "laser steps", keys[k], lists[k]->str);
        g_string_free(lists[k], TRUE);
    }
}

static char *cli_calibrate_laser_sum_up(const struct job *job) {
    g_autoptr(GPtrArray) sums = g_ptr_array_new();
    for (guint i = 0; i < job->frames->len; i++)
        g_ptr_array_add(sums, ((struct calibrate_frame *)job->frames->pdata[i])->sha256);
    return calibration_checksum((const char *const *)sums->pdata, (int)sums->len);
}

/* A sweep most of whose points were left out is not one of this laser on this plate. */
static void reject_sweeps(struct job *job) {
    g_autofree int *n = g_new0(int, job->frames->len), *out = g_new0(int, job->frames->len);
    for (guint i = 0; i < job->points->len; i++) {
        const struct laser_point *p = &g_array_index(job->points, struct laser_point, i);
        n[p->sweep]++;
        out[p->sweep] += job->result.rejected[i];
    }
    for (guint i = 0; i < job->frames->len; i++)
        if (2 * out[i] > n[i])
            g_ptr_array_add(job->rejected,
                            g_strdup_printf("%s: %d of %d points do not fit the other sweeps",
                                            (char *)job->names->pdata[i], out[i], n[i]));
}

static void cli_calibrate_laser_keep(struct job *job) {
    struct calibration *calibration = job->calibration;
    const struct laser_result *found = &job->result;
    g_autofree char *sum = cli_calibrate_laser_sum_up(job);
    reject_sweeps(job);
    calibration->rig = found->rig;
    for (int i = 0; i < found->rig.n_lasers; i++)
        if (found->seen[i])
            calibration->lasers[i] = (struct calibration_laser){
                .known = TRUE,
                .position_mm = {found->source_error_mm[i], found->source_error_mm[i],
                                found->source_error_mm[i]},
                .axis_rad = found->axis_error_rad[i],
                .normal_rad = found->zero_error_rad[i],
                .stretch = found->stretch_error[i],
                .residual_rms_mm = found->rms_mm[i],
            };
    calibration->arc.known = TRUE;
    for (int k = 0; k < 2; k++) {
        calibration->arc.tilt_rad[k] = found->tilt_error_rad[k];
        calibration->arc.centre_mm[k] = found->centre_error_mm[k];
    }
    struct calibration_part *part = calibration_set_part(
        calibration, CALIBRATION_LASER, "lines on plates of different height, all together",
        (int)job->frames->len, sum, g_steal_pointer(&job->rejected));
    part->residual_rms = found->rms_all_mm;
    g_free(part->residual_unit);
    part->residual_unit = g_strdup("mm");
    part->degrees_of_freedom = found->degrees_of_freedom;
    keep_steps(job);
}

/* What lamps have told, which is no better than the arc's own steps; or what is usual. */
static struct laser_arc arc_known(const struct calibration *calibration) {
    const struct calibration_arc *arc = &calibration->arc;
    if (!arc->known || !(arc->centre_mm[0] > 0))
        return (struct laser_arc){RAD(0.5), 1};
    return (struct laser_arc){MAX(hypot(arc->tilt_rad[0], arc->tilt_rad[1]), RAD(0.005)),
                              MAX(hypot(arc->centre_mm[0], arc->centre_mm[1]), 0.05)};
}

static gboolean cli_calibrate_laser_work(const struct work *work, gpointer data, GError **error) {
    struct job *job = data;
    if (!cli_calibrate_laser_gather(job, error) || !cli_calibrate_laser_measure(job, work, error))
        return FALSE;
    const struct laser_arc known = arc_known(job->calibration);
    if (!laser_fit(&job->calibration->rig, (const struct laser_point *)(gpointer)job->points->data,
                   (int)job->points->len, &known, (const char *const *)job->names->pdata,
                   &job->result, error))
        return FALSE;
    cli_calibrate_laser_keep(job);
    return calibration_write(job->calibration, output_option, error);
}

static GVariant *laser_variant(const struct job *job, int i) {
    const struct laser_result *found = &job->result;
    const struct rig_laser *laser = &found->rig.lasers[i];
    GVariantBuilder builder;
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&builder, "{sv}", "name", g_variant_new_string(laser->name));
    g_variant_builder_add(
        &builder, "{sv}", "position_mm",
        g_variant_new("(ddd)", laser->position_mm.x, laser->position_mm.y, laser->position_mm.z));
    g_variant_builder_add(&builder, "{sv}", "source_error_mm",
                          g_variant_new_double(found->source_error_mm[i]));
    g_variant_builder_add(&builder, "{sv}", "stretch", g_variant_new_double(laser->stretch));
    g_variant_builder_add(&builder, "{sv}", "rms_mm", g_variant_new_double(found->rms_mm[i]));
    g_variant_builder_add(&builder, "{sv}", "points", g_variant_new_int32(found->points[i]));
    return g_variant_builder_end(&builder);
}

static void cli_calibrate_laser_tell_json(const struct job *job, double seconds) {
    const struct calibration_part *part = &job->calibration->parts[CALIBRATION_LASER];
    GVariantBuilder builder, lasers;
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_init(&lasers, G_VARIANT_TYPE("aa{sv}"));
    for (int i = 0; i < job->result.rig.n_lasers; i++)
        if (job->result.seen[i])
            g_variant_builder_add_value(&lasers, laser_variant(job, i));
    g_variant_builder_add(&builder, "{sv}", "file", g_variant_new_string(output_option));
    g_variant_builder_add(&builder, "{sv}", "sweeps", g_variant_new_int32(part->pictures));
    g_variant_builder_add(&builder, "{sv}", "points", g_variant_new_int32(job->result.n_used));
    g_variant_builder_add(&builder, "{sv}", "rejected",
                          g_variant_new_strv((const char *const *)part->rejected->pdata,
                                             (gssize)part->rejected->len));
    g_variant_builder_add(&builder, "{sv}", "rms_mm", g_variant_new_double(job->result.rms_all_mm));
    g_variant_builder_add(&builder, "{sv}", "lasers", g_variant_builder_end(&lasers));
    g_variant_builder_add(&builder, "{sv}", "steps", g_variant_new_uint32(job->result.steps->len));
    g_variant_builder_add(&builder, "{sv}", "worst_step_mm", g_variant_new_double(job->worst_mm));
    g_variant_builder_add(&builder, "{sv}", "worst_step_deg",
                          g_variant_new_double(job->worst_rad * 180 / G_PI));
    g_variant_builder_add(&builder, "{sv}", "real_s", g_variant_new_double(seconds));
    cli_print_json(g_variant_builder_end(&builder));
}

static void cli_calibrate_laser_tell(const struct job *job, double seconds) {
    const struct calibration_part *part = &job->calibration->parts[CALIBRATION_LASER];
    const struct laser_result *found = &job->result;
    if (cli_json) {
        cli_calibrate_laser_tell_json(job, seconds);
        return;
    }
    g_print("%s: %d sweeps, %d points, %.3f mm RMS from their sheets\n", output_option,
            part->pictures, found->n_used, found->rms_all_mm);
    for (int i = 0; i < found->rig.n_lasers; i++) {
        const struct vec3 p = found->rig.lasers[i].position_mm;
        if (found->seen[i])
            g_print("  %-12s at %.2f %.2f %.2f mm ± %.2f mm across its axis, zero ± %.4f°, sweeps "
                    "%+.3f %%, %.3f mm RMS\n",
                    found->rig.lasers[i].name, p.x, p.y, p.z, found->source_error_mm[i],
                    found->zero_error_rad[i] * 180 / G_PI, 100 * found->rig.lasers[i].stretch,
                    found->rms_mm[i]);
    }
    g_print("  %u steps told one by one: at most %.3f mm and %.4f° from the model",
            found->steps->len, job->worst_mm, job->worst_rad * 180 / G_PI);
    if (job->uneven)
        g_print("; %d by more than %g mm: does the sweep run evenly?", job->uneven, UNEVEN_MM);
    g_print("\n");
    if (part->rejected->len)
        g_print("  %u sweeps left out; mesorig calibrate show %s lists them\n", part->rejected->len,
                output_option);
    if (!job->calibration->parts[CALIBRATION_CAMERAS].done)
        g_print("  the cameras are nominal: calibrate them first, and give -c\n");
}

static int cli_calibrate_laser_run_job(struct job *job) {
    g_autoptr(GError) error = NULL;
    double seconds = 0;
    const gboolean ok = cli_work_run(cli_calibrate_laser_work, job, &seconds, &error);
    if (ok)
        cli_calibrate_laser_tell(job, seconds);
    return ok ? CLI_DONE : cli_fail(error);
}

static int cli_calibrate_laser_run(const struct command *command, int argc, char **argv) {
    struct job job = {0};
    if (!cli_parse(command, entries, FALSE, &argc, &argv, 1, 64))
        return CLI_USAGE;
    if (!output_option)
        return cli_usage(command, "where to? Give -o FILE");
    job.sessions = argv + 1;
    job.n_sessions = argc - 1;
    job.frames = g_ptr_array_new_with_free_func((GDestroyNotify)calibrate_frame_free);
    job.names = g_ptr_array_new();
    job.rejected = g_ptr_array_new_with_free_func(g_free);
    job.plates = g_array_new(FALSE, FALSE, sizeof(struct plate));
    job.points = g_array_new(FALSE, FALSE, sizeof(struct laser_point));
    const int code = cli_calibrate_laser_run_job(&job);
    laser_result_clear(&job.result);
    calibration_free(job.calibration);
    g_ptr_array_unref(job.frames);
    g_ptr_array_unref(job.names);
    g_clear_pointer(&job.rejected, g_ptr_array_unref);
    g_array_unref(job.plates);
    g_array_unref(job.points);
    return code;
}

const struct command calibrate_laser = {.name = "calibrate laser",
                                        .arguments = "SESSION SESSION… -o FILE",
                                        .help = "Find out how the laser sheets lie and sweep, from "
                                                "sessions of flat plates of different height.",
                                        .run_arguments = cli_calibrate_laser_run};
