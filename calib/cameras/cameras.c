/* Calibrates cameras from pictures of a board on the turntable, in these steps:
 *   find the boards;
 *   estimate the pose of each lay from single pictures (cameras_start.c); a lay is one position of
 *   the board on the turntable;
 *   make a first bundle adjustment;
 *   search again for all corners where the geometry predicts them;
 *   adjust in rounds with outlier rejection (cameras_refine.c). */
#include "cameras_private.h"

#include "base/work.h"

#include <cblas.h>
#include <gio/gio.h>
#include <string.h>

#define RAD(deg) ((deg) * (G_PI / 180))
/* standard deviation of the turntable's angle from the commanded angle */
#define ANGLE_SIGMA_DEG 0.1
#define NEAR_PX         3 /* search radius in px once the geometry is known */
/* search radius before the geometry is known, as a share of the picture's width */
#define FAR           0.2
#define MIN_CORNERS   6 /* smallest number of corners in a usable picture */
#define MIN_PICTURES  3 /* smallest number of pictures from which a camera is refined */
#define SIZE_PICTURES 8 /* number of pictures that are examined for another size of the board */
/* A board's x axis counts as reversed if its azimuth is within this angle of 180°. */
#define HALF_TURN_DEG 10

G_DEFINE_QUARK(cameras_error, cameras_error)

gboolean cameras_refuse(GError **error, enum cameras_error code, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    g_propagate_error(error, g_error_new_valist(CAMERAS_ERROR, (int)code, format, arguments));
    va_end(arguments);
    return FALSE;
}

void cameras_result_free(struct cameras_result *result) {
    if (!result)
        return;
    g_array_unref(result->residuals);
    g_array_unref(result->stops);
    g_array_unref(result->lays);
    g_free(result);
}

gboolean cameras_board_azimuth(const struct cameras_result *result, const struct board *board,
                               double *ret_deg, GError **error) {
    const struct cameras_lay *flat = &g_array_index(result->lays, struct cameras_lay, 0);
    for (guint i = 1; i < result->lays->len; i++) {
        const struct cameras_lay *lay = &g_array_index(result->lays, struct cameras_lay, i);
        flat = lay->tilt_deg < flat->tilt_deg ? lay : flat;
    }
    *ret_deg = flat->azimuth_deg;
    if (board->print != BOARD_CHESSBOARD || fabs(*ret_deg) < 180 - HALF_TURN_DEG)
        return TRUE;
    g_set_error(
        error, CAMERAS_ERROR, CAMERAS_ERROR_FIT,
        "by the nominal azimuths of the cameras, the board's x axis is at azimuth %.1f°, "
        "but it must be near 0°: if the board's top left square is %s, %s --board; "
        "otherwise, turn the azimuths of the cameras in the rig file by 180°, and capture or "
        "import again",
        *ret_deg, board->white_first ? "black" : "white",
        board->white_first ? "take first=white out of" : "add first=white to");
    return FALSE;
}

gboolean cameras_progress(struct cameras_work *work, GError **error) {
    const struct cameras_task *task = work->task;
    work->step = MIN(work->step + 1, work->steps);
    if (!task->progress || task->progress(work->step, work->steps, task->data))
        return TRUE;
    g_set_error_literal(error, G_IO_ERROR, G_IO_ERROR_CANCELLED, "cancelled");
    return FALSE;
}

static void cameras_work_init(struct cameras_work *work, struct calibration *calibration,
                              const struct cameras_task *task, gboolean free_boards) {
    const int n = task->n_pictures;
    *work = (struct cameras_work){.calibration = calibration,
                                  .task = task,
                                  .nominal = calibration->rig,
                                  .free_boards = free_boards,
                                  .steps = (free_boards ? 2 : 3) * n + CAMERAS_ROUNDS};
    work->seen = g_new0(struct seen, n + 1);
    work->observations = g_array_new(FALSE, TRUE, sizeof(struct bundle_observation));
    work->bundle.cameras = g_new0(struct bundle_camera, RIG_MAX_CAMERAS);
    work->bundle.n_cameras = calibration->rig.n_cameras;
    work->bundle.stops = g_new0(struct bundle_stop, n + 1);
    for (int i = 0; i < n; i++)
        work->bundle.n_lays = MAX(work->bundle.n_lays, task->pictures[i].lay + 1);
    work->bundle.lays = g_new0(struct bundle_lay, work->bundle.n_lays + 1);
    work->bundle.fix_azimuth = !free_boards && !task->no_turntable;
    for (int i = 0; i < n; i++) {
        const struct cameras_picture *picture = &task->pictures[i];
        const double angle_rad = RAD(picture->turntable_deg);
        struct bundle_stop *stops = work->bundle.stops;
        int stop = 0;
        while (stop < work->bundle.n_stops &&
               (stops[stop].lay != picture->lay || stops[stop].commanded_rad != angle_rad))
            stop++;
        if (stop == work->bundle.n_stops)
            stops[work->bundle.n_stops++] =
                (struct bundle_stop){picture->lay, angle_rad, angle_rad,
                                     free_boards || task->no_turntable ? 0 : RAD(ANGLE_SIGMA_DEG)};
        work->seen[i].camera = picture->camera;
        work->seen[i].lay = picture->lay;
        work->seen[i].stop = stop;
    }
}

