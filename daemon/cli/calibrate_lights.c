/* calibrate lights: lamps and the arc from a captured session of posts or balls; or the directions
 * that photographs were lit from, by balls in them. */
#include "calibrate.h"
#include "calibrate_photos.h"
#include "lamps/highlights.h"
#include "lamps/shadows.h"
#include "work.h"

#include <math.h>
#include <string.h>

#define ROUNDS       2   /* of looking closely, each from where the last one found things */
#define LOCATE_VIEWS 6   /* in which the plate is looked for */
#define LOCATE_SHOTS 8   /* of each */
#define MOST_A_LAMP  160 /* pictures: more of them tell little more */
#define REACH_MM     5.0 /* how far off the target may lie, and */
#define REACH_RAD    (5 * G_PI / 180)

static char *target_option, *output_option, *calibration_option;
static const GOptionEntry entries[] = {
    {"target", 't', 0, G_OPTION_ARG_FILENAME, &target_option,
     "What stands on the turntable: etc/demo/poles.conf, etc/demo/balls.conf", "FILE"},
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output_option, "Write the result here", "FILE"},
    {"calibration", 'c', 0, G_OPTION_ARG_FILENAME, &calibration_option,
     "Start from this calibration, which knows the cameras", "FILE"},
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
    const char *session;
    struct lamp_target target;
    struct calibration *calibration;
    GPtrArray *frames; /* struct calibrate_frame */
    GArray *views;     /* struct view */
    struct plate_map *maps[RIG_MAX_CAMERAS];
    struct rig rig; /* as far as it is known */
    GArray *sights;
    GPtrArray *rejected;
    struct lamps_result result;
    const struct work *work;
    gint64 begun_us;
    int done, total;
};

static void clear_view(gpointer data) {
    g_ptr_array_unref(((struct view *)data)->frames);
}

static struct picture *read_grey(const struct calibrate_frame *frame, GError **error) {
    g_autofree char *cfa = NULL;
    g_autoptr(Picture) picture = calibrate_read(frame, &cfa, error);
    if (!picture || picture_balance(picture, cfa))
        return g_steal_pointer(&picture);
    g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES, "%s: its colour filter “%s” is not known",
                picture->name, cfa);
    return NULL;
}

static double cli_calibrate_lights_radians(double deg) {
    return deg * (G_PI / 180);
}

static int cli_calibrate_lights_index_of(const struct job *job,
                                         const struct calibrate_frame *frame) {
    guint index = 0;
    g_ptr_array_find(job->frames, frame, &index);
    return (int)index;
}

static gboolean cli_calibrate_lights_step(struct job *job, GError **error) {
    job->done++;
    return work_tell(job->work, "lights", MIN(job->done, job->total), job->total, job->begun_us,
                     error);
}

/* Every n-th of each lamp's, so that no lamp has many more than are of use. */
static void thin(struct job *job) {
    int n[RIG_MAX_LAMPS] = {0}, seen[RIG_MAX_LAMPS] = {0};
    g_autoptr(GPtrArray) all = job->frames;
    job->frames = g_ptr_array_new_with_free_func((GDestroyNotify)calibrate_frame_free);
    for (guint i = 0; i < all->len; i++)
        n[((struct calibrate_frame *)all->pdata[i])->lamp]++;
    for (guint i = 0; i < all->len; i++) {
        struct calibrate_frame *frame = all->pdata[i];
        int lamp = frame->lamp, k = seen[lamp]++;
        if ((gint64)k * MOST_A_LAMP / n[lamp] != (gint64)(k - 1) * MOST_A_LAMP / n[lamp] ||
            n[lamp] <= MOST_A_LAMP || k == 0) {
            g_ptr_array_add(job->frames, frame);
            all->pdata[i] = NULL;
        }
    }
}

static void sort_into_views(struct job *job) {
    for (guint i = 0; i < job->frames->len; i++) {
        struct calibrate_frame *frame = job->frames->pdata[i];
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

static gboolean cli_calibrate_lights_check_frames(const struct job *job, GError **error) {
    for (guint i = 0; i < job->frames->len; i++) {
        const struct calibrate_frame *frame = job->frames->pdata[i];
        if (frame->camera < job->rig.n_cameras && frame->lamp >= 0 &&
            frame->lamp < job->rig.n_lamps)
            continue;
        g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES,
                    "%s: its camera or lamp is not in the calibration", frame->path);
        return FALSE;
    }
    if (job->frames->len > 0)
        return TRUE;
    g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES,
                "%s: holds no pictures under lamps; is it captured?", job->session);
    return FALSE;
}

