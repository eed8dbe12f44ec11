/* calibrate cameras: cameras and turntable from captured boards, or one camera from photographs. */
#include "calibrate.h"
#include "cameras/cameras.h"
#include "pictures/vision.h"
#include "work.h"

#include <string.h>

#define MOST_PICTURES 20000
#define KEPT_VECTORS  400 /* residuals of a camera, for the report */

static char *board_option, *output_option, *calibration_option, *images_option, *name_option;
static const GOptionEntry entries[] = {
    {"board", 'b', 0, G_OPTION_ARG_STRING, &board_option,
     "The board, as measured, in mm; mesorig board draws one",
     "8x8,square=9,marker=6.75,thickness=3"},
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output_option, "Write the calibration here", "FILE"},
    {"calibration", 'c', 0, G_OPTION_ARG_FILENAME, &calibration_option,
     "Start from this calibration, and keep what it says of lamps and lasers", "FILE"},
    {"images", 'i', 0, G_OPTION_ARG_FILENAME, &images_option,
     "No sessions: photographs (JPEG, PNG, TIFF) that one camera took of a board held at different "
     "tilts",
     "DIR"},
    {"name", 0, 0, G_OPTION_ARG_STRING, &name_option, "With --images: the camera's name", "NAME"},
    {NULL},
};

struct source { /* of a picture: a frame of a session, or a file */
    struct calibrate_frame *frame;
    char *path;
};

struct job {
    char *const *sessions;
    int n_sessions;
    struct board board;
    struct calibration *calibration;
    struct cameras_result *result;
    GArray *pictures; /* struct cameras_picture */
    GArray *sources;  /* struct source, of pictures */
    const struct work *work;
    gint64 begun_us;
};

static void clear_source(gpointer data) {
    struct source *source = data;
    calibrate_frame_free(source->frame);
    g_free(source->path);
}