void cameras_set_why(struct seen *seen, const char *why) {
    g_free(seen->why);
    seen->why = g_strdup_printf("%s: %s", seen->name, why);
}

/* Finds the board in picture i without prior knowledge. If the board is not found, seen->why
 * gets the reason. Returns FALSE if the picture cannot be read, if a picture of a rig has
 * another size than its camera, or if enough pictures show a board of another size. */
static gboolean find_board(struct cameras_work *work, int i, double reach_px, GError **error) {
    struct seen *seen = &work->seen[i];
    g_autoptr(GError) why = NULL;
    g_autoptr(Picture) picture = work->task->read(i, work->task->data, error);
    const struct rig_camera *c = &work->nominal.cameras[seen->camera];
    if (!picture)
        return FALSE;
    /* On a rig, a picture of another size was taken by another camera or was scaled. That is an
     * error, not an outlier. */
    if (!work->free_boards && (picture->width != c->width || picture->height != c->height))
        return cameras_refuse(error, CAMERAS_ERROR_PICTURES,
                              "%s has %d × %d pixels, but camera %s has %d × %d: use pictures of "
                              "this camera that are neither cropped nor scaled",
                              picture->name, picture->width, picture->height, c->name, c->width,
                              c->height);
    seen->name = g_strdup(picture->name);
    seen->checksum = g_strdup(picture->checksum);
    seen->width = picture->width;
    seen->height = picture->height;
    seen->coloured = *picture->cfa != '\0';
    seen->corners = board_find(picture, &work->task->board, work->free_boards, &why);
    if (!seen->corners)
        cameras_set_why(seen, why->message);
    return board_census_after(work->census, picture, seen->corners, error);
}

/* If the pictures are large, first examines at most SIZE_PICTURES of them, at equal distances in
 * the list, for a board of another size. */
static gboolean check_size(struct cameras_work *work, GError **error) {
    const int n = work->task->n_pictures, most = MIN(n, SIZE_PICTURES);
    gboolean more = TRUE;
    for (int k = 0; k < most && more; k++) {
        g_autoptr(Picture) picture = work->task->read(k * n / most, work->task->data, error);
        if (!picture || !board_census_before(work->census, picture, &more, error))
            return FALSE;
    }
    return TRUE;
}

gboolean cameras_project(const double xy_mm[2], gboolean straight, double ret_xy_px[2],
                         gconstpointer data) {
    const struct cameras_look *at = data;
    return bundle_project(at->bundle, at->camera, at->stop, straight, xy_mm, ret_xy_px);
}

/* Searches picture i for all corners where the geometry predicts them, including corners that
 * the detector has not found. If too few corners are found, the picture is no longer used.
 * Returns FALSE only if the picture cannot be read. */
static gboolean search_near(struct cameras_work *work, int i, double reach_px, GError **error) {
    struct seen *seen = &work->seen[i];
    struct cameras_look at = {&work->bundle, seen->camera, seen->stop};
    g_autoptr(Picture) picture = work->task->read(i, work->task->data, error);
    double fit;
    if (!picture)
        return FALSE;
    GArray *corners =
        board_find_near(picture, &work->task->board, cameras_project, &at, reach_px, &fit);
    if (corners && corners->len >= MIN_CORNERS) {
        g_clear_pointer(&seen->corners, g_array_unref);
        seen->corners = corners;
        return TRUE;
    }
    if (!seen->why)
        cameras_set_why(seen, corners ? "fewer than " G_STRINGIFY(
                                            MIN_CORNERS) " corners of the board are clear enough"
                                      : "at the place where the geometry predicts the board, the "
                                        "picture does not look like the board");
    g_clear_pointer(&corners, g_array_unref);
    g_clear_pointer(&seen->corners, g_array_unref);
    return TRUE;
}

