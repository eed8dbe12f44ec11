/* calibrate lights --images: finds the directions of light from balls in photographs. */
#include "calibrate_photos.h"

#include "calibrate.h"
#include "common/work.h"
#include "lamps/ball_outline.h"
#include "lamps/highlights.h"
#include "pictures/picture_says.h"

#include <math.h>
#include <string.h>

#define INSIDE 0.97 /* part of a ball's radius within which the highlight is searched for */
/* A highlight outside of a ball shows that the given circle is wrong if it is much brighter than
 * that on the ball. The highlight is searched for up to this distance from the centre of the ball,
 * in radii. */
#define AROUND 1.3
/* A highlight outside of a ball is much brighter if its energy is at least this many times that of
 * the highlight on the ball. */
#define BRIGHTER 5.0
/* Largest part of a ball's disc that a highlight may cover. It corresponds to directions within 26°
 * of the lamp. */
#define SPOT_SHARE 0.05
#define GIVEN_PX   0.5 /* standard deviation of a circle that the user has given, in pixels */
/* Largest error of the centre or the radius of a circle that the user has given, in radii. */
#define MOVED    0.05
#define MOVED_PX 4    /* the same for a small ball, in pixels; the larger of the two counts */
#define WHITE    0.98 /* A pixel counts as clipped from this part of the brightest pixel on. */
/* An outline at another place shows that the given circle is a mistake, provided that it differs
 * from the circle by less than this part of the radius. */
#define LOST 0.25
#define DEG  (180 / G_PI)

char *photos_folder, **photos_balls, *photos_middle;
double photos_dome_mm, photos_radius_mm, photos_focal_px, photos_within_deg = 0.5;

struct light {
    char *name; /* name of the file */
    struct ball_light found;
    /* With --dome-radius: position of the lamp relative to the middle of the dome. */
    struct vec3 dome_mm;
    double dome_error_mm; /* RMS distance along the dome from the true position */
};

struct job {
    struct ball_outline given[BALL_LIGHT_MAX], balls[BALL_LIGHT_MAX];
    double sigma_px[BALL_LIGHT_MAX]; /* standard deviations of the circles in balls */
    /* whether the outline of the ball was found in the pictures */
    gboolean outlined[BALL_LIGHT_MAX];
    BallEdges *edges[BALL_LIGHT_MAX]; /* NULL if the ball is too small */
    int n_balls;
    double focal_px;    /* 0 if not known */
    struct vec3 middle; /* middle of the dome in the frame of the highlights, in radii of a ball */
    /* Source of the focal length in the data of a photograph; NULL if the user gave the focal
     * length. */
    char *focal_said;
    GPtrArray *names; /* paths */
    /* Mean over the pictures that are not overexposed. Each pixel has the mean of the square roots
     * of its values. */
    Picture *mean;
    int n_mean;
    GArray *lights; /* of struct light */
    GPtrArray *rejected;
    OutputFile *to;
};

static void clear_light(gpointer data) {
    g_free(((struct light *)data)->name);
}

static void reject(struct job *job, const char *name, int ball, const char *why) {
    g_ptr_array_add(job->rejected, g_strdup_printf("%s: ball %d %s", name, ball + 1, why));
}

/* Returns whether a larger part of a ball is white than a lamp's highlight can cover. Such a
 * picture is not used for outlines, because its glare extends beyond the outline. */
static gboolean overexposed(const struct job *job, const struct picture *picture, int i) {
    const struct ball_outline *ball = &job->given[i];
    const int reach = (int)ball->radius_px, x = (int)ball->x_px, y = (int)ball->y_px;
    float most = 0;
    int white = 0;
    for (int pass = 0; pass < 2; pass++)
        for (int row = MAX(y - reach, 0); row <= MIN(y + reach, picture->height - 1); row++)
            for (int column = MAX(x - reach, 0); column <= MIN(x + reach, picture->width - 1);
                 column++) {
                const float value = picture->values[row * picture->width + column];
                if (pass == 0)
                    most = fmaxf(most, value);
                else
                    white += hypot(column - x, row - y) < reach && value >= (float)WHITE * most;
            }
    return white > SPOT_SHARE * G_PI * reach * reach;
}

/* Adds a picture to the outlines and to the mean, unless a ball in it is overexposed. The mean is
 * that of the square roots, so that highlights do not outshine outlines. */
