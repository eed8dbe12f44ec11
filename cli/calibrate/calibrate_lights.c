/* calibrate lights: finds the lamps and the arc from a captured session of posts or balls. With
 * --images, finds the directions of light from balls in photographs. */
#include "base/residual.h"
#include "calibrate.h"
#include "calibrate_photos.h"
#include "lamps/highlights.h"
#include "lamps/shadows.h"

#include <math.h>
#include <string.h>

/* Number of rounds of measuring. The first round starts from the positions in the calibration. Each
 * further round starts from the positions that the round before has found. */
#define ROUNDS       2
#define LOCATE_VIEWS 6   /* maximum number of views in which the plate is searched for */
#define LOCATE_SHOTS 8   /* maximum number of pictures of each of these views */
#define MAX_A_LAMP   160 /* maximum number of pictures of a lamp; more improve the result little */
/* Largest displacement and rotation of the target from its described place. */
#define REACH_MM  5.0
#define REACH_RAD (5 * G_PI / 180)
/* A mistake is certain if undoing it raises the agreement by more than this. */
#define DECISIVE 0.15
/* A mistake is also certain if undoing it divides the missing agreement, 1 − agreement, by more
 * than this. */
#define MISSES 4.0
/* If the share of sights that are used is smaller than this, a mistake is searched for. */
#define MIN_USED 0.5
#define DEGREES  (180 / G_PI)

static char *target_option;
static const GOptionEntry entries[] = {
    {"target", 't', 0, G_OPTION_ARG_FILENAME, &target_option,
     "Description of the target on the turntable, such as poles.conf or balls.conf in "
     "/usr/share/mesorig/demo",
     "FILE"},
    CALIBRATE_OUTPUT("Write the result here"),
    CALIBRATE_FROM("Start from this calibration, in which the cameras are calibrated"),
    CALIBRATE_INCOMPLETE,
    CALIBRATE_FOUND,
    {"images", 'i', 0, G_OPTION_ARG_FILENAME, &photos_folder,
     "Instead of a session: a folder of photographs (JPEG, PNG, TIFF, BMP, PGM, EXR, camera raw) "
     "from one fixed camera",
     "DIR"},
    {"ball", 0, 0, G_OPTION_ARG_STRING_ARRAY, &photos_balls,
     "With --images: position and radius of a ball in pixels, accurate to 5 % of R; several balls "
     "also determine distances",
     "X,Y,R"},
    {"radius", 0, 0, G_OPTION_ARG_DOUBLE, &photos_radius_mm,
     "With --images: the balls' radius in mm", "MM"},
    {"dome-radius", 0, 0, G_OPTION_ARG_DOUBLE, &photos_dome_mm,
     "With --images and --radius: distance of all lamps from the middle of their dome; the result "
     "is the lamps' positions in mm instead of directions",
     "MM"},
    {"dome-middle", 0, 0, G_OPTION_ARG_STRING, &photos_middle,
     "With --dome-radius: where the middle of the dome is on the plate on which the balls lie, in "
     "pixels; default: the picture's middle",
     "X,Y"},
    {"focal", 0, 0, G_OPTION_ARG_DOUBLE, &photos_focal_px,
     "With --images: the camera's focal length in pixels; default: that of the first photograph's "
     "EXIF; without either, the camera is assumed to be far away",
     "PX"},
    {"within", 0, 0, G_OPTION_ARG_DOUBLE, &photos_within_deg,
     "With --images: leave out directions with a larger standard error (0.5)", "DEG"},
    {NULL},
};

struct view { /* the pictures of one camera at one turntable angle */
    int camera;
    double turntable_deg;
    GPtrArray *frames; /* of struct calibrate_frame, borrowed */
};

struct job {
    struct calibrate_job base;
    struct lamp_target target;
    GArray *views; /* of struct view */
    struct plate_map *maps[RIG_MAX_CAMERAS];
    struct rig rig; /* the rig as known so far */
    GArray *sights;
    struct lamps_result result;
    int done, total;
    /* Maps a frame to its Picture while find_mistake() reads the same pictures several times;
     * otherwise NULL. */
    GHashTable *kept;
};

static void clear_view(gpointer data) {
    g_ptr_array_unref(((struct view *)data)->frames);
}