struct each {
    struct cameras_work *work;
    CamerasPass run;
    const double *reach_px; /* search radius of each picture; if NULL, it is 0 for all pictures */
    GAsyncQueue *done;      /* queue of GError *, or of the work itself for success */
};

static void cameras_run_picture(gpointer item, gpointer data) {
    const struct each *each = data;
    const int i = GPOINTER_TO_INT(item) - 1;
    GError *error = NULL;
    const gboolean ok = each->run(each->work, i, each->reach_px ? each->reach_px[i] : 0, &error);
    g_async_queue_push(each->done, ok ? (gpointer)each->work : error);
}

/* If an error occurs, pictures that have not begun are skipped. */
gboolean cameras_for_each(struct cameras_work *work, CamerasPass run, const double *reach_px,
                          GError **error) {
    g_autoptr(GAsyncQueue) done = g_async_queue_new();
    struct each each = {work, run, reach_px, done};
    GThreadPool *pool =
        g_thread_pool_new(cameras_run_picture, &each, (int)g_get_num_processors(), FALSE, NULL);
    GError *first = NULL;
    int left = 0;
    for (int i = 0; i < work->task->n_pictures; i++)
        if (!reach_px || reach_px[i] >= 0) {
            g_thread_pool_push(pool, GINT_TO_POINTER(i + 1), NULL);
            left++;
        }
    for (; left > 0 && !first; left--) {
        gpointer end = g_async_queue_pop(done);
        if (end != (gpointer)work)
            first = end;
        else
            cameras_progress(work, &first);
    }
    g_thread_pool_free(pool, first != NULL, TRUE);
    for (gpointer rest; (rest = g_async_queue_try_pop(done));)
        if (rest != (gpointer)work)
            g_error_free(rest);
    if (first)
        g_propagate_error(error, first);
    return first == NULL;
}

int cameras_pictures_of(const struct cameras_work *work, int camera) {
    int n = 0;
    for (int i = 0; i < work->task->n_pictures; i++)
        n += work->seen[i].camera == camera && work->seen[i].corners;
    return n;
}

/* Fixes pose and lens of cameras that have too few pictures so far, at their values in the rig
 * file. */
static void fix_unknown(struct cameras_work *work) {
    struct bundle_camera *cameras = work->bundle.cameras;
    for (int c = 0; c < work->bundle.n_cameras; c++) {
        const gboolean unknown = cameras_pictures_of(work, c) < MIN_PICTURES;
        if (!work->free_boards)
            cameras[c].fixed_pose = unknown;
        cameras[c].fixed_lens = unknown;
        if (!unknown) /* the lens of all stops is adjusted if one stop has enough pictures */
            cameras[c - cameras[c].stop].fixed_lens = FALSE;
    }
}

gboolean cameras_solve(struct cameras_work *work, GError **error) {
    fix_unknown(work);
    cameras_set_observations(work);
    work->bundle.robust = 3;
    return bundle_solve(&work->bundle, error);
}

/* Searches in two passes. The first pass searches every picture of cameras with fewer than
 * MIN_PICTURES usable pictures, within a large radius. Of the other cameras, the first pass
 * searches only pictures without corners, within a small radius. The second pass searches all
 * pictures with the improved geometry. A bundle adjustment follows each pass. */
static gboolean search_everywhere(struct cameras_work *work, GError **error) {
    gboolean unknown[RIG_MAX_CAMERAS];
    for (int c = 0; c < work->bundle.n_cameras; c++)
        unknown[c] = cameras_pictures_of(work, c) < MIN_PICTURES;
    g_autofree double *reach_px = g_new(double, work->task->n_pictures);
    for (int pass = 0; pass < 2; pass++) {
        for (int i = 0; i < work->task->n_pictures; i++) {
            const int camera = work->seen[i].camera;
            const gboolean far = pass == 0 && unknown[camera];
            const gboolean wanted = pass == 1 || far || !work->seen[i].corners;
            reach_px[i] = far ? FAR * work->nominal.cameras[camera].width : wanted ? NEAR_PX : -1;
        }
        if (!cameras_for_each(work, search_near, reach_px, error) || !cameras_solve(work, error))
            return FALSE;
    }
    return TRUE;
}