static void add_to_mean(struct job *job, const struct picture *picture) {
    const int pixels = picture->width * picture->height;
    struct picture **mean = &job->mean;
    if (!*mean)
        *mean = picture_new("mean", "", picture->width, picture->height);
    for (int i = 0; i < job->n_balls; i++)
        if (overexposed(job, picture, i))
            return;
    for (int i = 0; i < job->n_balls; i++)
        if (job->edges[i])
            ball_edges_add(job->edges[i], picture);
    for (int i = 0; i < pixels; i++)
        (*mean)->values[i] += sqrtf(MAX(picture->values[i], 0));
    job->n_mean++;
}

/* Finds a ball's outline in the pictures, because it is more accurate than a circle that somebody
 * has drawn. If there is no outline, the circle is used. Fails if there is an outline, but not near
 * the circle, because the circle is then a mistake. */
static gboolean outline(struct job *job, int i, GError **error) {
    const struct ball_outline *given = &job->given[i];
    struct ball_outline seen;
    double sigma_px;
    const BallEdges *edges = job->edges[i];
    job->outlined[i] = edges && ball_outline_find(edges, MAX(MOVED * given->radius_px, MOVED_PX),
                                                  &job->balls[i], &job->sigma_px[i]);
    if (job->outlined[i])
        return TRUE;
    if (edges && ball_outline_find(edges, LOST * given->radius_px, &seen, &sigma_px)) {
        g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES,
                    "ball %d is said to be at %.1f, %.1f px with a radius of %.1f px, but the "
                    "pictures show an outline at %.1f, %.1f px with a radius of %.1f px; measure "
                    "the circle again, and correct --ball X,Y,R",
                    i + 1, given->x_px, given->y_px, given->radius_px, seen.x_px, seen.y_px,
                    seen.radius_px);
        return FALSE;
    }
    job->balls[i] = *given;
    job->sigma_px[i] = GIVEN_PX;
    return TRUE;
}

struct size {
    int width, height;
};

static int count_of(const GArray *sizes, const struct size *size) {
    int n = 0;
    for (guint i = 0; i < sizes->len; i++)
        n += memcmp(&g_array_index(sizes, struct size, i), size, sizeof *size) == 0;
    return n;
}

/* Leaves out pictures whose size differs from that of most pictures, because the balls must be at
 * the same place in all pictures. Such pictures are thumbnails or show something else. The progress
 * stage is "sizes". Returns FALSE if a picture cannot be read, or if the work is cancelled. */
static gboolean leave_out_sizes(struct job *job, const struct work *work, GError **error) {
    const gint64 begun_us = g_get_monotonic_time();
    const int n = (int)job->names->len;
    g_autoptr(GArray) sizes = g_array_new(FALSE, FALSE, sizeof(struct size));
    struct size usual = {0};
    for (int i = 0; i < n; i++) {
        g_autoptr(Picture) picture = calibrate_read_photograph(job->names->pdata[i], error);
        if (!picture || !work_tell(work, "sizes", i + 1, n, begun_us, error))
            return FALSE;
        const struct size size = {picture->width, picture->height};
        g_array_append_val(sizes, size);
        if (count_of(sizes, &size) > count_of(sizes, &usual))
            usual = size;
    }
    for (guint i = sizes->len; i-- > 0;) {
        const struct size *size = &g_array_index(sizes, struct size, i);
        if (size->width == usual.width && size->height == usual.height)
            continue;
        g_ptr_array_add(job->rejected,
                        g_strdup_printf("%s: has %d × %d pixels, and most pictures have %d × %d",
                                        (char *)job->names->pdata[i], size->width, size->height,
                                        usual.width, usual.height));
        g_ptr_array_remove_index(job->names, i);
    }
    return TRUE;
}

static gboolean find_outlines(struct job *job, const struct work *work, GError **error) {
    const gint64 begun_us = g_get_monotonic_time();
    const int n = (int)job->names->len;
    for (int i = 0; i < job->n_balls; i++)
        job->edges[i] = ball_edges_new(&job->given[i]);
    for (int i = 0; i < n; i++) {
        g_autoptr(Picture) picture = calibrate_read_photograph(job->names->pdata[i], error);
        if (!picture || !work_tell(work, "outlines", i + 1, n, begun_us, error))
            return FALSE;
        add_to_mean(job, picture);
    }
    for (int i = 0; i < job->mean->width * job->mean->height; i++)
        job->mean->values[i] /= (float)MAX(job->n_mean, 1);
    for (int i = 0; i < job->n_balls; i++)
        if (!outline(job, i, error))
            return FALSE;
    return TRUE;
}

