#include "lamps_private.h"

#include <gio/gio.h>
#include <math.h>

#include "frames/rectify.h"
#include "session/inputs.h"
#include "session/outputs.h"

#define RAD(deg)   ((deg) * (G_PI / 180))
#define MAX_PROBES 256
/* maximum number of shots of a further round, relative to the number of shots of all earlier
 * rounds */
#define GROWTH 1.0
/* Maximum number of shots that are considered, both as single candidates and as first shots of
 * chains. */
#define MAX_SINGLE 600

struct lamps_job { /* a frame to be read */
    const Lamps *lamps;
    int pair, camera, lamp;
    double turntable_rad, arc_rad;
    struct input input;
};

static void free_job(gpointer data) {
    struct lamps_job *job = data;
    input_clear(&job->input);
    g_free(job);
}

/* Converts the radiance L of each probe to the reflectance ρ = π L / E, as in the BTF (btf/btf.h),
 * with the irradiance E that the lamp has at its calibrated output. Holes become NAN. */
static void to_reflectance(const struct lamps_job *job, const struct rig *rig, const guint8 *holes,
                           float *values) {
    const Lamps *lamps = job->lamps;
    const struct calibration *calibration = lamps->setup.calibration;
    const struct session_grid *grid = &lamps->setup.conf->grid;
    const struct radiometry_lamp *lamp = &calibration->lamp_radiometry[job->lamp];
    for (int i = 0; i < lamps->n_probes; i++) {
        const int row = lamps->texels[i] / grid->width, column = lamps->texels[i] % grid->width;
        const struct vec3 p = rectify_point_mm(grid, column + 0.5, row + 0.5);
        const double irradiance = rig_lamp_irradiance(
            &rig->arc, &rig->lamps[job->lamp], job->arc_rad, rig_turn(p, job->turntable_rad));
        for (int c = 0; c < 3; c++) {
            const double scale = G_PI / (irradiance * (lamp->known ? lamp->colour[c] : 1));
            values[3 * i + c] =
                holes[i] || !(irradiance > 0) ? NAN : (float)((double)values[3 * i + c] * scale);
        }
    }
}

/* Reads a frame and sets the values of its pair. Runs in a thread of the readers. The frame of a
 * camera that does not see the whole sample is not used. */
static gboolean lamps_read(gpointer data, GError **error) {
    static const char *const any[] = {NULL};
    struct lamps_job *job = data;
    const Lamps *lamps = job->lamps;
    const struct calibration *calibration = lamps->setup.calibration;
    const char *cfa;
    g_autoptr(ExrPart) frame = input_read(&job->input, any, error);
    const float *mosaic = frame ? input_mosaic(job->input.path, frame, &cfa, error) : NULL;
    if (!mosaic)
        return FALSE;
    g_autofree float *values = g_new(float, 3 * lamps->n_probes);
    g_autofree guint8 *holes = g_new(guint8, lamps->n_probes);
    g_autofree struct rig *rig = g_new(struct rig, 1);
    rig_at(&calibration->rig, job->turntable_rad, rig);
    g_autoptr(Rectify) rectify = rectify_new_at(
        &rig->cameras[job->camera], &calibration->camera_radiometry[job->camera], cfa,
        job->turntable_rad, &lamps->setup.conf->grid, lamps->texels, lamps->n_probes, NULL);
    if (!rectify)
        return TRUE;
    rectify_apply(rectify, mosaic, values, holes);
    to_reflectance(job, rig, holes, values);
    g_free(lamps->values[job->pair]);
    lamps->values[job->pair] = g_steal_pointer(&values);
    return TRUE;
}

void lamps_take_shot(Lamps *lamps, const struct session_shot *shot,
                     const struct session_frame *frames, int n) {
    for (int i = 0; i < n; i++) {
        const int pair = session_pairs_of(lamps->pairs, shot, frames[i].camera);
        if (pair < 0)
            continue;
        const struct rig_camera *camera = &lamps->setup.calibration->rig.cameras[frames[i].camera];
        struct lamps_job *job = g_new0(struct lamps_job, 1);
        *job =
            (struct lamps_job){.lamps = lamps,
                               .pair = pair,
                               .camera = frames[i].camera,
                               .lamp = shot->device,
                               .turntable_rad = RAD(session_frame_turntable_deg(&frames[i], shot)),
                               .arc_rad = RAD(shot->arc_deg),
                               .input = {.path = session_file(lamps->setup.session, frames[i].path),
                                         .sha256 = g_strdup(frames[i].sha256),
                                         .shot = shot->id,
                                         .width = camera->width,
                                         .height = camera->height}};
        readers_push(lamps->setup.readers, lamps_read, free_job, job, frames[i].path);
    }
}

