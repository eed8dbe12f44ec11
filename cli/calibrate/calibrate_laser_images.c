/* calibrate laser --images: finds the plane of a laser that does not move, from photographs of a
 * board on which the laser's line falls. */
#include "calibrate_laser_images.h"

#include "base/residual.h"
#include "calibrate.h"
#include "cameras/board_size.h"
#include "laser/laser_plane.h"
#include "pictures/picture_read.h"
#include "pictures/raw.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

#define MOST 1000 /* maximum number of photographs */
#define DEG  (180 / G_PI)

char *laser_images_folder, *laser_images_dark, *laser_images_board, *laser_images_name,
    *laser_images_plane;

struct seen { /* a photograph that shows the board and the line */
    char *path;
    GArray *corners, *dots;
};

struct job {
    struct calibrate_job base;
    struct board board;
    int camera, laser;
    OutputFile *table; /* NULL if --plane is not given */
    GArray *seen;      /* of struct seen */
    struct laser_plane *plane;
};

static void clear_seen(gpointer data) {
    struct seen *seen = data;
    g_free(seen->path);
    g_clear_pointer(&seen->corners, g_array_unref);
    g_clear_pointer(&seen->dots, g_array_unref);
}

/* Returns the linear R, G, B of a photograph. `grey` is the same photograph as read by
 * calibrate_read_photograph(). For a grey photograph, all three values of a pixel are equal and
 * *ret_grey is TRUE. EXR and camera raw files count as grey. Returns NULL with an error if the file
 * cannot be read. Free the result with g_free(). */
static float *read_colours(const char *path, const struct picture *grey, gboolean *ret_grey,
                           GError **error) {
    const gsize n = (gsize)grey->width * (gsize)grey->height;
    g_auto(PictureCodes) codes = {0};
    g_autofree char *lower = g_ascii_strdown(path, -1);
    *ret_grey = g_str_has_suffix(lower, ".exr") || raw_is(path);
    if (!*ret_grey) {
        if (!picture_read_codes(path, &codes, error))
            return NULL;
        const struct picture_tone *tone =
            picture_tone_choose(&codes.says.tone, codes.bits, PICTURE_TONES_UNSAID, path, error);
        if (!tone)
            return NULL;
        picture_tone_apply(tone, codes.bits, codes.rgb, 3 * n);
        *ret_grey = codes.grey;
        return g_steal_pointer(&codes.rgb);
    }
    float *rgb = g_new(float, 3 * n);
    for (gsize i = 0; i < 3 * n; i++)
        rgb[i] = grey->values[i / 3];
    return rgb;
}

/* Reads the photograph of the same name that was taken without the laser. Returns NULL with an
 * error if there is none. */
static struct picture *read_dark(const char *path, GError **error) {
    g_autofree char *name = g_path_get_basename(path);
    g_autofree char *dark = g_build_filename(laser_images_dark, name, NULL);
    if (g_file_test(dark, G_FILE_TEST_EXISTS))
        return calibrate_read_photograph(dark, error);
    g_set_error(
        error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
        "%s: there is no photograph %s without the laser in that folder; pairs have the same "
        "file name in --images and --dark-images",
        laser_images_dark, name);
    return NULL;
}

/* Returns how strongly the laser lit each pixel, or NULL with an error. dark is the photograph
 * without the laser, or NULL. *ret_reflectance gets the reflectance of each pixel, or NULL if it is
 * not known. */
static struct picture *read_strength(const struct picture *picture, const struct picture *dark,
                                     struct picture **ret_reflectance, GError **error) {
    const gsize n = (gsize)picture->width * (gsize)picture->height;
    gboolean grey, dark_grey;
    g_autofree float *rgb = read_colours(picture->name, picture, &grey, error);
    g_autofree float *without =
        rgb && dark ? read_colours(dark->name, dark, &dark_grey, error) : NULL;
    if (!rgb || (dark && !without))
        return NULL;
    struct picture *strength = picture_new(picture->name, "", picture->width, picture->height);
    g_autoptr(Picture) reflectance =
        picture_new(picture->name, "", picture->width, picture->height);
    const int colour = grey ? -1 : laser_colour(rgb, without, n);
    laser_strength(rgb, without, n, colour, strength->values, reflectance->values);
    *ret_reflectance = without || colour >= 0 ? g_steal_pointer(&reflectance) : NULL;
    return strength;
}

