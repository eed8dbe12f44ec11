#include "window_private.h"

#include "recent.h"
#include "scene_files.h"
#include "series.h"

#include <epoxy/gl.h>
#include <gio/gio.h>
#include <glib/gstdio.h>
#include <string.h>

/* Returns the time in µs at which a file was last changed, or −1 if there is no file. */
static gint64 time_of(const char *path) {
    GStatBuf info;
    return path != NULL && g_stat(path, &info) == 0
               ? info.st_mtim.tv_sec * G_USEC_PER_SEC + info.st_mtim.tv_nsec / 1000
               : -1;
}

static void ask_mdf(struct window *w) {
    w->mdf_time = time_of(w->now.mdf_path);
    opener_ask(w->opener, OPENER_MDF, NULL, w->now.mdf_path);
}

void window_ask_mdf(struct window *w, const char *path) {
    w->outlines = TRUE;
    w->now.mdf_path = g_string_chunk_insert_const(w->texts, path);
    ask_mdf(w);
}

void window_ask_environment(struct window *w, const char *name) {
    opener_ask(w->opener, OPENER_ENVIRONMENT, NULL, name);
}

/* Requests to open, for a method, the MATERIAL that is being opened, or otherwise the MATERIAL that
 * is shown. */
static void ask_method(struct window *w, enum opener_place place, const struct method *method) {
    struct viewer_options options = w->now;
    if (w->asked_argument != NULL)
        options.argument = w->asked_argument;
    if (options.argument == NULL && method->product != NULL) {
        window_say(
            w,
            "There is no material yet that this method can draw; open a session first (Ctrl+O).");
        return;
    }
    g_autofree char *path = viewer_options_path(&options, method);
    if (place == OPENER_FIRST)
        w->asked_time = time_of(path);
    opener_ask(w->opener, place, method, path);
}

void window_ask_material(struct window *w, const char *argument, const struct method *method) {
    w->asked_argument = g_string_chunk_insert_const(w->texts, argument);
    ask_method(w, OPENER_FIRST, method);
}

static void show_live(struct window *w) {
    g_autoptr(GError) error = NULL;
    const gboolean good = viewer_set_material(w->viewer, w->live_maps, &error);
    if (good) {
        w->now.method = methods[0];
        g_free(w->material);
        w->material = method_path(w->now.method, w->session);
        w->file_time = time_of(w->material);
        w->stale = TRUE;
    }
    window_say(w, good ? NULL : error->message);
}

/* If eigen-maps of a session that is being captured are wanted, there is no file yet. live_maps are
 * then shown instead. */