/* Returns a result without the wobble and the camera arm. The caller sets these members. */
static struct cameras_result *cameras_new_result(const struct cameras_work *work) {
    struct cameras_result *to = g_new0(struct cameras_result, 1);
    to->residuals = g_array_new(FALSE, FALSE, sizeof(struct cameras_residual));
    to->stops = g_array_new(FALSE, FALSE, sizeof(struct cameras_stop));
    to->lays = g_array_new(FALSE, FALSE, sizeof(struct cameras_lay));
    const struct bundle *b = &work->bundle;
    double sum = 0, d[2] = {0, 0};
    int n = 0;
    for (int i = 0; i < b->n_observations; i++) {
        const struct bundle_observation *o = &b->observations[i];
        if (o->rejected)
            continue;
        cameras_residual(b, o, d);
        const struct cameras_residual r = {
            o->camera,   o->picture, o->corner, (float)o->seen_px[0], (float)o->seen_px[1],
            (float)d[0], (float)d[1]};
        g_array_append_val(to->residuals, r);
        sum += d[0] * d[0] + d[1] * d[1];
        n++;
    }
    to->rms_px = n ? sqrt(sum / n) : 0;
    memcpy(to->held_out_px, work->held_out_px, sizeof to->held_out_px);
    memcpy(to->inflation, work->inflation, sizeof to->inflation);
    to->expected_px = cameras_expected_px(work, -1);
    for (int id = 0; id < board_n_corners(&work->task->board); id++) {
        double mm[2];
        board_corner_mm(&work->task->board, id, mm);
        const double z =
            b->bend[0] * mm[0] * mm[0] + b->bend[1] * mm[0] * mm[1] + b->bend[2] * mm[1] * mm[1];
        to->bend_mm[0] = MIN(to->bend_mm[0], z);
        to->bend_mm[1] = MAX(to->bend_mm[1], z);
    }
    for (int i = 0; i < work->bundle.n_stops; i++) {
        const struct bundle_stop *stop = &work->bundle.stops[i];
        const struct cameras_stop s = {stop->lay, stop->commanded_rad * 180 / G_PI,
                                       (stop->angle_rad - stop->commanded_rad) * 180 / G_PI};
        g_array_append_val(to->stops, s);
    }
    for (int l = 0; l < work->bundle.n_lays; l++) {
        const double *r = work->bundle.lays[l].rotation; /* its first column is the board's x */
        struct cameras_lay lay = {.tilt_deg = cameras_tilt_rad(&work->bundle.lays[l]) * 180 / G_PI,
                                  .azimuth_deg = atan2(r[3], r[0]) * 180 / G_PI};
        for (int i = 0; i < work->task->n_pictures; i++)
            lay.pictures += work->seen[i].lay == l && work->seen[i].corners;
        g_array_append_val(to->lays, lay);
    }
    return to;
}

void cameras_take_camera(struct rig_camera *to, const struct bundle_camera *from) {
    double *const members[BUNDLE_INTRINSICS] = {&to->fx_px, &to->fy_px, &to->cx_px, &to->cy_px,
                                                &to->k1,    &to->k2,    &to->k3,    &to->p1,
                                                &to->p2,    &to->k4,    &to->k5,    &to->k6};
    to->lens = (int)from->lens;
    for (int i = 0; i < BUNDLE_INTRINSICS; i++)
        *members[i] = from->intrinsics[i];
    memcpy(to->rotation.m, from->rotation, sizeof from->rotation);
    to->translation_mm = vec3(from->shift[0], from->shift[1], from->shift[2]);
}

/* Stores the results in the calibration, and also returns them. arm is NULL if the rig has no
 * camera arm, or if the arm's axis is not determined. */