static gboolean on_a_ball(const struct job *job, double x_px, double y_px) {
    for (int i = 0; i < job->n_balls; i++)
        if (hypot(x_px - job->balls[i].x_px, y_px - job->balls[i].y_px) < job->balls[i].radius_px)
            return TRUE;
    return FALSE;
}

/* Looks next to the ball for a highlight that is much brighter than the one on the ball. `energy`
 * is the energy of the highlight on the ball, or 0 if none was found there. Returns a text that
 * says that the given circle is wrong, or NULL if there is no such highlight. A highlight on
 * another ball does not count. */
static char *look_around(const struct job *job, const struct picture *picture,
                         const struct ball_outline *ball, double max_px, double energy) {
    const struct highlight_mean mean = {job->mean, job->n_mean};
    struct highlight around;
    const double room = MIN(MIN(ball->x_px, picture->width - 1 - ball->x_px),
                            MIN(ball->y_px, picture->height - 1 - ball->y_px));
    g_autofree char *why = highlight_find(picture, &mean, ball->x_px, ball->y_px,
                                          MIN(AROUND * ball->radius_px, room), max_px, &around);
    if (why || on_a_ball(job, around.x_px, around.y_px) || around.energy < BRIGHTER * energy)
        return NULL;
    return g_strdup_printf(
        "has a brighter highlight next to it, at %.1f, %.1f px; check the position given with "
        "--ball",
        around.x_px, around.y_px);
}

/* Measures the direction in which a ball shows the light. Positions are in radii of the ball. Their
 * origin is the first ball or, if the focal length is known, the camera. Returns NULL on success,
 * otherwise the reason of the failure, to be freed with g_free(). */
static char *measure_ball(const struct job *job, const struct picture *picture, int i,
                          struct ball_ray *ret) {
    const struct ball_outline *ball = &job->balls[i], *first = &job->balls[0];
    const double max_px = MAX(SPOT_SHARE * G_PI * ball->radius_px * ball->radius_px, 9);
    const struct highlight_mean mean = {job->mean, job->n_mean};
    struct highlight found = {0};
    if (overexposed(job, picture, i))
        return g_strdup(
            "is white over a larger area than a lamp's highlight covers; use a shorter exposure");
    g_autofree char *why = highlight_find(picture, &mean, ball->x_px, ball->y_px,
                                          INSIDE * ball->radius_px, max_px, &found);
    g_autofree char *outside =
        job->outlined[i] ? NULL : look_around(job, picture, ball, max_px, found.energy);
    if (outside || why)
        return outside ? g_steal_pointer(&outside) : g_steal_pointer(&why);
    const struct ball_camera camera = {job->focal_px, 0.5 * (picture->width - 1),
                                       0.5 * (picture->height - 1)};
    double shift_rad;
    if (!ball_light_mean_direction(&camera, ball, found.x_px, found.y_px, found.xx_px2,
                                   found.xy_px2, found.yy_px2, &ret->from, &ret->direction,
                                   &shift_rad))
        return g_strdup("has its highlight outside of its outline, or is too large for the focal "
                        "length; check --ball and --focal");
    /* A ball that appears larger than another of the same size is nearer to the camera. This
     * difference is neglected. */
    if (job->focal_px == 0)
        ret->from = vec3_add(ret->from, vec3((ball->x_px - first->x_px) / ball->radius_px,
                                             (first->y_px - ball->y_px) / ball->radius_px, 0));
    /* The mean direction of the highlight differs from the direction at its centroid by shift_rad.
     * The true direction lies between these two, because part of the highlight's size is blur. */
    ret->sigma_rad = hypot(shift_rad / 2, ball_light_sigma_rad(ball, job->sigma_px[i], found.x_px,
                                                               found.y_px, found.sigma_px));
    return NULL;
}

