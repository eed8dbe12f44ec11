#include "window_private.h"

#include "series.h"

#include <epoxy/gl.h>
#include <glib/gstdio.h>
#include <string.h>

void window_say(struct window *w, const char *message) {
    if (message != NULL)
        g_printerr("mesorig-view: %s\n", message);
    g_free(w->message);
    w->message = g_strdup(message);
    w->frames_due = WINDOW_FRAMES;
}

static gint64 time_of(const char *path) {
    GStatBuf info;
    return path != NULL && g_stat(path, &info) == 0
               ? info.st_mtim.tv_sec * G_USEC_PER_SEC + info.st_mtim.tv_nsec / 1000
               : -1;
}

static void ask_mdf(struct window *w) {
    w->mdf_time = time_of(w->options->mdf_path);
    opener_ask(w->opener, OPENER_MDF, NULL, w->options->mdf_path);
}

static void ask_method(struct window *w, enum opener_place place, const struct method *method) {
    g_autofree char *path = viewer_options_path(w->options, method);
    if (place == OPENER_FIRST)
        w->asked_time = time_of(path);
    opener_ask(w->opener, place, method, path);
}

static void show_live(struct window *w) {
    g_autoptr(GError) error = NULL;
    const gboolean good = viewer_set_material(w->viewer, w->live_maps, &error);
    if (good) {
        w->method = methods[0];
        g_free(w->material);
        w->material = method_path(w->method, w->session);
        w->file_time = time_of(w->material);
        w->stale = TRUE;
    }
    window_say(w, good ? NULL : error->message);
}

/* While a session is captured its eigen-maps are those of the views that are there. */
void window_set_method(struct window *w, const struct method *method) {
    g_autofree char *product = w->live_maps != NULL ? method_path(methods[0], w->session) : NULL;
    if (method == methods[0] && product != NULL && time_of(product) < 0)
        show_live(w);
    else
        ask_method(w, OPENER_FIRST, method);
}

static gboolean take_first(struct window *w, struct opened *o, GError **error) {
    if (!viewer_set_method(w->viewer, o->method, o->material, error))
        return FALSE;
    o->material = NULL;
    w->method = o->method;
    w->file_time = w->asked_time;
    g_free(w->material);
    w->material = g_steal_pointer(&o->path);
    return TRUE;
}

/* Hatches pictures where views are missing. */
static void show_planned(struct window *w) {
    Viewer *const both[2] = {w->viewer, w->second};
    for (int k = 0; k < 2; k++)
        if (both[k] != NULL && w->planned != NULL)
            viewer_set_planned(both[k], (const struct planned_view *)(const void *)w->planned->data,
                               w->planned->len);
    w->stale = TRUE;
}

gboolean window_set_environment(const struct window *w, Viewer *viewer, GError **error) {
    return w->environment == NULL || viewer_set_environment(viewer, w->environment, error);
}

static gboolean take_second(struct window *w, struct opened *o, GError **error) {
    if (w->second == NULL) {
        g_autoptr(Viewer) viewer = viewer_new(NULL, error);
        if (viewer == NULL || !viewer_set_mesh(viewer, w->mesh, error) ||
            !window_set_environment(w, viewer, error) ||
            (w->mdf != NULL && !viewer_set_mdf(viewer, w->mdf, error)))
            return FALSE;
        w->second = g_steal_pointer(&viewer);
        show_planned(w);
    }
    if (!viewer_set_method(w->second, o->method, o->material, error))
        return FALSE;
    o->material = NULL;
    w->second_method = o->method;
    g_free(w->second_material);
    w->second_material = g_steal_pointer(&o->path);
    w->how.mode = w->second_mode;
    return TRUE;
}