static gboolean cli_calibrate_lights_gather(struct job *job, GError **error) {
    g_autoptr(Session) session = session_open(job->session, SESSION_READ, error);
    if (!session)
        return FALSE;
    job->calibration = calibrate_begin(calibration_option, session, error);
    job->frames = job->calibration ? calibrate_frames(session, SHOT_LAMP, error) : NULL;
    if (!job->frames)
        return FALSE;
    job->rig = job->calibration->rig;
    if (!cli_calibrate_lights_check_frames(job, error))
        return FALSE;
    thin(job);
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
        g_autoptr(Picture) picture = read_grey(frame, error);
        if (!picture ||
            !shadow_view_add(shadows, picture, cli_calibrate_lights_index_of(job, frame),
                             frame->lamp, cli_calibrate_lights_radians(frame->arc_deg), error))
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
    return lamps_fit(&job->calibration->rig, &job->target,
                     (const struct lamp_sight *)(gpointer)job->sights->data, (int)job->sights->len,
                     &job->result, error);
}

static gboolean measure_poles(struct job *job, GError **error) {
    job->total = LOCATE_VIEWS + ROUNDS * (int)job->views->len;
    if (!locate(job, error))
        return FALSE;
    for (int round = 0; round < ROUNDS; round++) {
        g_array_set_size(job->sights, 0);
        g_ptr_array_set_size(job->rejected, 0);
        for (guint i = 0; i < job->views->len; i++) {
            g_autoptr(ShadowView) view = cli_calibrate_lights_load_view(
                job, &g_array_index(job->views, struct view, i), G_MAXUINT, error);
            if (!view || !cli_calibrate_lights_step(job, error))
                return FALSE;
            shadow_view_measure(view, &job->rig, &job->target, round > 0, job->sights,
                                job->rejected);
        }
        if (!cli_calibrate_lights_adjust(job, error))
            return FALSE;
        job->rig = job->result.rig;
        job->target = job->result.target;
    }
    return TRUE;
}

static gboolean measure_balls(struct job *job, GError **error) {
    job->total = (int)job->frames->len;
    for (guint i = 0; i < job->frames->len; i++) {
        const struct calibrate_frame *frame = job->frames->pdata[i];
        g_autoptr(Picture) picture = read_grey(frame, error);
        const struct highlight_picture from = {picture,
                                               (int)i,
                                               frame->lamp,
                                               frame->camera,
                                               cli_calibrate_lights_radians(frame->turntable_deg),
                                               cli_calibrate_lights_radians(frame->arc_deg)};
        if (!picture || !cli_calibrate_lights_step(job, error) ||
            !highlights_measure(&job->rig, &job->target, &from, REACH_MM, job->sights,
                                job->rejected, error))
            return FALSE;
    }
    return cli_calibrate_lights_adjust(job, error);
}

/* Nothing found: then why is more to the point than that. */
static void add_reason(const struct job *job, GError **error) {
    if (error && *error && (*error)->domain == LAMPS_ERROR && job->rejected->len > 0)
        g_prefix_error(error, "%s (and %u more like it): ", (char *)job->rejected->pdata[0],
                       job->rejected->len - 1);
}

static void reject_misfits(struct job *job) {
    const gboolean poles = job->target.kind == LAMP_POLES;
    for (guint i = 0; i < job->sights->len; i++) {
        const struct lamp_sight *s = &g_array_index(job->sights, struct lamp_sight, i);
        const struct calibrate_frame *frame = job->frames->pdata[s->picture];
        if (job->result.rejected[i])
            g_ptr_array_add(job->rejected,
                            g_strdup_printf("%s: %s %d does not fit what the others show",
                                            frame->path, poles ? "post" : "ball", s->mark + 1));
    }
}

