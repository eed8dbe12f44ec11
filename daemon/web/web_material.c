#include "web_material.h"

#include <gio/gio.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include "base/json.h"
#include "directions/directions.h"
#include "partial/partial_forecast.h"

#define LOOK_US       (G_USEC_PER_SEC / 5) /* time between two looks at the session */
#define OPEN_AGAIN_S  2  /* seconds until a session that could not be read is tried again */
#define READ_TOGETHER 16 /* maximum number of pictures between two events */
#define FORECAST_S    3  /* minimum time between two forecasts */
/* minimum time between two forecasts, relative to the processor time of the last one */
#define FORECAST_REST 15
#define MAX_KEPT      256 /* number of predicted pictures that are kept until the next forecast */
#define READ_NICE     5
#define FORECAST_NICE 15

/* A request for a picture. It is answered in the main loop. */
struct request {
    int pair; /* −1: the thread is only woken up */
    WebMaterialPicture back;
    gpointer data;
    GBytes *picture;
    GError *error;
    gboolean answered; /* in the main loop */
};

/* A session that is followed. The main loop, the thread, and each struct told have a reference. */
struct following {
    char *directory;
    GThread *thread;
    GCancellable *stop;
    GAsyncQueue *requests; /* of struct request */

    /* members of the main loop */
    WebMaterial *material; /* NULL if the session is not followed any more */
    GPtrArray *waiting;    /* of struct request, not owned */
    char *session, *layout, *problem;
    int n_pairs, n_measured, n_forecasts;
    GBytes **pictures; /* for each pair: the measured picture, or NULL */
    PartialForecast *forecast;
};

/* What the thread tells the main loop. Members that are NULL have not changed. */
struct told {
    struct following *following;
    char *session, *layout; /* layout has the constant members of web_material_text() */
    int n_pairs;
    GArray *fresh;       /* of int: pairs that were measured */
    GPtrArray *pictures; /* of GBytes: their pictures */
    PartialForecast *forecast;
    char *problem;
};

struct WebMaterial {
    WebMaterialNews news;
    gpointer data;
    struct following *following; /* NULL if no session is followed */
};

static void following_clear(gpointer data) {
    struct following *following = data;
    g_async_queue_unref(following->requests);
    g_object_unref(following->stop);
    g_ptr_array_unref(following->waiting);
    g_free(following->directory);
    g_free(following->session);
    g_free(following->layout);
    g_free(following->problem);
    for (int pair = 0; pair < following->n_pairs; pair++)
        g_clear_pointer(&following->pictures[pair], g_bytes_unref);
    g_free(following->pictures);
    partial_forecast_unref(following->forecast);
}

static void following_unref(struct following *following) {
    g_atomic_rc_box_release_full(following, following_clear);
}

/* Wakes the thread up. */
static void wake(struct following *following) {
    struct request *request = g_new0(struct request, 1);
    request->pair = -1;
    g_async_queue_push(following->requests, request);
}

/* --- the main loop: answers and news */

static void append_expected(GString *to, const PartialForecast *forecast) {
    char number[G_ASCII_DTOSTR_BUF_SIZE], high[G_ASCII_DTOSTR_BUF_SIZE];
    double range[2];
    int n = 0;
    const struct partial_later *later = forecast ? partial_forecast_later(forecast, &n) : NULL;
    g_string_append_printf(
        to, "\"expected_error\": %s, \"expected_error_range\": ",
        forecast ? g_ascii_formatd(number, sizeof number, "%.5f", partial_forecast_error(forecast))
                 : "null");
    if (forecast) {
        partial_forecast_error_range(forecast, range);
        g_string_append_printf(to, "[%s, %s]",
                               g_ascii_formatd(number, sizeof number, "%.5f", range[0]),
                               g_ascii_formatd(high, sizeof high, "%.5f", range[1]));
    } else {
        g_string_append(to, "null");
    }
    g_string_append(to, ", \"later\": [");
    for (int i = 0; i < n; i++)
        g_string_append_printf(to, "%s[%d, %s]", i ? ", " : "", later[i].shots,
                               g_ascii_formatd(number, sizeof number, "%.5f", later[i].error));
    g_string_append_c(to, ']');
}

