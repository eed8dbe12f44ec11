#include "live.h"

#include <gio/gio.h>

#include "exr/exr.h"
#include "live_pictures.h"
#include "scene/reference.h"
#include "session/session.h"

#define TERMS     4 /* number of terms, as in Wang et al. 2005 §5 */
#define PICTURE_S 5 /* time in s from the end of a computation until pictures are read again */

static gboolean get_column(int view, float *ret_column, gpointer data, GError **error) {
    return reference_read_view(data, view, ret_column, error);
}

static struct eigenmaps *maps_like(const struct reference_info *info, const char *session) {
    struct eigenmaps *maps = g_new0(struct eigenmaps, 1);
    maps->name = g_path_get_basename(session);
    maps->layout.width = info->width;
    maps->layout.height = info->height;
    maps->layout.texel_mm = 1.0;
    maps->layout.views.n = info->n_views;
    maps->layout.lights.n = info->n_lights;
    maps->n_terms = MIN(TERMS, info->n_views);
    maps->layout.views.theta_deg = g_memdup2(info->view_theta_deg, sizeof(float) * info->n_views);
    maps->layout.views.phi_deg = g_memdup2(info->view_phi_deg, sizeof(float) * info->n_views);
    maps->layout.lights.theta_deg =
        g_memdup2(info->light_theta_deg, sizeof(float) * info->n_lights);
    maps->layout.lights.phi_deg = g_memdup2(info->light_phi_deg, sizeof(float) * info->n_lights);
    return maps;
}

struct eigenmaps *live_eigenmaps(const char *session, int *ret_n_views, GError **error) {
    g_autofree char *btf = g_build_filename(session, "products", "btf", NULL);
    g_autoptr(Reference) reference = reference_open(btf, error);
    if (reference == NULL)
        return NULL;
    const struct reference_info info = reference_info(reference);
    struct eigenmaps *maps = maps_like(&info, session);
    double rest;
    *ret_n_views = info.n_views;
    if (!eigenmaps_compute(maps, get_column, reference, &rest, error))
        g_clear_pointer(&maps, eigenmaps_free);
    return maps;
}

GArray *live_views(const char *session, GError **error) {
    g_autoptr(Session) opened = session_open(session, SESSION_READ, error);
    g_autoptr(GPtrArray) planned = opened != NULL ? session_views(opened, error) : NULL;
    if (planned == NULL)
        return NULL;
    GArray *views = g_array_new(FALSE, FALSE, sizeof(struct planned_view));
    for (guint k = 0; k < planned->len; k++) {
        const struct session_direction *direction = planned->pdata[k];
        g_autofree char *path =
            g_strdup_printf("%s/products/btf/view_%04d.exr", session, direction->index);
        const struct planned_view view = {direction->theta_deg, direction->phi_deg,
                                          g_file_test(path, G_FILE_TEST_EXISTS)};
        g_array_append_val(views, view);
    }
    return views;
}

struct Live {
    char *session;
    GThread *thread; /* NULL if no thread is running */
    /* atomic: the thread has finished, so it can be joined without waiting */
    gint done;
    GCancellable *stop;     /* cancelled when the thread must end */
    LivePictures *pictures; /* belongs to the thread while one is running */
    gint64 due_us;          /* time from which pictures may be read again */
    /* Number of views of the BTF in the result that is being computed, or in the last result. 0 if
     * the result is made from pictures. */
    int n_views;
    gboolean more_views;    /* the thread makes eigen-maps of the BTF, not of pictures */
    struct eigenmaps *maps; /* the result of the thread, or NULL */
    GError *error;
    char *text;      /* result of live_text(); becomes new_text when the thread has finished */
    char *new_text;  /* NULL if there is none */
    GArray *has;     /* of gboolean: live_pictures_has_view() of each view */
    GArray *new_has; /* NULL if there is none */
};

Live *live_new(const char *session) {
    Live *live = g_new0(Live, 1);
    live->session = g_strdup(session);
    live->stop = g_cancellable_new();
    live->pictures = live_pictures_new(session);
    return live;
}

