/*
 * Compares a capture that ends its laser sweeps when the surface is known ([lasers] stop = covered)
 * with a capture of all sweeps of the same material: its time, and the errors of its MDF. Measures
 * sessions that tests/bench/fast_materials has captured; the truth is the simulated world's.
 *
 * Laser time: the sum over all sweeps of the time from the end of the previous shot to the end of
 * the sweep. It includes moves and homing between rounds. Coverage: the share of the texels of all
 * views that have a distance, first counting only distances measured by the view itself, then also
 * distances predicted from other views. RMS: of the final distances against the truth, in texels,
 * away from depth edges. wrong: share of all distances that are off by more than a texel.
 *
 * --replay: instead of a session captured with stop = covered, that with all sweeps, of which the
 * rounds choose as they would in a capture (line_mm aside). Its laser time is that of as many of
 * the sweeps.
 */
#include "bench.h"

#include <math.h>
#include <string.h>

#include "base/work.h"
#include "mdf/mdf_views.h"
#include "pipeline/catalogue.h"
#include "pipeline/mdf_product.h"
#include "plan/adaptive/sweeps.h"
#include "world/truth.h"

enum { ALL, COVERED, WAYS };
static const char *const ways[WAYS] = {"all", "covered"};

struct measured {
    double laser_s, session_s;
    int sweeps, left_out, rounds;
    double coverage, known, rms, wrong;
};

struct scene {
    World *world;
    struct catalogue *catalogue;
    struct mdf_result **results;
    int n_texels, n_views;
    gboolean *taken; /* of each shot: the rounds have chosen it; NULL: all are taken */
    float **truth;   /* of each view */
    guint8 **edges;
};

static gboolean replay;
static int every = 1;
static const GOptionEntry entries[] = {
    {"every", 0, 0, G_OPTION_ARG_INT, &every,
     "Measure every so manieth view alone, by what it saw itself; default 1: all, and settled",
     "N"},
    {"replay", 0, 0, G_OPTION_ARG_NONE, &replay,
     "Replay the rounds with the session that has all sweeps", NULL},
    {NULL},
};

static void fast_make_view(int block, gpointer data) {
    struct scene *scene = data;
    const int view = block * every;
    g_autoptr(GError) error = NULL;
    struct mdf_job *job = NULL;
    if (catalogue_mdf(scene->catalogue, view, &job) != CATALOGUE_READY)
        bench_fail(1, "view %d has no sweeps, or its session is not finished", view);
    for (guint i = job->sweeps->len; scene->taken && i > 0; i--) {
        struct mdf_input *sweep = &g_array_index(job->sweeps, struct mdf_input, i - 1);
        if (scene->taken[sweep->input.shot - 1])
            continue;
        input_clear(&sweep->input);
        g_array_remove_index(job->sweeps, i - 1);
    }
    scene->results[view] = mdf_make_view(job, &scene->catalogue->grid, NULL, &error);
    bench_check(error);
    mdf_job_free(job);
}

static void fast_ignore(gpointer data) {
}

/* Times of the sweeps, and how many of them were left out. */
static void fast_count(Session *session, struct measured *ret) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GPtrArray) shots = session_shots(session, &error);
    bench_check(error);
    g_autoptr(GPtrArray) frames = session_frames(session, &error);
    bench_check(error);
    g_autofree double *end_s = g_new0(double, shots->len + 1);
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        end_s[frame->shot - 1] = MAX(end_s[frame->shot - 1], frame->captured_s);
    }
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        double before_s = 0; /* in order of time: a further round begins in the list's middle */
        ret->session_s = MAX(ret->session_s, end_s[i]);
        if (shot->kind != SHOT_SWEEP)
            continue;
        ret->sweeps += shot->state == SHOT_DONE;
        ret->left_out += shot->state == SHOT_SKIPPED;
        for (guint k = 0; k < shots->len && shot->state == SHOT_DONE; k++)
            if (end_s[k] < end_s[i])
                before_s = MAX(before_s, end_s[k]);
        ret->laser_s += shot->state == SHOT_DONE ? end_s[i] - before_s : 0;
    }
    g_autoptr(GHashTable) rounds = session_values(session, "lasers.round.", &error);
    bench_check(error);
    ret->rounds = MAX(1, (int)g_hash_table_size(rounds) - 1); /* the last one is empty */
}

