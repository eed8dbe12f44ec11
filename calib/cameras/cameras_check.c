/* This file has the checks between the steps of a calibration. If the set of pictures is
 * degenerate, the board is wrong or a camera has moved, a check fails with an error that names the
 * cause. Without the check, the result would be wrong. */
#include "cameras_private.h"

#include <string.h>

#define DEG(rad)     ((rad) * (180 / G_PI))
#define MIN_STOPS    3
#define MIN_TURN_DEG 60
#define FLAT_DEG     2
#define MIN_TILT_DEG 5
#define MIN_PICTURES 3
/* largest relative deviation of the cameras' mean distance from the rig file */
#define MAX_SCALE    0.04
#define MAX_RMS_PX   1.0
#define MAX_DISTANCE 0.02 /* largest relative standard error of a camera's distance */

double cameras_tilt_rad(const struct bundle_lay *lay) {
    return acos(CLAMP(fabs(lay->rotation[8]), 0, 1));
}

gboolean cameras_check_motion(const struct cameras_work *work, GError **error) {
    double range_deg = 0; /* largest range of the commanded angles of a lay */
    int stops = 0;
    if (work->task->no_turntable)
        return TRUE;
    for (int l = 0; l < work->bundle.n_lays; l++) {
        double least = G_MAXDOUBLE, most = -G_MAXDOUBLE;
        int n = 0;
        for (int i = 0; i < work->bundle.n_stops; i++) {
            const struct bundle_stop *stop = &work->bundle.stops[i];
            if (stop->lay != l)
                continue;
            least = MIN(least, DEG(stop->commanded_rad));
            most = MAX(most, DEG(stop->commanded_rad));
            n++;
        }
        range_deg = MAX(range_deg, most - least);
        stops = MAX(stops, n);
    }
    if (stops >= MIN_STOPS && range_deg >= MIN_TURN_DEG)
        return TRUE;
    return cameras_refuse(
        error, CAMERAS_ERROR_PICTURES,
        "the turntable's axis cannot be found from %d angle(s) over %g°: turn the "
        "board to at least %d angles over %d° or more",
        stops, work->bundle.n_stops ? range_deg : 0.0, MIN_STOPS, MIN_TURN_DEG);
}

static const char *first_reason(const struct cameras_work *work, int camera,
                                gboolean only_set_aside) {
    for (int i = 0; i < work->task->n_pictures; i++) {
        const struct seen *seen = &work->seen[i];
        if (seen->camera == camera && !seen->corners && seen->why &&
            (seen->set_aside || !only_set_aside))
            return seen->why;
    }
    return "the camera has no pictures";
}

static int n_set_aside(const struct cameras_work *work, int camera) {
    int n = 0;
    for (int i = 0; i < work->task->n_pictures; i++)
        n += work->seen[i].camera == camera && work->seen[i].set_aside;
    return n;
}

/* Refuses a lens on which fewer than MIN_PICTURES or less than half of the photographs agree,
 * because their agreement may be an accident. */
static gboolean check_photographs(const struct cameras_work *work, GError **error) {
    const int all = work->task->n_pictures, used = cameras_pictures_of(work, 0);
    const int contradict = n_set_aside(work, 0);
    return (used >= MIN_PICTURES && 2 * used >= all) ||
           cameras_refuse(
               error, CAMERAS_ERROR_PICTURES,
               "only %d of %d photographs agree on one lens, but at least %d must; the board was "
               "not found in %d photographs, and %d contradict the others; for example, %s; take "
               "out photographs of another board, camera, zoom or focus, or give more photographs",
               used, all, MAX(MIN_PICTURES, (all + 1) / 2), all - used - contradict, contradict,
               first_reason(work, 0, FALSE));
}

/* For a rig, only pictures in which the board was found are counted, because a tilted board on the
 * turntable faces away from some cameras. */
gboolean cameras_check_majority(const struct cameras_work *work, GError **error) {
    if (work->free_boards)
        return check_photographs(work, error);
    for (int c = 0; c < work->bundle.n_cameras; c++) {
        const int used = cameras_pictures_of(work, c), contradict = n_set_aside(work, c);
        if (contradict > used)
            return cameras_refuse(
                error, CAMERAS_ERROR_FIT,
                "camera %s: %d of the %d pictures in which it sees the board contradict the other "
                "pictures: the camera or the board has moved between pictures, or the given "
                "sessions do not belong together; for example, %s; capture again, or give only "
                "sessions that belong together",
                work->nominal.cameras[c].name, contradict, used + contradict,
                first_reason(work, c, TRUE));
    }
    return TRUE;
}