static void tell_news(const struct following *following, const GArray *fresh) {
    g_autoptr(GString) json = g_string_new("{\"session\": ");
    json_append_string(json, following->session);
    g_string_append_printf(json, ", \"measured\": %d, \"forecast\": %d, ", following->n_measured,
                           following->n_forecasts);
    append_expected(json, following->forecast);
    g_string_append(json, ", \"new\": [");
    for (guint i = 0; fresh && i < fresh->len; i++)
        g_string_append_printf(json, "%s%d", i ? ", " : "", g_array_index(fresh, int, i));
    g_string_append(json, "]}");
    following->material->news(json->str, following->material->data);
}

static void take(struct following *following, struct told *told) {
    if (told->layout) {
        following->session = g_steal_pointer(&told->session);
        following->layout = g_steal_pointer(&told->layout);
        following->n_pairs = told->n_pairs;
        following->pictures = g_new0(GBytes *, told->n_pairs);
        g_clear_pointer(&following->problem, g_free);
    }
    for (guint i = 0; told->fresh && i < told->fresh->len; i++) {
        GBytes **picture = &following->pictures[g_array_index(told->fresh, int, i)];
        following->n_measured += !*picture;
        g_clear_pointer(picture, g_bytes_unref);
        *picture = g_bytes_ref(told->pictures->pdata[i]);
    }
    if (told->forecast) {
        partial_forecast_unref(following->forecast);
        following->forecast = g_steal_pointer(&told->forecast);
        following->n_forecasts++;
    }
    if (told->problem) {
        g_free(following->problem);
        following->problem = g_steal_pointer(&told->problem);
    }
}

static void told_free(struct told *told) {
    if (told->fresh)
        g_array_unref(told->fresh);
    if (told->pictures)
        g_ptr_array_unref(told->pictures);
    partial_forecast_unref(told->forecast);
    g_free(told->session);
    g_free(told->layout);
    g_free(told->problem);
    following_unref(told->following);
    g_free(told);
}

static gboolean on_told(gpointer data) {
    struct told *told = data;
    struct following *following = told->following;
    if (following->material) {
        take(following, told);
        if (following->layout)
            tell_news(following, told->fresh);
    }
    told_free(told);
    return G_SOURCE_REMOVE;
}

struct answer {
    struct following *following;
    struct request *request;
};

static void answer(struct following *following, struct request *request) {
    if (request->answered)
        return;
    request->answered = TRUE;
    g_ptr_array_remove_fast(following->waiting, request);
    request->back(request->picture, request->error, request->data);
}

static gboolean on_answer(gpointer data) {
    g_autofree struct answer *of = data;
    struct request *request = of->request;
    if (request->pair >= 0)
        answer(of->following, request);
    g_clear_pointer(&request->picture, g_bytes_unref);
    g_clear_error(&request->error);
    g_free(request);
    following_unref(of->following);
    return G_SOURCE_REMOVE;
}

/* --- the threads */

/* Lowers the priority of the calling thread. A service may not be allowed to; the thread then works
 * with the priority of the process. */
static void work_quietly(int nice) {
    if (setpriority(PRIO_PROCESS, (id_t)gettid(), nice) != 0)
        g_debug("the priority of a thread cannot be lowered: %s", g_strerror(errno));
}

struct reader {
    struct following *following;
    Partial *partial;
    PartialForecast *forecast; /* the last one; NULL before */
    GHashTable *kept;          /* pair → GBytes: pictures that forecast has predicted */
    /* the forecast that is being made */
    GThread *forecaster; /* NULL if there is none */
    gint ready;          /* atomic: forecaster has finished */
    struct partial_sample *sample;
    PartialForecast *made;
    double cpu_s;
    char *failed;
    gint64 due_us; /* time from which the next forecast may be made */
};

static struct told *told_new(const struct reader *reader) {
    struct told *told = g_new0(struct told, 1);
    told->following = g_atomic_rc_box_acquire(reader->following);
    return told;
}