void live_free(Live *live) {
    if (live == NULL)
        return;
    g_cancellable_cancel(live->stop);
    if (live->thread != NULL)
        g_thread_join(live->thread);
    eigenmaps_free(live->maps);
    g_clear_error(&live->error);
    live_pictures_free(live->pictures);
    g_object_unref(live->stop);
    g_clear_pointer(&live->has, g_array_unref);
    g_clear_pointer(&live->new_has, g_array_unref);
    g_free(live->text);
    g_free(live->new_text);
    g_free(live->session);
    g_free(live);
}

static gboolean go_on(double share, gpointer data) {
    Live *live = data;
    return !g_cancellable_is_cancelled(live->stop);
}

static int count_marked(const GArray *has) {
    int n = 0;
    for (guint k = 0; has != NULL && k < has->len; k++)
        n += g_array_index(has, gboolean, k);
    return n;
}

/* Reads the pictures. Makes eigen-maps of them, unless the BTF has at least as many views as are
 * half captured (live.h). If the pictures cannot be read, makes no eigen-maps and reports no error,
 * because a session may have no lamps. */
static void read_pictures(Live *live) {
    g_autoptr(GError) unread = NULL;
    if (!live_pictures_read(live->pictures, live->stop, &unread)) {
        if (unread != NULL)
            g_debug("the pictures of %s are not shown: %s", live->session, unread->message);
        return;
    }
    live->new_text = live_pictures_text(live->pictures);
    live->new_has = g_array_new(FALSE, FALSE, sizeof(gboolean));
    for (int view = 0; view < live_pictures_n_views(live->pictures); view++) {
        const gboolean has = live_pictures_has_view(live->pictures, view);
        g_array_append_val(live->new_has, has);
    }
    if (live->n_views > 0 && count_marked(live->new_has) <= live->n_views)
        return;
    live->n_views = 0;
    live->maps = live_pictures_eigenmaps(live->pictures, live->stop, &live->error);
}

static gpointer work(gpointer data) {
    Live *live = data;
    exr_watch(go_on, live);
    if (live->more_views)
        live->maps = live_eigenmaps(live->session, &live->n_views, &live->error);
    else
        read_pictures(live);
    exr_watch(NULL, NULL);
    g_atomic_int_set(&live->done, TRUE);
    return NULL;
}

struct eigenmaps *live_poll(Live *live, int *ret_n_views, GError **error) {
    if (live->thread != NULL && !g_atomic_int_get(&live->done))
        return NULL;
    if (live->thread != NULL) {
        g_thread_join(g_steal_pointer(&live->thread));
        live->due_us = g_get_monotonic_time() + PICTURE_S * G_USEC_PER_SEC;
        if (live->new_text != NULL) {
            g_free(live->text);
            live->text = g_steal_pointer(&live->new_text);
        }
        if (live->new_has != NULL) {
            g_clear_pointer(&live->has, g_array_unref);
            live->has = g_steal_pointer(&live->new_has);
        }
        *ret_n_views = live->n_views;
        if (live->error != NULL)
            g_propagate_error(error, g_steal_pointer(&live->error));
        return g_steal_pointer(&live->maps);
    }
    g_autofree char *btf = g_build_filename(live->session, "products", "btf", NULL);
    g_autoptr(GDir) dir = g_dir_open(btf, 0, NULL);
    int n = 0;
    for (const char *name; dir != NULL && (name = g_dir_read_name(dir)) != NULL;)
        n += g_str_has_prefix(name, "view_") && g_str_has_suffix(name, ".exr");
    live->more_views = n > live->n_views && n >= count_marked(live->has);
    if (live->more_views || g_get_monotonic_time() >= live->due_us) {
        live->n_views = live->more_views ? n : live->n_views;
        live->done = FALSE;
        live->thread = g_thread_new("live", work, live);
    }
    return NULL;
}

const char *live_text(const Live *live) {
    return live->text;
}

void live_mark_pictures(const Live *live, GArray *views) {
    for (guint k = 0;
         live->n_views == 0 && live->has != NULL && k < MIN(views->len, live->has->len); k++)
        g_array_index(views, struct planned_view, k).measured =
            g_array_index(live->has, gboolean, k);
}
