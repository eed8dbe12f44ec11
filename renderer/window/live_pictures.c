#include "live_pictures.h"

#include "partial/partial_forecast.h"
#include "partial/shared_exponent.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

#define TERMS 4 /* number of terms, as in Wang et al. 2005 §5 */

struct LivePictures {
    char *session;
    Partial *partial;          /* NULL before the session could be opened */
    PartialForecast *forecast; /* NULL before the first picture */
    double shot_s;             /* mean time in s between two shots, on the session's clock */
};

LivePictures *live_pictures_new(const char *session) {
    LivePictures *pictures = g_new0(LivePictures, 1);
    pictures->session = g_strdup(session);
    return pictures;
}

void live_pictures_free(LivePictures *pictures) {
    if (pictures == NULL)
        return;
    partial_forecast_unref(pictures->forecast);
    partial_free(pictures->partial);
    g_free(pictures->session);
    g_free(pictures);
}

/* Returns the mean time in s between two shots, or 0 if it is not known yet. */
static double find_shot_s(const char *path) {
    g_autoptr(Session) session = session_open(path, SESSION_READ, NULL);
    g_autoptr(GPtrArray) shots = session != NULL ? session_shots(session, NULL) : NULL;
    g_autoptr(GPtrArray) frames = shots != NULL ? session_frames(session, NULL) : NULL;
    double first = INFINITY, last = -INFINITY;
    int n = 0;
    for (guint k = 0; frames != NULL && k < frames->len; k++) {
        const struct session_frame *frame = frames->pdata[k];
        first = fmin(first, frame->captured_s);
        last = fmax(last, frame->captured_s);
    }
    for (guint k = 0; frames != NULL && k < shots->len; k++)
        n += ((const struct session_shot *)shots->pdata[k])->state == SHOT_DONE;
    return n > 1 && last > first ? (last - first) / (n - 1) : 0.0;
}

gboolean live_pictures_read(LivePictures *pictures, GCancellable *stop, GError **error) {
    const struct work work = {.n_threads = 1, .cancellable = stop};
    g_autoptr(GArray) fresh = g_array_new(FALSE, FALSE, sizeof(int));
    g_autofree char *problem = NULL;
    if (pictures->partial == NULL &&
        (pictures->partial = partial_open(pictures->session, error)) == NULL)
        return FALSE;
    do { /* A few pictures at a time are read, so that the window can be closed meanwhile. */
        g_array_set_size(fresh, 0);
        if (!partial_read(pictures->partial, 16, fresh, &problem, error) ||
            g_cancellable_set_error_if_cancelled(stop, error))
            return FALSE;
    } while (fresh->len > 0);
    const int n = partial_n_measured(pictures->partial);
    if (n == 0 ||
        (pictures->forecast != NULL && partial_forecast_n_measured(pictures->forecast) == n))
        return FALSE;
    struct partial_sample *sample = partial_sample(pictures->partial, error);
    PartialForecast *forecast =
        sample != NULL ? partial_forecast_new(sample, pictures->forecast, &work, error) : NULL;
    partial_sample_free(sample);
    if (forecast == NULL)
        return FALSE;
    partial_forecast_unref(pictures->forecast);
    pictures->forecast = forecast;
    pictures->shot_s = find_shot_s(pictures->session);
    return TRUE;
}

struct columns {
    const LivePictures *of;
    GCancellable *stop;
};

/* Sets ret_column to the pictures of a view: n_lights × height × width × 3. */
static gboolean get_column(int view, float *ret_column, gpointer data, GError **error) {
    const struct columns *columns = data;
    const Partial *partial = columns->of->partial;
    const struct session_grid *grid = partial_grid(partial);
    const gsize n = (gsize)grid->width * (gsize)grid->height;
    const int n_lights = (int)partial_lights(partial)->len;
    for (int light = 0; light < n_lights; light++) {
        const int pair = view * n_lights + light;
        GBytes *measured = partial_picture(partial, pair);
        g_autoptr(GBytes) picture =
            measured != NULL ? g_bytes_ref(measured)
                             : partial_forecast_picture(columns->of->forecast, partial, pair);
        const guint32 *texels = g_bytes_get_data(picture, NULL);
        for (gsize i = 0; i < n; i++)
            shared_exponent_unpack(texels[i], ret_column + 3 * ((gsize)light * n + i));
        if (g_cancellable_set_error_if_cancelled(columns->stop, error))
            return FALSE;
    }
    return TRUE;
}