static double rad_of(double deg) {
    return deg * (G_PI / 180);
}

static gboolean step(struct job *job, GError **error) {
    job->done++;
    return work_tell(job->base.work, "lights", MIN(job->done, job->total), job->total,
                     job->base.begun_us, error);
}

/* Moves the pictures of the array `all` to the frames of the job. A lamp with more than MAX_A_LAMP
 * pictures keeps about MAX_A_LAMP of them, evenly spaced. */
static void thin(struct job *job, GPtrArray *all) {
    int n[RIG_MAX_LAMPS] = {0}, seen[RIG_MAX_LAMPS] = {0};
    for (guint i = 0; i < all->len; i++)
        n[((struct calibrate_frame *)all->pdata[i])->lamp]++;
    for (guint i = 0; i < all->len; i++) {
        struct calibrate_frame *frame = all->pdata[i];
        int lamp = frame->lamp, k = seen[lamp]++;
        if ((gint64)k * MAX_A_LAMP / n[lamp] != (gint64)(k - 1) * MAX_A_LAMP / n[lamp] ||
            n[lamp] <= MAX_A_LAMP || k == 0) {
            g_ptr_array_add(job->base.frames, frame);
            all->pdata[i] = NULL;
        }
    }
}

static void sort_into_views(struct job *job) {
    for (guint i = 0; i < job->base.frames->len; i++) {
        struct calibrate_frame *frame = job->base.frames->pdata[i];
        struct view *view = NULL;
        for (guint k = 0; k < job->views->len && !view; k++) {
            struct view *v = &g_array_index(job->views, struct view, k);
            if (v->camera == frame->camera && v->turntable_deg == frame->turntable_deg)
                view = v;
        }
        if (!view) {
            const struct view fresh = {frame->camera, frame->turntable_deg, g_ptr_array_new()};
            g_array_append_val(job->views, fresh);
            view = &g_array_index(job->views, struct view, job->views->len - 1);
        }
        g_ptr_array_add(view->frames, frame);
    }
}

static gboolean gather(struct job *job, GError **error) {
    g_autoptr(Session) session = calibrate_open(&job->base, 0, error);
    g_autoptr(GPtrArray) frames = session ? calibrate_frames(session, SHOT_LAMP, error) : NULL;
    if (!frames)
        return FALSE;
    job->rig = job->base.calibration->rig;
    for (guint i = 0; i < frames->len; i++) {
        const struct calibrate_frame *frame = frames->pdata[i];
        if (frame->camera < job->rig.n_cameras && frame->lamp >= 0 &&
            frame->lamp < job->rig.n_lamps)
            continue;
        const gboolean camera = frame->camera >= job->rig.n_cameras;
        g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES,
                    "%s: the %s of this frame has the number %d, counted from 0, but the "
                    "calibration has only %d %ss: give a calibration of this rig with -c",
                    frame->path, camera ? "camera" : "lamp", camera ? frame->camera : frame->lamp,
                    camera ? job->rig.n_cameras : job->rig.n_lamps, camera ? "camera" : "lamp");
        return FALSE;
    }
    if (frames->len == 0) {
        g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES,
                    "%s: the session contains no pictures under lamps: capture the session first",
                    job->base.sessions[0]);
        return FALSE;
    }
    thin(job, frames);
    sort_into_views(job);
    return TRUE;
}

/* Returns the picture of a frame, or NULL with an error if the picture cannot be read. If job->kept
 * exists, it owns the picture. Otherwise the caller owns the picture, and *ret is set to it. */
static struct picture *read_frame(struct job *job, const struct calibrate_frame *frame,
                                  struct picture **ret, GError **error) {
    struct picture *picture = job->kept ? g_hash_table_lookup(job->kept, frame) : NULL;
    if (picture)
        return picture;
    picture = calibrate_read(frame, error);
    if (picture && job->kept)
        g_hash_table_insert(job->kept, (gpointer)frame, picture);
    else
        *ret = picture;
    return picture;
}