static struct cameras_result *cameras_store_result(struct cameras_work *work,
                                                   const struct rig_swing_fit *arm) {
    struct calibration *calibration = work->calibration;
    struct cameras_result *result = cameras_new_result(work);
    GPtrArray *rejected = g_ptr_array_new_with_free_func(g_free);
    g_autofree char *spec = board_spec(&work->task->board);
    g_autofree char *method =
        g_strdup_printf("board %s, %d %s", spec, work->bundle.n_lays,
                        work->free_boards          ? "photographs"
                        : work->task->no_turntable ? "positions, no turntable"
                                                   : "positions on the turntable");
    g_autoptr(GPtrArray) sums = g_ptr_array_new();
    for (int i = 0; i < work->task->n_pictures; i++)
        if (work->seen[i].corners)
            g_ptr_array_add(sums, work->seen[i].checksum);
        else
            g_ptr_array_add(rejected, g_strdup(work->seen[i].why));
    const int used = (int)sums->len;
    g_autofree char *sum = calibration_checksum((const char *const *)sums->pdata, used);
    struct calibration_part *part =
        calibration_set_part(calibration, CALIBRATION_CAMERAS, method, used, sum, rejected);
    part->residual_rms = result->rms_px;
    part->residual_expected = result->expected_px;
    bundle_wobble(work->bundle.wobble, &calibration->rig.wobble);
    result->wobble_rad = rig_wobble_most_rad(&calibration->rig.wobble);
    result->wobble_error_rad = work->bundle.wobble_error_rad;
    calibration->turntable = (struct calibration_turntable){.known = result->wobble_rad > 0,
                                                            .wobble_rad = result->wobble_error_rad};
    part->degrees_of_freedom = MAX(2 * (int)result->residuals->len - cameras_n_parameters(work), 0);
    for (int c = 0; c < work->bundle.n_cameras; c++) {
        const struct bundle_camera *from = &work->bundle.cameras[c];
        struct calibration_camera *to = &calibration->cameras[c];
        cameras_take_camera(&calibration->rig.cameras[c], from);
        calibration->rig.cameras[c].width = work->nominal.cameras[c].width;
        calibration->rig.cameras[c].height = work->nominal.cameras[c].height;
        for (int i = 0; i < BUNDLE_CAMERA; i++)
            for (int k = 0; k < BUNDLE_CAMERA; k++)
                if (i >= CALIBRATION_K4)
                    to->further_covariance[i - CALIBRATION_K4][k] = from->covariance[i][k];
                else if (k < CALIBRATION_K4)
                    to->covariance[i][k] = from->covariance[i][k];
        /* Counts the camera's points, and computes the RMS of their residuals. */
        const struct bundle *b = &work->bundle;
        double squares = 0;
        to->points = 0;
        for (int i = 0; i < b->n_observations; i++) {
            const struct bundle_observation *o = &b->observations[i];
            double d[2] = {0, 0};
            if (o->rejected || o->camera != c)
                continue;
            cameras_residual(b, o, d);
            squares += d[0] * d[0] + d[1] * d[1];
            to->points++;
        }
        to->residual_rms_px = to->points ? sqrt(squares / to->points) : 0;
        to->expected_px = cameras_expected_px(work, c);
        memcpy(calibration->rig.cameras[c].lateral_colour, work->lateral_colour[c],
               sizeof work->lateral_colour[c]);
        memcpy(to->lateral_colour, work->lateral_error[c], sizeof to->lateral_colour);
        to->known = TRUE;
    }
    result->arm_known = arm != NULL;
    if (arm) {
        result->arm = *arm;
        cameras_place_stops(work, calibration, result);
    }
    return result;
}

/* Places the boards by means of the nominal cameras, and makes the first adjustment of all
 * parameters. */
static gboolean cameras_begin(struct cameras_work *work, GError **error) {
    return cameras_check_motion(work, error) && cameras_start_lays(work, error) &&
           (!work->task->no_turntable || cameras_level(work, error)) && cameras_solve(work, error);
}

/* The height of the boards is not determined yet. Moves everything along the turntable's axis so
 * that the flattest board lies on the turntable's top, as the nominal positions assume. */
static void set_top(struct cameras_work *work) {
    struct bundle *b = &work->bundle;
    const struct bundle_lay *flat = &b->lays[0];
    for (int l = 1; l < b->n_lays; l++)
        if (cameras_tilt_rad(&b->lays[l]) < cameras_tilt_rad(flat))
            flat = &b->lays[l];
    const double up_mm = work->task->board.thickness_mm - flat->place[2];
    for (int l = 0; l < b->n_lays; l++)
        b->lays[l].place[2] += up_mm;
    for (int c = 0; c < b->n_cameras; c++)
        for (int i = 0; i < 3 && !b->cameras[c].fixed_pose; i++)
            b->cameras[c].shift[i] -= b->cameras[c].rotation[3 * i + 2] * up_mm;
}

/* Begins as cameras_begin() does. If the boards do not fit, looks for a mistake in the notes on the
 * pictures. Then, on a rig with a turntable, calls set_top(). Returns FALSE with an error if a
 * mistake was found, if the adjustment failed, or if cameras_check_start() refuses the result of
 * the adjustment. */
