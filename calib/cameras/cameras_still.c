/* Sets the frame of a rig without a turntable. A flat board defines the level, and the rig file
 * defines the rest. */
#include "cameras_private.h"

#include <string.h>

/* largest tilt of a flat board, as seen by the nominal cameras */
#define MAX_TILT_RAD (5 * (G_PI / 180))

gboolean cameras_level(struct cameras_work *work, GError **error) {
    struct bundle_lay *flat = &work->bundle.lays[0];
    for (int l = 1; l < work->bundle.n_lays; l++)
        if (cameras_tilt_rad(&work->bundle.lays[l]) < cameras_tilt_rad(flat))
            flat = &work->bundle.lays[l];
    if (cameras_tilt_rad(flat) > MAX_TILT_RAD)
        return cameras_refuse(
            error, CAMERAS_ERROR_PICTURES,
            "no board lies flat: by the cameras of the rig file, the flattest board is tilted by "
            "%.1f°. Without a turntable, a flat board shows what is level: also capture the board "
            "lying where samples lie, and give that session",
            cameras_tilt_rad(flat) * 180 / G_PI);
    /* azimuth of the board's x axis */
    const double azimuth = atan2(flat->rotation[3], flat->rotation[0]);
    const double level[9] = {
        cos(azimuth), -sin(azimuth), 0, sin(azimuth), cos(azimuth), 0, 0, 0, 1};
    memcpy(flat->rotation, level, sizeof level);
    flat->place[2] = work->task->board.thickness_mm;
    flat->fixed = TRUE;
    return TRUE;
}

/* Returns the point where the viewing ray of a pixel meets the plane z = 0. */
static struct vec3 on_plane(const struct rig_camera *camera, double x_px, double y_px) {
    const struct vec3 eye = rig_camera_centre_mm(camera), ray = rig_pixel_ray(camera, x_px, y_px);
    return vec3_add(eye, vec3_scale(ray, -eye.z / ray.z));
}

/* Returns the angle a of the rotation about z, and gives the shift d, that bring points p_i of the
 * plane nearest to q_i. They minimise Σ |Rz(a) p_i + d − q_i|², so a = atan2(Σ p_i × q_i, Σ p_i ·
 * q_i) with the means of p_i and q_i subtracted. Returns 0 without a shift if there are no points.
 *
 * For each camera, the q_i are four points around the origin. The p_i are the points that the
 * calibrated camera sees in the pixels in which the nominal camera sees q_i. These points are well
 * determined, unlike the cameras' own positions. */
static double fit_plane(const struct cameras_work *work, struct vec3 *ret_off) {
    const struct board *board = &work->task->board;
    const double r = board->columns * board->square_mm / 2;
    const struct vec3 around[4] = {{r, 0, 0}, {0, r, 0}, {-r, 0, 0}, {0, -r, 0}};
    struct vec3 p_sum = {0, 0, 0}, q_sum = {0, 0, 0};
    double across = 0, along = 0;
    int n = 0;
    for (int c = 0; c < work->bundle.n_cameras; c++)
        for (int i = 0; i < 4; i++) {
            const struct rig_camera *nominal = &work->nominal.cameras[c];
            struct rig_camera camera = *nominal;
            double x, y;
            cameras_take_camera(&camera, &work->bundle.cameras[c]);
            if (work->bundle.cameras[c].fixed_pose || !rig_project(nominal, around[i], &x, &y))
                continue;
            const struct vec3 p = on_plane(&camera, x, y), q = around[i];
            p_sum = vec3_add(p_sum, p);
            q_sum = vec3_add(q_sum, q);
            across += p.x * q.y - p.y * q.x;
            along += p.x * q.x + p.y * q.y;
            n++;
        }
    if (n == 0)
        return 0;
    across -= (p_sum.x * q_sum.y - p_sum.y * q_sum.x) / n;
    along -= (p_sum.x * q_sum.x + p_sum.y * q_sum.y) / n;
    const double angle = atan2(across, along);
    *ret_off = vec3_scale(vec3_sub(q_sum, rig_turn(p_sum, angle)), 1.0 / n);
    return angle;
}

/* Moves the rig by p' = Rz(a) p + d, with a and d from fit_plane(). The cameras' poses become R' =
 * R Rz(−a), t' = t − R' d. */
void cameras_align(struct cameras_work *work) {
    struct bundle *b = &work->bundle;
    struct vec3 off = vec3(0, 0, 0);
    const double angle = fit_plane(work, &off);
    for (int c = 0; c < b->n_cameras; c++) {
        struct bundle_camera *camera = &b->cameras[c];
        if (camera->fixed_pose)
            continue;
        for (int i = 0; i < 3; i++) {
            double *row = camera->rotation + 3 * i;
            const struct vec3 turned = rig_turn(vec3(row[0], row[1], row[2]), angle);
            row[0] = turned.x;
            row[1] = turned.y;
            camera->shift[i] -= turned.x * off.x + turned.y * off.y;
        }
    }
    for (int l = 0; l < b->n_lays; l++) {
        struct bundle_lay *lay = &b->lays[l];
        const struct vec3 at = rig_turn(vec3(lay->place[0], lay->place[1], 0), angle);
        const struct vec3 normal =
            rig_turn(vec3(lay->rotation[2], lay->rotation[5], lay->rotation[8]), angle);
        for (int k = 0; k < 3; k++) {
            const struct vec3 column =
                rig_turn(vec3(lay->rotation[k], lay->rotation[3 + k], lay->rotation[6 + k]), angle);
            lay->rotation[k] = column.x;
            lay->rotation[3 + k] = column.y;
        }
        lay->place[0] = at.x + off.x;
        lay->place[1] = at.y + off.y;
        /* h is the height at which the print's plane meets the z axis. The shift changes h, because
         * the z axis is then another line. */
        lay->place[2] += (normal.x * off.x + normal.y * off.y) / normal.z;
    }
}