static gboolean same_size(const struct picture *a, int width, int height) {
    return a->width == width && a->height == height;
}

/* Finds the board and the line in a photograph. A photograph in which they are not found is listed
 * as rejected. Returns FALSE with an error only if the whole calibration must end. */
static gboolean look_at(struct job *job, const char *path, BoardCensus *census, GError **error) {
    const struct rig_camera *camera = &job->base.calibration->rig.cameras[job->camera];
    g_autoptr(Picture) picture = calibrate_read_photograph(path, error);
    g_autoptr(Picture) dark = picture && laser_images_dark ? read_dark(path, error) : NULL;
    g_autoptr(GError) why = NULL;
    struct laser_pose pose;
    gboolean more;
    if (!picture || (laser_images_dark && !dark))
        return FALSE;
    const struct picture *wrong = !same_size(picture, camera->width, camera->height) ? picture
                                  : dark && !same_size(dark, camera->width, camera->height) ? dark
                                                                                            : NULL;
    if (wrong) {
        g_ptr_array_add(
            job->base.rejected,
            g_strdup_printf(
                "%s: the photograph has %d × %d pixels, but camera %s has %d × %d; give "
                "whole photographs, not scaled",
                wrong->name, wrong->width, wrong->height, camera->name, camera->width,
                camera->height));
        return TRUE;
    }
    const struct picture *shows_board = dark ? dark : picture;
    if (!board_census_before(census, shows_board, &more, error))
        return FALSE;
    g_autoptr(GArray) corners = board_find(shows_board, &job->board, TRUE, &why);
    if (!board_census_after(census, shows_board, corners, error))
        return FALSE;
    g_autoptr(Picture) reflectance = NULL;
    g_autoptr(Picture) strength =
        corners ? read_strength(picture, dark, &reflectance, error) : NULL;
    if (corners && !strength)
        return FALSE;
    g_autoptr(GArray) dots = NULL;
    if (corners && !laser_pose_fit(camera, &job->board, corners, NULL, &pose))
        g_set_error_literal(&why, LASER_PLANE_ERROR, LASER_PLANE_ERROR_PICTURES,
                            "the corners in the photograph do not fit the board of --board and the "
                            "lens of the calibration: measure the board again and correct --board, "
                            "or calibrate the camera again");
    else if (corners)
        dots = laser_line_find(strength, reflectance, camera, &job->board, &pose, &why);
    if (!dots) {
        /* Without the board's reflectance, white print may be taken for the line, because it may be
         * brighter. */
        const char *advice = corners && strength && !reflectance
                                 ? "; no colour of the photograph belongs to the laser alone: take "
                                   "the same photographs without the laser, and give --dark-images"
                                 : "";
        g_ptr_array_add(job->base.rejected,
                        g_strdup_printf("%s: %s%s", path, why->message, advice));
        return TRUE;
    }
    const struct seen seen = {g_strdup(path), g_steal_pointer(&corners), g_steal_pointer(&dots)};
    struct calibrate_frame *frame = g_new0(struct calibrate_frame, 1);
    frame->path = g_strdup(path);
    frame->sha256 = g_strdup(picture->checksum);
    g_ptr_array_add(job->base.frames, frame);
    g_array_append_val(job->seen, seen);
    return TRUE;
}

/* Chooses the laser that has the name of --name; the laser must be fixed. Without --name, the only
 * laser of the rig is chosen. If the rig has no laser or several, the name is “laser”. If a
 * calibration from photographs has no laser of the name, a new laser is added to it. */