static gboolean begin_or_find_mistake(struct cameras_work *work, GError **error) {
    g_autoptr(GError) why = NULL;
    cameras_start(work);
    const gboolean begun = cameras_begin(work, &why);
    if (cameras_find_mistake(work, begun, error))
        return FALSE;
    if (!begun)
        g_propagate_error(error, g_steal_pointer(&why));
    if (begun && !work->task->no_turntable)
        set_top(work);
    return begun && cameras_check_start(work, error);
}

/* Replaces the error of an adjustment if the boards did not fit the rig file from the beginning. In
 * that case the error of the adjustment does not name the cause. */
static void tell_unexplained(const struct cameras_work *work, GError **error) {
    if (!error || !*error || !(work->unexplained_px > 0) ||
        ((*error)->domain != BUNDLE_ERROR && (*error)->domain != CAMERAS_ERROR))
        return;
    g_clear_error(error);
    cameras_refuse(error, CAMERAS_ERROR_FIT,
                   "the boards do not fit the rig file: half of all corners are more than %.3g px "
                   "from the places that the rig file predicts, and %s. Check theta_deg, "
                   "phi_deg and distance_mm of each camera, %sand whether every session is of one "
                   "position of the board. After a correction, capture or import again",
                   work->unexplained_px,
                   work->task->no_turntable ? "exchanged cameras do not explain this"
                                            : "neither a reversed turntable, nor angles in "
                                              "radians, nor exchanged cameras explain this",
                   work->task->no_turntable ? "" : "the angles of the turntable, ");
}

/* If free_boards is TRUE, only a lens is calibrated. The camera frame is then the rig frame, and
 * every photograph is a separate lay. */
static struct cameras_result *cameras_run(struct calibration *calibration,
                                          const struct cameras_task *task, gboolean free_boards,
                                          GError **error) {
    struct cameras_work work;
    struct cameras_result *result = NULL;
    struct rig_swing_fit arm;
    gboolean arm_known = FALSE;
    const int blas_threads = openblas_get_num_threads();
    if (!free_boards && !board_check_upright(&task->board, error))
        return NULL;
    /* OpenCV and this folder solve thousands of small systems. Several BLAS threads would mostly
     * wait for each other. */
    work_use_one_blas_thread();
    cameras_work_init(&work, calibration, task, free_boards);
    work.census = board_census_new(&task->board);
    gboolean ok = check_size(&work, error) && cameras_for_each(&work, find_board, NULL, error);
    board_census_free(work.census);
    if (free_boards) {
        struct rig_camera *camera = &work.nominal.cameras[0];
        camera->rotation = (struct mat3){{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
        camera->translation_mm = vec3(0, 0, 0);
        ok = ok && cameras_start_lens(&work, error) && cameras_start_lays(&work, error) &&
             cameras_choose_lens(&work, error);
    } else {
        ok = ok && begin_or_find_mistake(&work, error) && search_everywhere(&work, error) &&
             cameras_check_pictures(&work, error);
    }
    if (ok)
        fix_unknown(&work);
    ok = ok && cameras_refine(&work, error) && cameras_check_majority(&work, error) &&
         (free_boards || cameras_check_pictures(&work, error)) &&
         cameras_check_result(&work, error);
    if (ok && task->no_turntable)
        cameras_align(&work);
    ok = ok && (free_boards || cameras_check_places(&work, error));
    if (!ok)
        tell_unexplained(&work, error);
    ok =
        ok && cameras_find_lateral(&work, error) && cameras_fit_arm(&work, &arm_known, &arm, error);
    if (ok)
        result = cameras_store_result(&work, arm_known ? &arm : NULL);
    for (int i = 0; i < work.task->n_pictures; i++) {
        g_free(work.seen[i].name);
        g_free(work.seen[i].checksum);
        g_free(work.seen[i].why);
        g_clear_pointer(&work.seen[i].corners, g_array_unref);
        g_clear_pointer(&work.seen[i].set_aside, g_array_unref);
    }
    g_free(work.seen);
    g_array_unref(work.observations);
    g_free(work.bundle.cameras);
    g_free(work.bundle.stops);
    g_free(work.bundle.lays);
    openblas_set_num_threads(blas_threads);
    return result;
}

struct cameras_result *cameras_calibrate(struct calibration *calibration,
                                         const struct cameras_task *task, GError **error) {
    return cameras_run(calibration, task, FALSE, error);
}

struct cameras_result *cameras_calibrate_lens(struct calibration *calibration,
                                              const struct cameras_task *task, GError **error) {
    return cameras_run(calibration, task, TRUE, error);
}
