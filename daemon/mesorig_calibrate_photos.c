/* calibrate lights --images: the directions of light in photographs, by balls in them. */
#include "mesorig_calibrate_photos.h"

#include "calib/ball_light.h"
#include "calib/highlights.h"
#include "calib/vision.h"
#include "mesorig_cli.h"
#include "mesorig_work.h"

#include <math.h>
#include <string.h>

#define MOST_BALLS 16
#define INSIDE     0.97 /* of a ball's radius: what is looked at */
#define SPOT_SHARE 0.2  /* of a ball's disc, that a highlight may take up */

char *photos_folder, **photos_balls;
double photos_radius_mm;

struct light {
    char *name; /* of the file */
    struct vec3 direction, place;
    gboolean placed;
    double miss;
};

struct job {
    const char *output;
    struct ball_outline balls[MOST_BALLS];
    int n_balls;
    GPtrArray *names; /* paths */
    GArray *lights;   /* struct light */
    GPtrArray *rejected;
};

static void clear_light(gpointer data) {
    g_free(((struct light *)data)->name);
}

static gboolean parse_ball(const char *text, struct ball_outline *ret) {
    g_auto(GStrv) words = g_strsplit(text, ",", 4);
    double values[3];
    if (g_strv_length(words) != 3)
        return FALSE;
    for (int i = 0; i < 3; i++) {
        char *end;
        values[i] = g_ascii_strtod(words[i], &end);
        if (end == words[i] || *end || !isfinite(values[i]))
            return FALSE;
    }
    *ret = (struct ball_outline){values[0], values[1], values[2]};
    return values[2] >= 5;
}

static gboolean is_photograph(const char *name) {
    static const char *const ends[] = {".jpg", ".jpeg", ".png", ".tif", ".tiff"};
    g_autofree char *lower = g_ascii_strdown(name, -1);
    for (gsize i = 0; i < G_N_ELEMENTS(ends); i++)
        if (g_str_has_suffix(lower, ends[i]))
            return TRUE;
    return FALSE;
}

static int by_text(gconstpointer a, gconstpointer b) {
    return strcmp(*(char *const *)a, *(char *const *)b);
}

static gboolean list(struct job *job, GError **error) {
    g_autoptr(GDir) dir = g_dir_open(photos_folder, 0, error);
    const char *name;
    while (dir && (name = g_dir_read_name(dir)))
        if (is_photograph(name))
            g_ptr_array_add(job->names, g_build_filename(photos_folder, name, NULL));
    g_ptr_array_sort(job->names, by_text);
    if (dir && job->names->len == 0)
        g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES,
                    "%s: there is no .jpg, .png or .tif picture in that folder", photos_folder);
    return job->names->len > 0;
}

static void reject(struct job *job, const char *name, int ball, const char *why) {
    g_ptr_array_add(job->rejected, g_strdup_printf("%s: ball %d %s", name, ball + 1, why));
}

/* Of all balls that show it; their directions differ a little where the lamp is near. */
static void measure(struct job *job, const struct picture *picture) {
    struct ball_outline seen[MOST_BALLS];
    double at[MOST_BALLS][2];
    struct vec3 sum = vec3(0, 0, 0), d;
    int n = 0;
    for (int i = 0; i < job->n_balls; i++) {
        const struct ball_outline *ball = &job->balls[i];
        double most = MAX(SPOT_SHARE * G_PI * ball->radius_px * ball->radius_px, 9);
        const char *why = highlight_find(picture, ball->x_px, ball->y_px, INSIDE * ball->radius_px,
                                         most, &at[n][0], &at[n][1]);
        if (!why && !ball_light_direction(ball, at[n][0], at[n][1], &d))
            why = "shows the lamp outside of its outline";
        if (why) {
            reject(job, picture->name, i, why);
            continue;
        }
        sum = vec3_add(sum, d);
        seen[n++] = *ball;
    }
    if (n == 0)
        return;
    struct light light = {.name = g_path_get_basename(picture->name), .direction = vec3_unit(sum)};
    light.placed =
        n >= 2 && ball_light_place(seen, (const double(*)[2])at, n, &light.place, &light.miss);
    g_array_append_val(job->lights, light);
}

static gboolean write_lights(const struct job *job, GError **error) {
    g_autoptr(GString) text = g_string_new(NULL);
    g_string_append_printf(text, "%u\n", job->lights->len);
    for (guint i = 0; i < job->lights->len; i++) {
        const struct light *light = &g_array_index(job->lights, struct light, i);
        const double d[3] = {light->direction.x, light->direction.y, light->direction.z};
        g_string_append(text, light->name);
        for (int k = 0; k < 3; k++) {
            char number[G_ASCII_DTOSTR_BUF_SIZE];
            g_ascii_formatd(number, sizeof number, "%.6f", d[k]);
            g_string_append_printf(text, " %s", number);
        }
        g_string_append_c(text, '\n');
    }
    return g_file_set_contents(job->output, text->str, (gssize)text->len, error);
}

