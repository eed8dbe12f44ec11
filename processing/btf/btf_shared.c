/* In each round, every rank reads one view and then distributes its texels to all ranks. Each file
 * is read once, and each rank keeps [own texels][view][light][colour]. */
#include <string.h>

#include "btf_matrix_private.h"

#include "base/data_error.h"
#include "session/session.h"

#define COLOURS 3

struct btf_shared {
    const struct team *team;
    struct btf_matrix *btf;
    const GPtrArray *paths;
    int first, end; /* this rank has the texels first … end − 1 */
    gsize *starts;  /* n_ranks + 1: first value of each rank within a view */
    float *mine;    /* this rank's values of one view */
    int n_threads;  /* threads that decode a view */
};

/* Returns TRUE on all ranks if ok is TRUE on all ranks, otherwise FALSE on all ranks, with an
 * error. */
static gboolean all_ok(const struct team *team, gboolean ok, GError **error) {
    double failed = !ok;
    team->sum_doubles(team, &failed, 1);
    if (ok && failed > 0)
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "another of the %d processes could not read its part of the BTF; see the error "
                    "message of that process",
                    team->n_ranks);
    return failed == 0;
}

/* Reads one round: rank r reads view from + r, then the ranks distribute their views in turn.
 * buffer has the size of a view. */
static gboolean read_round(struct btf_shared *shared, int from, float *buffer, GError **error) {
    struct btf_matrix *btf = shared->btf;
    const struct team *team = shared->team;
    const int view = from + team->rank;
    gboolean ok = TRUE;
    if ((gsize)view < btf->layout.views.n) {
        const char *path = g_ptr_array_index(shared->paths, (guint)view);
        ok = session_check_product(path, error) &&
             btf_read_rows(btf, view, path, shared->n_threads, buffer,
                           btf->layout.lights.n * COLOURS, error);
    }
    if (!all_ok(team, ok, error))
        return FALSE;
    /* Each rank gets the rows of its own texels. */
    const gsize n = btf->layout.lights.n * COLOURS, row = n * btf->layout.views.n;
    for (int root = 0; root < MIN(team->n_ranks, (int)btf->layout.views.n - from); root++) {
        team->deal(team, root, buffer, shared->starts, shared->mine);
        for (gsize i = 0; i < (gsize)(shared->end - shared->first); i++)
            memcpy(btf->values + i * row + (gsize)(from + root) * n, shared->mine + i * n,
                   sizeof(float) * n);
    }
    return TRUE;
}

/* Divides the texels among the ranks and allocates this rank's share. */
static gboolean take_part(struct btf_shared *shared, GError **error) {
    struct btf_matrix *btf = shared->btf;
    const gsize n = btf->layout.lights.n * COLOURS;
    shared->starts = g_new0(gsize, shared->team->n_ranks + 1);
    for (int rank = 0; rank < shared->team->n_ranks; rank++) {
        int first, end;
        team_part(shared->team, rank, btf_layout_texels(&btf->layout), TEAM_ROWS, &first, &end);
        shared->starts[rank + 1] = (gsize)end * n;
    }
    team_part(shared->team, shared->team->rank, btf_layout_texels(&btf->layout), TEAM_ROWS,
              &shared->first, &shared->end);
    const gsize mine = (gsize)(shared->end - shared->first);
    shared->mine = g_new(float, mine *n + 1);
    btf->values = g_try_new0(float, mine *n * btf->layout.views.n + 1);
    if (!btf->values)
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "%s: the memory for this process's %zu texels was refused; use processes on "
                    "more computers",
                    btf->directory, mine);
    return btf->values != NULL;
}

/* Gives all ranks the directions and counts of all views. Each rank has the directions of the views
 * that it read, and 0 for other views, and it has counted only the texels of its own views.
 * Therefore sums over all ranks are the results. */
static void share_directions(const struct btf_shared *shared) {
    struct btf_matrix *btf = shared->btf;
    double counts[] = {(double)btf->holes, (double)btf->bounds, (double)btf->shorter,
                       (double)btf->predicted};
    shared->team->sum_floats(shared->team, btf->layout.views.theta_deg, btf->layout.views.n);
    shared->team->sum_floats(shared->team, btf->layout.views.phi_deg, btf->layout.views.n);
    shared->team->sum_doubles(shared->team, counts, G_N_ELEMENTS(counts));
    btf->holes = (gint64)counts[0];
    btf->bounds = (gint64)counts[1];
    btf->shorter = (gint64)counts[2];
    btf->predicted = (gint64)counts[3];
}

static gboolean btf_shared_read(struct btf_shared *shared, const struct work *work,
                                GError **error) {
    struct btf_matrix *btf = shared->btf;
    const gint64 begun_us = g_get_monotonic_time();
    const int step = shared->team->n_ranks;
    const char *path = g_ptr_array_index(shared->paths, 0);
    struct exr_file *first = exr_read_headers(path, error);
    const gboolean ok =
        first && btf_take_lights(btf, first, path, error) && take_part(shared, error);
    exr_file_free(first);
    if (!all_ok(shared->team, ok, error))
        return FALSE;
    g_autofree float *buffer =
        g_new(float, btf_layout_texels(&btf->layout) * btf->layout.lights.n * COLOURS);
    for (gsize view = 0; view < btf->layout.views.n; view += step) {
        if (!read_round(shared, view, buffer, error))
            return FALSE;
        const int done = MIN(view + step, btf->layout.views.n);
        work_tell(work, "read", done, btf->layout.views.n, begun_us, NULL);
    }
    share_directions(shared);
    return TRUE;
}

struct btf_matrix *btf_matrix_read_shared(const struct team *team, const char *path,
                                          const struct work *work, GError **error) {
    g_autoptr(GPtrArray) paths = NULL;
    struct btf_shared shared = {team, btf_open(path, FALSE, work, &paths, error)};
    shared.paths = paths;
    shared.n_threads = work ? work->n_threads : 0;
    if (!all_ok(team, shared.btf != NULL, error) || !shared.btf ||
        !btf_shared_read(&shared, work, error))
        g_clear_pointer(&shared.btf, btf_matrix_free);
    g_free(shared.starts);
    g_free(shared.mine);
    return shared.btf;
}