static void fast_compare(const struct scene *scene, struct measured *ret) {
    const double texel_mm = scene->catalogue->grid.width_mm / scene->catalogue->grid.width;
    double squares = 0;
    gint64 n = 0, known = 0, wrong = 0, all = 0;
    double predicted;
    ret->coverage = mdf_coverage(scene->results, (int)scene->catalogue->views->len, scene->n_texels,
                                 &predicted);
    ret->known = ret->coverage + predicted;
    for (guint v = 0; v < scene->catalogue->views->len; v += (guint)every)
        for (int i = 0; i < scene->n_texels; i++, all++) {
            const float mm = scene->results[v]->planes[0][i], truth = scene->truth[v][i];
            if (mm < 0 || truth < 0)
                continue;
            const double error = (double)(mm - truth) / texel_mm;
            known++;
            wrong += fabs(error) > 1;
            if (scene->edges[v][i])
                continue;
            squares += error * error;
            n++;
        }
    ret->rms = sqrt(squares / (double)MAX(n, 1));
    ret->wrong = (double)wrong / (double)MAX(known, 1);
}

/* Takes a shot's frames, as if it had just been captured. */
static void fast_take(Sweeps *sweeps, struct session_shot *shot, const GPtrArray *frames) {
    shot->state = SHOT_DONE;
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        if (frame->shot == shot->id)
            sweeps_take(sweeps, shot, frame, 1);
    }
}

static void fast_replay(struct scene *scene, Session *session, struct measured *ret) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GPtrArray) shots = session_shots(session, &error);
    g_autoptr(GPtrArray) frames = session_frames(session, &error);
    g_autofree char *text = session_text(session, "session.conf", &error);
    g_auto(SessionConf) conf = {0};
    bench_check(error);
    session_conf_parse(&conf, text, "session.conf", &error);
    bench_check(error);
    conf.laser_stop = STOP_COVERED;
    Clock *clock = clock_new_virtual();
    Readers *readers = readers_new(clock);
    Sweeps *sweeps = sweeps_new(session, &conf, shots, &scene->catalogue->rig, readers);
    const int n = (int)shots->len, before = ret->sweeps;
    g_autofree gboolean *first = g_new0(gboolean, n);
    scene->taken = g_new0(gboolean, n);
    for (int i = 0; i < n; i++)
        ((struct session_shot *)shots->pdata[i])->state = SHOT_PLANNED;
    plan_first_sweeps(&conf, &scene->catalogue->rig,
                      (const struct session_shot *const *)shots->pdata, n, first);
    ret->rounds = ret->sweeps = 0;
    g_autoptr(GArray) round = g_array_new(FALSE, FALSE, sizeof(int));
    for (int i = 0; i < n; i++)
        if (first[i] && ((struct session_shot *)shots->pdata[i])->kind == SHOT_SWEEP)
            g_array_append_val(round, i);
    while (round->len > 0) {
        ret->rounds++;
        for (guint i = 0; i < round->len; i++) {
            const int number = g_array_index(round, int, i);
            scene->taken[number] = TRUE;
            ret->sweeps++;
            fast_take(sweeps, shots->pdata[number], frames);
        }
        if (!readers_wait(readers, &error))
            bench_check(error);
        sweeps_note_done(sweeps);
        const struct sweeps_choice choice = sweeps_choose(sweeps);
        g_array_unref(round);
        round = choice.shots;
    }
    ret->laser_s *= (double)ret->sweeps / before;
    ret->left_out = before - ret->sweeps;
    readers_free(readers);
    sweeps_free(sweeps);
    clock_unref(clock);
}