static gboolean contradict(const char *name, const int *balls, int n,
                           const struct ball_light *light, GError **error) {
    int worst = 0;
    for (int i = 1; i < n; i++)
        if (light->off_rad[i] > light->off_rad[worst])
            worst = i;
    if (n == 2)
        g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES,
                    "%s: balls %d and %d contradict each other: they show the lamp %.1f° apart, "
                    "more than any distance of the lamp explains; check their circles and "
                    "highlights, or add a third ball",
                    name, balls[0] + 1, balls[1] + 1, light->off_rad[0] * DEG);
    else
        g_set_error(
            error, LAMPS_ERROR, LAMPS_ERROR_PICTURES,
            "%s: the balls contradict each other: the direction in which ball %d shows the lamp is "
            "%.1f° from that of the nearest other ball, and no majority of them agrees; check "
            "each --ball, and whether each highlight is that of the lamp",
            name, balls[worst] + 1, light->off_rad[worst] * DEG);
    return FALSE;
}

static void reject_unsure(struct job *job, const char *name, double sigma_rad) {
    gboolean outlined = TRUE;
    for (int i = 0; i < job->n_balls; i++)
        outlined &= job->outlined[i];
    g_ptr_array_add(
        job->rejected,
        g_strdup_printf("%s: the direction of its light is known to ± %.2f° only; %s, or give "
                        "--within %.1f",
                        name, sigma_rad * DEG,
                        outlined
                            ? "photograph the ball larger, with its whole outline visible"
                            : "photograph the ball larger and in front of something bright, so "
                              "that its outline is visible",
                        ceil(10 * sigma_rad * DEG) / 10));
}

/* Places the lamp where the rays of the balls meet the dome, on average. Balls that disagree are
 * left out. Returns FALSE if a ray does not meet the dome. */
static gboolean place_on_dome(const struct job *job, const struct ball_ray *rays, int n,
                              struct light *light) {
    const double radius = photos_dome_mm / photos_radius_mm;
    struct vec3 sum = vec3(0, 0, 0);
    double weights = 0;
    for (int i = 0; i < n; i++) {
        struct vec3 at;
        if (light->found.left_out[i])
            continue;
        if (!ball_light_on_sphere(rays[i].from, rays[i].direction, job->middle, radius, &at))
            return FALSE;
        const double error = rays[i].sigma_rad * vec3_length(vec3_sub(at, rays[i].from));
        const double weight = 1 / (error * error);
        sum = vec3_add(sum, vec3_scale(vec3_sub(at, job->middle), weight));
        weights += weight;
    }
    light->dome_mm = vec3_scale(sum, photos_radius_mm / weights);
    light->dome_error_mm = photos_radius_mm / sqrt(weights);
    return TRUE;
}

/* Measures the direction to the lamp from the highlights on all balls that show the lamp. Returns
 * FALSE with an error if the balls contradict each other. If no ball shows the lamp, or if the
 * direction is too uncertain, the picture is only rejected and the result is TRUE. */
static gboolean measure(struct job *job, const struct picture *picture, GError **error) {
    struct ball_ray rays[BALL_LIGHT_MAX] = {0};
    int balls[BALL_LIGHT_MAX], n = 0;
    struct light light;
    for (int i = 0; i < job->n_balls; i++) {
        g_autofree char *why = measure_ball(job, picture, i, &rays[n]);
        if (why)
            reject(job, picture->name, i, why);
        else
            balls[n++] = i;
    }
    if (n == 0)
        return TRUE;
    if (!ball_light_join(rays, n, &light.found))
        return contradict(picture->name, balls, n, &light.found, error);
    for (int i = 0; i < n; i++)
        if (light.found.left_out[i]) {
            g_autofree char *why = g_strdup_printf("shows the lamp %.1f° from where the others do",
                                                   light.found.off_rad[i] * DEG);
            reject(job, picture->name, balls[i], why);
        }
    if (light.found.sigma_rad * DEG > photos_within_deg) {
        reject_unsure(job, picture->name, light.found.sigma_rad);
        return TRUE;
    }
    if (photos_dome_mm > 0 && !place_on_dome(job, rays, n, &light)) {
        g_set_error(
            error, LAMPS_ERROR, LAMPS_ERROR_PICTURES,
            "%s: a ball is outside of the dome, whose radius is %g mm; check --dome-radius, "
            "--dome-middle and --radius",
            picture->name, photos_dome_mm);
        return FALSE;
    }
    light.name = g_path_get_basename(picture->name);
    g_array_append_val(job->lights, light);
    return TRUE;
}