static ShadowView *load_view(struct job *job, const struct view *view, guint most, GError **error) {
    struct plate_map **map = &job->maps[view->camera];
    if (!*map)
        *map = plate_map_new(&job->rig.cameras[view->camera], &job->target);
    g_autoptr(ShadowView) shadows =
        shadow_view_new(&job->rig, view->camera, rad_of(view->turntable_deg), &job->target, *map);
    guint every = 1 + view->frames->len / most;
    for (guint i = 0; i < view->frames->len; i += every) {
        const struct calibrate_frame *frame = view->frames->pdata[i];
        g_autoptr(Picture) own = NULL;
        const struct picture *picture = read_frame(job, frame, &own, error);
        guint index = 0;
        g_ptr_array_find(job->base.frames, frame, &index);
        if (!picture || !shadow_view_add(shadows, picture, (int)index, frame->lamp,
                                         rad_of(frame->arc_deg), error))
            return NULL;
    }
    return g_steal_pointer(&shadows);
}

/* Loads some views with some of their pictures. The plate is searched for in these pictures. */
static GPtrArray *load_some(struct job *job, GError **error) {
    g_autoptr(GPtrArray) views = g_ptr_array_new_with_free_func((GDestroyNotify)shadow_view_free);
    guint every = 1 + job->views->len / LOCATE_VIEWS;
    for (guint i = 0; i < job->views->len; i += every) {
        ShadowView *view =
            load_view(job, &g_array_index(job->views, struct view, i), LOCATE_SHOTS, error);
        if (!view || !step(job, error)) {
            shadow_view_free(view);
            return NULL;
        }
        g_ptr_array_add(views, view);
    }
    return g_steal_pointer(&views);
}

static gboolean locate(struct job *job, GError **error) {
    g_autoptr(GPtrArray) views = load_some(job, error);
    return views && shadows_locate((ShadowView *const *)views->pdata, (int)views->len, &job->target,
                                   REACH_MM, REACH_RAD, error);
}

/* Fits the lamps to the sights. Then tests whether the posts or balls have other sizes than
 * described. This mistake is tested before all others, because the test needs no new measurement of
 * the sights. Returns FALSE with an error if the fit fails, or if the sights fit much better with
 * other sizes. */
static gboolean adjust(struct job *job, GError **error) {
    const struct rig *rig = &job->base.calibration->rig;
    const struct lamp_sight *sights = (const struct lamp_sight *)(gpointer)job->sights->data;
    const int n = (int)job->sights->len;
    g_autoptr(GError) why = NULL;
    lamps_result_clear(&job->result);
    const gboolean ok = lamps_fit(rig, &job->target, sights, n, &job->result, &why);
    if ((ok || g_error_matches(why, LAMPS_ERROR, LAMPS_ERROR_DEGENERATE)) &&
        !lamps_check_sizes(rig, &job->target, sights, n, &job->result, error))
        return FALSE;
    if (why)
        g_propagate_error(error, g_steal_pointer(&why));
    return ok;
}

static gboolean measure_poles(struct job *job, GError **error) {
    job->total = LOCATE_VIEWS + ROUNDS * (int)job->views->len;
    if (!locate(job, error))
        return FALSE;
    for (int round = 0; round < ROUNDS; round++) {
        g_array_set_size(job->sights, 0);
        g_ptr_array_set_size(job->base.rejected, 0);
        for (guint i = 0; i < job->views->len; i++) {
            g_autoptr(ShadowView) view =
                load_view(job, &g_array_index(job->views, struct view, i), G_MAXUINT, error);
            if (!view || !step(job, error))
                return FALSE;
            shadow_view_measure(view, &job->rig, &job->target, round > 0, job->sights,
                                job->base.rejected);
        }
        if (!adjust(job, error))
            return FALSE;
        job->rig = job->result.rig;
        job->target = job->result.target;
    }
    return TRUE;
}

static gboolean measure_picture(struct job *job, guint i, const struct picture *picture,
                                GArray *sights, GPtrArray *rejected, GError **error) {
    const struct calibrate_frame *frame = job->base.frames->pdata[i];
    const struct highlight_picture from = {picture,
                                           (int)i,
                                           frame->lamp,
                                           frame->camera,
                                           rad_of(frame->turntable_deg),
                                           rad_of(frame->arc_deg)};
    return highlights_measure(&job->rig, &job->target, &from, REACH_MM, sights, rejected, error);
}