static gboolean choose_laser(struct job *job, GError **error) {
    struct rig *rig = &job->base.calibration->rig;
    const char *name = laser_images_name    ? laser_images_name
                       : rig->n_lasers == 1 ? rig->lasers[0].name
                                            : "laser";
    const gboolean photographs = rig->n_lamps == 0 && rig->n_cameras == 1;
    for (job->laser = 0; job->laser < rig->n_lasers; job->laser++)
        if (g_str_equal(rig->lasers[job->laser].name, name)) {
            if (rig->lasers[job->laser].fixed)
                return TRUE;
            g_set_error(error, LASER_PLANE_ERROR, LASER_PLANE_ERROR_PICTURES,
                        "%s: laser %s turns with the arc, so it has no fixed plane: calibrate this "
                        "laser from sessions of plates",
                        calibrate_from, name);
            return FALSE;
        }
    if (photographs && rig->n_lasers == RIG_MAX_LASERS) {
        g_set_error(error, LASER_PLANE_ERROR, LASER_PLANE_ERROR_PICTURES,
                    "%s has %d lasers, which is the maximum: give the name of one of them with "
                    "--name, or another calibration",
                    calibrate_from, rig->n_lasers);
        return FALSE;
    }
    if (!photographs && rig->n_lasers == 0) {
        g_set_error(error, LASER_PLANE_ERROR, LASER_PLANE_ERROR_PICTURES,
                    "%s: the rig of this file has no laser: give the calibration of a rig with a "
                    "laser, or of a camera alone",
                    calibrate_from);
        return FALSE;
    }
    if (!photographs) {
        g_autoptr(GString) known = g_string_new(NULL);
        for (int i = 0; i < rig->n_lasers; i++)
            g_string_append_printf(known, "%s%s", i ? ", " : "", rig->lasers[i].name);
        g_set_error(
            error, LASER_PLANE_ERROR, LASER_PLANE_ERROR_PICTURES,
            "%s: there is no laser “%s” in the rig of this file; give --name with one of: %s",
            calibrate_from, name, known->str);
        return FALSE;
    }
    rig->lasers[rig->n_lasers++] = (struct rig_laser){.fixed = 1};
    g_strlcpy(rig->lasers[job->laser].name, name, RIG_NAME);
    return TRUE;
}

/* Chooses the only calibrated camera that has as many pixels as the photograph. */
static gboolean choose_camera(struct job *job, const char *path, GError **error) {
    const struct calibration *calibration = job->base.calibration;
    const struct rig *rig = &calibration->rig;
    g_autoptr(Picture) picture = calibrate_read_photograph(path, error);
    int n = 0;
    if (!picture)
        return FALSE;
    for (int i = 0; i < rig->n_cameras; i++)
        if (same_size(picture, rig->cameras[i].width, rig->cameras[i].height)) {
            job->camera = n++ ? job->camera : i;
        }
    if (n == 1 && calibration->parts[CALIBRATION_CAMERAS].done)
        return TRUE;
    if (!calibration->parts[CALIBRATION_CAMERAS].done)
        g_set_error(error, LASER_PLANE_ERROR, LASER_PLANE_ERROR_PICTURES,
                    "%s: the cameras of this file are not calibrated: run mesorig calibrate "
                    "cameras --images first",
                    calibrate_from);
    else
        g_set_error(error, LASER_PLANE_ERROR, LASER_PLANE_ERROR_PICTURES,
                    n ? "%s: %d cameras of this file have %d × %d pixels, the size of %s, so it is "
                        "not known which camera took the photographs: give a calibration of only "
                        "that camera (calibrate cameras --images)"
                      : "%s: %d cameras of this file have the %d × %d pixels of %s: give "
                        "photographs of the camera that was calibrated, whole and not scaled",
                    calibrate_from, n, picture->width, picture->height, path);
    return FALSE;
}

/* Stores the plane as the sheet of a laser. If the laser has an axis, that axis is projected onto
 * the plane. Otherwise the axis is any direction in the plane, because the sheet does not turn. */
static void keep_laser(struct job *job) {
    struct calibration *calibration = job->base.calibration;
    struct rig_laser *laser = &calibration->rig.lasers[job->laser];
    const struct laser_plane *found = job->plane;
    struct vec3 n = found->plane.normal;
    if (vec3_length(laser->normal) > 0 && vec3_dot(laser->normal, n) < 0)
        n = vec3_scale(n, -1);
    const struct vec3 axis = vec3_sub(laser->axis, vec3_scale(n, vec3_dot(n, laser->axis)));
    if (vec3_length(laser->axis) > 0 && vec3_length(axis) > 0.5) {
        const double away = vec3_dot(n, vec3_sub(laser->position_mm, found->point_mm));
        laser->axis = vec3_unit(axis);
        laser->position_mm = vec3_sub(laser->position_mm, vec3_scale(n, away));
    } else {
        laser->axis = found->along;
        laser->position_mm = found->point_mm;
    }
    laser->normal = n;
    calibration->lasers[job->laser] = (struct calibration_laser){
        .known = TRUE,
        .position_mm = {found->offset_error_mm, found->offset_error_mm, found->offset_error_mm},
        .axis_rad = found->tilt_error_rad,
        .normal_rad = found->tilt_error_rad,
        .residual_rms_mm = found->rms_mm,
    };
}