/* Refuses pictures that do not show both a tilted and a flat board. The tilted board determines
 * distances, and the flat board determines the top of the turntable. */
static gboolean check_lays(const struct cameras_work *work, GError **error) {
    double least = G_MAXDOUBLE, most = 0;
    for (int l = 0; l < work->bundle.n_lays; l++) {
        least = MIN(least, DEG(cameras_tilt_rad(&work->bundle.lays[l])));
        most = MAX(most, DEG(cameras_tilt_rad(&work->bundle.lays[l])));
    }
    if (most < MIN_TILT_DEG)
        return cameras_refuse(error, CAMERAS_ERROR_PICTURES,
                              "the board is never tilted by more than %.1f°, so the pictures do "
                              "not show how far away the cameras stand: also capture the board "
                              "leaning by 15° to 30°, and give all sessions",
                              most);
    if (least > FLAT_DEG)
        return cameras_refuse(error, CAMERAS_ERROR_PICTURES,
                              "the board never lies flat on the turntable (it is always tilted by "
                              "at least %.1f°), so the pictures do not show where the turntable's "
                              "top is: also capture the board flat, and give both sessions",
                              least);
    return TRUE;
}

gboolean cameras_is_predicted(const struct cameras_work *work, int camera) {
    const struct rig *rig = &work->nominal;
    int others = 0;
    for (int i = 0; i < work->task->n_pictures; i++)
        if (work->seen[i].camera == camera)
            return FALSE;
    for (int c = 0; c < rig->n_cameras; c++)
        others += rig_camera_unit(rig, c) == rig_camera_unit(rig, camera) &&
                  cameras_pictures_of(work, c) >= MIN_PICTURES;
    return others >= 2;
}

gboolean cameras_check_pictures(const struct cameras_work *work, GError **error) {
    for (int c = 0; c < work->bundle.n_cameras; c++) {
        int all = 0;
        const int good = cameras_pictures_of(work, c);
        for (int i = 0; i < work->task->n_pictures; i++)
            all += work->seen[i].camera == c;
        if (all < MIN_PICTURES && good == all && !cameras_is_predicted(work, c))
            return cameras_refuse(error, CAMERAS_ERROR_PICTURES,
                                  "camera %s has %d pictures in the given sessions, but at least "
                                  "%d are needed: also capture the board with this camera in "
                                  "other positions, and give all sessions",
                                  work->nominal.cameras[c].name, all, MIN_PICTURES);
        if (good < MIN_PICTURES && !cameras_is_predicted(work, c))
            return cameras_refuse(error, CAMERAS_ERROR_PICTURES,
                                  "camera %s: only %d of the camera's %d pictures can be used, "
                                  "and at least %d are needed; for example, %s",
                                  work->nominal.cameras[c].name, good, all, MIN_PICTURES,
                                  first_reason(work, c, FALSE));
    }
    return check_lays(work, error);
}

static double centre_distance(const struct bundle_camera *camera) {
    return vec3_length(vec3(camera->shift[0], camera->shift[1], camera->shift[2]));
}

/* If the squares are larger than specified, all distances come out too small by the same factor.
 * The result is refused if the mean ratio of the distances to the nominal ones differs from 1 by at
 * least MAX_SCALE and by three standard deviations of the ratios. */
