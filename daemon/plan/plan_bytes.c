/* Predicts the disk space of a session from the files that intake_write.c writes. */
#include "plan_private.h"
#include "shot_frames.h"

#include <math.h>

/* Overhead in bytes of an uncompressed scan line: its entry in the table of offsets, its number and
 * its size. In a file of several parts, the line also has the number of its part. */
#define LINE_BYTES      16
#define PART_LINE_BYTES 20
/* File systems allocate space in blocks of this size (ext4, XFS, Btrfs, tmpfs). */
#define BLOCK_BYTES 4096
/* Bytes in session.db. EMPTY_BYTES are those of the tables and texts of a session without shots.
 * Each shot takes SHOT_BYTES, each direction DIRECTION_BYTES, and each frame FRAME_BYTES, with its
 * path and its checksum. */
#define EMPTY_BYTES     (56 << 10)
#define SHOT_BYTES      120
#define DIRECTION_BYTES 50
#define FRAME_BYTES     230

#define RAD(deg) ((deg) * (G_PI / 180))

#define HALF_BITS 11 /* a half float stores integers of up to this number of bits exactly */

/* Files of more than SMALL_PIXELS pixels, except the kept frames of a sweep, are compressed with
 * PIZ (intake_write.c). Each block of 32 rows has a separate table of codes. Without its head and
 * the overhead of its blocks (LINE_BYTES), a part has
 *     pixels · (surroundings + (lit − surroundings) · share − saved) + blocks · table
 * bytes. The symbols are:
 * - surroundings, lit, table, bit: the members of struct packing.
 * - share: the part of the pixels that show the sample (lamp), or that the laser's line passes
 *   (sweep).
 * - saved = (NOISE_BITS − bits of the camera) · bit, because values with less noise take less
 *   space.
 *
 * The constants are a least-squares fit over captures of five simulated materials (woven, brick,
 * brushed, peanuts, ridges) at 384² to 1280² pixels. docs/lab/speed.md has the errors, including
 * those of captures that were left out of the fit. */
#define SMALL_PIXELS (256 * 256)
#define BLOCK_ROWS   32
#define NOISE_BITS   12 /* bits of the cameras of those captures */

struct packing {              /* disk space of a compressed part */
    double surroundings, lit; /* bytes per pixel */
    double table;             /* bytes of the table of codes of a block */
    double bit; /* bytes per pixel that are saved for each bit of the camera below NOISE_BITS */
};
static const struct packing packed_lamp = {0.81, 1.59, 5000, 0.115},
                            packed_sweep = {0.60, 10.14, 2430, 0},
                            packed_dark = {0.87, 0.87, 2540, 0.22},
                            packed_raw = {0.96, 0.96, 4900, 0.115};
/* Bytes by which a dark pixel of a lamp's frame grows for each doubling of the number of dark
 * frames, because the subtracted dark level becomes finer. With more than MAX_DIGITS dark frames, a
 * half float cannot store a finer level. */
#define DARK_DIGITS 0.13
#define DARK_FRAMES 4 /* number of dark frames in those captures */
#define MAX_DIGITS  8
/* If no pixel shows the line of a sweep, the file contains only zeros. */
static const struct packing packed_nothing = {0, 0, 100, 0};
/* The mean of one or two dark frames has no digits in the lower half of a float. */
static const struct packing packed_short_dark = {0.49, 0.49, 1500, 0.11};

struct kind {
    int parts, channels, value_bytes;
    int head_bytes;                /* bytes of the attributes of a part */
    const struct packing *packing; /* NULL if never compressed */
};

/* Pixels that look above the horizon show no point of the reference plane. */
struct plan_footprint plan_footprint(const struct session_conf *conf,
                                     const struct rig_camera *camera) {
    const struct vec3 eye = rig_camera_centre_mm(camera);
    struct plan_footprint ret = {.n = 0};
    for (int i = 0; i < PLAN_FOOTPRINT * PLAN_FOOTPRINT; i++) {
        const int column = i % PLAN_FOOTPRINT, row = i / PLAN_FOOTPRINT;
        const double x_px = (column + 0.5) / PLAN_FOOTPRINT * camera->width - 0.5;
        const double y_px = (row + 0.5) / PLAN_FOOTPRINT * camera->height - 0.5;
        const struct vec3 ray = rig_pixel_ray(camera, x_px, y_px);
        const double along = (conf->grid.reference_mm - eye.z) / ray.z;
        if (along > 0)
            ret.points_mm[ret.n++] = vec3_add(eye, vec3_scale(ray, along));
    }
    return ret;
}

/* Returns the share of a camera's pixels that are lit. Under a lamp, these are the pixels that show
 * the sample with its margin. For a sweep, only pixels that the line passes are counted. If the
 * session has no flat face around the sample, they must also show the sample with its margin. */
static double lit_share(const struct session_conf *conf, const struct rig *rig,
                        const struct session_shot *shot, const struct plan_footprint *footprint) {
    const double x_mm = conf->grid.width_mm / 2 + conf->sweep_margin_mm;
    const double y_mm = conf->grid.height_mm / 2 + conf->sweep_margin_mm;
    const gboolean sweep = shot->kind == SHOT_SWEEP;
    struct rig_plane sheets[2] = {0};
    int n = 0;
    for (int i = 0; sweep && i < 2; i++)
        sheets[i] = rig_laser_sheet(&rig->arc, &rig->lasers[shot->device], RAD(shot->arc_deg),
                                    RAD(i == 0 ? shot->sweep_from_deg : shot->sweep_to_deg));
    for (int i = 0; i < footprint->n; i++) {
        const struct vec3 p = footprint->points_mm[i];
        const struct vec3 q = rig_turn(p, -RAD(shot->turntable_deg));
        const gboolean inside = fabs(q.x) <= x_mm && fabs(q.y) <= y_mm;
        const gboolean around = sweep && conf->reference.radius_mm > 0;
        const gboolean passed =
            !sweep || (vec3_dot(sheets[0].normal, p) - sheets[0].offset_mm) *
                              (vec3_dot(sheets[1].normal, p) - sheets[1].offset_mm) <=
                          0;
        n += (inside || around) && passed;
    }
    return (double)n / (PLAN_FOOTPRINT * PLAN_FOOTPRINT);
}