static gboolean work(const struct work *work, gpointer data, GError **error) {
    struct job *job = data;
    const gint64 begun_us = g_get_monotonic_time();
    if (!list(job, error))
        return FALSE;
    for (guint i = 0; i < job->names->len; i++) {
        g_autoptr(Picture) picture = vision_read(job->names->pdata[i], error);
        if (!picture || g_cancellable_set_error_if_cancelled(work->cancellable, error))
            return FALSE;
        measure(job, picture);
        work_tell(work, "lights", (int)i + 1, (int)job->names->len, begun_us, NULL);
    }
    if (job->lights->len > 0)
        return write_lights(job, error);
    g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES, "%s (and %u more like it)",
                (char *)job->rejected->pdata[0], job->rejected->len - 1);
    return FALSE;
}

static GVariant *light_variant(const struct light *light) {
    const double unit = photos_radius_mm > 0 ? photos_radius_mm : 1;
    GVariantBuilder builder;
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&builder, "{sv}", "file", g_variant_new_string(light->name));
    g_variant_builder_add(
        &builder, "{sv}", "direction",
        g_variant_new("(ddd)", light->direction.x, light->direction.y, light->direction.z));
    if (light->placed) {
        g_variant_builder_add(&builder, "{sv}", photos_radius_mm > 0 ? "place_mm" : "place_radii",
                              g_variant_new("(ddd)", unit * light->place.x, unit * light->place.y,
                                            unit * light->place.z));
        g_variant_builder_add(&builder, "{sv}", "miss", g_variant_new_double(unit * light->miss));
    }
    return g_variant_builder_end(&builder);
}

static void tell_json(const struct job *job) {
    GVariantBuilder builder, lights;
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_init(&lights, G_VARIANT_TYPE("aa{sv}"));
    for (guint i = 0; i < job->lights->len; i++)
        g_variant_builder_add_value(&lights,
                                    light_variant(&g_array_index(job->lights, struct light, i)));
    g_variant_builder_add(&builder, "{sv}", "file", g_variant_new_string(job->output));
    g_variant_builder_add(&builder, "{sv}", "lights", g_variant_builder_end(&lights));
    g_variant_builder_add(
        &builder, "{sv}", "rejected",
        g_variant_new_strv((const char *const *)job->rejected->pdata, (gssize)job->rejected->len));
    cli_print_json(g_variant_builder_end(&builder));
}

static void tell(const struct job *job) {
    const double unit = photos_radius_mm > 0 ? photos_radius_mm : 1;
    if (cli_json) {
        tell_json(job);
        return;
    }
    g_print("%s: %u of %u photographs\n", job->output, job->lights->len, job->names->len);
    for (guint i = 0; i < job->lights->len; i++) {
        const struct light *light = &g_array_index(job->lights, struct light, i);
        g_print("  %-24s %+.4f %+.4f %+.4f", light->name, light->direction.x, light->direction.y,
                light->direction.z);
        if (light->placed)
            g_print("   at %.1f %.1f %.1f %s", unit * light->place.x, unit * light->place.y,
                    unit * light->place.z, photos_radius_mm > 0 ? "mm" : "radii");
        g_print("\n");
    }
    for (guint i = 0; i < job->rejected->len; i++)
        g_print("  left out: %s\n", (char *)job->rejected->pdata[i]);
}

static int run_job(struct job *job) {
    g_autoptr(GError) error = NULL;
    double seconds = 0;
    if (!cli_work_run(work, job, &seconds, &error))
        return cli_fail(error);
    tell(job);
    return CLI_DONE;
}

static int bad_usage(const char *what) {
    g_printerr("mesorig calibrate lights: %s\n", what);
    return CLI_USAGE;
}

int photos_calibrate(const char *output) {
    struct job job = {.output = output};
    if (!photos_balls)
        return bad_usage("where is the ball in the photographs? Give --ball X,Y,R in pixels");
    for (char **text = photos_balls; *text; text++)
        if (job.n_balls == MOST_BALLS || !parse_ball(*text, &job.balls[job.n_balls++]))
            return bad_usage("--ball needs X,Y,R in pixels, R at least 5; at most 16 of them");
    job.names = g_ptr_array_new_with_free_func(g_free);
    job.rejected = g_ptr_array_new_with_free_func(g_free);
    job.lights = g_array_new(FALSE, FALSE, sizeof(struct light));
    g_array_set_clear_func(job.lights, clear_light);
    const int code = run_job(&job);
    g_ptr_array_unref(job.names);
    g_ptr_array_unref(job.rejected);
    g_array_unref(job.lights);
    return code;
}
