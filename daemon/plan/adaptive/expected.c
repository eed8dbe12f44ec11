#include "expected.h"

#include <math.h>

#include "base/data_error.h"
#include "lamps_private.h"

/* Maximum distance of two unit vectors that count as the same direction. */
#define SAME_DIRECTION 1e-4
/* Maximum number of shots between two points of the curve, as a part of the number of shots at the
 * first of them. */
#define MORE 0.5
/* The predictor sums the error over at most PREDICTION_TARGETS pairs of a view and a light. If
 * there are more pairs and nothing is measured, the computed error is too small after many shots.
 * The curve therefore ends after 1 / MAX_OF_MANY of the shots. */
#define MAX_OF_MANY 8

/* An earlier session. lamps contains the reflectances that were measured at its probes. */
struct earlier {
    Session *session;
    struct session_conf conf;
    GPtrArray *shots;
    struct calibration *calibration;
    Clock *clock;
    Readers *readers;
    Lamps *lamps;
};

static void clear_earlier(struct earlier *earlier) {
    readers_free(earlier->readers);
    lamps_dispose(earlier->lamps);
    g_clear_pointer(&earlier->clock, clock_unref);
    calibration_free(earlier->calibration);
    g_clear_pointer(&earlier->shots, g_ptr_array_unref);
    session_conf_clear(&earlier->conf);
    session_close(earlier->session);
}

static gboolean expected_open(struct earlier *earlier, const char *path,
                              const struct rig_timing *timing, GError **error) {
    Session *session = earlier->session = session_open(path, SESSION_READ, error);
    g_autofree char *conf = session ? session_text(session, "session.conf", error) : NULL;
    if (!conf || !session_conf_parse(&earlier->conf, conf, path, error))
        return FALSE;
    g_autofree char *text = session_text(session, "calibration.conf", error);
    if (!text || !(earlier->calibration = calibration_from_text(text, path, error)) ||
        !(earlier->shots = session_shots(session, error)))
        return FALSE;
    earlier->clock = clock_new_real();
    earlier->readers = readers_new(earlier->clock);
    const struct lamps_setup setup = {.session = session,
                                      .conf = &earlier->conf,
                                      .shots = earlier->shots,
                                      .calibration = earlier->calibration,
                                      .nominal = &earlier->calibration->rig,
                                      .timing = timing,
                                      .readers = earlier->readers};
    return (earlier->lamps = lamps_new(&setup, error)) != NULL;
}

static gboolean expected_read(struct earlier *earlier, GError **error) {
    g_autoptr(GPtrArray) frames = session_frames(earlier->session, error);
    if (!frames)
        return FALSE;
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        const struct session_shot *shot = earlier->shots->pdata[frame->shot - 1];
        if (shot->kind == SHOT_LAMP && shot->state == SHOT_DONE)
            lamps_take_shot(earlier->lamps, shot, frame, 1);
    }
    return readers_wait(earlier->readers, error) && lamps_note_done(earlier->lamps, error);
}

/* The directions of an earlier session, followed by the directions of the plan that the session
 * does not have. */
struct joined {
    GArray *directions, *places_mm; /* of struct vec3 */
    int *of;                        /* for each direction of the plan: its index in directions */
};

static struct joined join(const struct vec3 *earlier, const struct vec3 *earlier_mm, int n_earlier,
                          const struct vec3 *planned, const struct vec3 *planned_mm,
                          int n_planned) {
    struct joined ret = {g_array_new(FALSE, FALSE, sizeof(struct vec3)),
                         g_array_new(FALSE, FALSE, sizeof(struct vec3)),
                         g_new0(int, n_planned + 1)};
    g_array_append_vals(ret.directions, earlier, (guint)n_earlier);
    g_array_append_vals(ret.places_mm, earlier_mm, (guint)n_earlier);
    for (int i = 0; i < n_planned; i++) {
        ret.of[i] = -1;
        for (int k = 0; k < n_earlier && ret.of[i] < 0; k++)
            if (vec3_length(vec3_sub(earlier[k], planned[i])) < SAME_DIRECTION)
                ret.of[i] = k;
        if (ret.of[i] >= 0)
            continue;
        ret.of[i] = (int)ret.directions->len;
        g_array_append_val(ret.directions, planned[i]);
        g_array_append_val(ret.places_mm, planned_mm[i]);
    }
    return ret;
}

static void clear_joined(struct joined *joined) {
    g_array_unref(joined->directions);
    g_array_unref(joined->places_mm);
    g_free(joined->of);
}

/* Sets the values of each planned pair. If the earlier session has measured the pair, these are the
 * measured values. Otherwise they are predicted from the other values that it has measured. Fails
 * if the earlier session has no picture under a lamp. */