static void append_row(GString *to, const double *values, int n, const char *between) {
    for (int i = 0; i < n; i++) {
        char text[G_ASCII_DTOSTR_BUF_SIZE];
        g_string_append_printf(to, "%s%s", i ? between : "",
                               g_ascii_formatd(text, sizeof text, "%.12g", values[i]));
    }
}

/* Keeps the plane with its covariance in a separate section of the calibration, because the
 * section of a laser has no key for a covariance. */
static void keep_plane(struct job *job) {
    const struct laser_plane *found = job->plane;
    GKeyFile *to = job->base.calibration->extra;
    g_autofree char *group = g_strdup_printf("laser plane %d", job->laser);
    const struct vec3 n = found->plane.normal, p = found->point_mm;
    const struct {
        const char *key;
        double values[16];
        int n;
    } rows[] = {{"normal", {n.x, n.y, n.z}, 3},
                {"offset_mm", {found->plane.offset_mm}, 1},
                {"point_mm", {p.x, p.y, p.z}, 3},
                {"rms_mm", {found->rms_mm}, 1},
                {"expected_rms_mm", {found->expected_rms_mm}, 1}};
    for (gsize i = 0; i < G_N_ELEMENTS(rows); i++) {
        g_autoptr(GString) text = g_string_new(NULL);
        append_row(text, rows[i].values, rows[i].n, ";");
        g_key_file_set_value(to, group, rows[i].key, text->str);
    }
    g_autoptr(GString) covariance = g_string_new(NULL);
    append_row(covariance, &found->covariance[0][0], 16, ";");
    g_key_file_set_value(to, group, "covariance", covariance->str);
}

/* Writes a table for numpy.loadtxt(): six rows of four numbers. */
static gboolean write_table(const struct job *job, GError **error) {
    const struct laser_plane *found = job->plane;
    const struct vec3 n = found->plane.normal, p = found->point_mm;
    g_autoptr(GString) text = g_string_new(
        "# " OUTPUT_FILE_TEXT("plane") "\n"
                                       "# row 0: normal x, y, z and offset d in mm: points X of "
                                       "the plane have normal * X = d\n"
                                       "# rows 1 to 4: covariance of these four numbers\n"
                                       "# row 5: a point of the plane amid the lines, x, y, z, "
                                       "and the standard error of the plane there, in mm\n");
    append_row(text, (const double[]){n.x, n.y, n.z, found->plane.offset_mm}, 4, " ");
    g_string_append_c(text, '\n');
    for (int i = 0; i < 4; i++) {
        append_row(text, found->covariance[i], 4, " ");
        g_string_append_c(text, '\n');
    }
    append_row(text, (const double[]){p.x, p.y, p.z, found->offset_error_mm}, 4, " ");
    g_string_append_c(text, '\n');
    return output_file_put(job->table, text->str, text->len, error);
}

static gboolean fit(struct job *job, GError **error) {
    const struct calibration *calibration = job->base.calibration;
    const int n = (int)job->seen->len;
    g_autofree struct laser_photograph *photographs = g_new(struct laser_photograph, n + 1);
    for (int i = 0; i < n; i++) {
        const struct seen *seen = &g_array_index(job->seen, struct seen, i);
        photographs[i] = (struct laser_photograph){seen->path, seen->corners, seen->dots};
    }
    if (n < LASER_PLANE_MIN) {
        g_set_error(
            error, LASER_PLANE_ERROR, LASER_PLANE_ERROR_PICTURES,
            "%d of %u photographs show board and laser line, but at least %d must: take more "
            "photographs%s%s",
            n, n + job->base.rejected->len, LASER_PLANE_MIN,
            job->base.rejected->len ? "; the first of those that were left out: " : "",
            job->base.rejected->len ? (char *)job->base.rejected->pdata[0] : "");
        return FALSE;
    }
    job->plane =
        laser_plane_fit(&calibration->rig.cameras[job->camera], &calibration->cameras[job->camera],
                        &job->board, photographs, n, error);
    if (!job->plane)
        return FALSE;
    for (int i = n; i-- > 0;)
        if (job->plane->left_out[i]) {
            g_ptr_array_add(job->base.rejected,
                            g_strdup_printf("%s: its line is %.3f mm from the plane of the others",
                                            photographs[i].name, job->plane->off_mm[i]));
            g_ptr_array_remove_index(job->base.frames, (guint)i);
        }
    return TRUE;
}

