/* calibrate: the command with subcommands. Each subcommand is in a file calibrate_*.c. */
#include "calibrate.h"

#include "base/residual.h"
#include "common/work.h"
#include "exr/exr.h"
#include "pictures/picture_read.h"
#include "pictures/raw.h"
#include "pictures/vision.h"
#include "session/inputs.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

static const struct command *const commands[] = {
    &calibrate_cameras, &calibrate_lights, &calibrate_laser,  &calibrate_radiometry,
    &calibrate_colour,  &calibrate_show,   &calibrate_report, NULL};

/* The group of a calibration file that lists, for each part, the sessions that lacked shots. */
#define INCOMPLETE_GROUP "incomplete sessions"

char *calibrate_output, *calibrate_from;
gboolean calibrate_incomplete;

char **calibrate_lacking(const struct calibration *calibration, const char *part) {
    return g_key_file_get_string_list(calibration->extra, INCOMPLETE_GROUP, part, NULL, NULL);
}

const char *calibrate_left_out(enum calibration_kind kind) {
    static const char *const words[] = {"pictures", "sights", "sweeps", "pictures"};
    return words[kind];
}

/* Records in the calibration which sessions lacked shots. Removes the records of an earlier run. */
static void keep_incomplete(const struct calibrate_job *job) {
    GKeyFile *to = job->calibration->extra;
    if (job->incomplete->len > 0)
        g_key_file_set_string_list(to, INCOMPLETE_GROUP, job->part,
                                   (const char *const *)job->incomplete->pdata,
                                   job->incomplete->len);
    else
        g_key_file_remove_key(to, INCOMPLETE_GROUP, job->part, NULL);
}

/* Refuses a session that lacks shots. With --incomplete, adds the session to job->incomplete
 * instead. */
static gboolean check_complete(struct calibrate_job *job, Session *session, GError **error) {
    g_autoptr(GPtrArray) shots = session_shots(session, error);
    guint planned = 0;
    if (!shots)
        return FALSE;
    for (guint i = 0; i < shots->len; i++)
        planned += ((const struct session_shot *)shots->pdata[i])->state == SHOT_PLANNED;
    if (planned == 0)
        return TRUE;
    g_autofree char *state = session_value(session, "state");
    const char *path = session_path(session);
    g_autofree char *lacks =
        g_strdup_printf("%s is %s, with %u of %u shots", path, state ? state : "unfinished",
                        shots->len - planned, shots->len);
    if (calibrate_incomplete)
        g_ptr_array_add(job->incomplete, g_steal_pointer(&lacks));
    else
        g_set_error(error, SESSION_ERROR, SESSION_ERROR_FORMAT,
                    "%s: mesorig resume %s takes the others; --incomplete calibrates without them",
                    lacks, path);
    return calibrate_incomplete;
}

static gboolean calibrate_work(const struct work *work, gpointer data, GError **error) {
    struct calibrate_job *job = data;
    job->work = work;
    job->begun_us = g_get_monotonic_time();
    if (!job->method->find(job, error) ||
        g_cancellable_set_error_if_cancelled(work->cancellable, error))
        return FALSE;
    keep_incomplete(job);
    if (job->found && !calibrate_found_write(job, NULL, error))
        return FALSE;
    const char *path = output_file_path(job->to, error);
    return path &&
           output_file_end(job->to, calibration_write(job->calibration, path, error), error);
}

