/* calibrate cameras: cameras and turntable from captured boards, or one camera from photographs. */
#include "base/config.h"
#include "base/residual.h"
#include "calibrate.h"
#include "calibrate_video.h"
#include "cameras/cameras.h"
#include "pictures/picture_says.h"

#include <gio/gio.h>
#include <math.h>

#define MAX_PICTURES   20000
#define KEPT_VECTORS   400 /* maximum number of residuals per camera in the report */
#define SHORT_PICTURES 5   /* see rows_shown() */
/* If the focal length differs relatively by more than this from that of the EXIF data, it is
 * probably a mistake. */
#define EXIF_OFF 0.1
/* Photographs have different zooms if their focal lengths differ relatively by more than this. */
#define ZOOMED 0.01

static char *board_option, *images_option, *name_option, *corners_option, *lens_option;
static gboolean azimuth_option;
static const GOptionEntry entries[] = {
    {"board", 'b', 0, G_OPTION_ARG_STRING, &board_option,
     "The board, as measured, in mm; mesorig board draws one",
     "8x8,square=9,marker=6.75,thickness=3"},
    CALIBRATE_OUTPUT("Write the calibration here"),
    CALIBRATE_FROM("Start from this calibration, and keep its lamps and lasers"),
    CALIBRATE_INCOMPLETE,
    {"board-azimuth", 0, 0, G_OPTION_ARG_NONE, &azimuth_option,
     "Azimuth 0 is the x axis of the board that lies flat, with the turntable at 0; default: the "
     "cameras keep their mean azimuth",
     NULL},
    {"images", 'i', 0, G_OPTION_ARG_FILENAME, &images_option,
     "Instead of sessions: a folder of photographs (JPEG, PNG, TIFF, BMP, PGM, EXR, camera raw) "
     "that one camera took of a board held at different tilts, or a video of it",
     "DIR|VIDEO"},
    {"corners", 0, 0, G_OPTION_ARG_FILENAME, &corners_option,
     "Also write the corners that were used to this file, as mrcal reads them", "FILE"},
    CALIBRATE_FOUND,
    {"name", 0, 0, G_OPTION_ARG_STRING, &name_option, "With --images: the camera's name", "NAME"},
    {"lens", 0, 0, G_OPTION_ARG_STRING, &lens_option,
     "The lens model: polynomial, rational or fisheye (default: with --images the model that fits "
     "best, otherwise the model of -c or of the rig file)",
     "MODEL"},
    {NULL},
};

struct job {
    struct calibrate_job base;
    struct board board;
    struct cameras_result *result;
    enum rig_lens lens;            /* lens model of --lens; set only if lens_option is given */
    GArray *pictures;              /* of struct cameras_picture, one per frame */
    struct calibrate_video *video; /* NULL unless --images names a video */
    gboolean turns; /* the rig file of a session has a turntable, or the turntable has turned */
    /* Median, smallest and largest of the focal lengths that the EXIF data of the photographs give,
     * in pixels. All are 0 if no photograph has one. exif_said names the source of the first
     * one. */
    double exif_px, exif_least_px, exif_most_px;
    char *exif_said;
    /* With --board-azimuth: azimuth of the board's x axis before the rig was turned. */
    double board_deg;
};

static void add(struct job *job, struct calibrate_frame *frame, int lay) {
    const struct cameras_picture picture = {frame->camera, lay, frame->turntable_deg};
    g_array_append_val(job->pictures, picture);
    g_ptr_array_add(job->base.frames, frame);
}

static gboolean gather_session(struct job *job, int lay, GError **error) {
    g_autoptr(Session) session = calibrate_open(&job->base, lay, error);
    g_autoptr(GPtrArray) frames = session ? calibrate_frames(session, SHOT_LAMP, error) : NULL;
    g_autofree char *rig = frames ? session_text(session, "rig.conf", error) : NULL;
    if (!rig)
        return FALSE;
    g_autoptr(Config) config = config_parse(rig, job->base.sessions[lay], NULL);
    job->turns |= config && config_find(config, "axis", "turntable");
    for (guint i = 0; i < frames->len; i++) {
        struct calibrate_frame *frame = frames->pdata[i];
        job->turns |= frame->turntable_deg != 0;
        /* Of the frames of one pose only the first is used, because one light is enough. */
        gboolean wanted = frame->camera < job->base.calibration->rig.n_cameras;
        for (guint k = 0; wanted && k < job->pictures->len; k++) {
            const struct cameras_picture *p =
                &g_array_index(job->pictures, struct cameras_picture, k);
            wanted = p->lay != lay || p->camera != frame->camera ||
                     p->turntable_deg != frame->turntable_deg;
        }
        if (!wanted)
            continue;
        frames->pdata[i] = NULL;
        add(job, frame, lay);
    }
    return TRUE;
}