static gboolean write_lights(const struct job *job, GError **error) {
    g_autoptr(GString) text = g_string_new(NULL);
    g_string_append_printf(text, "%u\n", job->lights->len);
    for (guint i = 0; i < job->lights->len; i++) {
        const struct light *light = &g_array_index(job->lights, struct light, i);
        const struct vec3 d = photos_dome_mm > 0 ? light->dome_mm : light->found.direction;
        char x[G_ASCII_DTOSTR_BUF_SIZE], y[G_ASCII_DTOSTR_BUF_SIZE], z[G_ASCII_DTOSTR_BUF_SIZE];
        g_string_append_printf(
            text, "%s %s %s %s\n", light->name, g_ascii_formatd(x, sizeof x, "%.6f", d.x),
            g_ascii_formatd(y, sizeof y, "%.6f", d.y), g_ascii_formatd(z, sizeof z, "%.6f", d.z));
    }
    return output_file_put(job->to, text->str, text->len, error);
}

/* Finds the middle of the dome in the frame of the highlights. */
static gboolean find_middle(struct job *job, GError **error) {
    const double x = 0.5 * (job->mean->width - 1), y = 0.5 * (job->mean->height - 1);
    const struct ball_camera camera = {job->focal_px, x, y};
    double at[2] = {x, y};
    if (photos_middle)
        calibrate_parse(photos_middle, ",", 2, at);
    if (photos_dome_mm == 0 ||
        ball_light_plate(&camera, &job->balls[0], at[0], at[1], &job->middle))
        return TRUE;
    g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES,
                "ball 1 is too large for a focal length of %.0f px; check --ball and --focal",
                job->focal_px);
    return FALSE;
}

/* Uses the focal length that was given. Without one, uses that of the first photograph. */
static void find_focal(struct job *job) {
    struct picture_says says;
    job->focal_px = photos_focal_px;
    if (job->focal_px != 0)
        return;
    picture_says_read_file(job->names->pdata[0], &says);
    job->focal_px =
        picture_says_focal_px(&says, job->mean->width, job->mean->height, &job->focal_said);
    picture_says_clear(&says);
}

static gboolean cli_calibrate_photos_work(const struct work *work, gpointer data, GError **error) {
    struct job *job = data;
    g_autoptr(GPtrArray) hidden = g_ptr_array_new_with_free_func(g_free);
    if (!(job->names = calibrate_photographs(photos_folder, G_MAXUINT, hidden, error)) ||
        !leave_out_sizes(job, work, error) || !find_outlines(job, work, error))
        return FALSE;
    const gint64 begun_us = g_get_monotonic_time();
    find_focal(job);
    if (!find_middle(job, error))
        return FALSE;
    for (guint i = 0; i < job->names->len; i++) {
        g_autoptr(Picture) picture = calibrate_read_photograph(job->names->pdata[i], error);
        if (!picture || !measure(job, picture, error) ||
            !work_tell(work, "lights", (int)i + 1, (int)job->names->len, begun_us, error))
            return FALSE;
    }
    if (job->lights->len > 0) {
        g_ptr_array_extend_and_steal(job->rejected, g_steal_pointer(&hidden));
        return write_lights(job, error);
    }
    g_set_error_literal(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES, job->rejected->pdata[0]);
    if (job->rejected->len > 1)
        g_prefix_error(error, "no picture shows where its light is; the first of %u reasons: ",
                       job->rejected->len);
    return FALSE;
}

static void say_vec3(Record *to, const char *key, const char *format, struct vec3 v) {
    record_say_doubles(to, key, format, (double[]){v.x, v.y, v.z}, 3);
}

static void tell_light(Record *to, const struct light *light) {
    const gboolean mm = photos_radius_mm > 0;
    const struct ball_light *found = &light->found;
    const double unit = mm ? photos_radius_mm : 1;
    record_begin(to, NULL);
    record_say(to, "  %-24s{file} ", light->name);
    say_vec3(to, "direction", "%+.4f", found->direction);
    record_say(to, " ± %.2f{sigma_deg}°", found->sigma_rad * DEG);
    if (found->placed) {
        record_say(to, "   at ");
        say_vec3(to, mm ? "place_mm" : "place_radii", "%.1f", vec3_scale(found->place, unit));
        record_say(to, " %s, ± ", mm ? "mm" : "radii");
        say_vec3(to, mm ? "error_mm" : "error_radii", "%.1f", vec3_scale(found->place_error, unit));
        record_double(to, "miss", unit * found->miss);
    }
    if (photos_dome_mm > 0) {
        record_say(to, "   on the dome at ");
        say_vec3(to, "dome_mm", "%.1f", light->dome_mm);
        record_say(to, " mm, ± %.1f{dome_error_mm}", light->dome_error_mm);
    }
    record_end(to);
    record_say(to, "\n");
}