void window_set_method(struct window *w, const struct method *method) {
    g_autofree char *product = w->live_maps != NULL ? method_path(methods[0], w->session) : NULL;
    if (method == methods[0] && product != NULL && time_of(product) < 0)
        show_live(w);
    else
        ask_method(w, OPENER_FIRST, method);
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

/* Removes the state of the previous material, and sets the paths of the new one. */
static void change_argument(struct window *w, const char *argument) {
    g_autofree char *folder = g_file_test(argument, G_FILE_TEST_IS_DIR)
                                  ? g_build_filename(argument, "products", NULL)
                                  : g_path_get_dirname(argument);
    g_autofree char *mdf = g_build_filename(folder, "mdf.exr", NULL);
    const gboolean outlines = w->now.settings.silhouettes;
    g_clear_pointer(&w->live, live_free);
    g_clear_pointer(&w->live_maps, eigenmaps_free);
    g_clear_pointer(&w->planned, g_array_unref);
    g_clear_pointer(&w->mdf, mdf_source_free);
    g_clear_pointer(&w->session, g_free);
    viewer_set_index(w->viewer, NULL, NULL);
    w->now.index_path = NULL;
    viewer_set_planned(w->viewer, NULL, 0);
    if (w->second != NULL)
        viewer_set_planned(w->second, NULL, 0);
    w->now.compose.mode = COMPOSE_ONE; /* the second picture belongs to the previous material */
    w->now.second = NULL;
    w->now.settings.silhouettes = FALSE;
    w->now.argument = argument;
    w->now.mdf_path = g_string_chunk_insert_const(w->texts, mdf);
    w->show_measured = FALSE;
    w->mdf_time = w->n_live = 0;
    w->looked_us = 0; /* check the files now */
    g_autofree char *database = g_build_filename(argument, "session.db", NULL);
    if (g_file_test(database, G_FILE_TEST_EXISTS))
        w->session = g_strdup(argument);
    if (outlines && g_file_test(mdf, G_FILE_TEST_EXISTS))
        window_ask_mdf(w, mdf);
}

void window_watch_session(struct window *w, const char *session) {
    g_autoptr(GError) error = NULL;
    opener_cancel(w->opener, OPENER_FIRST);
    w->asked_argument = NULL;
    change_argument(w, g_string_chunk_insert_const(w->texts, session));
    w->live = live_new(session);
    recent_add(session);
    w->now.method = method_find(METHOD_DEMO);
    g_free(w->material);
    w->material = g_strdup(METHOD_DEMO);
    w->file_time = -1;
    if (!viewer_open(w->viewer, w->now.method, NULL, &error))
        window_say(w, error->message);
    w->stale = TRUE;
}

/* Each function take_…() shows what was opened for a place, and takes it out of the job. */
static gboolean take_first(struct window *w, struct opened *o, GError **error) {
    if (!viewer_set_method(w->viewer, o->method, o->material, error))
        return FALSE;
    o->material = NULL;
    const gboolean is_new = w->asked_argument != NULL || !w->first_open;
    if (w->asked_argument != NULL)
        change_argument(w, w->asked_argument);
    w->asked_argument = NULL;
    if (is_new && w->now.argument != NULL && w->now.close_after == 0)
        recent_add(w->now.argument);
    w->now.method = o->method;
    w->file_time = w->asked_time;
    g_free(w->material);
    w->material = g_steal_pointer(&o->path);
    return TRUE;
}

static gboolean take_second(struct window *w, struct opened *o, GError **error) {
    if (w->second == NULL) {
        g_autoptr(Viewer) viewer = viewer_new(NULL, error);
        if (viewer == NULL || !scene_files_open(w->start, o->method, TRUE, viewer, error) ||
            !viewer_set_mesh(viewer, w->mesh, error) ||
            (w->environment != NULL && !viewer_set_environment(viewer, w->environment, error)) ||
            (w->mdf != NULL && !viewer_set_mdf(viewer, w->mdf, error)) ||
            !viewer_set_index(viewer, viewer_index(w->viewer), error))
            return FALSE;
        w->second = g_steal_pointer(&viewer);
        show_planned(w);
    }
    if (!viewer_set_method(w->second, o->method, o->material, error))
        return FALSE;
    o->material = NULL;
    w->now.second = o->method;
    g_free(w->second_material);
    w->second_material = g_steal_pointer(&o->path);
    w->now.compose.mode = w->second_mode;
    return TRUE;
}

static gboolean take_mdf(struct window *w, struct opened *o, GError **error) {
    if ((w->material != NULL && !mdf_source_fits(o->path, w->material, error)) ||
        !viewer_set_mdf(w->viewer, o->mdf, error) ||
        (w->second != NULL && !viewer_set_mdf(w->second, o->mdf, error)))
        return FALSE;
    mdf_source_free(w->mdf);
    w->mdf = g_steal_pointer(&o->mdf);
    w->now.settings.silhouettes |= w->outlines;
    w->outlines = FALSE;
    return TRUE;
}

static gboolean take_environment(struct window *w, struct opened *o, GError **error) {
    if (!viewer_set_environment(w->viewer, o->environment, error) ||
        (w->second != NULL && !viewer_set_environment(w->second, o->environment, error)))
        return FALSE;
    window_set_environment(w, g_steal_pointer(&o->environment), o->path);
    return TRUE;
}

gboolean window_take_opened(struct window *w, GError **error) {
    for (struct opened *o; (o = opener_poll(w->opener)) != NULL; opened_free(o)) {
        static gboolean (*const takers[OPENER_PLACES])(
            struct window * w, struct opened * o, GError * *error) = {take_first, take_second,
                                                                      take_mdf, take_environment};
        g_autoptr(GError) why = g_steal_pointer(&o->error);
        if (o->place == OPENER_FIRST && g_strcmp0(o->path, w->material) == 0)
            /* Also set after an error, so that the file is not opened again until it changes. */
            w->file_time = w->asked_time;
        if (o->place == OPENER_MDF && why != NULL)
            w->outlines = FALSE;
        const gboolean good = why == NULL && takers[o->place](w, o, &why);
        w->stale = TRUE;
        if (!good && o->place == OPENER_FIRST)
            w->asked_argument = NULL;
        if (!good && !w->first_open && w->now.close_after > 0) {
            g_propagate_error(error, g_steal_pointer(&why));
            opened_free(o);
            return FALSE;
        }
        if (!good)
            window_say(w, why->message);
        else if (w->is_error) /* the message is about an earlier attempt */
            window_say(w, NULL);
    }
    if (!w->first_open && !opener_is_busy(w->opener)) {
        w->first_open = TRUE;
        w->frames_due = WINDOW_FRAMES; /* the progress is not shown any more */
    }
    return TRUE;
}

void window_set_second(struct window *w, const struct method *method, enum compose_mode mode) {
    w->second_mode = mode;
    if (mode != COMPOSE_ONE && method != w->now.second)
        ask_method(w, OPENER_SECOND, method);
    else
        w->now.compose.mode = mode;
    w->stale = TRUE;
}

void window_toggle_silhouettes(struct window *w) {
    if (w->mdf != NULL || (w->start->n_bindings > 0 && w->start->argument == NULL)) {
        w->now.settings.silhouettes = !w->now.settings.silhouettes;
    } else {
        window_ask_mdf(w, w->now.mdf_path);
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
        measured_compare(reference, w->viewer, &w->now.settings, 3 * 64, &found, &error)) {
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
    window_say(w,
               error != NULL
                   ? error->message
                   : "only a session has measured pictures to compare with; open a session first");
}

/* Takes new eigen-maps of a session that is being captured. Shows them, unless the user has chosen
 * another method. When the file of the eigen-maps exists, stops following the session. */
static void follow_live(struct window *w) {
    g_autoptr(GError) error = NULL;
    int n_views = 0;
    struct eigenmaps *maps = live_poll(w->live, &n_views, &error);
    if (error != NULL)
        window_say(w, error->message);
    if (maps == NULL)
        return;
    const gboolean other =
        w->live_maps != NULL && w->now.method != methods[0]; /* the user chose another method */
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
    /* while a file is being opened, w->material may not be the file that is shown */
    if (!opener_is_busy(w->opener)) {
        if (w->mdf_time > 0 && time_of(w->now.mdf_path) != w->mdf_time)
            ask_mdf(w);
        /* Processing replaces the file as a whole, so an existing file can always be read. */
        const gint64 changed = time_of(w->material);
        if (changed != w->file_time && changed >= 0)
            window_set_method(w, w->now.method);
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
    if (w->live != NULL)
        live_mark_pictures(w->live, views);
    const gboolean news = w->planned == NULL || series_count(w->planned) != series_count(views);
    g_clear_pointer(&w->planned, g_array_unref);
    w->planned = views;
    if (news)
        show_planned(w);
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
    environment_free(w->environment);
    g_clear_pointer(&w->recent, g_ptr_array_unref);
    g_free(w->session);
    g_free(w->material);
    g_free(w->second_material);
    g_free(w->message);
}
