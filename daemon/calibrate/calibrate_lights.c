/* calibrate lights: lamps and the arc from a captured session of posts or balls; or the directions
 * that photographs were lit from, by balls in them. */
#include "calibrate.h"
#include "calibrate_photos.h"
#include "lamps/highlights.h"
#include "lamps/shadows.h"

#include <math.h>
#include <string.h>

#define ROUNDS       2   /* of looking closely, each from where the last one found things */
#define LOCATE_VIEWS 6   /* in which the plate is looked for */
#define LOCATE_SHOTS 8   /* of each */
#define MOST_A_LAMP  160 /* pictures: more of them tell little more */
#define REACH_MM     5.0 /* how far off the target may lie, and */
#define REACH_RAD    (5 * G_PI / 180)

static char *target_option;
static const GOptionEntry entries[] = {
    {"target", 't', 0, G_OPTION_ARG_FILENAME, &target_option,
     "What stands on the turntable: etc/demo/poles.conf, etc/demo/balls.conf", "FILE"},
    CALIBRATE_OUTPUT("Write the result here"),
    CALIBRATE_FROM("Start from this calibration, which knows the cameras"),
    {"images", 'i', 0, G_OPTION_ARG_FILENAME, &photos_folder,
     "No session: photographs (JPEG, PNG, TIFF) from one fixed camera", "DIR"},
    {"ball", 'b', 0, G_OPTION_ARG_STRING_ARRAY, &photos_balls,
     "With --images: where a ball is in them, in pixels to 5 % of R; several tell distances too",
     "X,Y,R"},
    {"radius", 'r', 0, G_OPTION_ARG_DOUBLE, &photos_radius_mm,
     "With --images: the balls' radius in mm", "MM"},
    {NULL},
};

struct view { /* pictures of one camera at one turntable angle */
    int camera;
    double turntable_deg;
    GPtrArray *frames; /* struct calibrate_frame, borrowed */
};

struct job {
    struct calibrate_job base;
    struct lamp_target target;
    GArray *views; /* struct view */
    struct plate_map *maps[RIG_MAX_CAMERAS];
    struct rig rig; /* as far as it is known */
    GArray *sights;
    struct lamps_result result;
    int done, total;
};

static void clear_view(gpointer data) {
    g_ptr_array_unref(((struct view *)data)->frames);
}

static double cli_calibrate_lights_radians(double deg) {
    return deg * (G_PI / 180);
}

static gboolean cli_calibrate_lights_step(struct job *job, GError **error) {
    job->done++;
    return work_tell(job->base.work, "lights", MIN(job->done, job->total), job->total,
                     job->base.begun_us, error);
}

/* Takes every n-th of each lamp's, so that no lamp has many more than are of use. */
static void thin(struct job *job, GPtrArray *all) {
    int n[RIG_MAX_LAMPS] = {0}, seen[RIG_MAX_LAMPS] = {0};
    for (guint i = 0; i < all->len; i++)
        n[((struct calibrate_frame *)all->pdata[i])->lamp]++;
    for (guint i = 0; i < all->len; i++) {
        struct calibrate_frame *frame = all->pdata[i];
        int lamp = frame->lamp, k = seen[lamp]++;
        if ((gint64)k * MOST_A_LAMP / n[lamp] != (gint64)(k - 1) * MOST_A_LAMP / n[lamp] ||
            n[lamp] <= MOST_A_LAMP || k == 0) {
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

static gboolean cli_calibrate_lights_gather(struct job *job, GError **error) {
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
        g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES,
                    "%s: its camera or lamp is not in the calibration", frame->path);
        return FALSE;
    }
    if (frames->len == 0) {
        g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES,
                    "%s: holds no pictures under lamps; is it captured?", job->base.sessions[0]);
        return FALSE;
    }
    thin(job, frames);
    sort_into_views(job);
    return TRUE;
}

static ShadowView *cli_calibrate_lights_load_view(struct job *job, const struct view *view,
                                                  guint most, GError **error) {
    struct plate_map **map = &job->maps[view->camera];
    if (!*map)
        *map = plate_map_new(&job->rig.cameras[view->camera], &job->target);
    g_autoptr(ShadowView) shadows =
        shadow_view_new(&job->rig, view->camera, cli_calibrate_lights_radians(view->turntable_deg),
                        &job->target, *map);
    guint every = 1 + view->frames->len / most;
    for (guint i = 0; i < view->frames->len; i += every) {
        const struct calibrate_frame *frame = view->frames->pdata[i];
        g_autoptr(Picture) picture = calibrate_read(frame, error);
        guint index = 0;
        g_ptr_array_find(job->base.frames, frame, &index);
        if (!picture || !shadow_view_add(shadows, picture, (int)index, frame->lamp,
                                         cli_calibrate_lights_radians(frame->arc_deg), error))
            return NULL;
    }
    return g_steal_pointer(&shadows);
}

static gboolean locate(struct job *job, GError **error) {
    g_autoptr(GPtrArray) views = g_ptr_array_new_with_free_func((GDestroyNotify)shadow_view_free);
    guint every = 1 + job->views->len / LOCATE_VIEWS;
    for (guint i = 0; i < job->views->len; i += every) {
        ShadowView *view = cli_calibrate_lights_load_view(
            job, &g_array_index(job->views, struct view, i), LOCATE_SHOTS, error);
        if (!view || !cli_calibrate_lights_step(job, error)) {
            shadow_view_free(view);
            return FALSE;
        }
        g_ptr_array_add(views, view);
    }
    return shadows_locate((ShadowView *const *)views->pdata, (int)views->len, &job->target,
                          REACH_MM, REACH_RAD, error);
}