static void cli_calibrate_cameras_add(struct job *job, struct source source, int camera, int lay,
                                      double turntable_deg) {
    const struct cameras_picture picture = {camera, lay, turntable_deg};
    g_array_append_val(job->pictures, picture);
    g_array_append_val(job->sources, source);
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

static gboolean cli_calibrate_cameras_add_session(struct job *job, const char *path, int lay,
                                                  GError **error) {
    g_autoptr(Session) session = session_open(path, SESSION_READ, error);
    if (!session)
        return FALSE;
    struct calibration *own = calibrate_begin(calibration_option, session, error);
    if (!own)
        return FALSE;
    const gboolean same =
        !job->calibration || calibration_check_rig(job->calibration, path, &own->rig, error);
    if (job->calibration)
        calibration_free(own);
    else
        job->calibration = own;
    g_autoptr(GPtrArray) frames = same ? calibrate_frames(session, SHOT_LAMP, error) : NULL;
    for (guint i = 0; frames && i < frames->len; i++) {
        struct calibrate_frame *frame = frames->pdata[i];
        if (frame->camera >= job->calibration->rig.n_cameras || !is_new(job, frame, lay))
            continue;
        const struct source source = {frame, NULL};
        frames->pdata[i] = NULL;
        cli_calibrate_cameras_add(job, source, frame->camera, lay, frame->turntable_deg);
    }
    return frames != NULL;
}

static int cli_calibrate_cameras_by_text(gconstpointer a, gconstpointer b) {
    return strcmp(*(char *const *)a, *(char *const *)b);
}

static gboolean cli_calibrate_cameras_is_photograph(const char *name) {
    static const char *const ends[] = {".jpg", ".jpeg", ".png", ".tif", ".tiff", NULL};
    g_autofree char *lower = g_ascii_strdown(name, -1);
    for (int i = 0; ends[i]; i++)
        if (g_str_has_suffix(lower, ends[i]))
            return TRUE;
    return FALSE;
}

static gboolean add_photographs(struct job *job, const char *path, GError **error) {
    g_autoptr(GDir) dir = g_dir_open(path, 0, error);
    g_autoptr(GPtrArray) names = g_ptr_array_new_with_free_func(g_free);
    const char *name;
    if (!dir)
        return FALSE;
    while ((name = g_dir_read_name(dir)) && names->len < MOST_PICTURES)
        if (cli_calibrate_cameras_is_photograph(name))
            g_ptr_array_add(names, g_build_filename(path, name, NULL));
    g_ptr_array_sort(names, cli_calibrate_cameras_by_text);
    for (guint i = 0; i < names->len; i++)
        cli_calibrate_cameras_add(job, (struct source){NULL, g_strdup(names->pdata[i])}, 0, (int)i,
                                  0);
    if (names->len > 0)
        return TRUE;
    g_set_error(error, CAMERAS_ERROR, CAMERAS_ERROR_PICTURES,
                "%s: there is no .jpg, .png or .tif picture in that folder", path);
    return FALSE;
}

/* The first photograph says how large the camera's pictures are. */
static gboolean begin_lens(struct job *job, GError **error) {
    struct rig rig = {.id = "photographs", .n_cameras = 1};
    g_autoptr(Picture) first =
        vision_read(g_array_index(job->sources, struct source, 0).path, error);
    if (!first)
        return FALSE;
    g_strlcpy(rig.cameras[0].name, name_option ? name_option : "camera", RIG_NAME);
    rig.cameras[0].width = first->width;
    rig.cameras[0].height = first->height;
    rig.cameras[0].response = 1;
    rig.cameras[0].rotation = (struct mat3){{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    job->calibration = calibration_new(&rig);
    return TRUE;
}

static struct picture *cli_calibrate_cameras_read_picture(int i, gpointer data, GError **error) {
    struct job *job = data;
    const struct source *source = &g_array_index(job->sources, struct source, (guint)i);
    g_autofree char *cfa = NULL;
    if (source->path)
        return vision_read(source->path, error);
    g_autoptr(Picture) picture = calibrate_read(source->frame, &cfa, error);
    if (picture && !picture_balance(picture, cfa)) {
        g_set_error(error, CAMERAS_ERROR, CAMERAS_ERROR_PICTURES,
                    "%s: its colour filter “%s” is not known", picture->name, cfa);
        return NULL;
    }
    return g_steal_pointer(&picture);
}

static gboolean on_step(int step, int n, gpointer data) {
    const struct job *job = data;
    return work_tell(job->work, "boards", step, n, job->begun_us, NULL);
}

static gboolean cli_calibrate_cameras_gather(struct job *job, GError **error) {
    if (images_option)
        return add_photographs(job, images_option, error) && begin_lens(job, error);
    for (int i = 0; i < job->n_sessions; i++)
        if (!cli_calibrate_cameras_add_session(job, job->sessions[i], i, error))
            return FALSE;
    return TRUE;
}

static void cli_calibrate_cameras_append(GString *to, double value) {
    char text[G_ASCII_DTOSTR_BUF_SIZE];
    g_ascii_formatd(text, sizeof text, "%.4f", value);
    g_string_append_printf(to, "%s%s", to->len ? ";" : "", text);
}

/* Some of the residuals of each camera, for pictures of them. */
static void keep_residuals(struct job *job, int camera) {
    const GArray *all = job->result->residuals;
    GString *lists[4] = {g_string_new(NULL), g_string_new(NULL), g_string_new(NULL),
                         g_string_new(NULL)};
    static const char *const keys[4] = {"x_px", "y_px", "dx_px", "dy_px"};
    g_autofree char *group = g_strdup_printf("camera residuals %d", camera);
    const int n = job->calibration->cameras[camera].points, every = n / KEPT_VECTORS + 1;
    int k = 0;
    for (guint i = 0; i < all->len; i++) {
        const struct cameras_residual *r = &g_array_index(all, struct cameras_residual, i);
        if (r->camera != camera || k++ % every != 0)
            continue;
        const float values[4] = {r->x_px, r->y_px, r->dx_px, r->dy_px};
        for (int j = 0; j < 4; j++)
            cli_calibrate_cameras_append(lists[j], (double)values[j]);
    }
    for (int j = 0; j < 4; j++) {
        g_key_file_set_value(job->calibration->extra, group, keys[j], lists[j]->str);
        g_string_free(lists[j], TRUE);
    }
}

static void keep_turntable(struct job *job) {
    g_autoptr(GString) commanded = g_string_new(NULL);
    g_autoptr(GString) errors = g_string_new(NULL);
    g_autoptr(GString) tilts = g_string_new(NULL);
    for (guint i = 0; i < job->result->stops->len; i++) {
        const struct cameras_stop *s = &g_array_index(job->result->stops, struct cameras_stop, i);
        cli_calibrate_cameras_append(commanded, s->commanded_deg);
        cli_calibrate_cameras_append(errors, s->error_deg);
    }
    for (guint i = 0; i < job->result->lays->len; i++)
        cli_calibrate_cameras_append(
            tilts, g_array_index(job->result->lays, struct cameras_lay, i).tilt_deg);
    g_key_file_set_value(job->calibration->extra, "turntable", "commanded_deg", commanded->str);
    g_key_file_set_value(job->calibration->extra, "turntable", "error_deg", errors->str);
    g_key_file_set_value(job->calibration->extra, "turntable", "board_tilts_deg", tilts->str);
}

static gboolean cli_calibrate_cameras_work(const struct work *work, gpointer data, GError **error) {
    struct job *job = data;
    job->work = work;
    job->begun_us = g_get_monotonic_time();
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
    job->result = (images_option ? cameras_calibrate_lens : cameras_calibrate)(job->calibration,
                                                                               &task, error);
    if (!job->result)
        return FALSE;
    for (int c = 0; c < job->calibration->rig.n_cameras; c++)
        keep_residuals(job, c);
    if (!images_option)
        keep_turntable(job);
    return calibration_write(job->calibration, output_option, error);
}

static void cli_calibrate_cameras_tell_json(const struct job *job, double seconds) {
    const struct calibration_part *part = &job->calibration->parts[CALIBRATION_CAMERAS];
    GVariantBuilder builder;
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&builder, "{sv}", "file", g_variant_new_string(output_option));
    g_variant_builder_add(&builder, "{sv}", "pictures", g_variant_new_int32(part->pictures));
    g_variant_builder_add(&builder, "{sv}", "rejected",
                          g_variant_new_strv((const char *const *)part->rejected->pdata,
                                             (gssize)part->rejected->len));
    g_variant_builder_add(&builder, "{sv}", "corners",
                          g_variant_new_uint32(job->result->residuals->len));
    g_variant_builder_add(&builder, "{sv}", "rms_px", g_variant_new_double(job->result->rms_px));
    g_variant_builder_add(&builder, "{sv}", "real_s", g_variant_new_double(seconds));
    cli_print_json(g_variant_builder_end(&builder));
}

static void cli_calibrate_cameras_tell(const struct job *job, double seconds) {
    const struct calibration_part *part = &job->calibration->parts[CALIBRATION_CAMERAS];
    if (cli_json) {
        cli_calibrate_cameras_tell_json(job, seconds);
        return;
    }
    g_print("%s: %d pictures, %u corners, %.3f px RMS", output_option, part->pictures,
            job->result->residuals->len, job->result->rms_px);
    if (part->rejected->len)
        g_print("; %u pictures without a good view of the board", part->rejected->len);
    g_print("\nmesorig calibrate show %s tells more\n", output_option);
}

static int cli_calibrate_cameras_run_job(struct job *job) {
    g_autoptr(GError) error = NULL;
    double seconds = 0;
    const gboolean ok = cli_work_run(cli_calibrate_cameras_work, job, &seconds, &error);
    if (ok)
        cli_calibrate_cameras_tell(job, seconds);
    return ok ? CLI_DONE : cli_fail(error);
}

static int cli_calibrate_cameras_run(const struct command *command, int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    struct job job = {0};
    if (!cli_parse(command, entries, FALSE, &argc, &argv, 0, 64))
        return CLI_USAGE;
    if (!board_option)
        return cli_usage(command, "which board? Give --board");
    if (!output_option)
        return cli_usage(command, "where to? Give -o FILE");
    if (images_option ? argc > 1 : argc < 2)
        return cli_usage(command, "give captured sessions, or --images DIR");
    if (!board_parse(&job.board, board_option, &error))
        return cli_usage(command, "%s", error->message);
    job.sessions = argv + 1;
    job.n_sessions = argc - 1;
    job.pictures = g_array_new(FALSE, FALSE, sizeof(struct cameras_picture));
    job.sources = g_array_new(FALSE, FALSE, sizeof(struct source));
    g_array_set_clear_func(job.sources, clear_source);
    const int code = cli_calibrate_cameras_run_job(&job);
    calibration_free(job.calibration);
    cameras_result_free(job.result);
    g_array_unref(job.pictures);
    g_array_unref(job.sources);
    return code;
}

const struct command calibrate_cameras = {
    .name = "calibrate cameras",
    .arguments = "SESSION… --board BOARD -o FILE",
    .help = "Find out where cameras and the turntable's axis are, "
            "from sessions of a board: one flat on the "
            "turntable, others leaning.",
    .run_arguments = cli_calibrate_cameras_run};
