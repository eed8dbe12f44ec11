#include "live.h"

#include "exr/exr.h"
#include "scene/reference.h"
#include "session/session.h"

#define TERMS 4 /* number of terms, as in Wang et al. 2005 §5 */

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
    gint done;       /* atomic: the thread has finished; it can be joined without waiting */
    gint cancelled;  /* atomic: the thread must end */
    int n_views;     /* number of views of the last result, or of the one that is being computed */
    struct eigenmaps *maps; /* the result of the thread, or NULL with an error */
    GError *error;
};

Live *live_new(const char *session) {
    Live *live = g_new0(Live, 1);
    live->session = g_strdup(session);
    return live;
}

void live_free(Live *live) {
    if (live == NULL)
        return;
    g_atomic_int_set(&live->cancelled, TRUE);
    if (live->thread != NULL)
        g_thread_join(live->thread);
    eigenmaps_free(live->maps);
    g_clear_error(&live->error);
    g_free(live->session);
    g_free(live);
}

static gboolean go_on(double share, gpointer data) {
    Live *live = data;
    return !g_atomic_int_get(&live->cancelled);
}

static gpointer work(gpointer data) {
    Live *live = data;
    exr_watch(go_on, live);
    live->maps = live_eigenmaps(live->session, &live->n_views, &live->error);
    exr_watch(NULL, NULL);
    g_atomic_int_set(&live->done, TRUE);
    return NULL;
}

struct eigenmaps *live_poll(Live *live, int *ret_n_views, GError **error) {
    if (live->thread != NULL && !g_atomic_int_get(&live->done))
        return NULL;
    if (live->thread != NULL) {
        g_thread_join(g_steal_pointer(&live->thread));
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
    if (n > live->n_views) {
        live->n_views = n;
        live->done = FALSE;
        live->thread = g_thread_new("live", work, live);
    }
    return NULL;
}