static gboolean take_mdf(struct window *w, struct opened *o, GError **error) {
    if (!viewer_set_mdf(w->viewer, o->mdf, error) ||
        (w->second != NULL && !viewer_set_mdf(w->second, o->mdf, error)))
        return FALSE;
    mdf_source_free(w->mdf);
    w->mdf = g_steal_pointer(&o->mdf);
    w->settings.silhouettes |= w->outlines;
    w->outlines = FALSE;
    return TRUE;
}

gboolean window_take_opened(struct window *w, GError **error) {
    for (struct opened *o; (o = opener_poll(w->opener)) != NULL; opened_free(o)) {
        static gboolean (*const takers[OPENER_PLACES])(struct window * w, struct opened * o,
                                                       GError * *error) = {take_first, take_second,
                                                                           take_mdf};
        g_autoptr(GError) why = g_steal_pointer(&o->error);
        if (o->place == OPENER_FIRST && g_strcmp0(o->path, w->material) == 0)
            w->file_time =
                w->asked_time; /* in either case it is not opened again until it changes */
        if (o->place == OPENER_MDF && why != NULL)
            w->outlines = FALSE;
        const gboolean good = why == NULL && takers[o->place](w, o, &why);
        w->stale = TRUE;
        if (!good && !w->first_open) {
            g_propagate_error(error, g_steal_pointer(&why));
            opened_free(o);
            return FALSE;
        }
        window_say(w, good ? NULL : why->message);
    }
    if (!w->first_open && !opener_is_busy(w->opener)) {
        w->first_open = TRUE;
        w->frames_due = WINDOW_FRAMES; /* the progress is no longer shown */
    }
    return TRUE;
}

void window_set_second(struct window *w, const struct method *method, enum compose_mode mode) {
    w->second_mode = mode;
    if (mode != COMPOSE_ONE && method != w->second_method)
        ask_method(w, OPENER_SECOND, method);
    else
        w->how.mode = mode;
    w->stale = TRUE;
}

void window_set_shape(struct window *w, const char *shape, const struct viewer_settings *tiles) {
    g_autoptr(GError) error = NULL;
    struct scene_options scene = {.up = w->options->upward, .floor = w->options->floor};
    if (tiles != NULL) {
        scene.tiles_u = tiles->tiles_u;
        scene.tiles_v = tiles->tiles_v;
    }
    struct mesh *mesh = scene_make(shape, &scene, &error);
    if (mesh == NULL || !viewer_set_mesh(w->viewer, mesh, &error) ||
        (w->second != NULL && !viewer_set_mesh(w->second, mesh, &error))) {
        window_say(w, error->message);
        mesh_free(mesh);
        return;
    }
    mesh_free(w->mesh);
    w->mesh = mesh;
    w->shape = shape;
    w->settings.tiles_u = mesh->tiles_u;
    w->settings.tiles_v = mesh->tiles_v;
    w->settings.camera_distance = w->options->settings.camera_distance;
    w->stale = TRUE;
    window_say(w, NULL);
}

void window_scale_tiles(struct window *w, double factor) {
    w->settings.tiles_u = CLAMP(w->settings.tiles_u * factor, 0.01, 500.0);
    w->settings.tiles_v = CLAMP(w->settings.tiles_v * factor, 0.01, 500.0);
    w->stale = TRUE;
}

void window_toggle_backdrop(struct window *w) {
    if (w->environment == NULL)
        window_say(w, "there is no environment to be seen: start with --environment FILE.exr");
    else
        w->settings.backdrop = !w->settings.backdrop;
    w->stale = TRUE;
}

void window_toggle_silhouettes(struct window *w) {
    if (w->mdf != NULL) {
        w->settings.silhouettes = !w->settings.silhouettes;
    } else {
        w->outlines = TRUE;
        ask_mdf(w);
    }
    w->stale = TRUE;
}