static gboolean fill(const Lamps *earlier, Lamps *planned, const struct joined *views,
                     const struct joined *lights, const struct work *work, GError **error) {
    const int n_views = (int)views->directions->len, n_lights = (int)lights->directions->len;
    const int rows = 3 * earlier->n_probes, n_pairs = n_views * n_lights;
    const struct prediction_pairs *of_earlier = &earlier->pairs->all;
    const int planned_lights = planned->pairs->all.n_lights;
    int taken;
    g_autofree float *known = lamps_table(earlier, &taken);
    if (taken == 0)
        return data_error_fail(
            session_path(earlier->setup.session), 0, error,
            "the session has no picture under a lamp; name a session that was captured");
    g_autofree float *table = g_new(float, (gsize)rows *(gsize)n_pairs);
    g_autofree int *groups = g_new(int, n_pairs);
    for (int pair = 0; pair < n_pairs; pair++) {
        const int v = pair / n_lights, l = pair % n_lights;
        const gboolean in = v < of_earlier->n_views && l < of_earlier->n_lights;
        const int from = in ? v * of_earlier->n_lights + l : -1;
        groups[pair] = in && of_earlier->groups[from] > 0 ? of_earlier->groups[from] : -1 - pair;
        for (int row = 0; row < rows; row++)
            table[(gsize)row * (gsize)n_pairs + (gsize)pair] =
                in ? known[(gsize)row * (gsize)session_pairs_n(earlier->pairs) + (gsize)from] : NAN;
    }
    const struct prediction_pairs pairs = {
        .n_views = n_views,
        .n_lights = n_lights,
        .views = (const struct vec3 *)(gpointer)views->directions->data,
        .lights = (const struct vec3 *)(gpointer)lights->directions->data,
        .views_mm = (const struct vec3 *)(gpointer)views->places_mm->data,
        .lights_mm = (const struct vec3 *)(gpointer)lights->places_mm->data,
        .groups = groups};
    g_autoptr(Prediction) prediction =
        prediction_new(&pairs, table, earlier->at_mm, earlier->n_probes, work, error);
    if (!prediction)
        return FALSE;
    prediction_fill(prediction, table, earlier->at_mm, earlier->n_probes, NULL);
    planned->n_probes = earlier->n_probes;
    g_free(planned->at_mm);
    planned->at_mm = g_memdup2(earlier->at_mm, sizeof(struct vec3) * (gsize)earlier->n_probes);
    for (int pair = 0; pair < session_pairs_n(planned->pairs); pair++) {
        const int from =
            views->of[pair / planned_lights] * n_lights + lights->of[pair % planned_lights];
        float *values = planned->values[pair] = g_new(float, rows);
        for (int row = 0; row < rows; row++)
            values[row] = table[(gsize)row * (gsize)n_pairs + (gsize)from];
    }
    return TRUE;
}

static gboolean take_like(Lamps *planned, const char *like, const struct rig_timing *timing,
                          const struct work *work, GError **error) {
    struct earlier earlier = {0};
    gboolean ok = expected_open(&earlier, like, timing, error) && expected_read(&earlier, error);
    if (ok) {
        const struct prediction_pairs *from = &earlier.lamps->pairs->all;
        const struct prediction_pairs *to = &planned->pairs->all;
        struct joined views =
            join(from->views, from->views_mm, from->n_views, to->views, to->views_mm, to->n_views);
        struct joined lights = join(from->lights, from->lights_mm, from->n_lights, to->lights,
                                    to->lights_mm, to->n_lights);
        ok = fill(earlier.lamps, planned, &views, &lights, work, error);
        clear_joined(&views);
        clear_joined(&lights);
    }
    clear_earlier(&earlier);
    return ok;
}

static double time_s(const Lamps *lamps, const int *numbers, int n) {
    const struct lamps_setup *setup = &lamps->setup;
    g_autofree const struct session_shot **list = g_new(const struct session_shot *, n + 1);
    for (int i = 0; i < n; i++)
        list[i] = setup->shots->pdata[numbers[i]];
    return plan_lamps_s(list, n, setup->conf, setup->nominal, setup->timing);
}

/* Chooses rounds as a capture does, but from the values of fill() instead of frames. Ends when the
 * next round would bring the number of shots above `most`. Appends a point of the curve to ret for
 * each round. */