gboolean lamps_note_done(Lamps *lamps, GError **error) {
    const GPtrArray *shots = lamps->setup.shots;
    struct outputs *outputs = outputs_load(lamps->setup.session, shots, error);
    if (!outputs)
        return FALSE;
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        lamps->done[i] = shot->kind == SHOT_LAMP && shot->state == SHOT_DONE;
        lamps->output[i] =
            lamps->done[i] && lamps->setup.calibration->lamp_radiometry[shot->device].known
                ? outputs_of(outputs, shot->id)
                : 1;
    }
    outputs_free(outputs);
    return TRUE;
}

static gboolean is_taken(const Lamps *lamps, int pair) {
    const int shot = lamps->pairs->all.groups[pair];
    return lamps->values[pair] && shot > 0 && lamps->done[shot - 1];
}

float *lamps_table(const Lamps *lamps, int *ret_taken) {
    const int n_pairs = session_pairs_n(lamps->pairs), rows = 3 * lamps->n_probes;
    float *table = g_new(float, (gsize)n_pairs *(gsize)rows);
    int n = 0, k = 0;
    for (int pair = 0; pair < n_pairs; pair++)
        n += is_taken(lamps, pair);
    for (int pair = 0; pair < n_pairs; pair++) {
        const gboolean taken = is_taken(lamps, pair);
        const gboolean given = taken && prediction_uses(k, n);
        k += taken;
        for (int row = 0; row < rows; row++)
            table[(gsize)row * (gsize)n_pairs + (gsize)pair] =
                given ? (float)((double)lamps->values[pair][row] /
                                lamps->output[lamps->pairs->all.groups[pair] - 1])
                      : NAN;
    }
    *ret_taken = n;
    return table;
}

/* Returns the maximum k for which the first k of the n chosen shots fit into [lights] budget_min,
 * after the time of the earlier rounds. Returns n if there is no budget. */
static int within_budget(const Lamps *lamps, const struct rounds *rounds, const int *chosen,
                         int n) {
    const struct lamps_setup *setup = &lamps->setup;
    const struct session_conf *conf = setup->conf;
    const guint n_shots = setup->shots->len;
    g_autofree const struct session_shot **list = g_new(const struct session_shot *, n_shots + 1);
    double left_s = 60 * conf->light_budget_min;
    if (left_s <= 0)
        return n;
    for (int round = 1; round <= rounds->n; round++) {
        int taken = 0;
        for (guint i = 0; i < n_shots; i++)
            if (rounds->of[i] == round)
                list[taken++] = setup->shots->pdata[i];
        left_s -= plan_lamps_s(list, taken, conf, setup->nominal, setup->timing);
    }
    int least = 0, most = n + 1;
    while (most - least > 1) {
        const int middle = (least + most) / 2;
        for (int i = 0; i < middle; i++)
            list[i] = setup->shots->pdata[chosen[i]];
        if (plan_lamps_s(list, middle, conf, setup->nominal, setup->timing) <= left_s)
            least = middle;
        else
            most = middle;
    }
    return least;
}

void lamps_clear_candidates(struct lamps_candidates *c) {
    g_array_unref(c->numbers);
    g_free(c->shots);
    g_free(c->chains);
    g_free(c->pairs);
}

/* Adds a chain of shots as a candidate, with the pairs of a view and a light that its shots
 * show. */
static void add_candidate(const Lamps *lamps, struct lamps_candidates *c, const int *chain,
                          int length, double price_s) {
    struct prediction_shot *one = &c->shots[c->n];
    *one = (struct prediction_shot){.pairs = c->pairs + c->n_pairs, .price_s = MAX(price_s, 1e-3)};
    for (int k = 0; k < CHAIN; k++) {
        c->chains[c->n][k] = k < length ? chain[k] : -1;
        const int number = k < length ? g_array_index(c->numbers, int, chain[k]) : -1;
        for (int camera = 0; number >= 0 && camera < lamps->setup.calibration->rig.n_cameras;
             camera++) {
            const int pair =
                session_pairs_of(lamps->pairs, lamps->setup.shots->pdata[number], camera);
            if (pair >= 0)
                c->pairs[c->n_pairs++] = pair;
        }
    }
    one->n_pairs = (int)(c->pairs + c->n_pairs - one->pairs);
    c->n += one->n_pairs > 0;
}

