/* calibrate cameras: cameras and turntable from captured boards, or one camera from photographs. */
#include "calibrate.h"
#include "cameras/cameras.h"
#include "pictures/vision.h"

#define MOST_PICTURES 20000
#define KEPT_VECTORS  400 /* residuals of a camera, for the report */

static char *board_option, *images_option, *name_option;
static const GOptionEntry entries[] = {
    {"board", 'b', 0, G_OPTION_ARG_STRING, &board_option,
     "The board, as measured, in mm; mesorig board draws one",
     "8x8,square=9,marker=6.75,thickness=3"},
    CALIBRATE_OUTPUT("Write the calibration here"),
    CALIBRATE_FROM("Start from this calibration, and keep what it says of lamps and lasers"),
    {"images", 'i', 0, G_OPTION_ARG_FILENAME, &images_option,
     "No sessions: photographs (JPEG, PNG, TIFF) that one camera took of a board held at different "
     "tilts",
     "DIR"},
    {"name", 0, 0, G_OPTION_ARG_STRING, &name_option, "With --images: the camera's name", "NAME"},
    {NULL},
};

struct job {
    struct calibrate_job base;
    struct board board;
    struct cameras_result *result;
    GArray *pictures; /* struct cameras_picture, one a frame */
};

static void cli_calibrate_cameras_add(struct job *job, struct calibrate_frame *frame, int lay) {
    const struct cameras_picture picture = {frame->camera, lay, frame->turntable_deg};
    g_array_append_val(job->pictures, picture);
    g_ptr_array_add(job->base.frames, frame);
}

/* One light is enough: the first of each pose. */
static gboolean is_new(const struct job *job, const struct calibrate_frame *frame, int lay) {
    for (guint i = 0; i < job->pictures->len; i++) {
        const struct cameras_picture *p = &g_array_index(job->pictures, struct cameras_picture, i);
        if (p->lay == lay && p->camera == frame->camera && p->turntable_deg == frame->turntable_deg)
            return FALSE;
    }
    return TRUE;
}

static gboolean cli_calibrate_cameras_add_session(struct job *job, int lay, GError **error) {
    g_autoptr(Session) session = calibrate_open(&job->base, lay, calibrate_from, error);
    g_autoptr(GPtrArray) frames = session ? calibrate_frames(session, SHOT_LAMP, error) : NULL;
    for (guint i = 0; frames && i < frames->len; i++) {
        struct calibrate_frame *frame = frames->pdata[i];
        if (frame->camera >= job->base.calibration->rig.n_cameras || !is_new(job, frame, lay))
            continue;
        frames->pdata[i] = NULL;
        cli_calibrate_cameras_add(job, frame, lay);
    }
    return frames != NULL;
}

static gboolean add_photographs(struct job *job, GError **error) {
    g_autoptr(GPtrArray) paths = calibrate_photographs(images_option, MOST_PICTURES, error);
    for (guint i = 0; paths && i < paths->len; i++) {
        struct calibrate_frame *frame = g_new0(struct calibrate_frame, 1);
        frame->path = g_strdup(paths->pdata[i]);
        cli_calibrate_cameras_add(job, frame, (int)i);
    }
    return paths != NULL;
}