guint64 plan_stored_bytes(guint64 file_bytes) {
    return FRAME_BYTES + (file_bytes + BLOCK_BYTES - 1) / BLOCK_BYTES * BLOCK_BYTES;
}

guint64 plan_database_bytes(int n_shots) {
    return EMPTY_BYTES + (guint64)n_shots * SHOT_BYTES;
}

static guint64 file_bytes(const struct rig_camera *camera, int bits, double share,
                          const struct kind *kind) {
    const struct packing *packing = plan_bytes_vary(camera) ? kind->packing : NULL;
    const guint64 pixels = (guint64)camera->width * (guint64)camera->height;
    const int line_bytes = kind->parts > 1 ? PART_LINE_BYTES : LINE_BYTES;
    const int blocks = packing ? (camera->height + BLOCK_ROWS - 1) / BLOCK_ROWS : camera->height;
    double part = kind->head_bytes + (double)blocks * line_bytes;
    if (packing) {
        const double fewer = (NOISE_BITS - bits) * packing->bit;
        const double value =
            packing->surroundings + (packing->lit - packing->surroundings) * share - fewer;
        part += (double)pixels * MAX(value, 0) + blocks * packing->table;
    } else {
        part += (double)pixels * kind->channels * kind->value_bytes;
    }
    const guint64 bytes = (guint64)(kind->parts * part);
    return (bytes + BLOCK_BYTES - 1) / BLOCK_BYTES * BLOCK_BYTES;
}

/* Returns the bytes of one camera's part of a shot. seen is TRUE if the camera sees the laser's
 * line wherever it passes the sample, and FALSE if it sees no line; footprint may then be NULL. */
static guint64 shot_bytes(const struct session_conf *conf, const struct rig *rig,
                          const struct session_shot *shot, int camera, int bits,
                          const struct plan_footprint *footprint, gboolean seen) {
    gint64 exposures[SHOT_MAX_DARKS];
    const struct rig_camera *by = &rig->cameras[camera];
    const gboolean sweep = shot->kind == SHOT_SWEEP;
    struct packing lamp = packed_lamp;
    lamp.surroundings +=
        DARK_DIGITS * log2((double)MIN(conf->dark_frames, MAX_DIGITS) / DARK_FRAMES);
    const int darks = shot->kind == SHOT_DARK ? shot_dark_exposures(conf, exposures) : 1;
    const struct kind kinds[] = {
        [SHOT_LAMP] = {1, 1, 2, 700, &lamp},
        [SHOT_SWEEP] = {1, 5, 4, 850, seen ? &packed_sweep : &packed_nothing},
        [SHOT_DARK] = {darks, 1, 4, 650, conf->dark_frames > 2 ? &packed_dark : &packed_short_dark},
    };
    const struct kind raw = {1, 1, bits <= HALF_BITS ? 2 : 4, 750, sweep ? NULL : &packed_raw};
    const gboolean keeps = sweep ? conf->keep_laser_frames : conf->keep_exposures;
    const guint64 n_raw = keeps ? (guint64)shot_n_frames(conf, shot) : 0;
    const double share = shot->kind == SHOT_DARK || !seen || !plan_bytes_vary(by)
                             ? 0
                             : lit_share(conf, rig, shot, footprint);
    return FRAME_BYTES + file_bytes(by, bits, share, &kinds[shot->kind]) +
           n_raw * file_bytes(by, bits, share, &raw);
}

guint64 plan_shot_bytes(const struct session_conf *conf, const struct rig *rig,
                        const struct session_shot *shot, int camera, int bits,
                        const struct plan_footprint *footprint) {
    return shot_bytes(conf, rig, shot, camera, bits, footprint, TRUE);
}

gboolean plan_bytes_vary(const struct rig_camera *camera) {
    return (guint64)camera->width * (guint64)camera->height > SMALL_PIXELS;
}

guint64 plan_bytes(const struct plan_build *b, guint n_first, guint64 *ret_least) {
    guint64 bytes = plan_database_bytes((int)b->shots->len) +
                    DIRECTION_BYTES * (b->views->len + b->lights->len + b->lasers->len);
    g_autofree struct plan_footprint *footprints = g_new(struct plan_footprint, b->rig->n_cameras);
    for (int c = 0; c < b->rig->n_cameras; c++)
        footprints[c] = plan_footprint(b->conf, &b->rig->cameras[c]);
    *ret_least = bytes;
    for (guint i = 0; i < b->shots->len; i++) {
        const struct session_shot *shot = &g_array_index(b->shots, struct session_shot, i);
        for (int c = 0; c < b->rig->n_cameras; c++) {
            if (shot->state != SHOT_PLANNED || !camera_set_has(shot->cameras, c))
                continue;
            const int bits = b->timing->bits[c];
            const guint64 most = plan_shot_bytes(b->conf, b->rig, shot, c, bits, &footprints[c]);
            bytes += most;
            if (i < n_first)
                *ret_least += shot->kind == SHOT_SWEEP
                                  ? shot_bytes(b->conf, b->rig, shot, c, bits, NULL, FALSE)
                                  : most;
        }
    }
    return bytes;
}