struct lamps_candidates lamps_list_candidates(Lamps *lamps) {
    const struct lamps_setup *setup = &lamps->setup;
    if (!lamps->price_s) {
        lamps->price_s = g_new(double, setup->shots->len + 1);
        plan_lamp_prices_s(setup->conf, setup->nominal, setup->timing,
                           (const struct session_shot *const *)setup->shots->pdata,
                           (int)setup->shots->len, lamps->price_s);
    }
    struct lamps_candidates ret = {.numbers = g_array_new(FALSE, FALSE, sizeof(int))};
    g_autoptr(GPtrArray) left = g_ptr_array_new();
    for (int i = 0; i < (int)setup->shots->len; i++) {
        const struct session_shot *shot = setup->shots->pdata[i];
        if (shot->kind != SHOT_LAMP || shot->state == SHOT_SKIPPED || lamps->done[i])
            continue;
        g_array_append_val(ret.numbers, i);
        g_ptr_array_add(left, (gpointer)shot);
    }
    const int n = (int)left->len, starts = MIN(n, MAX_SINGLE);
    ret.shots = g_new0(struct prediction_shot, 2 * (gsize)starts + 1);
    ret.chains = g_malloc_n(2 * (gsize)starts + 1, sizeof *ret.chains);
    ret.pairs = g_new(int, (2 * starts + 1) * CHAIN * setup->calibration->rig.n_cameras);
    for (int i = 0; i < starts; i++) {
        int chain[CHAIN] = {(int)((gint64)i * n / starts)};
        const double price_s = lamps->price_s[g_array_index(ret.numbers, int, chain[0])];
        double more_s;
        add_candidate(lamps, &ret, chain, 1, price_s);
        const int length = plan_lamp_chain(
            setup->conf, setup->nominal, setup->timing,
            (const struct session_shot *const *)left->pdata, n,
            setup->conf->motion == MOTION_CONTINUOUS ? CHAIN : CHAIN_STANDING, chain, &more_s);
        if (length > 1)
            add_candidate(lamps, &ret, chain, length, price_s + more_s);
    }
    return ret;
}

int lamps_list_chosen(const struct lamps_candidates *left, const struct prediction_choice *choices,
                      int n_choices, int most, double enough, int *ret_shots, double *ret_errors) {
    g_autofree gboolean *in = g_new0(gboolean, left->numbers->len + 1);
    int n = 0;
    for (int i = 0; i < n_choices; i++) {
        for (int k = 0; k < CHAIN && n < most; k++) {
            const int at = left->chains[choices[i].shot][k];
            if (at < 0 || in[at])
                continue;
            in[at] = TRUE;
            ret_errors[n] = choices[i].error_after;
            ret_shots[n++] = g_array_index(left->numbers, int, at);
        }
        if (n == most || choices[i].error_after <= enough)
            break;
    }
    return n;
}

/* Sets the shots of a further round and the expected error after it, or the reason why there is no
 * further round. Returns FALSE with an error if the choice was cancelled. */
static gboolean choose_shots(Lamps *lamps, const struct rounds *rounds,
                             const Prediction *prediction, struct lamps_choice *ret,
                             GError **error) {
    const double enough = lamps->setup.conf->light_error_pct / 100;
    const struct work work = {.cancellable = lamps->cancellable};
    struct lamps_candidates left = lamps_list_candidates(lamps);
    int n_done = 0, n = 0;
    for (guint i = 0; i < lamps->setup.shots->len; i++)
        n_done += lamps->done[i];
    const int most = MIN((int)left.numbers->len, MAX(1, (int)(GROWTH * n_done)));
    g_autofree struct prediction_choice *choices = g_new(struct prediction_choice, most + 1);
    g_autofree int *chosen = g_new(int, most + 1);
    g_autofree double *errors = g_new(double, most + 1);
    ret->end = left.n == 0 ? LAMPS_ALL : ret->error_pct <= 100 * enough ? LAMPS_KNOWN : LAMPS_GO_ON;
    if (ret->end == LAMPS_GO_ON)
        n = prediction_choose(prediction, left.shots, left.n, NULL, most, choices, &work, error);
    if (n > 0) {
        n = lamps_list_chosen(&left, choices, n, most, enough, chosen, errors);
        n = within_budget(lamps, rounds, chosen, n);
        ret->end = n > 0 ? LAMPS_GO_ON : LAMPS_BUDGET;
        ret->after_pct = n > 0 ? 100 * errors[n - 1] : ret->after_pct;
        g_array_append_vals(ret->shots, chosen, (guint)n);
    }
    lamps_clear_candidates(&left);
    return n >= 0;
}