static void append_directions(GString *to, const char *name, const GPtrArray *directions) {
    char theta[G_ASCII_DTOSTR_BUF_SIZE], phi[G_ASCII_DTOSTR_BUF_SIZE];
    g_string_append_printf(to, ", \"%s\": [", name);
    for (guint i = 0; i < directions->len; i++) {
        const struct session_direction *direction = directions->pdata[i];
        g_string_append_printf(to, "%s[%s, %s]", i ? ", " : "",
                               g_ascii_formatd(theta, sizeof theta, "%.4f", direction->theta_deg),
                               g_ascii_formatd(phi, sizeof phi, "%.4f", direction->phi_deg));
    }
    g_string_append_c(to, ']');
}

/* Appends the rings or, without rings, the triangles that say how to interpolate between
 * directions. If there are too few directions, both are empty. */
static void append_between(GString *to, const char *name, const GPtrArray *directions) {
    const int n = (int)directions->len;
    g_autofree float *theta_deg = g_new(float, n), *phi_deg = g_new(float, n);
    g_autofree int *indices = g_new(int, n);
    int n_triangles = 0;
    for (int i = 0; i < n; i++) {
        const struct session_direction *direction = directions->pdata[i];
        theta_deg[i] = (float)direction->theta_deg;
        phi_deg[i] = (float)direction->phi_deg;
    }
    g_autoptr(Directions) all = directions_new(theta_deg, phi_deg, n, NULL);
    g_string_append_printf(to, ", \"%s_rings\": [", name);
    for (int ring = 0; all && ring < directions_n_rings(all); ring++) {
        const int members = directions_ring(all, ring, indices);
        for (int i = 0; i < members; i++)
            g_string_append_printf(to, "%s%d", i ? ", " : ring ? ", [" : "[", indices[i]);
        g_string_append_c(to, ']');
    }
    const int *corners = all ? directions_triangles(all, &n_triangles) : NULL;
    g_string_append_printf(to, "], \"%s_triangles\": [", name);
    for (int i = 0; i < 3 * n_triangles; i++)
        g_string_append_printf(to, "%s%d", i ? ", " : "", corners[i]);
    g_string_append_c(to, ']');
}

static char *layout_text(const Partial *partial) {
    const struct session_grid *grid = partial_grid(partial);
    char width[G_ASCII_DTOSTR_BUF_SIZE], height[G_ASCII_DTOSTR_BUF_SIZE];
    GString *to = g_string_new(NULL);
    g_string_append_printf(to, "\"width\": %d, \"height\": %d, \"width_mm\": %s, \"height_mm\": %s",
                           grid->width, grid->height,
                           g_ascii_formatd(width, sizeof width, "%g", grid->width_mm),
                           g_ascii_formatd(height, sizeof height, "%g", grid->height_mm));
    append_directions(to, "views", partial_views(partial));
    append_directions(to, "lights", partial_lights(partial));
    append_between(to, "view", partial_views(partial));
    append_between(to, "light", partial_lights(partial));
    return g_string_free(to, FALSE);
}

/* Opens the session. If it cannot be read, says so and waits. */
static void open_session(struct reader *reader) {
    struct following *following = reader->following;
    g_autoptr(GError) error = NULL;
    reader->partial = partial_open(following->directory, &error);
    struct told *told = told_new(reader);
    if (reader->partial) {
        told->session = g_path_get_basename(following->directory);
        told->layout = layout_text(reader->partial);
        told->n_pairs = partial_n_pairs(reader->partial);
    } else {
        told->problem = g_strdup(error->message);
    }
    g_idle_add(on_told, told);
}

static void read_more(struct reader *reader) {
    g_autoptr(GError) error = NULL;
    struct told *told = told_new(reader);
    told->fresh = g_array_new(FALSE, FALSE, sizeof(int));
    if (!partial_read(reader->partial, READ_TOGETHER, told->fresh, &told->problem, &error) &&
        !told->problem)
        told->problem = g_strdup(error->message);
    told->pictures = g_ptr_array_new_with_free_func((GDestroyNotify)g_bytes_unref);
    for (guint i = 0; i < told->fresh->len; i++)
        g_ptr_array_add(told->pictures, g_bytes_ref(partial_picture(
                                            reader->partial, g_array_index(told->fresh, int, i))));
    if (told->fresh->len > 0 || told->problem)
        g_idle_add(on_told, told);
    else
        told_free(told);
}