int calibrate_run(const struct call *call, const struct calibrate_method *method,
                  struct calibrate_job *job, GError **error) {
    if (!calibrate_output)
        return cli_usage(call->command, "no file to write is given: give -o FILE");
    job->method = method;
    job->part = call->command->name + strlen("calibrate ");
    job->sessions = call->arguments;
    job->n_sessions = call->n_arguments;
    job->frames = g_ptr_array_new_with_free_func((GDestroyNotify)calibrate_frame_free);
    job->rejected = g_ptr_array_new_with_free_func(g_free);
    job->incomplete = g_ptr_array_new_with_free_func(g_free);
    job->warnings = g_ptr_array_new_with_free_func(g_free);
    job->marks = g_array_new(FALSE, FALSE, sizeof(struct found_mark));
    job->to = cli_output(calibrate_output, "calibration", error);
    const gboolean begins =
        job->to && (!calibrate_found ||
                    (job->found = cli_output(calibrate_found, "found in pictures", error)));
    const gboolean ok = begins && cli_work_run(calibrate_work, job, &job->seconds, error);
    /* If the calibration has failed, its error is reported, even if the page cannot be written. */
    if (job->found && !ok)
        calibrate_found_write(job, error ? *error : NULL, NULL);
    if (ok) {
        record_say(call->record, "%s{file}: ", calibrate_output);
        method->tell(call->record, job);
        record_say_strings(call->record, "warnings", "  warning: ", job->warnings);
        record_say_strings(call->record, "incomplete", "  incomplete: ", job->incomplete);
        /* A method that adds to the output file keeps the file's contents. The file is not reported
         * as replaced. */
        if (calibrate_from || !method->adds)
            cli_tell_output(call->record, job->to);
    }
    g_clear_pointer(&job->to, output_file_free);
    g_clear_pointer(&job->found, output_file_free);
    g_array_unref(job->marks);
    calibration_free(job->calibration);
    g_clear_pointer(&job->frames, g_ptr_array_unref);
    g_clear_pointer(&job->rejected, g_ptr_array_unref);
    g_clear_pointer(&job->incomplete, g_ptr_array_unref);
    g_clear_pointer(&job->warnings, g_ptr_array_unref);
    return ok ? CLI_DONE : CLI_FAILED;
}

Session *calibrate_open(struct calibrate_job *job, int i, GError **error) {
    const char *path = job->sessions[i], *from = calibrate_from;
    g_autoptr(Session) session = session_open(path, SESSION_READ, error);
    if (session && !check_complete(job, session, error))
        return NULL;
    g_autofree char *where =
        session ? session_file(session, "session.db (calibration.conf)") : NULL;
    g_autofree char *text = session ? session_text(session, "calibration.conf", error) : NULL;
    g_autoptr(Calibration) own = text ? calibration_from_text(text, where, error) : NULL;
    if (!from && job->method->adds && g_file_test(calibrate_output, G_FILE_TEST_EXISTS))
        from = calibrate_output;
    g_autoptr(Calibration) before = own && from ? calibration_read(from, error) : NULL;
    if (!own || (from && !before) ||
        (before && !calibration_check_rig(before, from, &own->rig, error)) ||
        (job->calibration && !calibration_check_rig(job->calibration, path, &own->rig, error)))
        return NULL;
    if (!job->calibration)
        job->calibration = before ? g_steal_pointer(&before) : g_steal_pointer(&own);
    return g_steal_pointer(&session);
}

void calibrate_set_part(struct calibrate_job *job, enum calibration_kind kind, const char *method,
                        double residual_rms, const char *residual_unit, int degrees_of_freedom) {
    g_autoptr(GPtrArray) sums = g_ptr_array_new();
    for (guint i = 0; i < job->frames->len; i++)
        g_ptr_array_add(sums, ((struct calibrate_frame *)job->frames->pdata[i])->sha256);
    g_autofree char *sum = calibration_checksum((const char *const *)sums->pdata, (int)sums->len);
    struct calibration_part *part =
        calibration_set_part(job->calibration, kind, method, (int)job->frames->len, sum,
                             g_steal_pointer(&job->rejected));
    part->residual_rms = residual_rms;
    g_free(part->residual_unit);
    part->residual_unit = g_strdup(residual_unit);
    part->degrees_of_freedom = degrees_of_freedom;
}

/* The number of observations that a part has used depends on the part:
 * - For lights it is half of the degrees of freedom, because each sight has two residuals.
 * - For lasers that were calibrated from sweeps it is part->pictures minus the rejected sweeps,
 *   because part->pictures counts these too.
 * - For all others, also for lasers that were calibrated from photographs, it is part->pictures. */
gboolean calibrate_left_out_most(const struct calibration_part *part, enum calibration_kind kind) {
    const double left_out = part->rejected->len;
    const gboolean sweeps =
        kind == CALIBRATION_LASER && g_strcmp0(part->method, CALIBRATE_LASER_PHOTOGRAPHS) != 0;
    const double used = kind == CALIBRATION_LIGHTS ? part->degrees_of_freedom / 2.0
                        : sweeps                   ? part->pictures - left_out
                                                   : part->pictures;
    return left_out > used;
}

void calibrate_warn_residual(const struct calibrate_job *job, const struct residual *residual) {
    char *warning = residual_warning(residual);
    if (warning)
        g_ptr_array_add(job->warnings, warning);
}