static gboolean expected_rounds(Lamps *lamps, int most, GArray *ret, GError **error) {
    const struct lamps_setup *setup = &lamps->setup;
    const guint n_shots = setup->shots->len;
    g_autofree gboolean *first = g_new0(gboolean, n_shots + 1);
    g_autoptr(GArray) chosen = g_array_new(FALSE, FALSE, sizeof(int));
    const struct rounds none = {0};
    struct expected_point point = {0};
    plan_first_lamps(setup->conf, setup->nominal, setup->timing,
                     (const struct session_shot *const *)setup->shots->pdata, (int)n_shots, first);
    for (int i = 0; i < (int)n_shots; i++)
        if (first[i])
            g_array_append_val(chosen, i);
    while (chosen->len > 0) {
        struct lamps_choice choice;
        for (guint i = 0; i < chosen->len; i++)
            lamps->done[g_array_index(chosen, int, i)] = TRUE;
        point.shots += (int)chosen->len;
        point.time_s += time_s(lamps, (const int *)(gpointer)chosen->data, (int)chosen->len);
        if (!lamps_choose(lamps, &none, &choice, error))
            return FALSE;
        point.error_pct = choice.error_pct;
        g_array_append_val(ret, point);
        g_array_set_size(chosen, 0);
        const int more = MIN((int)choice.shots->len, MAX(1, (int)(MORE * point.shots)));
        if (point.shots + more <= most)
            g_array_append_vals(chosen, choice.shots->data, (guint)more);
        g_array_unref(choice.shots);
    }
    return TRUE;
}

/* Chooses at most `most` shots by a predictor without measurements, and appends points of the curve
 * to ret. */
static gboolean order_unmeasured(Lamps *lamps, int most, GArray *ret, GError **error) {
    const struct work work = {.cancellable = lamps->cancellable};
    g_autoptr(Prediction) prediction =
        prediction_new(&lamps->pairs->all, NULL, NULL, 0, &work, error);
    if (!prediction)
        return FALSE;
    struct lamps_candidates left = lamps_list_candidates(lamps);
    g_autofree struct prediction_choice *choices = g_new(struct prediction_choice, most + 1);
    g_autofree int *chosen = g_new(int, most + 1);
    g_autofree double *errors = g_new(double, most + 1);
    const int n_choices =
        prediction_choose(prediction, left.shots, left.n, NULL, most, choices, &work, error);
    const int n =
        n_choices < 0 ? -1 : lamps_list_chosen(&left, choices, n_choices, most, 0, chosen, errors);
    lamps_clear_candidates(&left);
    for (int k = MIN(n, 8); k > 0; k = k == n ? 0 : MIN(n, (int)((1 + MORE) * k))) {
        const struct expected_point point = {k, time_s(lamps, chosen, k), 100 * errors[k - 1]};
        g_array_append_val(ret, point);
    }
    return n >= 0;
}

GArray *expected_curve(const struct session_conf *conf, const struct rig *rig,
                       const struct rig_timing *timing, const struct plan *plan, const char *like,
                       const struct work *work, GError **error) {
    struct session_conf adaptive = *conf; /* the pointers remain those of the caller */
    g_autoptr(GPtrArray) shots = g_ptr_array_new(), views = g_ptr_array_new();
    g_autoptr(GPtrArray) lights = g_ptr_array_new();
    g_autoptr(Calibration) nominal = calibration_new(rig);
    int n = 0;
    adaptive.light_sampling = SAMPLING_ADAPTIVE;
    adaptive.light_error_pct = adaptive.light_budget_min = 0;
    for (int i = 0; i < plan->session.n_shots; i++) {
        g_ptr_array_add(shots, (gpointer)&plan->session.shots[i]);
        n += plan->session.shots[i].kind == SHOT_LAMP &&
             plan->session.shots[i].state == SHOT_PLANNED;
    }
    for (int i = 0; i < plan->session.n_views; i++)
        g_ptr_array_add(views, (gpointer)&plan->session.views[i]);
    for (int i = 0; i < plan->session.n_lights; i++)
        g_ptr_array_add(lights, (gpointer)&plan->session.lights[i]);
    if (n < 2 || views->len < 2) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INCOMPLETE,
                    "%s: nothing can be predicted for this session: it has %d views and %d shots "
                    "of lamps, and at least 2 of each are needed; give more directions",
                    conf->path, plan->session.n_views, n);
        return NULL;
    }
    const struct lamps_setup setup = {.conf = &adaptive,
                                      .shots = shots,
                                      .calibration = nominal,
                                      .nominal = rig,
                                      .timing = timing};
    Lamps *lamps = lamps_make(&setup, views, lights);
    GArray *ret = g_array_new(FALSE, FALSE, sizeof(struct expected_point));
    const gboolean many = session_pairs_n(lamps->pairs) > PREDICTION_TARGETS;
    const int most_unmeasured = MAX(1, many ? n / MAX_OF_MANY : n / 2);
    const gboolean ok = like ? take_like(lamps, like, timing, work, error) &&
                                   expected_rounds(lamps, n / 2, ret, error)
                             : order_unmeasured(lamps, most_unmeasured, ret, error);
    if (!ok)
        g_clear_pointer(&ret, g_array_unref);
    lamps_dispose(lamps);
    return ret;
}
