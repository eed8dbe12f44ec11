/* calibrate: one subcommand a file, mesorig_calibrate_*.c. */
#include "calibrate.h"

#include "exr/exr.h"

#include <string.h>

static const struct command *const commands[] = {
    &calibrate_cameras, &calibrate_lights, &calibrate_laser, &calibrate_radiometry,
    &calibrate_colour,  &calibrate_show,   &calibrate_report};

struct calibration *calibrate_begin(const char *path, Session *session, GError **error) {
    g_autofree char *where = session_file(session, "session.db (calibration.conf)");
    g_autofree char *text = session_text(session, "calibration.conf", error);
    g_autoptr(Calibration) own = text ? calibration_from_text(text, where, error) : NULL;

    if (!own || !path || !g_file_test(path, G_FILE_TEST_EXISTS))
        return g_steal_pointer(&own);
    g_autoptr(Calibration) calibration = calibration_read(path, error);
    return calibration && calibration_check_rig(calibration, path, &own->rig, error)
               ? g_steal_pointer(&calibration)
               : NULL;
}

void calibrate_frame_free(struct calibrate_frame *frame) {
    if (!frame)
        return;
    g_free(frame->path);
    g_free(frame->sha256);
    g_free(frame);
}

static void free_frame(gpointer frame) {
    calibrate_frame_free(frame);
}

static struct calibrate_frame *cli_calibrate_new_frame(Session *session,
                                                       const struct session_shot *shot,
                                                       const struct session_frame *from) {
    struct calibrate_frame *frame = g_new0(struct calibrate_frame, 1);

    frame->path = session_file(session, from->path);
    frame->sha256 = g_strdup(from->sha256);
    frame->kind = shot->kind;
    frame->camera = from->camera;
    frame->lamp = shot->kind == SHOT_LAMP ? shot->device : -1;
    frame->laser = shot->kind == SHOT_SWEEP ? shot->device : -1;
    frame->turntable_deg = shot->turntable_deg;
    frame->arc_deg = shot->arc_deg;
    return frame;
}

GPtrArray *calibrate_frames(Session *session, enum session_shot_kind kind, GError **error) {
    g_autoptr(GPtrArray) shots = session_shots(session, error);
    g_autoptr(GPtrArray) rows = shots ? session_frames(session, error) : NULL;
    if (!rows)
        return NULL;
    GPtrArray *frames = g_ptr_array_new_with_free_func(free_frame);
    for (guint i = 0; i < rows->len; i++) {
        const struct session_frame *row = rows->pdata[i];
        if (row->shot < 1 || row->shot > (gint64)shots->len)
            continue;
        const struct session_shot *shot = shots->pdata[row->shot - 1];
        if (shot->kind == kind && shot->state == SHOT_DONE)
            g_ptr_array_add(frames, cli_calibrate_new_frame(session, shot, row));
    }
    return frames;
}

gboolean calibrate_check_sum(const struct calibrate_frame *frame, GError **error) {
    g_autofree char *sum = exr_sha256(frame->path, NULL, error);

    if (!sum || strcmp(sum, frame->sha256) == 0)
        return sum != NULL;
    g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT,
                "%s: is not the file that was captured, its checksum differs; mesorig resume takes "
                "it again",
                frame->path);
    return FALSE;
}

struct picture *calibrate_read(const struct calibrate_frame *frame, char **ret_cfa,
                               GError **error) {
    const char *cfa = NULL;
    struct exr_part *part =
        calibrate_check_sum(frame, error) ? exr_read_part(frame->path, "radiance", error) : NULL;
    const float *plane = part ? exr_part_plane(part, "Y") : NULL;
    struct picture *picture = NULL;

    if (part && !plane)
        g_set_error(error, EXR_ERROR, EXR_ERROR_MISSING, "%s: there is no channel Y", frame->path);
    if (plane && exr_get_string(part, "mesorig.cfa", &cfa, error)) {
        picture = picture_new(frame->path, frame->sha256, part->width, part->height);
        memcpy(picture->values, plane, sizeof(float) * (gsize)part->width * (gsize)part->height);
        if (ret_cfa)
            *ret_cfa = g_strdup(cfa);
    }
    exr_part_free(part);
    return picture;
}

static void cli_calibrate_print_help(void) {
    g_print("Usage: mesorig calibrate WHAT …\n\n");
    for (gsize i = 0; i < G_N_ELEMENTS(commands); i++)
        g_print("  %-12s %s\n", commands[i]->name + strlen("calibrate "), commands[i]->help);
    g_print("\n“mesorig calibrate WHAT --help” tells more.\n");
}

static int cli_calibrate_run(const struct command *command, int argc, char **argv) {
    if (argc < 2 || strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0) {
        cli_calibrate_print_help();
        return argc < 2 ? CLI_USAGE : CLI_DONE;
    }
    for (gsize i = 0; i < G_N_ELEMENTS(commands); i++)
        if (strcmp(commands[i]->name + strlen("calibrate "), argv[1]) == 0)
            return cli_run(commands[i], argc - 1, argv + 1);
    return cli_usage(
        command, "“%s” cannot be calibrated; “mesorig calibrate --help” lists what can", argv[1]);
}

const struct command cli_calibrate = {
    .name = "calibrate",
    .arguments = "WHAT …",
    .help = "Find out where cameras, lamps and lasers are, from pictures.",
    .run_arguments = cli_calibrate_run};