void calibrate_say_doubts(Record *to, const struct calibrate_job *job,
                          const struct calibration_part *part, const char *what) {
    const enum calibration_kind kind = (enum calibration_kind)(part - job->calibration->parts);
    if (part->rejected->len)
        record_say(to, "  %u %s left out, %s; mesorig calibrate show --all %s lists them\n",
                   part->rejected->len, what,
                   calibrate_left_out_most(part, kind) ? "more than were used: find out why"
                   : kind == CALIBRATION_LIGHTS        ? "which is usual: up to a half"
                                                       : "fewer than were used",
                   calibrate_output);
    if (!job->calibration->parts[CALIBRATION_CAMERAS].done)
        record_say(to, "  the cameras are nominal: calibrate them first, and give the calibration "
                       "file with -c\n");
}

double calibrate_bend_mm(const struct rig_laser *laser, double bend_rad) {
    const double along = vec3_dot(laser->position_mm, laser->axis);
    const double far2 = vec3_dot(laser->position_mm, laser->position_mm) - along * along;
    return far2 > 0 ? bend_rad * CALIBRATE_BEND_AT_MM * CALIBRATE_BEND_AT_MM / sqrt(far2) : 0;
}

void calibrate_keep(struct calibrate_job *job, const char *group,
                    const struct calibrate_column *columns, guint n_columns, const GArray *rows) {
    for (guint k = 0; k < n_columns; k++) {
        g_autoptr(GString) list = g_string_new(NULL);
        for (guint i = k; i < rows->len; i += n_columns) {
            char text[G_ASCII_DTOSTR_BUF_SIZE];
            g_ascii_formatd(text, sizeof text, columns[k].format, g_array_index(rows, double, i));
            g_string_append_printf(list, "%s%s", list->len ? ";" : "", text);
        }
        g_key_file_set_value(job->calibration->extra, group, columns[k].key, list->str);
    }
}

gboolean calibrate_parse(const char *text, const char *separator, int n, double *ret) {
    g_auto(GStrv) words = g_strsplit(text, separator, n + 1);
    if ((int)g_strv_length(words) != n)
        return FALSE;
    for (int i = 0; i < n; i++) {
        char *end;
        ret[i] = g_ascii_strtod(words[i], &end);
        if (end == words[i] || *end || !isfinite(ret[i]))
            return FALSE;
    }
    return TRUE;
}

static int by_name(gconstpointer a, gconstpointer b) {
    return strcmp(*(char *const *)a, *(char *const *)b);
}

static gboolean is_photograph(const char *name) {
    static const char *const ends[] = {".jpg", ".jpeg", ".png", ".tif", ".tiff",
                                       ".bmp", ".pgm",  ".ppm", ".exr"};
    g_autofree char *lower = g_ascii_strdown(name, -1);
    for (gsize i = 0; i < G_N_ELEMENTS(ends); i++)
        if (g_str_has_suffix(lower, ends[i]))
            return TRUE;
    return raw_is(name);
}

GPtrArray *calibrate_photographs(const char *folder, guint most, GPtrArray *skipped,
                                 GError **error) {
    g_autoptr(GDir) dir = g_dir_open(folder, 0, error);
    g_autoptr(GPtrArray) paths = g_ptr_array_new_with_free_func(g_free);
    for (const char *name; dir && (name = g_dir_read_name(dir));) {
        if (*name == '.') {
            g_autofree char *path = g_build_filename(folder, name, NULL);
            g_ptr_array_add(skipped, g_strdup_printf("%s: it is a hidden file", path));
        } else if (is_photograph(name))
            g_ptr_array_add(paths, g_build_filename(folder, name, NULL));
    }
    if (dir && paths->len == 0)
        g_set_error(
            error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
            "%s: there is no .jpg, .png, .tif, .bmp, .pgm, .ppm or .exr picture in that folder, "
            "and no camera raw: give the folder of the photographs",
            folder);
    if (paths->len > most)
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_FAILED,
                    "%s: there are %u photographs in that folder, but at most %u can be used: move "
                    "the others to another folder",
                    folder, paths->len, most);
    g_ptr_array_sort(paths, by_name);
    return paths->len > 0 && paths->len <= most ? g_steal_pointer(&paths) : NULL;
}