static gboolean measure_balls(struct job *job, GError **error) {
    job->total = (int)job->base.frames->len;
    for (guint i = 0; i < job->base.frames->len; i++) {
        g_autoptr(Picture) picture = calibrate_read(job->base.frames->pdata[i], error);
        if (!picture || !step(job, error) ||
            !measure_picture(job, i, picture, job->sights, job->base.rejected, error))
            return FALSE;
    }
    return adjust(job, error);
}

/* A mistake in the values that were recorded with the pictures. The true angles are the recorded
 * angles times these factors. If lamp i was recorded, lamp lamps[i] was lit. */
struct mistake {
    double turntable, arc;
    int lamps[RIG_MAX_LAMPS];
};

static struct mistake mistake_of(double turntable, double arc) {
    struct mistake mistake = {turntable, arc, {0}};
    for (int i = 0; i < RIG_MAX_LAMPS; i++)
        mistake.lamps[i] = i;
    return mistake;
}

/* Returns the mistakes that are tried. The first element stands for no mistake. The others are:
 * - wrong signs,
 * - radians instead of degrees,
 * - two exchanged lamps,
 * - lamps that are numbered from the other end, or by one too high or too low.
 *
 * Each mistake is tried on many pictures. If there are many lamps, only lamps with neighbouring
 * numbers are therefore exchanged.
 *
 * For balls, mistakes of lamps are not tried, because balls show lamps wherever they are, and
 * lamps_fit() finds exchanged lamps. */
#define MAX_PAIRED 16
static GArray *all_mistakes(enum lamp_target_kind kind, int n_lamps) {
    static const double factors[][2] = {{1, 1},       {-1, 1},      {1, -1},           {-1, -1},
                                        {DEGREES, 1}, {1, DEGREES}, {DEGREES, DEGREES}};
    GArray *all = g_array_new(FALSE, FALSE, sizeof(struct mistake));
    for (gsize i = 0; i < G_N_ELEMENTS(factors); i++) {
        const struct mistake mistake = mistake_of(factors[i][0], factors[i][1]);
        g_array_append_val(all, mistake);
    }
    for (int a = 0; a < n_lamps && kind == LAMP_POLES; a++)
        for (int b = a + 1; b < (n_lamps > MAX_PAIRED ? MIN(a + 2, n_lamps) : n_lamps); b++) {
            struct mistake mistake = mistake_of(1, 1);
            mistake.lamps[a] = b;
            mistake.lamps[b] = a;
            g_array_append_val(all, mistake);
        }
    struct mistake order[3] = {mistake_of(1, 1), mistake_of(1, 1), mistake_of(1, 1)};
    for (int i = 0; i < n_lamps; i++) {
        order[0].lamps[i] = n_lamps - 1 - i;
        order[1].lamps[i] = (i + 1) % n_lamps;
        order[2].lamps[i] = (i + n_lamps - 1) % n_lamps;
    }
    if (n_lamps > 2 && kind == LAMP_POLES)
        g_array_append_vals(all, order, 3);
    return all;
}

static void set_frame(struct calibrate_frame *frame, const struct calibrate_frame *noted,
                      const struct mistake *mistake) {
    frame->turntable_deg = noted->turntable_deg * mistake->turntable;
    frame->arc_deg = noted->arc_deg * mistake->arc;
    frame->lamp = mistake->lamps[noted->lamp];
}

static void set_mistake(struct job *job, const struct calibrate_frame *noted,
                        const struct mistake *mistake) {
    for (guint i = 0; i < job->base.frames->len; i++)
        set_frame(job->base.frames->pdata[i], &noted[i], mistake);
    g_array_set_size(job->views, 0);
    sort_into_views(job);
}

/* Computes how well the pictures of posts agree with the recorded values if each mistake is undone.
 * ret[k] is the share of the posts' expected shadows that is dark if mistake k is undone, 0 to 1.
 * Returns FALSE if the work was cancelled or a picture cannot be used. */