static gpointer make_forecast(gpointer data) {
    struct reader *reader = data;
    const struct work work = {.n_threads = 1, .cancellable = reader->following->stop};
    g_autoptr(GError) error = NULL;
    struct timespec used;
    work_quietly(FORECAST_NICE);
    reader->made = partial_forecast_new(reader->sample, reader->forecast, &work, &error);
    reader->failed = error ? g_strdup(error->message) : NULL;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &used);
    reader->cpu_s = (double)used.tv_sec + 1e-9 * (double)used.tv_nsec;
    g_atomic_int_set(&reader->ready, TRUE);
    wake(reader->following);
    return NULL;
}

/* Takes the forecast that has been made. */
static void end_forecast(struct reader *reader) {
    g_thread_join(g_steal_pointer(&reader->forecaster));
    const double rest_s = MAX(FORECAST_S, FORECAST_REST * reader->cpu_s);
    reader->due_us = g_get_monotonic_time() + (gint64)(rest_s * G_USEC_PER_SEC);
    g_clear_pointer(&reader->sample, partial_sample_free);
    struct told *told = told_new(reader);
    told->problem = g_steal_pointer(&reader->failed);
    if (reader->made) {
        partial_forecast_unref(reader->forecast);
        reader->forecast = g_steal_pointer(&reader->made);
        told->forecast = partial_forecast_ref(reader->forecast);
        g_hash_table_remove_all(reader->kept);
    }
    g_idle_add(on_told, told);
}

/* Begins a forecast if there are pictures that the last forecast does not know. */
static void begin_forecast(struct reader *reader) {
    const int n = partial_n_measured(reader->partial);
    if (n == 0 || g_get_monotonic_time() < reader->due_us ||
        (reader->forecast && partial_forecast_n_measured(reader->forecast) == n))
        return;
    if (!(reader->sample = partial_sample(reader->partial, NULL)))
        return;
    reader->ready = FALSE;
    reader->forecaster = g_thread_new("forecast", make_forecast, reader);
}

/* Finds the picture of a pair, or predicts it. */
static GBytes *find_picture(struct reader *reader, int pair, GError **error) {
    GBytes *picture = NULL;
    if (reader->partial && pair < partial_n_pairs(reader->partial) &&
        !(picture = partial_picture(reader->partial, pair)) &&
        !(picture = g_hash_table_lookup(reader->kept, GINT_TO_POINTER(pair))) && reader->forecast &&
        (picture = partial_forecast_picture(reader->forecast, reader->partial, pair))) {
        if (g_hash_table_size(reader->kept) >= MAX_KEPT)
            g_hash_table_remove_all(reader->kept);
        g_hash_table_insert(reader->kept, GINT_TO_POINTER(pair), picture);
    }
    if (picture)
        return g_bytes_ref(picture);
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                "there is no picture %d, neither measured nor predicted; /api/v1/material lists "
                "the pairs of a view and a light",
                pair);
    return NULL;
}

static void serve(struct reader *reader, struct request *request) {
    struct answer *of = g_new(struct answer, 1);
    if (request->pair >= 0)
        request->picture = find_picture(reader, request->pair, &request->error);
    *of = (struct answer){g_atomic_rc_box_acquire(reader->following), request};
    g_idle_add(on_answer, of);
}

static gpointer follow(gpointer data) {
    struct reader reader = {.following = data};
    struct following *following = data;
    gint64 look_us = 0;
    work_quietly(READ_NICE);
    reader.kept = g_hash_table_new_full(NULL, NULL, NULL, (GDestroyNotify)g_bytes_unref);
    while (!g_cancellable_is_cancelled(following->stop)) {
        const gint64 wait_us = MAX(look_us - g_get_monotonic_time(), 0);
        struct request *request =
            wait_us > 0 ? g_async_queue_timeout_pop(following->requests, (guint64)wait_us)
                        : g_async_queue_try_pop(following->requests);
        if (request)
            serve(&reader, request);
        if (reader.forecaster && g_atomic_int_get(&reader.ready))
            end_forecast(&reader);
        if (g_get_monotonic_time() < look_us)
            continue;
        if (!reader.partial)
            open_session(&reader);
        if (reader.partial)
            read_more(&reader);
        if (reader.partial && !reader.forecaster)
            begin_forecast(&reader);
        look_us =
            g_get_monotonic_time() + (reader.partial ? LOOK_US : OPEN_AGAIN_S * G_USEC_PER_SEC);
    }
    if (reader.forecaster)
        end_forecast(&reader);
    for (struct request *left; (left = g_async_queue_try_pop(following->requests));)
        serve(&reader, left);
    g_hash_table_unref(reader.kept);
    partial_forecast_unref(reader.forecast);
    partial_free(reader.partial);
    following_unref(following);
    return NULL;
}