static struct picture *read_exr(const char *path, GError **error) {
    g_autoptr(ExrPart) part = exr_read_picture(path, error);
    g_autofree char *sum = part ? exr_sha256(path, NULL, error) : NULL;
    if (!sum)
        return NULL;
    const float *y = exr_part_plane(part, "Y");
    const float *rgb[3] = {y, y, y};
    for (int c = 0; !y && c < 3; c++)
        rgb[c] = exr_part_plane(part, (const char *const[]){"R", "G", "B"}[c]);
    if (!rgb[0] || !rgb[1] || !rgb[2]) {
        g_set_error(error, EXR_ERROR, EXR_ERROR_MISSING,
                    "%s: the first part of the file has neither the channels R, G and B nor Y: "
                    "save the picture as RGB or as grey",
                    path);
        return NULL;
    }
    struct picture *picture = picture_new(path, sum, part->width, part->height);
    for (gsize i = 0; i < (gsize)part->width * (gsize)part->height; i++)
        picture->values[i] = 0.2126F * rgb[0][i] + 0.7152F * rgb[1][i] + 0.0722F * rgb[2][i];
    return picture;
}

struct picture *calibrate_read_photograph(const char *path, GError **error) {
    g_autofree char *lower = g_ascii_strdown(path, -1);
    return g_str_has_suffix(lower, ".exr") ? read_exr(path, error) : picture_read(path, error);
}

void calibrate_frame_free(struct calibrate_frame *frame) {
    if (!frame)
        return;
    g_free(frame->path);
    g_free(frame->sha256);
    g_free(frame);
}

GPtrArray *calibrate_frames(Session *session, enum session_shot_kind kind, GError **error) {
    g_autoptr(GPtrArray) shots = session_shots(session, error);
    g_autoptr(GPtrArray) rows = shots ? session_frames(session, error) : NULL;
    if (!rows)
        return NULL;
    GPtrArray *frames = g_ptr_array_new_with_free_func((GDestroyNotify)calibrate_frame_free);
    for (guint i = 0; i < rows->len; i++) {
        const struct session_frame *row = rows->pdata[i];
        if (row->shot < 1 || row->shot > (gint64)shots->len)
            continue;
        const struct session_shot *shot = shots->pdata[row->shot - 1];
        if (shot->kind != kind || shot->state != SHOT_DONE)
            continue;
        struct calibrate_frame *frame = g_new0(struct calibrate_frame, 1);
        frame->path = session_file(session, row->path);
        frame->sha256 = g_strdup(row->sha256);
        frame->camera = row->camera;
        frame->lamp = kind == SHOT_LAMP ? shot->device : -1;
        frame->laser = kind == SHOT_SWEEP ? shot->device : -1;
        frame->turntable_deg = session_frame_turntable_deg(row, shot);
        frame->arc_deg = shot->arc_deg;
        g_ptr_array_add(frames, frame);
    }
    return frames;
}

gboolean calibrate_check_sum(const struct calibrate_frame *frame, GError **error) {
    g_autofree char *sum = exr_sha256(frame->path, NULL, error);

    if (!sum || strcmp(sum, frame->sha256) == 0)
        return sum != NULL;
    g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT,
                "%s: the checksum of the file is not that of the captured frame; mesorig verify "
                "records the damage, and mesorig resume then captures the frame again; import an "
                "imported session again",
                frame->path);
    return FALSE;
}

struct picture *calibrate_read(const struct calibrate_frame *frame, GError **error) {
    const char *cfa = NULL;
    struct exr_part *part =
        calibrate_check_sum(frame, error) ? exr_read_part(frame->path, "radiance", error) : NULL;
    const float *plane = part ? input_mosaic(frame->path, part, &cfa, error) : NULL;
    g_autoptr(Picture) picture = NULL;

    if (plane) {
        picture = picture_new(frame->path, frame->sha256, part->width, part->height);
        memcpy(picture->values, plane, sizeof(float) * (gsize)part->width * (gsize)part->height);
        if (!picture_balance(picture, cfa)) {
            g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT,
                        "%s: the colour filter “%s” is not one of mono, rggb, bggr, grbg, gbrg and "
                        "rgb: capture or import the session again",
                        frame->path, cfa);
            g_clear_pointer(&picture, picture_free);
        }
    }
    exr_part_free(part);
    return g_steal_pointer(&picture);
}

const struct command cli_calibrate = {.name = "calibrate",
                                      .arguments = "WHAT …",
                                      .examples = "  mesorig calibrate show rig.calibration\n",
                                      .help = "Calibrate cameras, lamps and lasers from pictures.",
                                      .run_arguments = cli_run_child,
                                      .children = commands};