static void fast_measure(struct scene *scene, const char *directory, gboolean covered,
                         struct measured *ret) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(directory, SESSION_READ, &error);
    bench_check(error);
    *ret = (struct measured){0};
    fast_count(session, ret);
    scene->catalogue = catalogue_load(session, NULL, &error);
    bench_check(error);
    const struct session_grid *grid = &scene->catalogue->grid;
    const int n = (int)scene->catalogue->views->len;
    if (covered && replay)
        fast_replay(scene, session, ret);
    scene->n_texels = grid->width * grid->height;
    scene->n_views = n;
    scene->results = g_new0(struct mdf_result *, n);
    work_for_each(0, (n + every - 1) / every, fast_make_view, scene);
    if (every == 1)
        mdf_settle(scene->results, n, grid, NULL, fast_ignore, NULL);
    if (!scene->truth) {
        const struct truth_grid texels = {grid->width, grid->height, grid->width_mm,
                                          grid->height_mm, grid->reference_mm};
        scene->truth = g_new0(float *, n + 1);
        scene->edges = g_new0(guint8 *, n + 1);
        for (int v = 0; v < n; v += every) {
            const struct session_direction *view = scene->catalogue->views->pdata[v];
            scene->truth[v] = g_new(float, scene->n_texels);
            scene->edges[v] = g_new(guint8, scene->n_texels);
            truth_mdf(scene->world, view->device, view->turntable_deg, &texels, scene->truth[v],
                      scene->edges[v]);
        }
    }
    fast_compare(scene, ret);
    for (int v = 0; v < n; v++)
        mdf_result_free(scene->results[v]);
    g_free(scene->results);
    g_clear_pointer(&scene->taken, g_free);
    g_clear_pointer(&scene->catalogue, catalogue_free);
}

static void fast_tell(const char *name, const struct measured measured[WAYS]) {
    const struct measured *all = &measured[ALL], *some = &measured[COVERED];
    bench_begin(name);
    for (int k = 0; k < WAYS; k++) {
        const struct measured *m = &measured[k];
        bench_row(ways[k],
                  "%.1f{laser_s} %.1f{session_s} %d{sweeps} %d{left_out} %d{rounds} %.5f{coverage} "
                  "%.5f{known} %.5f{rms_texels} %.5f{wrong}",
                  m->laser_s, m->session_s, m->sweeps, m->left_out, m->rounds, m->coverage,
                  m->known, m->rms, m->wrong);
    }
    bench_put("%.4f{laser_time_ratio} %.5f{coverage_ratio} %.4f{rms_ratio}",
              some->laser_s / all->laser_s, some->coverage / all->coverage, some->rms / all->rms);
    bench_end();
}

int main(int argc, char **argv) {
    bench_parse(&argc, &argv, entries, "DIR NAME …");
    if (every < 1)
        bench_fail(2, "--every %d: give 1 or more", every);
    if (argc < 3)
        bench_fail(2, "give the folder of fast_materials, and names of materials in it");
    bench_begin(NULL);
    for (int i = 2; i < argc; i++) {
        g_autoptr(GError) error = NULL;
        g_autofree char *path = g_build_filename(argv[1], argv[i], "world.conf", NULL);
        struct scene scene = {.world = world_get(path, &error)};
        struct measured measured[WAYS];
        bench_check(error);
        for (int k = 0; k < WAYS; k++) {
            g_autofree char *session =
                g_strdup_printf("%s/%s/%s.session", argv[1], argv[i], ways[replay ? ALL : k]);
            fast_measure(&scene, session, k == COVERED, &measured[k]);
        }
        for (int v = 0; v < scene.n_views; v++) {
            g_free(scene.truth[v]);
            g_free(scene.edges[v]);
        }
        g_free(scene.truth);
        g_free(scene.edges);
        world_unref(scene.world);
        fast_tell(argv[i], measured);
    }
    bench_end();
    return 0;
}
