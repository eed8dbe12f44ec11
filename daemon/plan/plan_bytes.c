/* How much a session takes on disk, file by file, as intake_write.c writes them. */
#include "plan_private.h"
#include "shot_frames.h"

/* Of an uncompressed scan line: its row in the table of offsets, its number and size, and in a file
 * of several parts the number of its part. */
#define LINE_BYTES      16
#define PART_LINE_BYTES 20
/* File systems give space in blocks of this size (ext4, XFS, Btrfs, tmpfs). */
#define BLOCK_BYTES 4096
/* Of session.db: the tables and texts of a session without shots; a shot, a direction, and a frame
 * with its path and its checksum. */
#define EMPTY_BYTES     (56 << 10)
#define SHOT_BYTES      120
#define DIRECTION_BYTES 50
#define FRAME_BYTES     230

#define HALF_BITS 11 /* integers that a half holds exactly */

/* Files of more pixels are compressed (intake_write.c). The compressed share depends on noise and
 * texture; these shares were measured on the demo's weave at 384² and 640² pixels, where lamp
 * frames were 0.79 and 0.70, sweeps 0.24 and 0.26, dark frames 0.27 and 0.25, raw ones 0.34 and
 * 0.30. */
#define SMALL_PIXELS  (256 * 256)
#define LEFT_OF_LAMP  0.745
#define LEFT_OF_SWEEP 0.25
#define LEFT_OF_DARK  0.26
#define LEFT_OF_RAW   0.32

struct kind {
    int parts, channels, value_bytes;
    int head_bytes; /* attributes of a part */
    double left;    /* of the values, where files are compressed; 1: they never are */
};

static guint64 file_bytes(const struct rig_camera *camera, const struct kind *kind) {
    const guint64 pixels = (guint64)camera->width * (guint64)camera->height;
    const guint64 values = pixels * (guint64)(kind->parts * kind->channels * kind->value_bytes);
    const int line_bytes = kind->parts > 1 ? PART_LINE_BYTES : LINE_BYTES;
    const guint64 lines = (guint64)camera->height * (guint64)line_bytes;
    const guint64 heads = (guint64)kind->parts * ((guint64)kind->head_bytes + lines);
    const guint64 bytes = plan_bytes_vary(camera) && kind->left < 1
                              ? (guint64)((double)values * kind->left)
                              : values + heads;
    return (bytes + BLOCK_BYTES - 1) / BLOCK_BYTES * BLOCK_BYTES;
}

guint64 plan_shot_bytes(const struct session_conf *conf, const struct session_shot *shot,
                        const struct rig_camera *camera, int bits) {
    gint64 exposures[SHOT_MAX_DARKS];
    const gboolean sweep = shot->kind == SHOT_SWEEP;
    const struct kind kinds[] = {
        [SHOT_LAMP] = {1, 1, 2, 700, LEFT_OF_LAMP},
        [SHOT_SWEEP] = {1, 5, 4, 850, LEFT_OF_SWEEP},
        [SHOT_DARK] = {shot_dark_exposures(conf, exposures), 1, 4, 650, LEFT_OF_DARK},
    };
    const struct kind raw = {1, 1, bits <= HALF_BITS ? 2 : 4, 750, sweep ? 1 : LEFT_OF_RAW};
    const gboolean keeps = sweep ? conf->keep_laser_frames : conf->keep_exposures;
    const guint64 n_raw = keeps ? (guint64)shot_n_frames(conf, shot) : 0;
    return FRAME_BYTES + file_bytes(camera, &kinds[shot->kind]) + n_raw * file_bytes(camera, &raw);
}

gboolean plan_bytes_vary(const struct rig_camera *camera) {
    return (guint64)camera->width * (guint64)camera->height > SMALL_PIXELS;
}

guint64 plan_bytes(const struct plan_build *b) {
    guint64 bytes =
        EMPTY_BYTES + DIRECTION_BYTES * (b->views->len + b->lights->len + b->lasers->len);
    for (guint i = 0; i < b->shots->len; i++) {
        const struct session_shot *shot = &g_array_index(b->shots, struct session_shot, i);
        bytes += SHOT_BYTES;
        for (int c = 0; c < b->rig->n_cameras; c++)
            if (shot->state == SHOT_PLANNED && shot->cameras & 1u << c)
                bytes += plan_shot_bytes(b->conf, shot, &b->rig->cameras[c], b->timing->bits[c]);
    }
    return bytes;
}