/* The first photograph says how large the camera's pictures are. */
static gboolean begin_lens(struct job *job, GError **error) {
    struct rig rig = {.id = "photographs", .n_cameras = 1};
    const struct calibrate_frame *frame = job->base.frames->pdata[0];
    g_autoptr(Picture) first = vision_read(frame->path, error);
    if (!first)
        return FALSE;
    g_strlcpy(rig.cameras[0].name, name_option ? name_option : "camera", RIG_NAME);
    rig.cameras[0].width = first->width;
    rig.cameras[0].height = first->height;
    rig.cameras[0].response = 1;
    rig.cameras[0].rotation = (struct mat3){{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    job->base.calibration = calibration_new(&rig);
    return TRUE;
}

static struct picture *cli_calibrate_cameras_read_picture(int i, gpointer data, GError **error) {
    struct job *job = data;
    const struct calibrate_frame *frame = job->base.frames->pdata[i];
    g_autofree char *cfa = NULL;
    if (!frame->sha256)
        return vision_read(frame->path, error);
    g_autoptr(Picture) picture = calibrate_read(frame, &cfa, error);
    if (picture && !picture_balance(picture, cfa)) {
        g_set_error(error, CAMERAS_ERROR, CAMERAS_ERROR_PICTURES,
                    "%s: its colour filter “%s” is not known", picture->name, cfa);
        return NULL;
    }
    return g_steal_pointer(&picture);
}

static gboolean on_step(int step, int n, gpointer data) {
    const struct calibrate_job *job = data;
    return work_tell(job->work, "boards", step, n, job->begun_us, NULL);
}

static gboolean cli_calibrate_cameras_gather(struct job *job, GError **error) {
    if (images_option)
        return add_photographs(job, error) && begin_lens(job, error);
    for (int i = 0; i < job->base.n_sessions; i++)
        if (!cli_calibrate_cameras_add_session(job, i, error))
            return FALSE;
    return TRUE;
}

/* Some of the residuals of each camera, for pictures of them. */
static void keep_residuals(struct job *job, int camera) {
    const GArray *all = job->result->residuals;
    GString *lists[4] = {g_string_new(NULL), g_string_new(NULL), g_string_new(NULL),
                         g_string_new(NULL)};
    static const char *const keys[4] = {"x_px", "y_px", "dx_px", "dy_px"};
    g_autofree char *group = g_strdup_printf("camera residuals %d", camera);
    const int n = job->base.calibration->cameras[camera].points, every = n / KEPT_VECTORS + 1;
    int k = 0;
    for (guint i = 0; i < all->len; i++) {
        const struct cameras_residual *r = &g_array_index(all, struct cameras_residual, i);
        if (r->camera != camera || k++ % every != 0)
            continue;
        const float values[4] = {r->x_px, r->y_px, r->dx_px, r->dy_px};
        for (int j = 0; j < 4; j++)
            calibrate_append(lists[j], (double)values[j], "%.4f");
    }
    for (int j = 0; j < 4; j++) {
        g_key_file_set_value(job->base.calibration->extra, group, keys[j], lists[j]->str);
        g_string_free(lists[j], TRUE);
    }
}

static void keep_turntable(struct job *job) {
    g_autoptr(GString) commanded = g_string_new(NULL);
    g_autoptr(GString) errors = g_string_new(NULL);
    g_autoptr(GString) tilts = g_string_new(NULL);
    for (guint i = 0; i < job->result->stops->len; i++) {
        const struct cameras_stop *s = &g_array_index(job->result->stops, struct cameras_stop, i);
        calibrate_append(commanded, s->commanded_deg, "%.4f");
        calibrate_append(errors, s->error_deg, "%.4f");
    }
    for (guint i = 0; i < job->result->lays->len; i++)
        calibrate_append(tilts, g_array_index(job->result->lays, struct cameras_lay, i).tilt_deg,
                         "%.4f");
    g_key_file_set_value(job->base.calibration->extra, "turntable", "commanded_deg",
                         commanded->str);
    g_key_file_set_value(job->base.calibration->extra, "turntable", "error_deg", errors->str);
    g_key_file_set_value(job->base.calibration->extra, "turntable", "board_tilts_deg", tilts->str);
}

static gboolean cli_calibrate_cameras_find(struct calibrate_job *base, GError **error) {
    struct job *job = (struct job *)base;
    if (!cli_calibrate_cameras_gather(job, error))
        return FALSE;
    const struct cameras_task task = {
        .board = job->board,
        .pictures = (const struct cameras_picture *)(gpointer)job->pictures->data,
        .n_pictures = (int)job->pictures->len,
        .read = cli_calibrate_cameras_read_picture,
        .progress = on_step,
        .data = job,
    };
    job->result = (images_option ? cameras_calibrate_lens : cameras_calibrate)(base->calibration,
                                                                               &task, error);
    for (int c = 0; job->result && c < base->calibration->rig.n_cameras; c++)
        keep_residuals(job, c);
    if (job->result && !images_option)
        keep_turntable(job);
    return job->result != NULL;
}

static void cli_calibrate_cameras_tell(Record *to, const struct calibrate_job *base) {
    const struct cameras_result *result = ((const struct job *)base)->result;
    const struct calibration_part *part = &base->calibration->parts[CALIBRATION_CAMERAS];
    record_int(to, "pictures", part->pictures);
    record_strings(to, "rejected", part->rejected);
    record_int(to, "corners", result->residuals->len);
    record_double(to, "rms_px", result->rms_px);
    record_double(to, "real_s", base->seconds);
    record_say(to, "%s: %d pictures, %u corners, %.3f px RMS", calibrate_output, part->pictures,
               result->residuals->len, result->rms_px);
    if (part->rejected->len)
        record_say(to, "; %u pictures without a good view of the board", part->rejected->len);
    record_say(to, "\nmesorig calibrate show %s tells more\n", calibrate_output);
}

static int cli_calibrate_cameras_run(const struct call *call, GError **error) {
    static const struct calibrate_method method = {cli_calibrate_cameras_find,
                                                   cli_calibrate_cameras_tell};
    g_autoptr(GError) bad = NULL;
    struct job job = {0};
    if (!board_option)
        return cli_usage(call->command, "which board? Give --board");
    if (!calibrate_output)
        return cli_usage(call->command, "where to? Give -o FILE");
    if (images_option ? call->n_arguments > 0 : call->n_arguments < 1)
        return cli_usage(call->command, "give captured sessions, or --images DIR");
    if (!board_parse(&job.board, board_option, &bad))
        return cli_usage(call->command, "%s", bad->message);
    job.pictures = g_array_new(FALSE, FALSE, sizeof(struct cameras_picture));
    const int code = calibrate_run(call, &method, &job.base, error);
    cameras_result_free(job.result);
    g_array_unref(job.pictures);
    return code;
}

const struct command calibrate_cameras = {
    .name = "calibrate cameras",
    .arguments = "SESSION… --board BOARD -o FILE",
    .help = "Find out where cameras and the turntable's axis are, "
            "from sessions of a board: one flat on the "
            "turntable, others leaning.",
    .options = entries,
    .max = 64,
    .run = cli_calibrate_cameras_run};