static void copy_directions(const GPtrArray *from, gsize *ret_n, float **ret_theta,
                            float **ret_phi) {
    *ret_n = from->len;
    *ret_theta = g_new(float, from->len);
    *ret_phi = g_new(float, from->len);
    for (guint k = 0; k < from->len; k++) {
        const struct session_direction *direction = from->pdata[k];
        (*ret_theta)[k] = (float)direction->theta_deg;
        (*ret_phi)[k] = (float)direction->phi_deg;
    }
}

struct eigenmaps *live_pictures_eigenmaps(LivePictures *pictures, GCancellable *stop,
                                          GError **error) {
    struct columns columns = {pictures, stop};
    const struct session_grid *grid = partial_grid(pictures->partial);
    struct eigenmaps *maps = g_new0(struct eigenmaps, 1);
    double rest;
    maps->name = g_path_get_basename(pictures->session);
    maps->layout.width = grid->width;
    maps->layout.height = grid->height;
    maps->layout.texel_mm = grid->width_mm / grid->width;
    copy_directions(partial_views(pictures->partial), &maps->layout.views.n,
                    &maps->layout.views.theta_deg, &maps->layout.views.phi_deg);
    copy_directions(partial_lights(pictures->partial), &maps->layout.lights.n,
                    &maps->layout.lights.theta_deg, &maps->layout.lights.phi_deg);
    maps->n_terms = MIN(TERMS, (int)maps->layout.views.n);
    if (!eigenmaps_compute(maps, get_column, &columns, &rest, error))
        g_clear_pointer(&maps, eigenmaps_free);
    return maps;
}

/* Returns the number of further shots after which the error is expected to be below share. Returns
 * 0 if the forecast does not reach share. The error is interpolated linearly between the points of
 * the forecast. */
static double shots_until(const PartialForecast *forecast, double share) {
    int n;
    const struct partial_later *later = partial_forecast_later(forecast, &n);
    double shots = 0, error = partial_forecast_error(forecast);
    for (int i = 0; i < n; i++) {
        if (later[i].error <= share)
            return shots +
                   (later[i].shots - shots) * (error - share) / fmax(error - later[i].error, 1e-9);
        shots = later[i].shots;
        error = later[i].error;
    }
    return 0.0;
}

static void append_time(GString *to, double s) {
    if (s < 90)
        g_string_append_printf(to, "%.0f s", fmax(5 * round(s / 5), 5));
    else if (s < 5400)
        g_string_append_printf(to, "%.0f min", s / 60);
    else
        g_string_append_printf(to, "%.1f h", s / 3600);
}

char *live_pictures_text(const LivePictures *pictures) {
    static const double goals[] = {0.2, 0.1, 0.05, 0.02, 0.01, 0.005};
    const Partial *partial = pictures->partial;
    const int n = partial_n_measured(partial), all = partial_n_pairs(partial);
    GString *text = g_string_new(NULL);
    g_string_append_printf(text, "%d of %d pictures are measured.", n, all);
    if (n == all || pictures->forecast == NULL)
        return g_string_free(text, FALSE);
    const double error = partial_forecast_error(pictures->forecast);
    double range[2];
    partial_forecast_error_range(pictures->forecast, range);
    g_string_append_printf(text, " Expected error %.1f %% (%.1f to %.1f %%)", 100 * error,
                           100 * range[0], 100 * range[1]);
    for (guint k = 0; k < G_N_ELEMENTS(goals); k++) {
        const double s = pictures->shot_s * shots_until(pictures->forecast, goals[k]);
        if (goals[k] >= 0.8 * error || !(s > 0))
            continue;
        g_string_append_printf(text, ", %g %% in about ", 100 * goals[k]);
        append_time(text, s);
        break;
    }
    g_string_append_c(text, '.');
    return g_string_free(text, FALSE);
}

int live_pictures_n_views(const LivePictures *pictures) {
    return pictures->partial != NULL ? (int)partial_views(pictures->partial)->len : 0;
}

gboolean live_pictures_has_view(const LivePictures *pictures, int view) {
    if (pictures->partial == NULL)
        return FALSE;
    const int n_lights = (int)partial_lights(pictures->partial)->len;
    int n = 0;
    for (int light = 0; light < n_lights; light++)
        n += partial_picture(pictures->partial, view * n_lights + light) != NULL;
    return 2 * n >= n_lights;
}