static gboolean find(struct calibrate_job *base, GError **error) {
    struct job *job = (struct job *)base;
    g_autoptr(GPtrArray) paths =
        calibrate_photographs(laser_images_folder, MOST, base->rejected, error);
    g_autoptr(BoardCensus) census = board_census_new(&job->board);
    if (!paths || !(base->calibration = calibration_read(calibrate_from, error)) ||
        !choose_camera(job, paths->pdata[0], error) || !choose_laser(job, error))
        return FALSE;
    for (guint i = 0; i < paths->len; i++)
        if (!look_at(job, paths->pdata[i], census, error) ||
            !work_tell(base->work, "photographs", (int)i + 1, (int)paths->len, base->begun_us,
                       error))
            return FALSE;
    if (!fit(job, error))
        return FALSE;
    keep_laser(job);
    keep_plane(job);
    calibrate_set_part(base, CALIBRATION_LASER, CALIBRATE_LASER_PHOTOGRAPHS, job->plane->rms_mm,
                       "mm", 2 * job->plane->used - 3);
    return !job->table || write_table(job, error);
}

static void tell(Record *to, const struct calibrate_job *base) {
    const struct job *job = (const struct job *)base;
    const struct laser_plane *found = job->plane;
    const struct calibration_part *part = &base->calibration->parts[CALIBRATION_LASER];
    const struct vec3 n = found->plane.normal, p = found->point_mm;
    record_say(to,
               "laser %s{laser}: %d{photographs} photographs, %d{dots} dots of its line, "
               "%.4f{rms_mm} mm RMS from its plane\n  normal ",
               base->calibration->rig.lasers[job->laser].name, found->used, found->dots,
               found->rms_mm);
    record_say_doubles(to, "normal", "%+.6f", (double[]){n.x, n.y, n.z}, 3);
    record_say(to, " ± %.4f{tilt_error_deg}°, %.4f mm from the origin; through ",
               found->tilt_error_rad * DEG, fabs(found->plane.offset_mm));
    record_say_doubles(to, "point_mm", "%.3f", (double[]){p.x, p.y, p.z}, 3);
    record_say(to, " mm ± %.4f{offset_error_mm} mm\n", found->offset_error_mm);
    record_add(to, "%s{camera} %g{offset_mm} %g{expected_rms_mm} %g{real_s}",
               base->calibration->rig.cameras[job->camera].name, found->plane.offset_mm,
               found->expected_rms_mm, base->seconds);
    record_doubles(to, "covariance", &found->covariance[0][0], 16);
    record_say_strings(to, "rejected", "  left out: ", part->rejected);
    const struct residual residual = {
        "the laser's plane", found->rms_mm, found->expected_rms_mm, "mm",
        "a laser or camera that moved between photographs, a sheet of light or a board that is "
        "bent, an inaccurate calibration of the lens"};
    calibrate_warn_residual(base, &residual);
    /* The entry "replaced" of the record is about the calibration file, so a replaced table is only
     * said in words. */
    if (job->table && output_file_note(job->table))
        record_say(to, "%s\n", output_file_note(job->table));
}

int laser_images_calibrate(const struct call *call, GError **error) {
    static const struct calibrate_method method = {find, tell};
    g_autoptr(GError) bad = NULL;
    struct job job = {0};
    if (call->n_arguments > 0)
        return cli_usage(call->command, "give sessions, or --images DIR, not both");
    if (!laser_images_board)
        return cli_usage(call->command, "no board is given: give --board");
    if (!calibrate_from)
        return cli_usage(call->command, "--images needs the camera's calibration: give -c FILE; "
                                        "mesorig calibrate cameras --images makes one");
    if (!board_parse(&job.board, laser_images_board, &bad))
        return cli_usage(call->command, "%s", bad->message);
    if (laser_images_plane && !(job.table = cli_output(laser_images_plane, "plane", error)))
        return CLI_FAILED;
    job.seen = g_array_new(FALSE, FALSE, sizeof(struct seen));
    g_array_set_clear_func(job.seen, clear_seen);
    const int code = calibrate_run(call, &method, &job.base, error);
    output_file_free(job.table);
    laser_plane_free(job.plane);
    g_array_unref(job.seen);
    return code;
}