gboolean lamps_choose(Lamps *lamps, const struct rounds *rounds, struct lamps_choice *ret,
                      GError **error) {
    const struct work work = {.cancellable = lamps->cancellable};
    *ret = (struct lamps_choice){.n_pictures = session_pairs_n(lamps->pairs)};
    g_autofree float *table = lamps_table(lamps, &ret->n_taken);
    g_autoptr(Prediction) prediction =
        prediction_new(&lamps->pairs->all, table, lamps->at_mm, lamps->n_probes, &work, error);
    if (!prediction)
        return FALSE;
    ret->shots = g_array_new(FALSE, FALSE, sizeof(int));
    ret->error_pct = ret->after_pct = 100 * prediction_error(prediction);
    if (choose_shots(lamps, rounds, prediction, ret, error))
        return TRUE;
    g_clear_pointer(&ret->shots, g_array_unref);
    return FALSE;
}

/* Spreads the probes over the grid by the additive recurrence of the plastic number (Roberts 2018),
 * so that they sample all phases of a periodic structure. */
static void spread_probes(Lamps *lamps) {
    const struct session_grid *grid = &lamps->setup.conf->grid;
    const int n = grid->width * grid->height;
    lamps->n_probes = MIN(n, MAX_PROBES);
    lamps->texels = g_new(int, lamps->n_probes);
    lamps->at_mm = g_new(struct vec3, lamps->n_probes);
    for (int i = 0; i < lamps->n_probes; i++) {
        const double x = 0.5 + i * 0.7548776662466927, y = 0.5 + i * 0.5698402909980532;
        int column = (int)((x - floor(x)) * grid->width);
        int row = (int)((y - floor(y)) * grid->height);
        if (n <= MAX_PROBES) { /* every texel is a probe */
            column = i % grid->width;
            row = i / grid->width;
        }
        lamps->texels[i] = row * grid->width + column;
        lamps->at_mm[i] = rectify_point_mm(grid, column + 0.5, row + 0.5);
    }
}

Lamps *lamps_make(const struct lamps_setup *setup, const GPtrArray *views,
                  const GPtrArray *lights) {
    const guint n = setup->shots->len;
    Lamps *lamps = g_new0(Lamps, 1);
    lamps->setup = *setup;
    lamps->pairs = session_pairs_new(&setup->calibration->rig, views, lights, setup->shots);
    lamps->values = g_new0(float *, views->len * lights->len + 1);
    lamps->output = g_new(double, n + 1);
    lamps->done = g_new0(gboolean, n + 1);
    lamps->cancellable = g_cancellable_new();
    for (guint i = 0; i < n; i++)
        lamps->output[i] = 1;
    spread_probes(lamps);
    return lamps;
}

Lamps *lamps_new(const struct lamps_setup *setup, GError **error) {
    g_autoptr(GPtrArray) views = session_views(setup->session, error);
    g_autoptr(GPtrArray) lights = views ? session_lights(setup->session, error) : NULL;
    return lights ? lamps_make(setup, views, lights) : NULL;
}

void lamps_stop(Lamps *lamps) {
    g_cancellable_cancel(lamps->cancellable);
}

void lamps_dispose(Lamps *lamps) {
    if (!lamps)
        return;
    for (int i = 0; i < session_pairs_n(lamps->pairs); i++)
        g_free(lamps->values[i]);
    g_free(lamps->values);
    g_free(lamps->texels);
    g_free(lamps->at_mm);
    session_pairs_free(lamps->pairs);
    g_free(lamps->output);
    g_free(lamps->done);
    g_free(lamps->price_s);
    g_object_unref(lamps->cancellable);
    g_free(lamps);
}