static gboolean try_poles(struct job *job, const struct calibrate_frame *noted,
                          const GArray *mistakes, double *ret) {
    gboolean ok = TRUE;
    job->kept = g_hash_table_new_full(NULL, NULL, NULL, (GDestroyNotify)picture_free);
    for (guint k = 0; k < mistakes->len && ok; k++) {
        set_mistake(job, noted, &g_array_index(mistakes, struct mistake, k));
        g_autoptr(GPtrArray) views = load_some(job, NULL);
        ok = views != NULL;
        if (ok)
            ret[k] = shadows_score((ShadowView *const *)views->pdata, (int)views->len, &job->target,
                                   REACH_MM, REACH_RAD);
    }
    g_clear_pointer(&job->kept, g_hash_table_unref);
    return ok;
}

/* The same as try_poles(), but for balls. ret[k] is the share of the balls that show the lamp at
 * the place at which all others show it. Each picture is read once. */
static gboolean try_balls(struct job *job, const struct calibrate_frame *noted,
                          const GArray *mistakes, double *ret) {
    g_autoptr(GPtrArray) sights = g_ptr_array_new_with_free_func((GDestroyNotify)g_array_unref);
    g_autoptr(GPtrArray) rejected =
        g_ptr_array_new_with_free_func((GDestroyNotify)g_ptr_array_unref);
    for (guint k = 0; k < mistakes->len; k++) {
        g_ptr_array_add(sights, g_array_new(FALSE, FALSE, sizeof(struct lamp_sight)));
        g_ptr_array_add(rejected, g_ptr_array_new_with_free_func(g_free));
    }
    for (guint i = 0; i < job->base.frames->len; i++) {
        struct calibrate_frame *frame = job->base.frames->pdata[i];
        g_autoptr(Picture) picture = calibrate_read(frame, NULL);
        gboolean ok = picture && step(job, NULL);
        for (guint k = 0; k < mistakes->len && ok; k++) {
            set_frame(frame, &noted[i], &g_array_index(mistakes, struct mistake, k));
            ok = measure_picture(job, i, picture, sights->pdata[k], rejected->pdata[k], NULL);
        }
        if (!ok)
            return FALSE;
    }
    for (guint k = 0; k < mistakes->len; k++) {
        const GArray *of = sights->pdata[k];
        struct lamps_result result;
        if (!lamps_fit(&job->rig, &job->target, (const struct lamp_sight *)(gpointer)of->data,
                       (int)of->len, &result, NULL))
            continue;
        ret[k] = result.n_used / (double)(of->len + ((GPtrArray *)rejected->pdata[k])->len);
        lamps_result_clear(&result);
    }
    return TRUE;
}

static void tell_mistake(const struct job *job, const struct mistake *mistake, double is,
                         double would_be, GError **error) {
    const char *sign =
        mistake->arc < 0 ? "turns the wrong way" : "turns the wrong way, clockwise seen from above";
    static const char radians[] = "has its angles in radians, not in degrees";
    const struct rig *rig = &job->base.calibration->rig;
    const gboolean turntable = mistake->turntable != 1, arc = mistake->arc != 1;
    g_autofree char *fit = g_strdup_printf("the pictures show %.0f %% of the shadows or highlights "
                                           "that they should, and %.0f %% if this is corrected",
                                           100 * is, 100 * would_be);
    g_clear_error(error);
    if (turntable || arc) {
        const char *what = turntable && arc ? "each of turntable and arc"
                           : turntable      ? "the turntable"
                                            : "the arc";
        const gboolean reversed = (turntable ? mistake->turntable : mistake->arc) < 0;
        g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_MISTAKE,
                    "%s: %s %s (%s); correct the %s of steps_per_deg of %s in the rig file "
                    "(units_per_deg for a G-code board), or for imported pictures %s in the table, "
                    "and capture or import again",
                    job->base.sessions[0], what, reversed ? sign : radians, fit,
                    reversed ? "sign" : "value",
                    turntable && arc ? "[axis turntable] and [axis arc]"
                    : turntable      ? "[axis turntable]"
                                     : "[axis arc]",
                    turntable && arc ? "turntable_deg and arc_deg"
                    : turntable      ? "turntable_deg"
                                     : "arc_deg");
        return;
    }
    int a = 0, changed = 0;
    for (int i = rig->n_lamps - 1; i >= 0; i--)
        if (mistake->lamps[i] != i) {
            a = i;
            changed++;
        }
    if (changed == 2)
        g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_MISTAKE,
                    "%s: lamps %s and %s are exchanged (%s); " LAMPS_EXCHANGE_THEM,
                    job->base.sessions[0], rig->lamps[a].name, rig->lamps[mistake->lamps[a]].name,
                    fit, rig->lamps[a].name, rig->lamps[mistake->lamps[a]].name);
    else
        g_set_error(
            error, LAMPS_ERROR, LAMPS_ERROR_MISTAKE,
            "%s: the lamps are in another order: the lamp recorded as %s is in "
            "truth %s, and so on (%s); correct the index of every [lamp …] in the rig file, "
            "or, for imported pictures, the names in the table, and capture or import again",
            job->base.sessions[0], rig->lamps[a].name, rig->lamps[mistake->lamps[a]].name, fit);
}