static gboolean check_scale(const struct cameras_work *work, GError **error) {
    double sum = 0, squares = 0;
    int n = 0;
    for (int c = 0; c < work->bundle.n_cameras; c++)
        n += !work->bundle.cameras[c].fixed_pose;
    for (int c = 0; c < work->bundle.n_cameras; c++) {
        if (work->bundle.cameras[c].fixed_pose)
            continue;
        const double *at = work->bundle.cameras[c].nominal_centre;
        const double ratio =
            centre_distance(&work->bundle.cameras[c]) / vec3_length(vec3(at[0], at[1], at[2]));
        sum += ratio / n;
        squares += ratio * ratio / n;
    }
    const double spread = sqrt(MAX(squares - sum * sum, 0));
    if (n == 0 || fabs(sum - 1) < MAX_SCALE || 3 * spread > fabs(sum - 1))
        return TRUE;
    const struct board *board = &work->task->board;
    return cameras_refuse(
        error, CAMERAS_ERROR_FIT,
        "by these pictures, the cameras stand %.3f times as far away as in the rig file: measure "
        "the board, on which the distance from one %s to the next may be %.4g mm instead of %g mm; "
        "if this distance is right, correct distance_mm of the cameras in the rig file, and "
        "capture or import again",
        sum,
        board->circle_mm > 0            ? "row of circles"
        : board->print == BOARD_MARKERS ? "marker"
                                        : "square",
        board->square_mm / sum, board->square_mm);
}

gboolean cameras_check_start(const struct cameras_work *work, GError **error) {
    return check_lays(work, error) &&
           (work->task->no_turntable || cameras_check_places(work, error)) &&
           check_scale(work, error);
}

/* Refuses a lens if the boards do not differ in tilt, or if the relative standard error of the
 * focal length is large. */
static gboolean check_lens(const struct cameras_work *work, GError **error) {
    const struct bundle_camera *camera = &work->bundle.cameras[0];
    const double focal = sqrt(camera->covariance[0][0]) / camera->intrinsics[0];
    double most = 0;
    for (int a = 0; a < work->bundle.n_lays; a++)
        for (int b = 0; b < a; b++) {
            const double *p = work->bundle.lays[a].rotation, *q = work->bundle.lays[b].rotation;
            const double cosine = p[2] * q[2] + p[5] * q[5] + p[8] * q[8];
            if (work->seen[a].corners && work->seen[b].corners)
                most = MAX(most, DEG(acos(CLAMP(cosine, -1, 1))));
        }
    if (most < MIN_TILT_DEG)
        return cameras_refuse(error, CAMERAS_ERROR_PICTURES,
                              "the tilts of the boards differ by at most %.1f°: hold the board at "
                              "different tilts before the camera, up to 45°",
                              most);
    return focal < MAX_DISTANCE ||
           cameras_refuse(
               error, CAMERAS_ERROR_PICTURES,
               "the photographs determine the focal length only to %.2g %%, and less than %g %% is "
               "needed: take more photographs, with larger tilts of the board",
               100 * focal, 100 * MAX_DISTANCE);
}

static double rms_px(const struct cameras_work *work) {
    double sum = 0, n = 0, px[2];
    for (int i = 0; i < work->bundle.n_observations; i++) {
        const struct bundle_observation *o = &work->bundle.observations[i];
        if (o->rejected ||
            !bundle_project(&work->bundle, o->camera, o->stop, FALSE, o->board_mm, px))
            continue;
        sum += pow(px[0] - o->seen_px[0], 2) + pow(px[1] - o->seen_px[1], 2);
        n++;
    }
    return n > 0 ? sqrt(sum / n) : 0;
}

gboolean cameras_check_result(const struct cameras_work *work, GError **error) {
    if (rms_px(work) > MAX_RMS_PX)
        return cameras_refuse(
            error, CAMERAS_ERROR_FIT,
            "after the fit, the corners are %.2f px (RMS) from their predicted places, and at most "
            "%g px is allowed: the board is bent%s, or it is not the board of --board; correct "
            "--board, or take new pictures of a flat board",
            rms_px(work), MAX_RMS_PX,
            work->free_boards ? "" : ", the board has moved on the turntable, a camera has moved");
    if (work->free_boards)
        return check_lens(work, error);
    for (int c = 0; c < work->bundle.n_cameras; c++) {
        const struct bundle_camera *camera = &work->bundle.cameras[c];
        const double distance = sqrt(camera->covariance[14][14]) / centre_distance(camera);
        if (!(distance < MAX_DISTANCE))
            return cameras_refuse(error, CAMERAS_ERROR_PICTURES,
                                  "camera %s: the pictures determine the camera's distance only to "
                                  "%.2g %%, and less than %g %% is needed: take more pictures, "
                                  "with the board at larger tilts and in all parts of the picture",
                                  work->nominal.cameras[c].name, 100 * distance,
                                  100 * MAX_DISTANCE);
    }
    return check_scale(work, error);
}
