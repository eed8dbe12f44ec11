/* Opens files that the user names at the start or in a dialog, or drops on the window. */
#include "recent.h"
#include "scene_files.h"
#include "window_private.h"

#include <gio/gio.h>
#include <string.h>

/* Returns the present method if the session has a product for it. Otherwise returns the result of
 * method_of_session(), which is NULL if the session has no product. */
static const struct method *method_of(const struct window *w, const char *session) {
    const struct method *method = w->now.method;
    g_autofree char *path = method->product != NULL ? method_path(method, session) : NULL;
    return path != NULL && g_file_test(path, G_FILE_TEST_EXISTS) ? method
                                                                 : method_of_session(session);
}

static void window_open_session(struct window *w, const char *path) {
    const struct method *method = method_of(w, path);
    g_autofree char *database = g_build_filename(path, "session.db", NULL);
    if (method != NULL)
        window_ask_material(w, path, method);
    else if (g_file_test(database, G_FILE_TEST_EXISTS))
        window_watch_session(w, path);
    else
        window_ask_material(w, path, methods[0]); /* the error says how to make the file */
}

static void window_open_shape(struct window *w, const char *path) {
    const char *before = w->own_shape, *name = g_string_chunk_insert_const(w->texts, path);
    w->own_shape = name;
    window_set_shape(w, name, NULL);
    if (w->now.shape != name)
        w->own_shape = before;
    else
        recent_add(path);
}

void window_open(struct window *w, const char *path) {
    struct file_opened file;
    g_autoptr(GError) error = NULL;
    w->stale = TRUE;
    if (!file_kind_find(path, &file, &error)) {
        window_say(w, error->message);
        return;
    }
    window_show_page(w, WINDOW_NO_PAGE);
    window_say(w, NULL);
    switch (file.kind) {
    case FILE_KIND_SESSION:
        window_open_session(w, file.path);
        break;
    case FILE_KIND_MATERIAL:
        window_ask_material(w, file.path, file.method);
        break;
    case FILE_KIND_MDF:
        window_ask_mdf(w, file.path);
        break;
    case FILE_KIND_SHAPE:
        window_open_shape(w, file.path);
        break;
    case FILE_KIND_NORMALS:
        w->now.normal_map = g_string_chunk_insert(w->texts, file.path);
        window_set_method(w, w->now.method->takes_normals ? w->now.method
                                                          : method_find("metal-ashikhmin"));
        break;
    case FILE_KIND_ENVIRONMENT:
        window_ask_environment(w, file.path);
        break;
    }
    file_opened_clear(&file);
}

/* Returns whether the window shows eigen-maps of the existing views, because a session was given at
 * the start that does not have the product at path yet. */
static gboolean is_being_captured(const struct window *w, const char *path) {
    return w->session != NULL && w->start->method == methods[0] &&
           !g_file_test(path, G_FILE_TEST_EXISTS);
}

/* Returns TRUE if MATERIAL of the command line has to be opened as a material. If MATERIAL is
 * another kind of file, opens it and returns FALSE. If MATERIAL cannot be opened, shows the error
 * and returns FALSE.
 *
 * With close_after, always returns TRUE. Opening MATERIAL as a material then gives the error. */
static gboolean has_material(struct window *w) {
    const struct viewer_options *o = w->start;
    struct file_opened file;
    g_autoptr(GError) error = NULL;
    if (o->argument == NULL || o->close_after > 0)
        return TRUE;
    const gboolean good = file_kind_find(o->argument, &file, &error);
    if (good && (file.kind == FILE_KIND_SESSION || file.kind == FILE_KIND_MATERIAL)) {
        file_opened_clear(&file);
        return TRUE;
    }
    w->now.argument = NULL;
    if (good) {
        window_open(w, o->argument);
        file_opened_clear(&file);
    } else {
        window_show_page(w, WINDOW_START);
        window_say(w, error->message);
    }
    return FALSE;
}

/* Opens the index map given at the start. If the numbers of tiles were not given, rounds them to
 * whole repetitions of the map. */
static void window_open_index(struct window *w) {
    g_autoptr(GError) error = NULL;
    if (w->now.index_path == NULL)
        return;
    if (!viewer_open_index(w->viewer, w->now.index_path, &error)) {
        w->now.index_path = NULL;
        window_say(w, error->message);
        return;
    }
    if (w->start->tiles == NULL)
        viewer_whole_tiles(w->viewer, &w->now.settings.tiles_u, &w->now.settings.tiles_v);
}