/* Returns whether undoing a mistake improves the agreement so much that it cannot be chance. `is`
 * is the agreement with the recorded values, and would_be that with the mistake undone. */
static gboolean decisive(double is, double would_be) {
    return would_be >= SHADOWS_MIN_SCORE &&
           (would_be > is + DECISIVE || 1 - would_be < (1 - is) / MISSES);
}

/* Searches for a mistake after a failure, or if few sights fit. If one mistake explains the
 * pictures decisively better than the recorded values, sets the error to that mistake and returns
 * TRUE. Otherwise returns FALSE. target is the target as described in its file.
 *
 * The sights and the result of the job do not change. job->rig and job->target are reset to their
 * values before any measurement. */
static gboolean find_mistake(struct job *job, const struct lamp_target *target, GError **error) {
    const guint n = job->base.frames->len;
    g_autofree struct calibrate_frame *noted = g_new(struct calibrate_frame, n);
    g_autoptr(GArray) mistakes = all_mistakes(job->target.kind, job->base.calibration->rig.n_lamps);
    g_autofree double *agreement = g_new0(double, mistakes->len);
    guint best = 0;
    for (guint i = 0; i < n; i++)
        noted[i] = *(struct calibrate_frame *)job->base.frames->pdata[i];
    job->rig = job->base.calibration->rig;
    job->target = *target;
    const gboolean tried =
        (job->target.kind == LAMP_POLES ? try_poles : try_balls)(job, noted, mistakes, agreement);
    set_mistake(job, noted, &g_array_index(mistakes, struct mistake, 0));
    for (guint k = 1; k < mistakes->len; k++)
        if (agreement[k] > agreement[best])
            best = k;
    if (!tried || !decisive(agreement[0], agreement[best]))
        return FALSE;
    tell_mistake(job, &g_array_index(mistakes, struct mistake, best), agreement[0], agreement[best],
                 error);
    return TRUE;
}

/* Predicts the place of a sight in its picture. The seen place of a post's shadow is on the plate,
 * and is converted to the picture too. Returns FALSE if the seen or the predicted place is not in
 * front of the camera. */
static gboolean place_sight(const struct job *job, const struct rig *at, const struct lamp_sight *s,
                            struct found_mark *ret) {
    const struct lamp_target *target = &job->result.target;
    const struct rig_camera *camera = &at->cameras[s->camera];
    const struct vec3 lamp = s->lamp < 0
                                 ? rig_camera_centre_mm(camera)
                                 : rig_lamp_position_mm(&at->arc, &at->lamps[s->lamp], s->arc_rad);
    const struct vec3 mark = lamp_mark_mm(target, s->mark, s->turntable_rad);
    double x, y;
    ret->x_px = s->x;
    ret->y_px = s->y;
    if (target->kind == LAMP_BALLS) {
        if (!lamp_highlight_px(camera, mark, target->marks[s->mark].size_mm, lamp, &x, &y))
            return FALSE;
    } else {
        const struct vec3 seen = rig_turn(vec3(s->x, s->y, target->plane_mm), s->turntable_rad);
        struct vec3 end;
        if (!lamp_shadow_mm(target, s->mark, mark, lamp, &end, NULL) ||
            !rig_project(camera, end, &x, &y) || !rig_project(camera, seen, &ret->x_px, &ret->y_px))
            return FALSE;
    }
    ret->dx_px = x - ret->x_px;
    ret->dy_px = y - ret->y_px;
    return TRUE;
}

