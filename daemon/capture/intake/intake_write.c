#include "intake_write.h"

#include <errno.h>
#include <gio/gio.h>
#include <glib/gstdio.h>
#include <string.h>

#include "exr/exr.h"
#include "plan/shot_frames.h"
#include "radiance.h"

static const char *const mono_channels[] = {"Y", NULL};
static const char *const marked_channels[] = {"Y", "saturated", NULL};
static const char *const sweep_channels[] = {"intensity",   "peak",  "second_intensity",
                                             "second_peak", "width", NULL};

#define HALF_BITS 11 /* maximum number of bits of an integer that a half float stores exactly */

/* Frames of at most this number of pixels are not compressed. Compression would save little and
 * take longer than all other work on the frame. */
#define SMALL_PIXELS (256 * 256)

static enum exr_compression compression_of(const struct intake_file *file) {
    gsize n = (gsize)file->last->width * file->last->height;
    return n <= SMALL_PIXELS ? EXR_NONE : EXR_PIZ;
}

static struct exr_part *part_new(const struct intake_file *file, const char *name,
                                 const char *const *channels, enum exr_type type,
                                 const char *unit) {
    const Frame *frame = file->last;
    struct exr_part *part = exr_part_new(name, frame->width, frame->height, channels, type);
    g_autoptr(GString) exposures = g_string_new(NULL);
    int n = file->shot->kind == SHOT_SWEEP ? 2 : shot_n_frames(file->conf, file->shot);
    gint64 before = -1;
    for (int i = 0; i < n; i++) {
        gint64 us = file->bracket ? file->bracket[i]->exposure_us
                                  : shot_exposure_us(file->conf, file->shot, i);
        if (us != before)
            g_string_append_printf(exposures, "%s%" G_GINT64_FORMAT, exposures->len ? ";" : "", us);
        before = us;
    }
    exr_set_string(part, "mesorig.camera", file->camera_name);
    exr_set_int(part, "mesorig.shot", (int)file->shot->id);
    exr_set_double(part, "mesorig.turntable_deg", file->turntable_deg);
    if (file->turned)
        exr_set_double(part, "mesorig.turning_deg_s", file->shot->pass.speed_deg_s);
    exr_set_double(part, "mesorig.arc_deg", file->shot->arc_deg);
    if (vec3_length(file->rig->arm.axis) > 0)
        exr_set_double(part, "mesorig.arm_deg", rig_arm_deg(file->rig, file->shot->cameras));
    if (vec3_length(file->rig->probe.axis) > 0)
        exr_set_double(
            part, "mesorig.probe_deg",
            rig_probe_deg(file->rig, file->shot->kind == SHOT_LAMP ? file->shot->device : -1));
    exr_set_string(part, "mesorig.cfa", cfa_name(frame->cfa));
    exr_set_string(part, "mesorig.exposures_us", exposures->str);
    exr_set_double(part, "mesorig.dark_dn", file->dark_dn);
    exr_set_int(part, "mesorig.saturated", (int)file->saturated);
    exr_set_string(part, "mesorig.unit", unit);
    return part;
}

static void fill(struct exr_part *part, const float *pixels) {
    memcpy(part->planes[0], pixels, (gsize)part->width * part->height * sizeof(float));
}

/* Writes exr to the file of the shot, syncs the file, and sets path, sha256 and bytes of ret_frame.
 * Frees exr, even on failure. */
static gboolean intake_write_frame(const struct intake_file *file, struct exr_file *exr,
                                   struct session_frame *ret_frame, GError **error) {
    g_autofree char *relative = session_frame_path(file->shot, file->camera_name);
    g_autofree char *path = g_build_filename(file->directory, relative, NULL);
    gboolean ok =
        exr_write_below(file->directory, relative, exr, compression_of(file), TRUE, error) &&
        (ret_frame->sha256 = exr_sha256(path, &ret_frame->bytes, error));
    exr_file_free(exr);
    if (ok)
        ret_frame->path = g_steal_pointer(&relative);
    return ok;
}

gboolean intake_write_lamp(const struct intake_file *file, const float *radiance,
                           struct session_frame *ret_frame, GError **error) {
    const char *const *channels = file->saturated > 0 ? marked_channels : mono_channels;
    struct exr_part *part = part_new(file, "radiance", channels, EXR_HALF, "DN/ms");
    exr_set_string(part, "mesorig.lamp", file->source_name);
    if (file->shorter_from > 0)
        exr_set_double(part, "mesorig.shorter_from", file->shorter_from);
    fill(part, radiance);
    if (file->saturated > 0)
        radiance_mark(file->bracket, file->conf->n_exposures, exr_part_plane(part, "saturated"));
    struct exr_file *exr = exr_file_new();
    exr_file_add(exr, part);
    return intake_write_frame(file, exr, ret_frame, error);
}

static char *dark_name(gint64 exposure_us) {
    return g_strdup_printf("dark_%" G_GINT64_FORMAT "_us", exposure_us);
}