static char *cli_calibrate_lights_sum_up(const struct job *job) {
    g_autoptr(GPtrArray) sums = g_ptr_array_new();
    for (guint i = 0; i < job->frames->len; i++)
        g_ptr_array_add(sums, ((struct calibrate_frame *)job->frames->pdata[i])->sha256);
    return calibration_checksum((const char *const *)sums->pdata, (int)sums->len);
}

static void cli_calibrate_lights_keep(struct job *job) {
    struct calibration *calibration = job->calibration;
    const struct lamps_result *found = &job->result;
    const gboolean poles = job->target.kind == LAMP_POLES;
    g_autofree char *sum = cli_calibrate_lights_sum_up(job);
    reject_misfits(job);
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
    struct calibration_part *part = calibration_set_part(
        calibration, CALIBRATION_LIGHTS,
        poles ? "shadows of posts, all together" : "highlights on balls, all together",
        (int)job->frames->len, sum, g_steal_pointer(&job->rejected));
    part->residual_rms = found->rms;
    g_free(part->residual_unit);
    part->residual_unit = g_strdup(poles ? "mm" : "px");
    part->degrees_of_freedom = found->degrees_of_freedom;
}

static gboolean cli_calibrate_lights_work(const struct work *work, gpointer data, GError **error) {
    struct job *job = data;
    job->work = work;
    job->begun_us = g_get_monotonic_time();
    if (!cli_calibrate_lights_gather(job, error))
        return FALSE;
    if (!(job->target.kind == LAMP_POLES ? measure_poles : measure_balls)(job, error)) {
        add_reason(job, error);
        return FALSE;
    }
    cli_calibrate_lights_keep(job);
    return calibration_write(job->calibration, output_option, error);
}

static GVariant *lamp_variant(const struct job *job, int i) {
    const struct lamps_result *found = &job->result;
    const struct vec3 p = found->rig.lamps[i].position_mm;
    const double(*c)[3] = found->covariance_mm2[i];
    GVariantBuilder builder;
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&builder, "{sv}", "name", g_variant_new_string(found->rig.lamps[i].name));
    g_variant_builder_add(&builder, "{sv}", "position_mm", g_variant_new("(ddd)", p.x, p.y, p.z));
    g_variant_builder_add(&builder, "{sv}", "error_mm",
                          g_variant_new("(ddd)", sqrt(c[0][0]), sqrt(c[1][1]), sqrt(c[2][2])));
    g_variant_builder_add(&builder, "{sv}", "sights", g_variant_new_int32(found->sights[i]));
    return g_variant_builder_end(&builder);
}

static void cli_calibrate_lights_tell_json(const struct job *job, double seconds) {
    const struct calibration_part *part = &job->calibration->parts[CALIBRATION_LIGHTS];
    const struct rig_arc *arc = &job->result.rig.arc;
    GVariantBuilder builder, lamps;
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_init(&lamps, G_VARIANT_TYPE("aa{sv}"));
    for (int i = 0; i < job->result.rig.n_lamps; i++)
        if (job->result.seen[i])
            g_variant_builder_add_value(&lamps, lamp_variant(job, i));
    g_variant_builder_add(&builder, "{sv}", "file", g_variant_new_string(output_option));
    g_variant_builder_add(&builder, "{sv}", "pictures", g_variant_new_int32(part->pictures));
    g_variant_builder_add(&builder, "{sv}", "sights", g_variant_new_int32(job->result.n_used));
    g_variant_builder_add(&builder, "{sv}", "rejected",
                          g_variant_new_strv((const char *const *)part->rejected->pdata,
                                             (gssize)part->rejected->len));
    g_variant_builder_add(&builder, "{sv}", "rms", g_variant_new_double(job->result.rms));
    g_variant_builder_add(&builder, "{sv}", "lamps", g_variant_builder_end(&lamps));
    g_variant_builder_add(&builder, "{sv}", "arc_zero_deg",
                          g_variant_new_double(arc->zero_rad * 180 / G_PI));
    g_variant_builder_add(&builder, "{sv}", "arc_axis_known",
                          g_variant_new_boolean(job->result.arc_known));
    g_variant_builder_add(&builder, "{sv}", "real_s", g_variant_new_double(seconds));
    cli_print_json(g_variant_builder_end(&builder));
}