void window_compare_measured(struct window *w) {
    g_autoptr(GError) error = NULL;
    g_autofree char *btf =
        w->session != NULL ? g_build_filename(w->session, "products", "btf", NULL) : NULL;
    g_autoptr(Reference) reference = btf != NULL ? reference_open(btf, &error) : NULL;
    struct measured found = {0};
    if (reference != NULL &&
        measured_compare(reference, w->viewer, &w->settings, 3 * 64, &found, &error)) {
        measured_clear(&w->measured);
        glDeleteTextures(1, &w->measured_texture);
        w->measured = found;
        w->measured_texture = gpu_texture(GL_RGBA8, found.width, found.height, 0);
        glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
        glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, found.width, found.height, GL_RGB, GL_UNSIGNED_BYTE,
                        found.rgb);
        return;
    }
    w->show_measured = FALSE;
    window_say(w, error != NULL ? error->message
                                : "only a session has measured frames to compare with");
}

/* Until there are eigen-maps of the whole. */
static void follow_live(struct window *w) {
    g_autoptr(GError) error = NULL;
    int n_views = 0;
    struct eigenmaps *maps = live_poll(w->live, &n_views, &error);
    if (error != NULL)
        window_say(w, error->message);
    if (maps == NULL)
        return;
    const gboolean other = w->live_maps != NULL && w->method != methods[0]; /* was chosen since */
    w->n_live = n_views;
    eigenmaps_free(w->live_maps);
    w->live_maps = maps;
    if (!other)
        show_live(w);
    g_autofree char *product = method_path(methods[0], w->session);
    if (time_of(product) >= 0)
        g_clear_pointer(&w->live, live_free);
}

void window_follow(struct window *w) {
    const gint64 now = g_get_monotonic_time();
    if (now - w->looked_us < G_USEC_PER_SEC)
        return;
    w->looked_us = now;
    if (!opener_is_busy(w->opener)) { /* else the file may not be the one that is shown */
        if (w->mdf_time > 0 && time_of(w->options->mdf_path) != w->mdf_time)
            ask_mdf(w);
        /* Processing replaces the file as a whole, so an existing file can be read at once. */
        const gint64 changed = time_of(w->material);
        if (changed != w->file_time && changed >= 0)
            window_set_method(w, w->method);
    }
    if (w->live != NULL)
        follow_live(w);
    if (w->session == NULL || (w->planned != NULL && w->live == NULL))
        return;
    g_autoptr(GError) error = NULL;
    GArray *views = live_views(w->session, &error);
    if (views == NULL) {
        window_say(w, error->message);
        return;
    }
    const gboolean news = w->planned == NULL || series_count(w->planned) != series_count(views);
    g_clear_pointer(&w->planned, g_array_unref);
    w->planned = views;
    if (news)
        show_planned(w);
}

/* A session without the product that is asked for is one that is still being captured. */
void window_open_first(struct window *w) {
    const struct viewer_options *o = w->options;
    g_autofree char *path = viewer_options_path(o, o->method);
    if (o->argument != NULL && g_file_test(o->argument, G_FILE_TEST_IS_DIR)) {
        g_autofree char *database = g_build_filename(o->argument, "session.db", NULL);
        w->session = g_file_test(database, G_FILE_TEST_EXISTS) ? g_strdup(o->argument) : NULL;
    }
    if (w->session != NULL && o->method == methods[0] && time_of(path) < 0)
        w->live = live_new(w->session);
    else
        ask_method(w, OPENER_FIRST, o->method);
    if (w->outlines)
        ask_mdf(w);
    if (o->second != NULL)
        window_set_second(w, o->second, o->compose.mode);
}

void window_clear_sources(struct window *w) {
    opener_free(w->opener);
    live_free(w->live);
    eigenmaps_free(w->live_maps);
    g_clear_pointer(&w->planned, g_array_unref);
    measured_clear(&w->measured);
    glDeleteTextures(1, &w->measured_texture);
    viewer_free(w->viewer);
    viewer_free(w->second);
    mesh_free(w->mesh);
    mdf_source_free(w->mdf);
    g_free(w->session);
    g_free(w->material);
    g_free(w->second_material);
    g_free(w->message);
}