static void tell(Record *to, const struct job *job) {
    record_say(to, "%s{file}: %u of %u photographs\n", calibrate_output, job->lights->len,
               job->names->len);
    if (job->focal_said)
        record_say(to, "  focal length %.0f{focal_px} px (%s{focal_from}); --focal sets another\n",
                   job->focal_px, job->focal_said);
    record_say_if(
        to, photos_dome_mm > 0 && job->focal_px == 0,
        "  no focal length is known, so the camera is taken to be far away; positions are "
        "more accurate with --focal\n");
    record_begin_list(to, "balls");
    for (int i = 0; i < job->n_balls; i++) {
        const struct ball_outline *ball = &job->balls[i];
        record_begin(to, NULL);
        record_doubles(to, "outline_px", (double[]){ball->x_px, ball->y_px, ball->radius_px}, 3);
        record_say(to, "  ball %d: %s %.2f, %.2f px, radius %.2f px, ± %.2f{error_px} px\n", i + 1,
                   job->outlined[i] ? "its outline is seen at"
                                    : "as given, its outline is not seen:",
                   ball->x_px, ball->y_px, ball->radius_px, job->sigma_px[i]);
        record_boolean(to, "seen", job->outlined[i]);
        record_end(to);
    }
    record_end(to);
    record_begin_list(to, "lights");
    for (guint i = 0; i < job->lights->len; i++)
        tell_light(to, &g_array_index(job->lights, struct light, i));
    record_end(to);
    record_say_strings(to, "rejected", "  left out: ", job->rejected);
}

int photos_calibrate(const struct call *call, GError **error) {
    struct job job = {0};
    if (!calibrate_output)
        return cli_usage(call->command, "no file to write is given: give -o FILE");
    if (call->n_arguments > 0)
        return cli_usage(call->command, "give a session, or --images DIR, not both");
    double middle[2];
    if (photos_dome_mm != 0 && !(photos_dome_mm > photos_radius_mm && photos_radius_mm > 0))
        return cli_usage(call->command,
                         "--dome-radius=%g: also give the radius of the balls with "
                         "--radius, in mm; the dome must be larger",
                         photos_dome_mm);
    if (photos_middle && !(photos_dome_mm > 0 && calibrate_parse(photos_middle, ",", 2, middle)))
        return cli_usage(call->command, "--dome-middle=%s: give X,Y in pixels, and --dome-radius",
                         photos_middle);
    if (!photos_balls)
        return cli_usage(call->command,
                         "no ball in the photographs is given: give --ball X,Y,R in pixels");
    for (char **text = photos_balls; *text; text++) {
        double v[3];
        if (job.n_balls == BALL_LIGHT_MAX)
            return cli_usage(call->command, "--ball=%s: this is one ball too many; give at most %d",
                             *text, BALL_LIGHT_MAX);
        if (!calibrate_parse(*text, ",", 3, v) || !(v[2] >= 5))
            return cli_usage(call->command, "--ball=%s: give X,Y,R in pixels, R at least 5", *text);
        job.given[job.n_balls++] = (struct ball_outline){v[0], v[1], v[2]};
    }
    job.rejected = g_ptr_array_new_with_free_func(g_free);
    job.lights = g_array_new(FALSE, FALSE, sizeof(struct light));
    g_array_set_clear_func(job.lights, clear_light);
    /* the kind of file is NULL, because a list of lights can have no comments */
    job.to = cli_output(calibrate_output, NULL, error);
    const gboolean ok = job.to && cli_work_run(cli_calibrate_photos_work, &job, NULL, error);
    if (ok) {
        tell(call->record, &job);
        cli_tell_output(call->record, job.to);
    }
    output_file_free(job.to);
    g_free(job.focal_said);
    g_clear_pointer(&job.names, g_ptr_array_unref);
    g_clear_pointer(&job.mean, picture_free);
    for (int i = 0; i < job.n_balls; i++)
        ball_edges_free(job.edges[i]);
    g_ptr_array_unref(job.rejected);
    g_array_unref(job.lights);
    return ok ? CLI_DONE : CLI_FAILED;
}