static void tell_lamp(const struct lamps_result *found, int i) {
    const struct vec3 p = rig_lamp_position_mm(&found->rig.arc, &found->rig.lamps[i], 0);
    const double(*c)[3] = found->covariance_mm2[i];
    double theta, phi;
    rig_angles(p, &theta, &phi);
    g_print("  %-12s %7.2f mm at %6.3f° from the zenith, ± %.2f %.2f %.2f mm, %d sights\n",
            found->rig.lamps[i].name, vec3_length(p), theta * 180 / G_PI, sqrt(c[0][0]),
            sqrt(c[1][1]), sqrt(c[2][2]), found->sights[i]);
}

static void cli_calibrate_lights_tell(const struct job *job, double seconds) {
    const struct calibration_part *part = &job->calibration->parts[CALIBRATION_LIGHTS];
    const struct lamps_result *found = &job->result;
    const struct rig_arc *arc = &found->rig.arc;
    const double deg = 180 / G_PI;
    if (cli_json) {
        cli_calibrate_lights_tell_json(job, seconds);
        return;
    }
    g_print("%s: %d pictures, %d sights, %.3g %s RMS\n", output_option, part->pictures,
            found->n_used, part->residual_rms, part->residual_unit);
    for (int i = 0; i < found->rig.n_lamps; i++)
        if (found->seen[i])
            tell_lamp(found, i);
    g_print("  arc: zero %+.4f° ± %.4f°", arc->zero_rad * deg, found->zero_error_rad * deg);
    if (found->arc_known)
        g_print(", axis leans %.4f° and stands at %+.3f %+.3f mm\n",
                hypot(arc->tilt_rad[0], arc->tilt_rad[1]) * deg, arc->centre_mm[0],
                arc->centre_mm[1]);
    else
        g_print("; too few angles of it to tell its axis\n");
    if (part->rejected->len)
        g_print("  %u sights left out; mesorig calibrate show %s lists them\n", part->rejected->len,
                output_option);
    if (!job->calibration->parts[CALIBRATION_CAMERAS].done)
        g_print("  the cameras are nominal: calibrate them first, and give -c\n");
}

static int cli_calibrate_lights_run_job(struct job *job) {
    g_autoptr(GError) error = NULL;
    double seconds = 0;
    const gboolean ok = cli_work_run(cli_calibrate_lights_work, job, &seconds, &error);
    if (ok)
        cli_calibrate_lights_tell(job, seconds);
    return ok ? CLI_DONE : cli_fail(error);
}

static void clear_job(struct job *job) {
    lamps_result_clear(&job->result);
    calibration_free(job->calibration);
    g_clear_pointer(&job->frames, g_ptr_array_unref);
    g_clear_pointer(&job->rejected, g_ptr_array_unref);
    g_array_unref(job->views);
    g_array_unref(job->sights);
    for (int i = 0; i < RIG_MAX_CAMERAS; i++)
        plate_map_free(job->maps[i]);
}

static int cli_calibrate_lights_run(const struct command *command, int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    struct job job = {0};
    if (!cli_parse(command, entries, FALSE, &argc, &argv, 0, 1))
        return CLI_USAGE;
    if (!output_option)
        return cli_usage(command, "where to? Give -o FILE");
    if (photos_folder)
        return argc > 1 ? cli_usage(command, "give a session, or --images DIR, not both")
                        : photos_calibrate(output_option);
    if (argc < 2)
        return cli_usage(command, "give a captured session, or --images DIR");
    if (!target_option)
        return cli_usage(command, "what stands on the turntable? Give --target");
    if (!lamp_target_load(&job.target, target_option, &error))
        return cli_fail(error);
    job.session = argv[1];
    job.views = g_array_new(FALSE, FALSE, sizeof(struct view));
    g_array_set_clear_func(job.views, clear_view);
    job.sights = g_array_new(FALSE, FALSE, sizeof(struct lamp_sight));
    job.rejected = g_ptr_array_new_with_free_func(g_free);
    const int code = cli_calibrate_lights_run_job(&job);
    clear_job(&job);
    return code;
}

const struct command calibrate_lights = {
    .name = "calibrate lights",
    .arguments = "SESSION --target FILE -o FILE",
    .help = "Find out where lamps and the arc's axis are, from a session of posts or of balls.",
    .run_arguments = cli_calibrate_lights_run};