/* Opens the materials of a scene. The window shows the scene when all materials have been read. */
static void window_open_scene(struct window *w) {
    const struct viewer_options *o = w->start;
    g_autoptr(GError) error = NULL;
    if (!scene_files_open(o, o->method, TRUE, w->viewer, &error)) {
        window_say(w, error->message);
        return;
    }
    if (o->n_bindings > 0 && o->argument == NULL) { /* otherwise after the main MDF was opened */
        w->now.settings.silhouettes = w->outlines;
        w->outlines = FALSE;
    }
    w->stale = TRUE;
}

void window_open_first(struct window *w) {
    const struct viewer_options *o = w->start;
    window_open_scene(w);
    if (!has_material(w)) {
        if (o->environment != NULL)
            window_ask_environment(w, o->environment);
        return;
    }
    g_autofree char *path = viewer_options_path(o, o->method);
    if (o->argument != NULL && g_file_test(o->argument, G_FILE_TEST_IS_DIR)) {
        g_autofree char *database = g_build_filename(o->argument, "session.db", NULL);
        w->session = g_file_test(database, G_FILE_TEST_EXISTS) ? g_strdup(o->argument) : NULL;
    }
    if (o->environment != NULL)
        window_ask_environment(w, o->environment);
    window_open_index(w);
    if (is_being_captured(w, path)) {
        w->live = live_new(w->session);
        if (o->close_after == 0)
            recent_add(w->session);
    } else {
        window_set_method(w, o->method);
    }
    if (w->outlines)
        window_ask_mdf(w, o->mdf_path);
    if (o->second != NULL)
        window_set_second(w, o->second, o->compose.mode);
    if (o->argument == NULL && o->method_name == NULL && o->close_after == 0)
        window_show_page(w, WINDOW_START);
}

void window_set_shape(struct window *w, const char *shape, const struct viewer_settings *tiles) {
    g_autoptr(GError) error = NULL;
    struct scene_options scene = {.up = w->now.upward, .floor = w->now.floor};
    if (tiles != NULL) {
        scene.tiles_u = tiles->tiles_u;
        scene.tiles_v = tiles->tiles_v;
    }
    struct mesh *mesh = scene_files_mesh(w->start, shape, &scene, &error);
    if (mesh == NULL || !viewer_set_mesh(w->viewer, mesh, &error) ||
        (w->second != NULL && !viewer_set_mesh(w->second, mesh, &error))) {
        window_say(w, error->message);
        mesh_free(mesh);
        return;
    }
    mesh_free(w->mesh);
    w->mesh = mesh;
    w->now.shape = (char *)shape;
    w->now.settings.tiles_u = mesh->tiles_u;
    w->now.settings.tiles_v = mesh->tiles_v;
    w->now.settings.camera_distance = w->start->settings.camera_distance;
    w->stale = TRUE;
    if (w->is_error)
        window_say(w, NULL);
}

void window_scale_tiles(struct window *w, double factor) {
    w->now.settings.tiles_u = CLAMP(w->now.settings.tiles_u * factor, 0.01, 500.0);
    w->now.settings.tiles_v = CLAMP(w->now.settings.tiles_v * factor, 0.01, 500.0);
    w->stale = TRUE;
}

/* Returns the folder of the present material, or the current directory if there is no material. */
static char *window_folder(const struct window *w) {
    g_autofree char *whole =
        w->now.argument != NULL ? g_canonicalize_filename(w->now.argument, NULL) : NULL;
    return whole != NULL ? g_path_get_dirname(whole) : g_get_current_dir();
}

void window_ask_file(struct window *w, enum chooser_what what) {
    g_autofree char *folder = NULL, *name = NULL;
    if (what == CHOOSER_SAVE)
        name = window_picture_name(w, &folder);
    else
        folder = window_folder(w);
    w->chooser_what = what;
    chooser_ask(w->chooser, what, folder, name);
    window_follow_chooser(w);
}

static void take_chosen(struct window *w, const char *path) {
    if (w->chooser_what == CHOOSER_SAVE)
        window_save_named(w, path,
                          TRUE); /* the dialog has asked whether to replace an existing file */
    else
        window_open(w, path);
}

void window_follow_chooser(struct window *w) {
    g_autofree char *path = NULL;
    const enum chooser_state state = chooser_poll(w->chooser, &path);
    if (state == CHOOSER_CHOSEN) {
        take_chosen(w, path);
    } else if (state == CHOOSER_UNAVAILABLE) {
        g_autofree char *folder = NULL, *name = NULL;
        if (w->chooser_what == CHOOSER_SAVE)
            name = window_picture_name(w, &folder);
        else
            folder = window_folder(w);
        window_files_begin(w, w->chooser_what, folder, name);
        window_show_page(w, WINDOW_FILES);
    }
}