static void mark_sights(struct job *job) {
    g_autofree struct rig *at = g_new(struct rig, 1);
    for (guint i = 0; i < job->sights->len; i++) {
        const struct lamp_sight *s = &g_array_index(job->sights, struct lamp_sight, i);
        struct found_mark mark = {.frame = s->picture, .is_left_out = job->result.rejected[i] != 0};
        rig_at(&job->result.rig, s->turntable_rad, at);
        if (place_sight(job, at, s, &mark))
            calibrate_found_add(&job->base, &mark);
    }
}

static void keep(struct job *job) {
    struct calibration *calibration = job->base.calibration;
    const struct lamps_result *found = &job->result;
    if (job->base.found)
        mark_sights(job);
    const gboolean poles = job->target.kind == LAMP_POLES;
    for (guint i = 0; i < job->sights->len; i++) {
        const struct lamp_sight *s = &g_array_index(job->sights, struct lamp_sight, i);
        const struct calibrate_frame *frame = job->base.frames->pdata[s->picture];
        if (found->rejected[i])
            g_ptr_array_add(job->base.rejected,
                            g_strdup_printf("%s: %s %d does not fit what the others show",
                                            frame->path, poles ? "post" : "ball", s->mark + 1));
    }
    calibration->rig = found->rig;
    calibration->arc = (struct calibration_arc){.known = found->rig.arc_radius_mm > 0,
                                                .zero_rad = found->zero_error_rad};
    for (int k = 0; k < 2; k++) {
        calibration->arc.tilt_rad[k] = found->tilt_error_rad[k];
        calibration->arc.centre_mm[k] = found->centre_error_mm[k];
    }
    for (int i = 0; i < found->rig.n_lamps; i++)
        if (found->seen[i]) {
            calibration->lamps[i].known = TRUE;
            memcpy(calibration->lamps[i].position_covariance_mm2, found->covariance_mm2[i],
                   sizeof found->covariance_mm2[i]);
        }
    calibrate_set_part(&job->base, CALIBRATION_LIGHTS,
                       poles ? "shadows of posts, all together"
                             : "highlights on balls, all together",
                       found->rms, poles ? "mm" : "px", found->degrees_of_freedom);
    calibration->parts[CALIBRATION_LIGHTS].residual_expected =
        found->sigma > 0 ? found->rms / found->sigma : 0;
}

static gboolean find(struct calibrate_job *base, GError **error) {
    struct job *job = (struct job *)base;
    const struct lamp_target target = job->target;
    g_autoptr(GError) cause = NULL;
    if (!gather(job, error))
        return FALSE;
    const gboolean ok =
        (job->target.kind == LAMP_POLES ? measure_poles : measure_balls)(job, &cause);
    const double sights = job->sights->len + base->rejected->len;
    if (ok ? job->target.kind == LAMP_POLES || job->result.n_used >= MIN_USED * sights
           : !cause || cause->domain != LAMPS_ERROR || cause->code == LAMPS_ERROR_MISTAKE) {
        if (ok)
            keep(job);
        else if (cause)
            g_propagate_error(error, g_steal_pointer(&cause));
        return ok;
    }
    /* If nothing was found, the reason of the first rejection explains the failure best. */
    if (!ok && base->rejected->len > 0)
        g_prefix_error(&cause, "%s (the first of %u sights that were left out): ",
                       (char *)base->rejected->pdata[0], base->rejected->len);
    if (find_mistake(job, &target, &cause) || !ok) {
        g_propagate_error(error, g_steal_pointer(&cause));
        return FALSE;
    }
    keep(job);
    return TRUE;
}