static gboolean cli_calibrate_lights_adjust(struct job *job, GError **error) {
    lamps_result_clear(&job->result);
    return lamps_fit(&job->base.calibration->rig, &job->target,
                     (const struct lamp_sight *)(gpointer)job->sights->data, (int)job->sights->len,
                     &job->result, error);
}

static gboolean measure_poles(struct job *job, GError **error) {
    job->total = LOCATE_VIEWS + ROUNDS * (int)job->views->len;
    if (!locate(job, error))
        return FALSE;
    for (int round = 0; round < ROUNDS; round++) {
        g_array_set_size(job->sights, 0);
        g_ptr_array_set_size(job->base.rejected, 0);
        for (guint i = 0; i < job->views->len; i++) {
            g_autoptr(ShadowView) view = cli_calibrate_lights_load_view(
                job, &g_array_index(job->views, struct view, i), G_MAXUINT, error);
            if (!view || !cli_calibrate_lights_step(job, error))
                return FALSE;
            shadow_view_measure(view, &job->rig, &job->target, round > 0, job->sights,
                                job->base.rejected);
        }
        if (!cli_calibrate_lights_adjust(job, error))
            return FALSE;
        job->rig = job->result.rig;
        job->target = job->result.target;
    }
    return TRUE;
}

static gboolean measure_balls(struct job *job, GError **error) {
    job->total = (int)job->base.frames->len;
    for (guint i = 0; i < job->base.frames->len; i++) {
        const struct calibrate_frame *frame = job->base.frames->pdata[i];
        g_autoptr(Picture) picture = calibrate_read(frame, error);
        const struct highlight_picture from = {picture,
                                               (int)i,
                                               frame->lamp,
                                               frame->camera,
                                               cli_calibrate_lights_radians(frame->turntable_deg),
                                               cli_calibrate_lights_radians(frame->arc_deg)};
        if (!picture || !cli_calibrate_lights_step(job, error) ||
            !highlights_measure(&job->rig, &job->target, &from, REACH_MM, job->sights,
                                job->base.rejected, error))
            return FALSE;
    }
    return cli_calibrate_lights_adjust(job, error);
}

static void cli_calibrate_lights_keep(struct job *job) {
    struct calibration *calibration = job->base.calibration;
    const struct lamps_result *found = &job->result;
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
    calibration->arc = (struct calibration_arc){.known = TRUE, .zero_rad = found->zero_error_rad};
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
}

static gboolean cli_calibrate_lights_find(struct calibrate_job *base, GError **error) {
    struct job *job = (struct job *)base;
    if (!cli_calibrate_lights_gather(job, error))
        return FALSE;
    if (!(job->target.kind == LAMP_POLES ? measure_poles : measure_balls)(job, error)) {
        /* Nothing found: then why is more to the point than that. */
        if (error && *error && (*error)->domain == LAMPS_ERROR && base->rejected->len > 0)
            g_prefix_error(error, "%s (and %u more like it): ", (char *)base->rejected->pdata[0],
                           base->rejected->len - 1);
        return FALSE;
    }
    cli_calibrate_lights_keep(job);
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
    record_string(to, "name", lamp->name);
    record_doubles(to, "position_mm", (double[]){own.x, own.y, own.z}, 3);
    record_doubles(to, "error_mm", error_mm, 3);
    record_int(to, "sights", found->sights[i]);
    record_end(to);
    record_say(to, "  %-12s %7.2f mm at %6.3f° from the zenith, ± %.2f %.2f %.2f mm, %d sights\n",
               lamp->name, vec3_length(p), theta * 180 / G_PI, error_mm[0], error_mm[1],
               error_mm[2], found->sights[i]);
}

static void cli_calibrate_lights_tell(Record *to, const struct calibrate_job *base) {
    const struct calibration_part *part = &base->calibration->parts[CALIBRATION_LIGHTS];
    const struct lamps_result *found = &((const struct job *)base)->result;
    const struct rig_arc *arc = &found->rig.arc;
    const double deg = 180 / G_PI;
    record_int(to, "pictures", part->pictures);
    record_int(to, "sights", found->n_used);
    record_strings(to, "rejected", part->rejected);
    record_double(to, "rms", found->rms);
    record_say(to, "%s: %d pictures, %d sights, %.3g %s RMS\n", calibrate_output, part->pictures,
               found->n_used, part->residual_rms, part->residual_unit);
    record_begin_list(to, "lamps");
    for (int i = 0; i < found->rig.n_lamps; i++)
        if (found->seen[i])
            tell_lamp(to, found, i);
    record_end(to);
    record_double(to, "arc_zero_deg", arc->zero_rad * 180 / G_PI);
    record_boolean(to, "arc_axis_known", found->arc_known);
    record_double(to, "real_s", base->seconds);
    record_say(to, "  arc: zero %+.4f° ± %.4f°", arc->zero_rad * deg, found->zero_error_rad * deg);
    if (found->arc_known)
        record_say(to, ", axis leans %.4f° and stands at %+.3f %+.3f mm\n",
                   hypot(arc->tilt_rad[0], arc->tilt_rad[1]) * deg, arc->centre_mm[0],
                   arc->centre_mm[1]);
    else
        record_say(to, "; too few angles of it to tell its axis\n");
    calibrate_say_doubts(to, base, part, "sights");
}

static int cli_calibrate_lights_run(const struct call *call, GError **error) {
    static const struct calibrate_method method = {cli_calibrate_lights_find,
                                                   cli_calibrate_lights_tell};
    const struct command *command = call->command;
    struct job job = {0};
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
    .help = "Find out where lamps and the arc's axis are, from a session of posts or of balls.",
    .options = entries,
    .max = 1,
    .run = cli_calibrate_lights_run};