/* Returns the names of the video frames that are used, or NULL with an error. */
static GPtrArray *gather_video(struct job *job, GError **error) {
    job->video = calibrate_video_read(images_option, &job->board, job->base.work, error);
    if (!job->video)
        return NULL;
    GPtrArray *names = g_ptr_array_new_with_free_func(g_free);
    for (guint i = 0; i < job->video->chosen->len; i++)
        g_ptr_array_add(names, calibrate_video_name(job->video, i));
    return names;
}

static gboolean gather_photographs(struct job *job, GError **error) {
    struct rig rig = {.id = "photographs", .n_cameras = 1};
    g_autoptr(GPtrArray) paths =
        g_file_test(images_option, G_FILE_TEST_EXISTS) &&
                !g_file_test(images_option, G_FILE_TEST_IS_DIR)
            ? gather_video(job, error)
            : calibrate_photographs(images_option, MAX_PICTURES, job->base.rejected, error);
    if (!paths)
        return FALSE;
    for (guint i = 0; i < paths->len; i++) {
        struct calibrate_frame *frame = g_new0(struct calibrate_frame, 1);
        frame->path = g_strdup(paths->pdata[i]);
        add(job, frame, (int)i);
    }
    g_strlcpy(rig.cameras[0].name, name_option ? name_option : "camera", RIG_NAME);
    rig.cameras[0].response = 1;
    rig.cameras[0].rotation = (struct mat3){{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    job->base.calibration = calibration_new(&rig);
    return TRUE;
}

static struct picture *read_picture(int i, gpointer data, GError **error) {
    const struct job *job = data;
    const struct calibrate_frame *frame = job->base.frames->pdata[i];
    if (job->video)
        return calibrate_video_picture(job->video, (guint)i);
    return frame->sha256 ? calibrate_read(frame, error)
                         : calibrate_read_photograph(frame->path, error);
}

static int by_size(gconstpointer a, gconstpointer b) {
    const double *x = a, *y = b;
    return (*x > *y) - (*x < *y);
}

/* Returns the median of the focal lengths that the EXIF data of the photographs give, in pixels, or
 * 0 if none gives one. The calibration uses it as a first guess. Sets the members exif_… of the
 * job. */
static double guess_focal(int width, int height, gpointer data) {
    struct job *job = data;
    g_autoptr(GArray) all = g_array_new(FALSE, FALSE, sizeof(double));
    for (guint i = 0; !job->video && i < job->base.frames->len; i++) {
        const struct calibrate_frame *frame = job->base.frames->pdata[i];
        struct picture_says says;
        g_autofree char *said = NULL;
        picture_says_read_file(frame->path, &says);
        const double px = picture_says_focal_px(&says, width, height, &said);
        picture_says_clear(&says);
        if (!(px > 0))
            continue;
        g_array_append_val(all, px);
        if (!job->exif_said)
            job->exif_said = g_steal_pointer(&said);
    }
    if (all->len == 0)
        return 0;
    g_array_sort(all, by_size);
    job->exif_least_px = g_array_index(all, double, 0);
    job->exif_most_px = g_array_index(all, double, all->len - 1);
    job->exif_px = g_array_index(all, double, all->len / 2);
    return job->exif_px;
}

static gboolean on_step(int step, int n, gpointer data) {
    const struct calibrate_job *job = data;
    return work_tell(job->work, "boards", step, n, job->begun_us, NULL);
}

/* Keeps some of the residuals of a camera. The report draws them. */
static void keep_residuals(struct job *job, int camera) {
    static const struct calibrate_column columns[] = {
        {"x_px", "%.4f"}, {"y_px", "%.4f"}, {"dx_px", "%.4f"}, {"dy_px", "%.4f"}};
    const GArray *all = job->result->residuals;
    g_autoptr(GArray) rows = g_array_new(FALSE, FALSE, sizeof(double));
    g_autofree char *group = g_strdup_printf("camera residuals %d", camera);
    const int n = job->base.calibration->cameras[camera].points, every = n / KEPT_VECTORS + 1;
    int k = 0;
    for (guint i = 0; i < all->len; i++) {
        const struct cameras_residual *r = &g_array_index(all, struct cameras_residual, i);
        const double row[4] = {(double)r->x_px, (double)r->y_px, (double)r->dx_px,
                               (double)r->dy_px};
        if (r->camera == camera && k++ % every == 0)
            g_array_append_vals(rows, row, 4);
    }
    calibrate_keep(&job->base, group, columns, 4, rows);
}

static void keep_turntable(struct job *job) {
    static const struct calibrate_column columns[] = {{"commanded_deg", "%.4f"},
                                                      {"error_deg", "%.4f"}},
                                         tilt_column = {"board_tilts_deg", "%.4f"};
    g_autoptr(GArray) stops = g_array_new(FALSE, FALSE, sizeof(double));
    g_autoptr(GArray) tilts = g_array_new(FALSE, FALSE, sizeof(double));
    for (guint i = 0; i < job->result->stops->len; i++) {
        const struct cameras_stop *s = &g_array_index(job->result->stops, struct cameras_stop, i);
        const double row[2] = {s->commanded_deg, s->error_deg};
        g_array_append_vals(stops, row, 2);
    }
    for (guint i = 0; i < job->result->lays->len; i++)
        g_array_append_val(tilts, g_array_index(job->result->lays, struct cameras_lay, i).tilt_deg);
    calibrate_keep(&job->base, "turntable", columns, 2, stops);
    calibrate_keep(&job->base, "turntable", &tilt_column, 1, tilts);
}

static void mark_corners(struct job *job) {
    const GArray *all = job->result->residuals;
    for (guint i = 0; i < all->len; i++) {
        const struct cameras_residual *r = &g_array_index(all, struct cameras_residual, i);
        calibrate_found_add(&job->base,
                            &(struct found_mark){r->picture, (double)r->x_px, (double)r->y_px,
                                                 (double)r->dx_px, (double)r->dy_px, FALSE});
    }
}

/* Turns the rig so that the board that lies flattest has its x axis at azimuth 0. */
static gboolean turn_to_board(struct job *job, GError **error) {
    if (!cameras_board_azimuth(job->result, &job->board, &job->board_deg, error))
        return FALSE;
    calibration_turn(job->base.calibration, -job->board_deg * G_PI / 180);
    return TRUE;
}

/* Writes all corners of each picture that was used, in the order of board.h, with dashes for
 * corners that were not found or not used. The format is vnlog. For a chessboard it is the same as
 * that of mrcal's corners.vnl. */
static gboolean write_corners(const struct job *job, GError **error) {
    const GArray *all = job->result->residuals;
    const int n = board_n_corners(&job->board), pictures = (int)job->pictures->len;
    g_autofree const struct cameras_residual **used =
        g_new0(const struct cameras_residual *, (gsize)n *(gsize)pictures + 1);
    g_autofree gboolean *is_used = g_new0(gboolean, pictures + 1);
    /* A line that begins with ## is a comment. The first line that begins with # names the
     * columns. */
    g_autoptr(GString) text =
        g_string_new("## " OUTPUT_FILE_TEXT("corners") "\n# filename x y level\n");
    for (guint i = 0; i < all->len; i++) {
        const struct cameras_residual *r = &g_array_index(all, struct cameras_residual, i);
        used[r->picture * n + r->corner] = r;
        is_used[r->picture] = TRUE;
    }
    for (int i = 0; i < pictures * n; i++) {
        const struct calibrate_frame *frame = job->base.frames->pdata[i / n];
        char x[G_ASCII_DTOSTR_BUF_SIZE], y[G_ASCII_DTOSTR_BUF_SIZE];
        if (is_used[i / n] && used[i])
            g_string_append_printf(text, "%s %s %s 0\n", frame->path,
                                   g_ascii_formatd(x, sizeof x, "%.4f", (double)used[i]->x_px),
                                   g_ascii_formatd(y, sizeof y, "%.4f", (double)used[i]->y_px));
        else if (is_used[i / n])
            g_string_append_printf(text, "%s - - -\n", frame->path);
    }
    return output_file_put(job->base.corners, text->str, text->len, error);
}

static gboolean find(struct calibrate_job *base, GError **error) {
    struct job *job = (struct job *)base;
    if (images_option && !gather_photographs(job, error))
        return FALSE;
    for (int i = 0; i < base->n_sessions; i++)
        if (!gather_session(job, i, error))
            return FALSE;
    const struct cameras_task task = {
        .board = job->board,
        .pictures = (const struct cameras_picture *)(gpointer)job->pictures->data,
        .n_pictures = (int)job->pictures->len,
        .read = read_picture,
        .progress = on_step,
        .guess = guess_focal,
        .data = job,
        .no_turntable = !job->turns && !images_option,
        .lens_given = lens_option != NULL,
        .lens = job->lens,
    };
    job->result = (images_option ? cameras_calibrate_lens : cameras_calibrate)(base->calibration,
                                                                               &task, error);
    for (int c = 0; job->result && c < base->calibration->rig.n_cameras; c++)
        keep_residuals(job, c);
    if (job->result)
        mark_corners(job);
    if (job->result && job->turns)
        keep_turntable(job);
    if (job->result && azimuth_option && !turn_to_board(job, error))
        return FALSE;
    for (guint i = 0; job->result && i < base->rejected->len; i++)
        g_ptr_array_add(base->calibration->parts[CALIBRATION_CAMERAS].rejected,
                        g_strdup(base->rejected->pdata[i]));
    return job->result != NULL && (!corners_option || write_corners(job, error));
}

/* Reports each camera's lens model and, for photographs, the evidence for the model. */
static void tell_lenses(Record *to, const struct calibration *calibration,
                        const struct cameras_result *result) {
    const struct rig *rig = &calibration->rig;
    record_begin_list(to, "lenses");
    for (int c = 0; c < rig->n_cameras; c++) {
        record_begin(to, NULL);
        record_add(to, "%s{camera} %s{lens} %g{variance_inflation}", rig->cameras[c].name,
                   rig_lens_name((enum rig_lens)rig->cameras[c].lens), result->inflation[c]);
        record_doubles(to, "lateral_colour", rig->cameras[c].lateral_colour, 3);
        record_doubles(to, "lateral_colour_error", calibration->cameras[c].lateral_colour, 3);
        record_end(to);
    }
    record_end(to);
    if (!images_option)
        return;
    record_say(to, "\n  %s lens%s", rig_lens_name((enum rig_lens)rig->cameras[0].lens),
               lens_option ? ", as given" : "; corners of left-out photographs are predicted to");
    record_begin(to, "held_out_px");
    for (int i = 0; i < RIG_LENSES; i++) {
        if (!(result->held_out_px[i] > 0))
            continue;
        record_double(to, rig_lens_name((enum rig_lens)i), result->held_out_px[i]);
        record_say(to, " %.3f px (%s)", result->held_out_px[i], rig_lens_name((enum rig_lens)i));
    }
    record_end(to);
}

/* Compares the focal length with the EXIF data of the photographs. A lens that is focused on a near
 * board may differ by several per cent. */
static void tell_exif(Record *to, const struct job *job) {
    const double found_px = job->base.calibration->rig.cameras[0].fx_px;
    const double off = found_px / job->exif_px - 1;
    if (!(job->exif_px > 0))
        return;
    record_begin(to, "exif");
    record_say(to,
               "\n  focal length %.1f{found_px} px; the photographs say %.1f{focal_px} px "
               "(%s{from})",
               found_px, job->exif_px, job->exif_said);
    record_end(to);
    if (job->exif_most_px > job->exif_least_px * (1 + ZOOMED))
        g_ptr_array_add(job->base.warnings,
                        g_strdup_printf("the EXIF data of the photographs give focal lengths from "
                                        "%.0f to %.0f px, so the zoom was changed between them; "
                                        "take all photographs with the zoom of the capture",
                                        job->exif_least_px, job->exif_most_px));
    if (fabs(off) > EXIF_OFF)
        g_ptr_array_add(
            job->base.warnings,
            g_strdup_printf("the focal length, %.0f px, is %.0f %% %s than the EXIF data of the "
                            "photographs say, %.0f px; causes: photographs that were cropped or "
                            "scaled, a lens that is focused on a very near board, boards that are "
                            "tilted too little",
                            found_px, 100 * fabs(off), off > 0 ? "larger" : "smaller",
                            job->exif_px));
}

/* Reports the axis of the camera arm, and the RMS deviation of the arm's stops from it. */
static void tell_arm(Record *to, const struct calibration *calibration,
                     const struct cameras_result *result) {
    const struct rig_swing_fit *arm = &result->arm;
    g_autoptr(GPtrArray) predicted = g_ptr_array_new();
    double theta_rad, phi_rad;
    if (!result->arm_known)
        return;
    rig_angles(arm->swing.axis, &theta_rad, &phi_rad);
    for (int c = 0; c < calibration->rig.n_cameras; c++)
        if (camera_set_has(result->predicted, c))
            g_ptr_array_add(predicted, (gpointer)calibration->rig.cameras[c].name);
    record_begin(to, "arm");
    record_say(to,
               "\n  arm: axis towards theta %.3f{axis_theta_deg}° phi %.3f{axis_phi_deg}°, through "
               "%.2f %.2f %.2f mm; zero %+.4f{zero_deg}°; the poses at its stops differ from turns "
               "about this axis by %.4f{angle_rms_deg}° and %.3f{position_rms_mm} mm (RMS)",
               theta_rad * 180 / G_PI, phi_rad * 180 / G_PI, arm->swing.centre_mm.x,
               arm->swing.centre_mm.y, arm->swing.centre_mm.z, arm->zero_rad * 180 / G_PI,
               arm->angle_rms_rad * 180 / G_PI, arm->position_rms_mm);
    record_strings(to, "predicted", predicted);
    record_end(to);
    if (predicted->len > 0)
        record_say(to, "; %u stop%s without pictures %s placed by the axis", predicted->len,
                   predicted->len == 1 ? "" : "s", predicted->len == 1 ? "is" : "are");
}

/* Returns the number of rows of the board that the pictures show, because a user may have given too
 * many. The markers of a ChArUco board are numbered row by row, so the corners of a board with
 * fewer rows are still found at the right places.
 *
 * In each picture there is a lowest row of corners. If the lowest of these rows is the same in at
 * least SHORT_PICTURES pictures, the board ends with the row of squares below it. With fewer such
 * pictures, and for other boards, the result is the given number of rows. */
static int rows_shown(const struct job *job) {
    const GArray *all = job->result->residuals;
    const int across = job->board.columns - 1;
    g_autofree int *last =
        g_new0(int, job->pictures->len + 1); /* last row of corners of each picture, from 1 */
    int lowest = 0, n = 0;
    for (guint i = 0; i < all->len; i++) {
        const struct cameras_residual *r = &g_array_index(all, struct cameras_residual, i);
        last[r->picture] = MAX(last[r->picture], r->corner / across + 1);
        lowest = MAX(lowest, last[r->picture]);
    }
    for (guint i = 0; i < job->pictures->len; i++)
        n += last[i] == lowest;
    return job->board.print == BOARD_CHARUCO && n >= SHORT_PICTURES ? lowest + 1 : job->board.rows;
}

static void tell(Record *to, const struct calibrate_job *base) {
    const struct job *job = (const struct job *)base;
    const struct cameras_result *result = job->result;
    const struct calibrate_video *video = job->video;
    const struct calibration_part *part = &base->calibration->parts[CALIBRATION_CAMERAS];
    record_say(to, "%d{pictures} pictures, %u{corners} corners, %.3f{rms_px} px RMS",
               part->pictures, result->residuals->len, result->rms_px);
    if (part->rejected->len)
        record_say(to, "; %u left out", part->rejected->len);
    record_add(to, "%g{expected_px} %g{real_s}", result->expected_px, base->seconds);
    if (video) {
        record_begin(to, "video");
        record_say(
            to,
            "\n  %d{frames} frames; %u{searched} that are sharper than their neighbours were "
            "searched, %d{seen} of these show the board, and %u{chosen} with the board at "
            "different places were chosen",
            video->video->n_frames, video->video->frames->len, video->n_seen, video->chosen->len);
        record_end(to);
    }
    tell_lenses(to, base->calibration, result);
    if (images_option)
        tell_exif(to, job);
    if (images_option)
        record_doubles(to, "bend_mm", result->bend_mm, 2);
    if (result->bend_mm[1] > result->bend_mm[0])
        record_say(to, "\n  the board is bent: its corners are from %+.2f to %+.2f mm off a plane",
                   result->bend_mm[0], result->bend_mm[1]);
    tell_arm(to, base->calibration, result);
    record_say_if(to, result->wobble_rad > 0,
                  "\n  turntable: its axis wobbles by up to %.4f{wobble_deg}° ± "
                  "%.4f{wobble_error_deg}°; the calibration corrects for that",
                  result->wobble_rad * 180 / G_PI, result->wobble_error_rad * 180 / G_PI);
    if (azimuth_option)
        record_say(to,
                   "\n  azimuths count from the board's x axis: those of the rig file were turned "
                   "by %+.3f{turned_deg}°",
                   -job->board_deg);
    record_say(to, "\n");
    if (images_option)
        record_say_strings(to, "rejected", "  left out: ", part->rejected);
    else
        record_strings(to, "rejected", part->rejected);
    record_say(to, "mesorig calibrate show %s tells more\n", calibrate_output);
    const int rows = rows_shown(job);
    if (rows != job->board.rows)
        record_say(to,
                   "  the board seems to have %d rows of squares, not %d; the calibration does not "
                   "depend on that\n",
                   rows, job->board.rows);
    /* The standard errors of the calibration already contain the excess of the residual, because
     * they follow from the residuals and their scatter between pictures (bundle.h). */
    const struct residual residual = {
        .of = "the board",
        .value = result->rms_px,
        .expected = result->expected_px,
        .unit = "px",
        .causes = result->wobble_rad > 0
                      ? "a board that is not flat, another lens model, a turntable that does not "
                        "come back to the same place, a camera that moved"
                      : "a board that is not flat, a loose or wobbling turntable, another lens "
                        "model, a camera that moved"};
    calibrate_warn_residual(base, &residual);
}

static int run(const struct call *call, GError **error) {
    static const struct calibrate_method method = {find, tell};
    g_autoptr(GError) bad = NULL;
    struct job job = {0};
    if (!board_option)
        return cli_usage(call->command, "no board is given: give --board");
    if (images_option && call->n_arguments > 0)
        return cli_usage(call->command, "give sessions, or --images DIR|VIDEO, not both");
    if (!images_option && call->n_arguments < 1)
        return cli_usage(call->command, "give captured sessions, or --images DIR|VIDEO");
    if (images_option && calibrate_found)
        return cli_usage(call->command, "--found is for sessions, not for --images");
    if (images_option && azimuth_option)
        return cli_usage(call->command, "--board-azimuth is for sessions, not for --images");
    if (!board_parse(&job.board, board_option, &bad) ||
        (!images_option && !board_check_upright(&job.board, &bad)))
        return cli_usage(call->command, "%s", bad->message);
    if (lens_option && !rig_lens_by_name(lens_option, &job.lens))
        return cli_usage(call->command, "--lens %s: give polynomial, rational or fisheye",
                         lens_option);
    if (corners_option && !(job.base.corners = cli_output(corners_option, "corners", error)))
        return CLI_FAILED;
    job.pictures = g_array_new(FALSE, FALSE, sizeof(struct cameras_picture));
    const int code = calibrate_run(call, &method, &job.base, error);
    output_file_free(job.base.corners);
    cameras_result_free(job.result);
    calibrate_video_free(job.video);
    g_free(job.exif_said);
    g_array_unref(job.pictures);
    return code;
}

const struct command calibrate_cameras = {
    .name = "calibrate cameras",
    .arguments = "SESSION… --board BOARD -o FILE",
    .examples = "  mesorig calibrate cameras flat.session leaning.session -b "
                "8x8,square=9,marker=6.75,thickness=3 -o rig.calibration\n",
    .help =
        "Calibrate the cameras and the axes of turntable and camera arm, from sessions of a board: "
        "one with the board flat on the turntable, others with the board leaning. Without a "
        "turntable: one session for each position of the board, one of them flat.",
    .options = entries,
    .writes = TRUE,
    .max = 64,
    .run = run};