/* --- the interface */

WebMaterial *web_material_new(WebMaterialNews news, gpointer data) {
    WebMaterial *material = g_new0(WebMaterial, 1);
    material->news = news;
    material->data = data;
    return material;
}

/* Ends a thread without waiting for it, and answers the requests that wait. */
static GThread *leave(WebMaterial *material) {
    struct following *following = g_steal_pointer(&material->following);
    g_autoptr(GError) error =
        g_error_new_literal(G_IO_ERROR, G_IO_ERROR_CANCELLED, "the session has changed");
    GThread *thread = following->thread;
    following->material = NULL;
    while (following->waiting->len > 0) {
        struct request *request = following->waiting->pdata[0];
        request->answered = TRUE;
        g_ptr_array_remove_index_fast(following->waiting, 0);
        request->back(NULL, error, request->data);
    }
    g_cancellable_cancel(following->stop);
    wake(following);
    following_unref(following);
    return thread;
}

void web_material_free(WebMaterial *material) {
    if (!material)
        return;
    if (material->following)
        g_thread_join(leave(material));
    g_free(material);
}

void web_material_follow(WebMaterial *material, const char *directory) {
    const char *now = material->following ? material->following->directory : "";
    if (g_strcmp0(now, directory ? directory : "") == 0)
        return;
    if (material->following)
        g_thread_unref(leave(material));
    if (!directory || !*directory)
        return;
    struct following *following = g_atomic_rc_box_new0(struct following);
    following->directory = g_strdup(directory);
    following->stop = g_cancellable_new();
    following->requests = g_async_queue_new();
    following->waiting = g_ptr_array_new();
    following->material = material;
    material->following = following;
    following->thread = g_thread_new("material", follow, g_atomic_rc_box_acquire(following));
}

static int pair_state(const struct following *following, int pair) {
    if (following->pictures[pair])
        return 0;
    if (!following->forecast)
        return -1;
    const double error = partial_forecast_pair_error(following->forecast, pair);
    return (int)CLAMP(1000 * error, 1, 9999);
}

char *web_material_text(const WebMaterial *material, GError **error) {
    const struct following *following = material->following;
    if (!following || !following->layout) {
        g_set_error_literal(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                            !following           ? "no session is captured"
                            : following->problem ? following->problem
                                                 : "the session is being read; ask again");
        return NULL;
    }
    GString *json = g_string_new("{\"session\": ");
    json_append_string(json, following->session);
    g_string_append_printf(json, ", %s, \"measured\": %d, \"forecast\": %d, ", following->layout,
                           following->n_measured, following->n_forecasts);
    append_expected(json, following->forecast);
    g_string_append(json, ", \"pairs\": [");
    for (int pair = 0; pair < following->n_pairs; pair++)
        g_string_append_printf(json, "%s%d", pair ? ", " : "", pair_state(following, pair));
    g_string_append(json, "], \"problem\": ");
    json_append_string(json, following->problem ? following->problem : "");
    g_string_append(json, "}\n");
    return g_string_free(json, FALSE);
}

void web_material_picture(WebMaterial *material, int pair, WebMaterialPicture back, gpointer data) {
    struct following *following = material->following;
    if (!following) {
        g_autoptr(GError) error = NULL;
        g_free(web_material_text(material, &error));
        back(NULL, error, data);
        return;
    }
    if (pair < following->n_pairs && following->pictures[pair]) {
        back(following->pictures[pair], NULL, data);
        return;
    }
    struct request *request = g_new0(struct request, 1);
    *request = (struct request){.pair = pair, .back = back, .data = data};
    g_ptr_array_add(following->waiting, request);
    g_async_queue_push(following->requests, request);
}