static void tell_lamp(Record *to, const struct lamps_result *found, int i) {
    const struct rig_lamp *lamp = &found->rig.lamps[i];
    const struct vec3 p = rig_lamp_position_mm(&found->rig.arc, lamp, 0), own = lamp->position_mm;
    const double(*c)[3] = found->covariance_mm2[i];
    const double error_mm[3] = {sqrt(c[0][0]), sqrt(c[1][1]), sqrt(c[2][2])};
    double theta, phi;
    rig_angles(p, &theta, &phi);
    record_begin(to, NULL);
    record_say(to, "  %-12s{name} %7.2f mm at %6.3f° from the zenith, ± ", lamp->name,
               vec3_length(p), theta * 180 / G_PI);
    record_doubles(to, "position_mm", (double[]){own.x, own.y, own.z}, 3);
    record_say_doubles(to, "error_mm", "%.2f", error_mm, 3);
    record_say(to, " mm, %d{sights} sights\n", found->sights[i]);
    record_end(to);
}

static void tell(Record *to, const struct calibrate_job *base) {
    const struct calibration_part *part = &base->calibration->parts[CALIBRATION_LIGHTS];
    const struct lamps_result *found = &((const struct job *)base)->result;
    const struct rig_arc *arc = &found->rig.arc;
    const double deg = 180 / G_PI;
    record_say(to, "%d{pictures} pictures, %d{sights} sights, %.3g{rms} %s RMS\n", part->pictures,
               found->n_used, found->rms, part->residual_unit);
    record_strings(to, "rejected", part->rejected);
    record_begin_list(to, "lamps");
    for (int i = 0; i < found->rig.n_lamps; i++)
        if (found->seen[i])
            tell_lamp(to, found, i);
    record_end(to);
    const gboolean has_arc = found->rig.arc_radius_mm > 0;
    record_say_if(to, has_arc, "  arc: zero %+.4f{arc_zero_deg}° ± %.4f°",
                  arc->zero_rad * 180 / G_PI, found->zero_error_rad * deg);
    record_boolean(to, "arc_axis_known", found->arc_known);
    record_double(to, "real_s", base->seconds);
    if (has_arc && found->arc_known)
        record_say(to, ", axis leans %.4f° and stands at %+.3f %+.3f mm\n",
                   hypot(arc->tilt_rad[0], arc->tilt_rad[1]) * deg, arc->centre_mm[0],
                   arc->centre_mm[1]);
    else if (has_arc)
        record_say(to, "; too few of its angles were captured to determine its axis\n");
    calibrate_say_doubts(to, base, part, "sights");
    /* The standard errors of the lamps contain the excess of the residual (geometry/fit.h). */
    const struct residual residual = {
        .of = "the target",
        .value = part->residual_rms,
        .expected = part->residual_expected,
        .unit = part->residual_unit,
        .causes = "a turntable or an arc that wobbles, a target that moved or is not flat, cameras "
                  "that have moved since they were calibrated"};
    calibrate_warn_residual(base, &residual);
}

static int run(const struct call *call, GError **error) {
    static const struct calibrate_method method = {find, tell};
    const struct command *command = call->command;
    struct job job = {0};
    if (photos_folder && calibrate_found)
        return cli_usage(command, "--found is for sessions, not for --images");
    if (photos_folder)
        return photos_calibrate(call, error);
    if (call->n_arguments < 1)
        return cli_usage(command, "give a captured session, or --images DIR");
    if (!target_option)
        return cli_usage(command, "no target on the turntable is given: give --target FILE");
    if (!lamp_target_load(&job.target, target_option, error))
        return CLI_FAILED;
    job.views = g_array_new(FALSE, FALSE, sizeof(struct view));
    g_array_set_clear_func(job.views, clear_view);
    job.sights = g_array_new(FALSE, FALSE, sizeof(struct lamp_sight));
    const int code = calibrate_run(call, &method, &job.base, error);
    lamps_result_clear(&job.result);
    g_array_unref(job.views);
    g_array_unref(job.sights);
    for (int i = 0; i < RIG_MAX_CAMERAS; i++)
        plate_map_free(job.maps[i]);
    return code;
}

const struct command calibrate_lights = {
    .name = "calibrate lights",
    .arguments = "SESSION --target FILE -o FILE",
    .examples = "  mesorig calibrate lights poles.session -t poles.conf -c rig.calibration -o "
                "rig.calibration\n"
                "  mesorig calibrate lights -i photos --ball 150,160,60 -o lights.lp\n",
    .help = "Calibrate the lamps and the arc's axis, from a session of posts or of balls.",
    .options = entries,
    .writes = TRUE,
    .max = 1,
    .run = run};