gboolean intake_write_dark(const struct intake_file *file, const gint64 *exposures_us,
                           const float *const *pixels, int n, struct session_frame *ret_frame,
                           GError **error) {
    struct exr_file *exr = exr_file_new();
    for (int i = 0; i < n; i++) {
        g_autofree char *name = dark_name(exposures_us[i]);
        struct exr_part *part = part_new(file, name, mono_channels, EXR_FLOAT, "DN");
        fill(part, pixels[i]);
        exr_file_add(exr, part);
    }
    return intake_write_frame(file, exr, ret_frame, error);
}

gboolean intake_write_sweep(const struct intake_file *file, const Sweep *sweep,
                            struct session_frame *ret_frame, GError **error) {
    struct exr_part *part = part_new(file, "sweep", sweep_channels, EXR_FLOAT, "DN");
    const struct session_shot *shot = file->shot;
    exr_set_string(part, "mesorig.laser", file->source_name);
    exr_set_double(part, "sweep.from_deg", shot->sweep_from_deg);
    exr_set_double(part, "sweep.to_deg", shot->sweep_to_deg);
    exr_set_int(part, "sweep.steps", shot->sweep_steps);
    const struct sweep_pulses first = {exr_part_plane(part, "peak"), exr_part_plane(part, "width"),
                                       exr_part_plane(part, "intensity")};
    const struct sweep_pulses second = {exr_part_plane(part, "second_peak"), NULL,
                                        exr_part_plane(part, "second_intensity")};
    sweep_finish(sweep, file->conf->laser_threshold_dn, &first, &second);
    struct exr_file *exr = exr_file_new();
    exr_file_add(exr, part);
    return intake_write_frame(file, exr, ret_frame, error);
}

gboolean intake_write_raw(const struct intake_file *file, int sub, GError **error) {
    g_autofree char *relative = session_frame_path(file->shot, file->camera_name);
    relative[strlen(relative) - strlen(".exr")] = '\0';
    g_autofree char *folder = g_build_filename(file->directory, relative, NULL);
    if (g_mkdir(folder, 0777) != 0 && errno != EEXIST) {
        const int code = errno;
        g_set_error(
            error, G_FILE_ERROR, (int)g_file_error_from_errno(code),
            "the folder %s for raw frames cannot be made: %s; free some space, and check that "
            "the daemon may write into the session",
            folder, g_strerror(code));
        return FALSE;
    }
    /* Frames of a sweep are not compressed, because they arrive faster than they can be
     * compressed. */
    const gboolean sweep = file->shot->kind == SHOT_SWEEP;
    const int step = sweep ? shot_sweep_step(file->conf, file->shot, sub) : sub;
    const int last = shot_n_frames(file->conf, file->shot) - 1;
    const gboolean is_short = sweep && shot_exposure_us(file->conf, file->shot, sub) <
                                           shot_exposure_us(file->conf, file->shot, last);
    g_autofree char *path =
        g_strdup_printf("%s/%04d%s.exr", relative, step, is_short ? "_short" : "");
    struct exr_part *part = part_new(file, "frame", mono_channels,
                                     file->last->bits <= HALF_BITS ? EXR_HALF : EXR_FLOAT, "DN");
    if (file->shot->kind != SHOT_DARK)
        exr_set_string(part, file->shot->kind == SHOT_LAMP ? "mesorig.lamp" : "mesorig.laser",
                       file->source_name);
    exr_set_double(part, "mesorig.exposure_us", (double)file->last->exposure_us);
    exr_set_int(part, "mesorig.bits", file->last->bits);
    for (gsize i = 0; i < (gsize)part->width * part->height; i++)
        part->planes[0][i] = file->last->pixels[i];
    struct exr_file *exr = exr_file_new();
    exr_file_add(exr, part);
    gboolean ok = exr_write_below(file->directory, path, exr,
                                  sweep ? EXR_NONE : compression_of(file), FALSE, error);
    exr_file_free(exr);
    return ok;
}

float *intake_read_dark(const char *directory, const struct session_shot *shot,
                        const char *camera_name, const struct camera_format *format,
                        gint64 exposure_us, GError **error) {
    g_autofree char *relative = session_frame_path(shot, camera_name);
    g_autofree char *path = g_build_filename(directory, relative, NULL);
    g_autofree char *name = dark_name(exposure_us);
    struct exr_part *part = exr_read_part(path, name, error);
    if (!part)
        return NULL;
    float *pixels = NULL;
    const float *plane = exr_part_plane(part, "Y");
    if (plane && part->width == format->width && part->height == format->height)
        pixels = g_memdup2(plane, (gsize)part->width * part->height * sizeof(float));
    else
        g_set_error(error, EXR_ERROR, EXR_ERROR_MISSING,
                    "%s: part %s is not a dark frame of %d × %d pixels, as this camera takes them; "
                    "remove the file and resume the session, which takes the shot again",
                    path, name, format->width, format->height);
    exr_part_free(part);
    return pixels;
}
